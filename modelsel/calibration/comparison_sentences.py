"""What changed between two campaigns, in words that go no further than the evidence."""

from __future__ import annotations

from ..diagnosis.sentences import format_quantity
from ..exceptions import count_words, sentence_list, write_rounded
from .campaigns import Comparison, Explanation
from .known_names import Names
from .mechanism_changes import CAMPAIGN_NAMES, DEFINITE_CHANGES, describe_change, write_p

MAX_LISTED = 6
SAME_TARGET_MM = 1.0  # between two targets that are told as one
COVERAGE = 2.0  # standard uncertainties that are told (k = 2)


def describe_comparison(comparison: Comparison) -> list[str]:
    """Describe what changed and what did not, and how large a change would have been detected (with
    90 %)."""
    sentences = [describe_change(change) for change in comparison.mechanisms]
    sentences += map(_describe_explanation, comparison.explained_by)
    sentences.append(_summarise(comparison))
    if comparison.targets_apart_mm > SAME_TARGET_MM:
        sentences.append(
            f"The two campaigns measured different targets: {write_rounded(comparison.targets_apart_mm)} mm apart on the flange."
        )
    if any(comparison.other_targets):
        sentences.append(_describe_other_targets(comparison.other_targets))
    if comparison.left_aside:
        why = "No target was measured in both campaigns: motions that a target would also make"
        if comparison.registered_again:
            why = "The set-up was registered again: motions that the tracker or the target would also make"
        sentences.append(f"{why} ({', '.join(comparison.left_aside)}) cannot be compared.")
    return sentences


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
    first = said[0].upper()
    return f"{first}{said[1:]}: where they sit on the flange cannot be compared."


def _describe_explanation(explanation: Explanation) -> str:
    also = ""
    if explanation.alike:
        alike = ", ".join(explanation.alike[:MAX_LISTED])
        also = f", or equally well {alike},"
    error = COVERAGE * explanation.standard_error
    by = format_quantity(explanation.by, error, explanation.unit)
    moves = write_rounded(explanation.moves_mm)
    return f"{explanation.label}{also} changed by {by} (k = 2): {moves} mm rms at the target."


def _summarise(comparison: Comparison) -> str:
    """Return the sentence on all parameters tested."""
    least = min((change.p for change in comparison.changes), default=1.0)
    parameters = count_words(len(comparison.changes), "parameter")
    tested = (
        f"{parameters} tested, {write_p(least)} for the most surprising, corrected for their number"
    )
    if comparison.seen_mm is None:
        return "No parameter is fitted in both campaigns: nothing else can be compared."
    if comparison.explained_by:
        return (
            f"These are the fewest terms that explain the difference of the parameters ({tested})."
        )
    if comparison.moved:
        moved = comparison.moved[:MAX_LISTED]
        names = ", ".join(change.label for change in moved)
        return f"{names} changed beyond chance, but no few terms explain it ({tested})."
    changed = any(change.what in DEFINITE_CHANGES for change in comparison.mechanisms)
    typical, worst = comparison.seen_mm
    return (
        f"Nothing {'else ' if changed else ''}changed beyond chance ({tested}). A change would "
        f"have been detected from {write_rounded(typical, 2)} mm rms at the target (typical parameter) or "
        f"{write_rounded(worst, 2)} mm (the worst-determined one)."
    )
