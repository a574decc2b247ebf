"""Cautions about a study's answer: a restricted list of candidates, geometry that does harm."""

from __future__ import annotations

from collections.abc import Sequence

from ...exceptions import sentence_list, write_rounded
from ...notices import Note
from ...selection.gain import Gain
from ..runs.finding_records import Finding


def explain_restriction(candidates: Sequence[str] | str) -> str:
    """Return what a verdict adds where only certain mechanisms may extend the base; else nothing."""
    if isinstance(candidates, str) or not candidates:
        return ""
    listed = sentence_list(list(dict.fromkeys(candidates)))
    return f" Only {listed} could be named: no other cause was considered, and an error that has one may seem not to repeat."


def explain_unknown_gravity(notes: Sequence[Note]) -> str:
    """Return what a verdict adds where no direction of gravity is known; else nothing."""
    if all(note.code != "gravity-unknown" for note in notes):
        return ""
    return (
        " Springs, wind-up and bending under the arm's weight were not looked for, since no direction "
        "of gravity is known: for an upright robot write gravity = [0, 0, -1] under [robot] in the "
        "study file."
    )


def explain_doubted_gravity(findings: Sequence[Finding]) -> str:
    """Return what a verdict adds where findings hold only for a direction of gravity that is in question;
    else nothing."""
    conditions = [one.condition for one in findings if one.condition]
    if not conditions:
        return ""
    condition = conditions[0].removeprefix("This")
    return f" What depends on gravity{condition}"


def explain_open_mistake(mistake: Note) -> str:
    """Return what a verdict says in place of findings where a mistake of the set-up comes first."""
    return (
        "No cause was looked for, since any would only make up for a mistake of the set-up. "
        f"{mistake.sentence} Correct that and run the study again."
    )


def restriction_notes(candidates: Sequence[str] | str) -> tuple[Note, ...]:
    """Return the warning about a restricted list of candidates, where a study has one."""
    if isinstance(candidates, str) or not candidates:
        return ()
    listed = sentence_list(list(dict.fromkeys(candidates)))
    sentence = (
        f"This study considers {listed} and no other cause: their probabilities are relative to "
        "this list, and an error that has another cause may be named after one of them. "
        'candidates = "all" in the study file considers every registered mechanism and every cell of the error map.'
    )
    return (Note("candidates-restricted", sentence),)


def harmful_base_notes(base: Sequence[str], gain: Gain, chosen: Gain) -> tuple[Note, ...]:
    """Return the warning about a base model that errs more on held-out rows than the nominal arm does,
    where the chosen model does no better than the nominal arm, either.

    `gain`, `chosen`: from the nominal arm to the base, and to the chosen model."""
    before, after = gain.held_out_rms_before_mm, gain.held_out_rms_after_mm
    if before is None or after is None or after <= before:
        return ()
    change = chosen.change
    if change is not None and change.fall > 0:
        return ()
    sentence = (
        f"On the held-out configurations the fitted base model ({sentence_list(base)}) errs by {write_rounded(after)} mm rms "
        f"where the nominal arm errs by {write_rounded(before)}{_harm(gain.interval_mm)}: the estimation configurations do not "
        "determine it well enough. Let more of them estimate, and keep the nominal parameters until then."
    )
    return (Note("base-worse-than-nominal", sentence),)


def advise_nominal(gain: Gain, orientation: tuple[float, float] | None) -> str:
    """Return what a verdict adds where the chosen model does no better on held-out rows than the nominal arm;
    else nothing.

    `orientation`: rms of the orientation error before and after, where it was measured."""
    before, after = gain.held_out_rms_before_mm, gain.held_out_rms_after_mm
    if before is None or after is None or after < before:
        return ""
    if orientation is not None:
        first, last = orientation
        if last < first:
            return ""
    outcome = "no better"
    if gain.interval_mm is not None:
        _, high = gain.interval_mm
        if high < 0:
            outcome = "worse"
    return f" Keep the nominal parameters: on configurations that they were not fitted to, the fitted ones are {outcome}."


def _harm(interval: Sequence[float] | None) -> str:
    """Return the 95 % interval of a loss, to follow the errors in a sentence."""
    if interval is None:
        return ""
    low, high = interval
    if high < 0:
        return f", worse by {write_rounded(-high)} to {write_rounded(-low)} mm (95 %)"
    return ", a difference that chance may make"
