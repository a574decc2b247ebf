"""What is to be said of an export: whose geometry it has, how good it is, at which temperature, and
of which placement."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

from ...exceptions import sentence_list, write_rounded
from ...measurements.campaign.late_names import list_sources
from ...measurements.campaign.reference_temperature import TEMPERATURE
from ...mechanisms.environment import find_references
from ..arm_alone import list_instrument_names
from ..commands.late_effects import describe_unknown_history
from ..other_sides import describe_other_sides
from ..refitting import list_moves, select_carried

if TYPE_CHECKING:
    from ..calibration import Calibration


def list_notes(c: Calibration, what: str, geometry: bool) -> tuple[str, ...]:
    """List the notes on a file that carries the "geometry", the "table" or the "whole" of a
    calibration, as a `geometry` or as corrections."""
    out = []
    accuracy = describe_accuracy(c, what)
    if accuracy:
        out.append(accuracy)
    if geometry:
        out.append("frame 0 is the robot's base before any registration")
    if geometry or what != "whole":
        origin = _describe_origin(c, what)
        out.append(origin)
    if TEMPERATURE in c.needs():
        temperature = _describe_temperature(c, what)
        out.append(temperature)
        carried = list(filter(select_carried(c.model, what), c.terms))
        out += [sentence.rstrip(".") for sentence in describe_unknown_history(carried)]
    out += describe_instrument(c)
    out += _describe_moves(c, what)
    group = find_group(c)
    if group is not None:
        out.append(f'the placement of the instrument is that of group "{group}"')
    return tuple(out)


def _describe_moves(c: Calibration, what: str) -> tuple[str, ...]:
    """Describe how the instrument and the base moved against each other, which a file does not have;
    nothing where they stood still, or the file has it."""
    moves = list_moves(c.model)
    carries = select_carried(c.model, what)
    left_out = {term.key for term in c.terms if not carries(term)}
    left_out &= moves
    if not left_out:
        return ()
    names = []
    for mechanism in c.model.mechanisms:
        keys = {term.key for term in mechanism.terms}
        if keys & left_out:
            names.append(mechanism.name)
    sentence = (
        f"{sentence_list(names)} says how the instrument and the base moved against each other while the arm was "
        "measured: the file is without it, as it does not belong to the arm"
    )
    return (sentence,)


def describe_instrument(c: Calibration) -> tuple[str, ...]:
    """Describe which errors of the instrument a file does not have, and what may be the arm's or the
    instrument's; nothing where none were found."""
    either = tuple(sentence.rstrip(".") for sentence in describe_other_sides(c))
    names = [name for name in list_instrument_names(c) if name not in c.other_sides]
    if not names:
        return either
    what, them = ("is an error", "it") if len(names) == 1 else ("are errors", "them")
    sentence = (
        f"{sentence_list(names)} {what} of the instrument, not of the arm: the file is without {them}, as "
        "are the measurements that it is compared with"
    )
    return sentence, *either


def find_group(c: Calibration) -> str | None:
    """Find the group whose tracker's frame a file has: the first; None where they have one frame."""
    return c.groups[0] if c.groups_differ() else None


def describe_coupling(c: Calibration) -> tuple[str, ...]:
    """Describe whose angles a file without the coupling has; nothing where no joint is coupled."""
    coupling = c.robot.coupling
    if coupling is None:
        return ()
    sums = []
    for joint, row in enumerate(coupling.matrix.tolist(), 1):
        readings = {f"m{motor}": ratio for motor, ratio in enumerate(row, 1) if ratio}
        if readings != {f"m{joint}": 1.0}:
            sums.append(f"q{joint} = {_describe_sum(readings)}")
    sentence = (
        f"q1 to q{c.robot.n} are the joints' angles, not the motors' readings m1 to m{c.robot.n}: "
        f"{', '.join(sums)}"
    )
    return (sentence,)


def _describe_sum(readings: Mapping[str, float]) -> str:
    """Write a weighted sum, the largest weight first: m3 - m2."""
    text = ""
    for name, ratio in sorted(readings.items(), key=lambda item: -item[1]):
        size = abs(ratio)
        weighted = name if size == 1 else f"{size:.6g} {name}"
        before = "-" if ratio < 0 else "+" if text else ""
        text += f" {before} {weighted}" if text else f"{before}{weighted}"
    return text


def describe_accuracy(c: Calibration, what: str) -> str:
    """Describe how good the file is, beside the whole model and the nominal arm; empty where that
    is not known."""
    if c.refits is None:
        return ""
    found = c.refits.errors(what)
    if found is None:
        return ""
    rows, nominal, own, whole = found
    better = f", the whole model leaves {write_rounded(whole)} mm"
    if what == "whole":
        better = ""
    return f"{rows}, the file leaves {write_rounded(own)} mm rms{better} and the nominal arm {write_rounded(nominal)} mm"


def _describe_origin(c: Calibration, what: str) -> str:
    """Describe where the numbers of a file come from."""
    if what == "whole":
        return "lengths and angles are those of the calibrated geometry"
    if c.refits is None:
        return (
            "the calibration is of an earlier version: these numbers were fitted together with what this form cannot carry, "
            "and without it they may be worse than the nominal arm; run the study again to have them fitted for it"
        )
    if what not in c.refits.alone:
        return (
            "the data do not determine by itself what this form carries: these numbers were fitted together with what it "
            "cannot carry, and without it they may be worse than the nominal arm"
        )
    if c.refits.nominal(what):
        return (
            "the numbers are the nominal ones: fitted without what this form cannot carry, they would not predict better "
            "(cross-validation)"
        )
    return "the numbers were fitted again without what this form cannot carry"


def _describe_temperature(c: Calibration, what: str) -> str:
    """Describe the temperature at which the file holds."""
    keep = select_carried(c.model, what)
    some = [
        t for t in c.terms if any(TEMPERATURE in list_sources(s.cause.names()) for s in t.screws)
    ]
    if (
        all(map(keep, some))
        or c.refits is None
        or c.refits.mean_celsius is None
        or what not in c.refits.alone
    ):
        start = sorted(
            frozenset[float]().union(*(find_references(s.cause) for t in some for s in t.screws))
        )
        where = f"{sentence_list([f'{r:g}' for r in start])} °C"
        return (
            f"thermal effects are counted from {where}"
            if all(map(keep, some))
            else f"the arm is that at {where}"
        )
    warm = f"{c.refits.mean_celsius:.1f} °C, the mean of the campaign"
    return (
        f"the measurements compared were taken at {warm}"
        if c.refits.nominal(what)
        else f"the arm is that at {warm}"
    )
