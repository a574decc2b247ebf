"""What changed between two campaigns, in words that go no further than the evidence."""

from __future__ import annotations

import math
from collections.abc import Sequence

from ...diagnosis.findings.sentences import format_quantity
from ...exceptions import choice_list, count_words, sentence_list, write_rounded
from ...mechanisms.compliance import PAYLOAD
from ..known_names import Names
from .campaigns import Comparison, Explanation
from .change_sentences import describe_change, write_p
from .difference_tests import SIGNIFICANCE_TOGETHER
from .mechanism_changes import CAMPAIGN_NAMES, DEFINITE_CHANGES, MechanismChange
from .noise_changes import NoiseChange
from .target_changes import TargetMotion

MAX_LISTED = 6
SAME_TARGET_MM = 1.0  # between two targets that are told as one
MIN_MOVE_MM = 1e-9  # what is less is rounding, of a change that turns the target alone
COVERAGE = 2.0  # standard uncertainties that are told (k = 2)


def describe_comparison(comparison: Comparison) -> list[str]:
    """Describe what changed and what did not, and how large a change would have been detected (with
    90 %)."""
    sentences = [describe_change(change) for change in comparison.mechanisms]
    if comparison.as_by_payload:
        sentences.append(_describe_payload(comparison.as_by_payload))
    sentences += map(_describe_motion, comparison.target_motions)
    sentences += map(_describe_explanation, comparison.explained_by)
    sentences.append(_summarise(comparison))
    if comparison.noise is not None:
        sentences.append(_describe_noise(comparison.noise))
    if comparison.targets_apart_mm > SAME_TARGET_MM and not comparison.targets:
        sentences.append(
            f"The two campaigns measured different targets: {write_rounded(comparison.targets_apart_mm)} mm apart on the flange."
        )
    if any(comparison.other_targets):
        sentences.append(_describe_other_targets(comparison.other_targets))
    if comparison.left_aside:
        sentences.append(_describe_left_aside(comparison))
    return sentences


def _describe_payload(changes: Sequence[MechanismChange]) -> str:
    """Say what else may have changed where the arm yields otherwise to its own weight."""
    names = sentence_list([change.name for change in changes])
    same = "the same change"
    if len(changes) > 1:
        same = "the same changes"
    return (
        f"Another payload would make {same} of {names}, and the data do not tell the payload: make sure that "
        f"the arm carried the same in both campaigns, or give the column {PAYLOAD}."
    )


def _describe_left_aside(comparison: Comparison) -> str:
    """Say which motions cannot be compared, and why."""
    why = "No target was measured in both campaigns: motions that a target would also make"
    if comparison.registered_again:
        movable = "the instrument" if comparison.targets else "the instrument or the target"
        why = f"The set-up was registered again: motions that {movable} would also make"
    return f"{why} ({', '.join(comparison.left_aside)}) cannot be compared."


def _describe_motion(motion: TargetMotion) -> str:
    """Describe which targets moved on the flange, and how far."""
    said = _describe_together(motion) if motion.together else _describe_alone(motion)
    if not motion.alike:
        return said
    listed = motion.alike[:MAX_LISTED]
    others = choice_list(listed)
    return f"{said} A change of {others} would explain it as well: the two campaigns do not tell these apart."


def _describe_alone(motion: TargetMotion) -> str:
    (name,) = motion.targets
    (moved,) = motion.moved_mm
    (standard_error,) = motion.standard_errors
    size = math.hypot(*moved)
    error = COVERAGE * standard_error
    by = format_quantity(size, error, "mm")
    return f'The target "{name}" moved on the flange by {by} (k = 2).'


def _describe_together(motion: TargetMotion) -> str:
    sizes = [math.hypot(*moved) for moved in motion.moved_mm]
    count = len(sizes)
    who = f"All {count} targets"
    if count == 2:
        first, second = motion.targets
        who = f'Both targets, "{first}" and "{second}",'
    smallest = min(sizes)
    largest = max(sizes)
    least = write_rounded(smallest)
    most = write_rounded(largest)
    uncertainty = COVERAGE * max(motion.standard_errors)
    error = write_rounded(uncertainty, 2)
    return (
        f"{who} moved together on the flange, by {least} to {most} mm (± {error} mm at most, k = 2), as on an "
        "adapter that was taken off and put back."
    )


def _describe_other_targets(names: tuple[Names, Names]) -> str:
    """Say which targets one campaign alone measured."""
    parts = []
    for campaign, own in zip(CAMPAIGN_NAMES, names, strict=True):
        if not own:
            continue
        quoted = [f'"{name}"' for name in own]
        listed = sentence_list(quoted)
        part = f"only the {campaign} campaign measured {listed}"
        parts.append(part)
    said = " and ".join(parts)
    letter = said[0]
    first = letter.upper()
    count = sum(len(own) for own in names)
    they_sit = "it sits" if count == 1 else "they sit"
    return f"{first}{said[1:]}: where {they_sit} on the flange cannot be compared."


def _describe_explanation(explanation: Explanation) -> str:
    also = ""
    if explanation.alike:
        alike = ", ".join(explanation.alike[:MAX_LISTED])
        also = f", or equally well {alike},"
    error = COVERAGE * explanation.standard_error
    by = format_quantity(explanation.by, error, explanation.unit)
    effect = _describe_effect(explanation)
    return f"{explanation.label}{also} changed by {by} (k = 2): {effect}."


def _describe_effect(explanation: Explanation) -> str:
    """Describe how far a change moves the target and, where orientations are compared, turns it."""
    moves = f"{write_rounded(explanation.moves_mm)} mm rms at the target"
    if explanation.turns_mrad is None:
        return moves
    turns = f"{write_rounded(explanation.turns_mrad)} mrad rms of its orientation"
    if explanation.moves_mm < MIN_MOVE_MM:
        return turns.replace("its orientation", "the target's orientation")
    return f"{moves}, {turns}"


def _summarise(comparison: Comparison) -> str:
    """Return the sentence on all parameters tested."""
    tested = _describe_tests(comparison)
    if comparison.seen_mm is None and not comparison.targets:
        return "No parameter is fitted in both campaigns: nothing else can be compared."
    if comparison.explained_by or comparison.target_motions:
        terms = "changes" if comparison.target_motions else "terms"
        return f"These are the fewest {terms} that explain the difference of the parameters ({tested})."
    moved = [change.label for change in comparison.moved]
    moved += [f'the place of "{one.target}"' for one in comparison.moved_targets]
    if not moved and comparison.together_p <= SIGNIFICANCE_TOGETHER:
        return f"The parameters changed together beyond chance, but no few terms explain it ({tested})."
    if moved:
        names = ", ".join(moved[:MAX_LISTED])
        return f"{names} changed beyond chance, but no few terms explain it ({tested})."
    changed = any(change.what in DEFINITE_CHANGES for change in comparison.mechanisms)
    what = "Nothing"
    if comparison.noise is not None:
        what = "No parameter"
    if changed:
        what = "Nothing else" if comparison.noise is None else "No other parameter"
    return f"{what} changed beyond chance ({tested}). {_describe_detectable(comparison)}"


def _describe_noise(noise: NoiseChange) -> str:
    """Say that the noise changed, and where to look for what made it louder."""
    before = write_rounded(noise.before_mm)
    after = write_rounded(noise.after_mm)
    sizes = f"from {before} to {after} mm per coordinate"
    if noise.after_mm < noise.before_mm:
        return f"What does not repeat became less, beyond chance: noise {sizes}."
    return (
        f"What does not repeat became more, beyond chance: noise {sizes}. Look at the instrument, at what "
        "holds the target and at how well the arm repeats."
    )


def _describe_tests(comparison: Comparison) -> str:
    """Describe what was tested, and the most surprising p."""
    count = len(comparison.changes)
    counted = count_words(count, "parameter")
    least = min((change.p for change in comparison.changes), default=1.0)
    if comparison.targets:
        of_targets = min(target.p for target in comparison.targets)
        least = min(least, of_targets, comparison.targets_among_p)
        targets = len(comparison.targets)
        counted = f"{counted} and the places of {targets} targets"
    said = write_p(least)
    together = write_p(comparison.together_p)
    return f"{counted} tested, {said} for the most surprising, corrected for their number, {together} for all together"


def _describe_detectable(comparison: Comparison) -> str:
    """Describe how large a change would have been detected."""
    sentences = []
    if comparison.seen_mm is not None:
        typical, worst = comparison.seen_mm
        sentences.append(
            f"A change would have been detected from {write_rounded(typical, 2)} mm rms at the target "
            f"(typical parameter) or {write_rounded(worst, 2)} mm (the worst-determined one)."
        )
    if comparison.targets:
        seen = max(one.seen_mm for one in comparison.targets)
        sentences.append(
            f"A target that moved on the flange would have been told from {write_rounded(seen, 2)} mm on."
        )
    return " ".join(sentences)
