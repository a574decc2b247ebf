"""The verdict: what is gained, what was named, what is left; of a fit that is hopeless, that first."""

from __future__ import annotations

import re
from collections.abc import Sequence
from math import hypot
from typing import NamedTuple

from ...diagnosis.findings.sentences import format_angle
from ...exceptions import choice_list, sentence_list, write_rounded
from ...fitting.noise import Floor
from ...selection.evaluation import Evaluation
from ...selection.gain import Gain
from ..repeatability.unsure_joints import CLEARLY_MORE, UnsureJoints
from ..runs.map_details import MIN_DISPLACEMENT
from ..schemas.finding_schema import FAULT
from ..sentences.small_findings import MIN_GROUPED, write_number
from .cautions import explain_restriction

SHOWN_NAMES = 6  # in a sentence
FREE_FUNCTION = re.compile(r"free\(([^()]+)\)")  # in a name


class Named(NamedTuple):
    """A finding as the verdict tells it: its name, whether that is proven, whether it matters, whether it is
    doubtful, what else it could be, and which of that is likelier than its name, the likeliest first; whether its
    name is that of a cause, or of a shape that no registered mechanism has."""

    name: str
    is_settled: bool
    matters: bool = True
    doubtful: bool = False
    rivals: tuple[str, ...] = ()
    likelier: tuple[str, ...] = ()
    is_cause: bool = True

    @property
    def is_fault(self) -> bool:
        """Whether it is a fault of the data, and no error of the arm."""
        return self.name.startswith(FAULT)

    @property
    def shown(self) -> str:
        """The name, or the names where its cause is not proven; that it is doubtful."""
        others = [rival for rival in self.rivals if rival not in self.likelier]
        names = [self.name] if self.is_settled else [*self.likelier, self.name, *others]
        text = choice_list(names)
        return f"{text} (doubtful)" if self.doubtful else text


class NamedErrors(NamedTuple):
    """Every finding, and the rms [mm] of those that do not matter, together; `small_rms_mrad`: of
    their turning, where it is told."""

    each: Sequence[Named]
    small_rms_mm: float = 0.0
    small_rms_mrad: float | None = None


class Noise(NamedTuple):
    """The noise floor, and the rms [mm] at the target of what does not repeat and is not in it, and of
    what the chosen model does not know of held-out rows; the joints that it holds without being sure."""

    floor: Floor
    unrepeated_mm: float = 0.0
    model_mm: float = 0.0
    unsure: UnsureJoints = UnsureJoints()


def write_verdict(
    nominal: Evaluation,
    chosen: Evaluation,
    gain: Gain,
    noise: Noise,
    named: NamedErrors,
    candidates: Sequence[str] | str,
    nothing_else: str,
) -> tuple[str, str, str]:
    """Write the verdict in three sentences.

    `named`: every finding in order; `candidates`: the mechanisms that the study lets extend the base, "all" or a
    list; `nothing_else`: what is said of what remains, of which the first sentence is taken."""
    extends = candidates != []
    findings = _describe_named(named, extends) + explain_restriction(candidates)
    remainder = nothing_else.partition(". ")[0].rstrip(".") + "."
    gained = _describe_gain(nominal, chosen, gain, _describe_noise(noise))
    return gained, findings, remainder


def complete_verdict(
    sentences: tuple[str, str, str],
    orientation: tuple[float, float] | None,
    hopeless: str | None,
    registered: str | None = None,
) -> tuple[str, ...]:
    """Add to the three sentences the rms of the orientation error before and after [rad], where it was measured,
    and what was `registered` before, where anything was.

    Where the fit is `hopeless`, the sentence that says so comes first, and none says that nothing else was
    found."""
    gained, named, remainder = sentences
    if registered is not None:
        gained += f" The nominal robot's error is what is left after {registered} were registered."
    gained += _describe_orientation(orientation)
    if hopeless is not None:
        return hopeless, gained, named
    return gained, named, remainder


def _describe_orientation(orientation: tuple[float, float] | None) -> str:
    """Return the orientation's errors in words."""
    if orientation is None:
        return ""
    before, after = orientation
    verb = _change_verb(before, after)
    return (
        f" The orientation error {verb} from {format_angle(before)} to {format_angle(after)} rms."
    )


def _change_verb(before: float, after: float) -> str:
    return "falls" if after < before else "does not fall: it goes"


def _describe_noise(noise: Noise) -> str:
    """Return what noise alone would leave, and, where that is clearly more, with joints that may have an
    error that repeats, with what else the model does not explain and with what it does not know."""
    floor, unsure = noise.floor, noise.unsure
    alone = _rms_length(floor)
    further = [
        (noise.unrepeated_mm, "what else is not explained"),
        (noise.model_mm, "the uncertainty of the model"),
    ]
    if unsure.matter:
        alone = unsure.rest_mm
        further.insert(0, (unsure.rms_mm, unsure.words))
    coordinate = alone / floor.coordinates**0.5
    words = f"noise of {write_rounded(coordinate)} mm per coordinate ({floor.source}) would leave {write_rounded(alone)} mm"
    left = alone
    others = []
    for more_mm, what in further:
        both = hypot(left, more_mm)
        if both >= CLEARLY_MORE * left:
            left = both
            others.append(what)
    if not others:
        return words
    return f"{words}, and with {sentence_list(others)} {write_rounded(left)} mm"


def _describe_gain(nominal: Evaluation, chosen: Evaluation, gain: Gain, noise: str) -> str:
    """Return the position error before and after, against what noise alone would leave."""
    before, after = gain.held_out_rms_before_mm, gain.held_out_rms_after_mm
    if before is None or after is None:
        before = nominal.estimation.rms_mm or 0.0
        after = chosen.estimation.rms_mm or 0.0
        return (
            "Nothing is held out: on the configurations that made the model its position error goes from "
            f"{write_rounded(before)} to {write_rounded(after)} mm rms, which flatters it; {noise}."
        )
    if write_rounded(before) == write_rounded(after):
        return (
            f"On held-out configurations the position error stays at {write_rounded(after)} mm rms; "
            f"{noise}."
        )
    verb = _change_verb(before, after)
    interval = describe_interval(gain.interval_mm)
    return (
        f"On held-out configurations the position error {verb} from {write_rounded(before)} to {write_rounded(after)} mm rms{interval}; "
        f"{noise}."
    )


def describe_interval(interval: Sequence[float] | None) -> str:
    """Return the 95 % interval of a gain [mm], to follow the errors in a sentence."""
    if interval is None:
        return ""
    low, high = interval
    return f", a gain of {write_rounded(low)} to {write_rounded(high)} mm (95 %)"


def _rms_length(floor: Floor) -> float:
    """Return the root mean square length of a row's noise [mm]."""
    return floor.coordinate_mm * float(floor.coordinates**0.5)


def _describe_named(every: NamedErrors, extends: bool) -> str:
    """Return what was named, what was found without a proven cause, what a free function is where one is
    among them, and of small findings their sum."""
    faults = [one for one in every.each if one.is_fault]
    errors = [one for one in every.each if not one.is_fault]
    sentences = _describe_faults(faults)
    if not errors:
        sentences.append("No error beyond the base model was named.")
        return " ".join(sentences)
    small = [one for one in every.each if not one.matters]
    is_grouped = len(small) >= MIN_GROUPED
    told = [one for one in errors if one.matters or not is_grouped]
    settled = [one for one in told if one.is_settled]
    unsettled = [one for one in told if not one.is_settled]
    sentences += [*_describe_settled(settled), *_describe_unsettled(unsettled, bool(settled))]
    sentences += _explain_free_function(" ".join(sentences))
    if is_grouped and len(told) < len(errors):
        among = _count_small_faults(small)
        alone = "small findings" if among else "small errors beyond the base model"
        which = "smaller ones" if told else alone
        effect = _describe_small_effect(every)
        sentences.append(f"{write_number(len(small))} {which}{among} together {effect}.")
    if not extends:
        is_one = len(errors) == 1
        added = "does not add it" if is_one else "adds none of them"
        sentences.append(f"The study {added} to the model.")
    return " ".join(sentences)


def _count_small_faults(small: Sequence[Named]) -> str:
    """Return how many of the small findings are faults, which are named by themselves, too."""
    count = sum(one.is_fault for one in small)
    if not count:
        return ""
    if count == 1:
        return ", a fault among them,"
    number = write_number(count).lower()
    return f", {number} faults among them,"


def _describe_small_effect(every: NamedErrors) -> str:
    """Return how far small findings move the target, and how far they turn it where that is told."""
    moved = f"{write_rounded(every.small_rms_mm)} mm rms"
    if every.small_rms_mrad is None:
        return f"move the target by {moved}"
    turned = f"{format_angle(every.small_rms_mrad * 1e-3)} rms"
    if every.small_rms_mm < MIN_DISPLACEMENT:
        return f"turn the target by {turned}"
    return f"move the target by {moved} and turn it by {turned}"


def _describe_faults(named: Sequence[Named]) -> list[str]:
    if not named:
        return []
    count = len(named)
    faults = "fault of the data was"
    if count > 1:
        faults = "faults of the data were"
    number = write_number(count)
    names = _list_names(named)
    return [f"{number} {faults} found: {names}."]


def _describe_settled(settled: Sequence[Named]) -> list[str]:
    """Return which errors were named, and which were found whose causes nothing registered has."""
    causes = [one for one in settled if one.is_cause]
    shapes = [one for one in settled if not one.is_cause]
    sentences = []
    if causes:
        errors = (
            "error beyond the base model was"
            if len(causes) == 1
            else "errors beyond the base model were"
        )
        sentences.append(f"{write_number(len(causes))} {errors} named: {_list_names(causes)}.")
    if shapes:
        begun = _begin_found(shapes, bool(causes))
        are = "cause is" if len(shapes) == 1 else "causes are"
        sentences.append(
            f"{begun} whose {are} not known to any registered mechanism: {_list_names(shapes)}."
        )
    return sentences


def _begin_found(found: Sequence[Named], is_more: bool) -> str:
    """Begin a sentence on what was found, or may be there where all of it is doubtful; `is_more`:
    after others."""
    count = len(found)
    what = "error beyond the base model" if count == 1 else "errors beyond the base model"
    if is_more:
        what = "more"
    verb = "was found" if count == 1 else "were found"
    if all(one.doubtful for one in found):
        verb = "may be there"
    return f"{write_number(count)} {what} {verb}"


def _describe_unsettled(named: Sequence[Named], is_more: bool) -> list[str]:
    if not named:
        return []
    begun = _begin_found(named, is_more)
    proven = "but their causes are not proven: they are"
    if len(named) == 1:
        proven = "but its cause is not proven: it is"
    listed = _list_names(named)
    return [f"{begun}, {proven} best described by {listed}."]


def _explain_free_function(text: str) -> list[str]:
    """Return what the first free function that a text names is; nothing where it names none."""
    first = FREE_FUNCTION.search(text)
    if first is None:
        return []
    drivers = sentence_list(first[1].split(", "))
    return [f"Here {first[0]} is a free function of {drivers}: its shape is fitted to the data."]


def _list_names(named: Sequence[Named]) -> str:
    """List names, each once, and how many more there are; those with rivals, and what is said of
    shapes, are parted by semicolons."""
    every = [one.shown for one in named]
    names = list(dict.fromkeys(every))
    shown = names[:SHOWN_NAMES]
    more = sum(name not in shown for name in every)
    if more > 1:
        names = [*shown, f"{more} more"]
    is_long = any(not one.is_cause or (not one.is_settled and one.rivals) for one in named)
    if is_long:
        return "; ".join(names)
    return sentence_list(names)
