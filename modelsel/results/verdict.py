"""The study in three sentences: what is gained, what was named, what is left; of a fit that is
hopeless, that first."""

from __future__ import annotations

from collections.abc import Sequence
from math import degrees

from ..exceptions import sentence_list
from ..fitting.noise import Floor
from ..selection.evaluation import Evaluation, Gain
from .cautions import of_those_asked

SHOWN = 6  # names in a sentence
NUMBERS = (
    "No",
    "One",
    "Two",
    "Three",
    "Four",
    "Five",
    "Six",
    "Seven",
    "Eight",
    "Nine",
    "Ten",
    "Eleven",
    "Twelve",
)


def verdict(
    nominal: Evaluation,
    chosen: Evaluation,
    gain: Gain,
    floor: Floor,
    named: Sequence[tuple[str, str]],
    asked: Sequence[str] | str,
    left: str,
) -> tuple[str, str, str]:
    """Three sentences. `named`: (name, verdict) of every finding in order; `asked`: the mechanisms
    that the study lets extend the base, "all" or a list; `left`: what is said of what remains."""
    second = _named(named, asked != []) + of_those_asked(asked)
    return _gained(nominal, chosen, gain, floor), second, left.partition(". ")[0].rstrip(".") + "."


def in_full(
    said: tuple[str, str, str], turned: tuple[float, float] | None, hopeless: str | None
) -> tuple[str, ...]:
    """The three sentences of `verdict` with rms of the orientation error [rad] before and after,
    where it was measured (`turned`). Where the fit is `hopeless`, the sentence that says so comes
    first, and none says that nothing else was found."""
    gained, found, left = said
    gained += _turned(turned)
    return (gained, found, left) if hopeless is None else (hopeless, gained, found)


def _turned(turned: tuple[float, float] | None) -> str:
    """The orientation's errors in words."""
    if turned is None:
        return ""
    verb = "falls" if turned[1] < turned[0] else "does not fall: it goes"
    return f" The orientation error {verb} from {_angle(turned[0])} to {_angle(turned[1])} rms."


def _angle(value: float) -> str:
    return f"{value * 1e3:.3g} mrad" if value < 0.1 else f"{degrees(value):.3g}°"


def _gained(nominal: Evaluation, chosen: Evaluation, gain: Gain, floor: Floor) -> str:
    noise = f"noise of {floor.coordinate_mm:.3g} mm per coordinate ({floor.source}) would leave {_left_by(floor):.3g} mm"
    before, after = gain.held_out_rms_before_mm, gain.held_out_rms_after_mm
    if before is None or after is None:
        before, after = nominal.estimation.rms_mm or 0.0, chosen.estimation.rms_mm or 0.0
        return (
            f"Nothing is held out: on the configurations that made the model its position error goes from {before:.3g} to "
            f"{after:.3g} mm rms, which flatters it; {noise}."
        )
    verb = "falls" if after < before else "does not fall: it goes"
    sure = (
        ""
        if gain.interval_mm is None
        else f", a gain of {gain.interval_mm[0]:.3g} to {gain.interval_mm[1]:.3g} mm (95 %)"
    )
    return f"On held-out configurations the position error {verb} from {before:.3g} to {after:.3g} mm rms{sure}; {noise}."


def _left_by(floor: Floor) -> float:
    """Root mean square length of a row's noise [mm]."""
    return floor.coordinate_mm * float(floor.coordinates**0.5)


def _named(named: Sequence[tuple[str, str]], extended: bool) -> str:
    if not named:
        return "No error beyond the base model was named."
    several = list(dict.fromkeys(name for name, _ in named))
    more = len(named) - sum(name in several[:SHOWN] for name, _ in named)
    shown = sentence_list([*several[:SHOWN], f"{more} more"] if more > 1 else several)
    unsure = sum(verdict != "found" for _, verdict in named)
    number = NUMBERS[len(named)] if len(named) < len(NUMBERS) else str(len(named))
    count = f"{number} error{' was' if len(named) == 1 else 's were'}"
    doubt = (
        ""
        if not unsure
        else (
            "; it has rivals that the data cannot tell from it"
            if len(named) == 1
            else f"; {unsure} of them {'has' if unsure == 1 else 'have'} rivals that the data cannot tell apart"
        )
    )
    kept = "" if extended else "; the study adds none of them to the model"
    return f"{count} named beyond the base: {shown}{doubt}{kept}."
