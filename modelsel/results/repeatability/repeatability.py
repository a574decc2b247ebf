"""What does not repeat, in figures and in words: the parts of what the chosen model leaves, how large
each is, its share at the target, and what else could look like it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import Any

import numpy as np

from ..._part_names import (
    ACROSS_LINE,
    ALONG_AXES,
    ALONG_LINE,
    AT_TARGET,
    INSTRUMENT,
    INSTRUMENT_PARTS,
    is_of_instrument,
    is_of_rows,
    name_rows,
)
from ..._typing import Array
from ...diagnosis.findings.sentences import choose_prefix
from ...exceptions import sentence_list, write_rounded
from ...fitting.error_structure import ErrorPart, ErrorStructure
from ...fitting.noise import Floor
from ...fitting.possible_parts import DIRECTIONS, GIVEN
from ..schemas.schema import ErrorPartRecord
from ..sentences.study_sentences import format_share
from .rounded_readings import Rounding
from .unstated_gears import ask_for_gears

JOINT = "joint"
# mm below which a length is written in µm
MAX_MICROMETRES = 0.1
# ratio of an interval's ends below which two digits would not show it
CLOSE_ENDS = 1.1
# share of a joint's standard deviation below which that of rounding is not told: with nine tenths of
# the variance another cause is to be found
TOLD_SHARE = 1 / 3
# share that rounds to one percent
MIN_SHARE = 0.005
# lines of a terminal
MAX_LINES = 6
# sources of a noise floor
ESTIMATED, REPEATS = "estimated", "repeats"
# parts, by what tells them, that repeats of one posture share
SHARED_BY_REPEATS = {("configuration", "repeats"), ("group", "groups")}
# what is shown of parts whose names say too little, by what tells them
LABELS = {
    ("configuration", "targets"): "targets of one configuration",
    ("configuration", "repeats"): "repeats of one posture",
    ("group", "groups"): "rows of one group",
    ("lasting", "order"): "lasting errors",
    **{(name, DIRECTIONS): f"more noise along {name[-1]}" for name in ALONG_AXES},
    (ALONG_LINE, DIRECTIONS): "more noise along the line of sight",
    (ACROSS_LINE, DIRECTIONS): "more noise across the line of sight",
}

Values = dict[str, Any]

NOT_ROUNDED: Mapping[str, Rounding] = MappingProxyType({})


def measure_unrepeated(errors: ErrorStructure, floor: Floor) -> float:
    """Measure the rms at the target [mm] of the parts that a noise floor does not hold.

    One that was estimated from what is left holds all of them; repeats hold what differs between visits of
    one posture; a stated one, and pairs of targets, the instrument alone."""
    if floor.source == ESTIMATED:
        return 0.0
    parts = errors.parts[1:]
    if floor.source == REPEATS:
        parts = tuple(part for part in parts if (part.name, part.told_by) in SHARED_BY_REPEATS)
    else:
        # the floor is all that the instrument has, in whatever direction and row
        parts = tuple(part for part in parts if not is_of_instrument(part.name))
    squares = [part.at_target**2 for part in parts]
    return float(np.sqrt(sum(squares)))


def describe_errors(
    errors: ErrorStructure,
    rounding: Mapping[str, Rounding] = NOT_ROUNDED,
    unstated_gears: Sequence[str] = (),
) -> list[Values]:
    """Return result.json's `repeatability`: the parts of what is left, the largest share first;
    `rounding`: of the readings of joints, by the names of their parts; `unstated_gears`: the parts of
    which a gear ratio may tell more."""
    parts = sorted(errors.parts, key=lambda part: -part.share)
    scales = {part.name: part.scale for part in parts}
    even = scales.get(INSTRUMENT, 0.0)
    unsure = [part.name for part in parts if is_unsure(part.name, part.told_by)]
    described = []
    for part in parts:
        said = _describe_part(part, len(parts) == 1, even)
        if part.name in unsure[1:]:
            said += f" This is not sure, for the reasons given for {unsure[0]}."
        elif part.name in unsure:
            said += _explain_doubt(part) + ask_for_gears(part, unstated_gears)
        said += _explain_by_rounding(part, rounding.get(part.name))
        values = {
            "part": part.name,
            "scale": part.scale,
            "unit": part.unit,
            "low": part.low,
            "high": part.high,
            "share": part.share,
            "told_by": part.told_by,
            "instead": list(part.instead),
            "sentence": said,
        }
        described.append(values)
    return described


# -- sentences
# --------------------------------------------------------------------------------------------------------------------


def _describe_part(part: ErrorPart, is_alone: bool, even: float) -> str:
    """Return one part in words: how large it is, what it does, and what else would look like it;
    `even`: what the instrument has in all directions and rows [mm]."""
    size = _describe_scale(part)
    moved = f"{round_digits(part.at_target)} mm"
    share = describe_share(part.share)
    effect = f"{moved} at the target, {share} of what is left"
    is_everywhere = part.name == INSTRUMENT
    if is_alone and is_everywhere:
        return _describe_alone(size, moved)
    if part.name in (INSTRUMENT, *INSTRUMENT_PARTS):
        return _describe_instrument(part, size, effect)
    if part.name in ("configuration", "group"):
        return _describe_shared(part, size, effect)
    if part.name == "lasting":
        return _describe_lasting(part, size, effect)
    if is_of_rows(part.name):
        return _describe_louder(part, size, even)
    return f"{part.name.capitalize()} does not repeat better than {size}: {effect}."


def _describe_alone(size: str, moved: str) -> str:
    return (
        f"What is left is independent from row to row, as an instrument's errors are: {size}, "
        f"{moved} at the target. No joint was found that fails to repeat, and no error that rows "
        "share."
    )


def _describe_instrument(part: ErrorPart, size: str, effect: str) -> str:
    """Return what the instrument leaves in all directions, or in one of them beyond that."""
    if part.name in INSTRUMENT_PARTS:
        return _describe_direction(part, size, effect)
    return f"The instrument, and whatever else is independent from row to row, leaves {size}: {effect}."


def _describe_shared(part: ErrorPart, size: str, effect: str) -> str:
    """Return what the targets of one visit, the visits of one posture or the rows of one group have in
    common."""
    if part.name == "group":
        return (
            f"The measurements of one group share an error of {size}: {effect}. It "
            "differs from group to group, as when the instrument is set up again."
        )
    if part.told_by == "repeats":
        return (
            f"Repeated measurements of one posture share an error of {size}: {effect}. "
            "It repeats, so it is an error of the model that no candidate describes, not of the "
            "measurement."
        )
    return (
        f"The targets of one configuration share an error of {size}: {effect}. The "
        "flange or the base stood a little differently each time, or, where no posture was measured "
        "again, the model errs there."
    )


def _describe_direction(part: ErrorPart, size: str, effect: str) -> str:
    """Return where the instrument errs more than in other directions, and what else would look so."""
    where, example = f"Along {part.name[-1]}", "as a camera does in depth"
    if part.name == ALONG_LINE:
        where = "Along the line of sight"
    if part.name == ACROSS_LINE:
        where, example = "Across the line of sight", "as a tracker does by its angles"
    return (
        f"{where} the instrument errs more than in other directions, {example}: by a further {size}, "
        f"independent from row to row: {effect}. An error of the model in that direction, which no "
        "candidate describes, would look the same."
    )


def _describe_louder(part: ErrorPart, size: str, even: float) -> str:
    """Return which target or group is measured with more noise, how much it has, and what else would
    look so."""
    rows = _name_rows(part.name)
    where = _locate_rows(part.name)
    own = float(np.hypot(part.scale, even))
    factor, unit = _choose_unit(own, "mm")
    figure = round_digits(own / factor)
    usual = round_digits(even / factor)
    share = describe_share(part.share)
    first = rows[0].upper()
    rest = rows[1:]
    which = first + rest
    return (
        f"{which} is measured with more noise than others, and weighs less: {figure} {unit} per coordinate "
        f"beside {usual} {unit}. That is a further {size}, independent from row to row: {share} of what is "
        f"left. An error of the model {where}, which no candidate describes, would look the same."
    )


def _name_rows(part: str) -> str:
    """Name the target or group of a part, as in target B."""
    name = name_rows(part)
    if part.startswith(AT_TARGET):
        return f"target {name}"
    return f"group {name}"


def _locate_rows(part: str) -> str:
    """Return where a part is, as at target B."""
    rows = _name_rows(part)
    if part.startswith(AT_TARGET):
        return f"at {rows}"
    return f"in {rows}"


def _describe_lasting(part: ErrorPart, size: str, effect: str) -> str:
    """Return what lasts, and which effects would tell the data about as well."""
    said = (
        f"Errors last from one configuration to the next, {size}, and fade over "
        f"about {part.length:g} configurations: {effect}."
    )
    if not part.instead:
        return said
    return (
        f"{said} The data could hold {sentence_list(part.instead)} instead: a few reference "
        "configurations, measured again throughout the campaign, would tell."
    )


def _explain_doubt(part: ErrorPart) -> str:
    """Say what else would look like a joint that does not repeat, where no repeats tell it."""
    return (
        f" This is not sure: an error of {part.name} that repeats, but that no candidate "
        "describes, would look the same. More postures that are measured again would tell them apart."
    )


def _explain_by_rounding(part: ErrorPart, rounding: Rounding | None) -> str:
    """Say what rounding of its readings leaves of a joint, unless that is little, or more than there is:
    then they were not rounded."""
    if rounding is None or not part.low * TOLD_SHARE < rounding.scale < part.high:
        return ""
    factor, unit = _choose_unit(rounding.scale, part.unit)
    left = f"{round_digits(rounding.scale / factor)} {unit}"
    return (
        f" Its readings are multiples of {rounding.step}; if they were rounded to that, this alone leaves {left}: "
        "record them with more digits."
    )


# -- figures
# --------------------------------------------------------------------------------------------------------------------


def _describe_scale(part: ErrorPart) -> str:
    """Return a standard deviation with its interval: 21 µrad (95 %: 18 to 24 µrad)."""
    scale, interval = format_scale(part)
    each = " per coordinate"
    is_one = part.name in INSTRUMENT_PARTS
    if is_one or part.name.startswith(JOINT):
        each = ""
    if part.told_by == GIVEN:
        return f"{scale}{each} (as the study gives it)"
    return f"{scale}{each} (95 %: {interval})"


def format_scale(part: ErrorPart | ErrorPartRecord) -> tuple[str, str]:
    """Return a standard deviation and its 95 % interval in one unit that reads well."""
    factor, unit = _choose_unit(part.scale, part.unit)
    is_close = part.high < CLOSE_ENDS * part.low
    figures = [
        round_digits(value / factor, 3 if is_close else 2)
        for value in (part.scale, part.low, part.high)
    ]
    interval = (
        f"{figures[1]} to {figures[2]} {unit}" if part.low else f"at most {figures[2]} {unit}"
    )
    return f"{figures[0]} {unit}", interval


def _choose_unit(size: float, unit: str) -> tuple[float, str]:
    """Return (factor, unit) in which a scale [unit] reads well; it is to be divided by the factor."""
    if unit == "mm":
        return (1e-3, "µm") if size < MAX_MICROMETRES else (1.0, "mm")
    return choose_prefix(size, unit)


def round_digits(value: float, digits: int = 2) -> str:
    """Return a figure of so many significant digits, zeros kept."""
    return write_rounded(value, digits)


def describe_share(share: float) -> str:
    """Return a share in percent that is never nought."""
    return format_share(share) if share >= MIN_SHARE else "less than 1 %"


def label_part(part: ErrorPartRecord) -> str:
    """Return what a table calls a part."""
    if is_of_rows(part.part):
        where = _locate_rows(part.part)
        return f"more noise {where}"
    return LABELS.get((part.part, part.told_by), part.part)


def compute_target_rms(parts: Sequence[ErrorPartRecord]) -> Array:
    """Compute (k,) the rms at the target [mm] of all parts, from their shares and the instrument's."""
    instrument = next(part for part in parts if part.part == INSTRUMENT)
    shares = np.array([part.share for part in parts])
    return np.asarray(np.sqrt(3 * shares / instrument.share) * instrument.scale)


# -- a terminal
# --------------------------------------------------------------------------------------------------------------------


def summarise_repeatability(parts: Sequence[ErrorPartRecord]) -> list[str]:
    """Return the largest part in full, and the others with their shares; what may be no error of the
    measurement, too, in full. None where nothing is told; of which joints too few repeats tell."""
    if not parts:
        return []
    first, *others = parts
    sentence = f"Repeatability: {first.sentence}"
    shares = []
    unsure = []
    for part in others:
        if part.instead:
            sentence += f" {part.sentence}"
            continue
        shares.append(f"{label_part(part)} ({describe_share(part.share)})")
        if is_unsure(part.part, part.told_by):
            unsure.append(part.part)
    if shares:
        sentence += f" Other parts of what is left: {sentence_list(shares)}."
    if unsure:
        sentence += f" It takes more postures that are measured again to be sure of {sentence_list(unsure)}."
    return [sentence]


def is_unsure(part: str, told_by: str) -> bool:
    """Return whether a part is a joint's that no repeats tell."""
    known = REPEATS, GIVEN
    is_joint = part.startswith(JOINT)
    is_known = told_by in known
    return is_joint and not is_known


def write_repeatability_lines(parts: Sequence[ErrorPartRecord]) -> list[str]:
    """Return one line a part, the largest share first; of many, how many more there are."""
    shown = list(parts)
    more = []
    if len(parts) > MAX_LINES:
        shown = shown[: MAX_LINES - 1]
        more = [f"{len(parts) - len(shown)} smaller parts are in result.json."]
    sentences = [part.sentence for part in shown] + more
    return [f"Repeatability: {sentence}" for sentence in sentences]
