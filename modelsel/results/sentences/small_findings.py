"""Small findings: those that hardly change what is left, in one line with their sum."""

from __future__ import annotations

import re
from collections.abc import Sequence

from ..schemas.finding_schema import FindingRecord, SmallFindingsRecord

# small findings from which one line tells them
MIN_GROUPED = 3
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
    "Thirteen",
    "Fourteen",
    "Fifteen",
    "Sixteen",
    "Seventeen",
    "Eighteen",
    "Nineteen",
    "Twenty",
)


def write_number(count: int) -> str:
    """Return a count as the first word of a sentence."""
    return NUMBERS[count] if count < len(NUMBERS) else str(count)


def write_sum(small: SmallFindingsRecord) -> str:
    """Return how many they are and their sum, as a sentence without their names."""
    counted, _, _ = small.sentence.partition(":")
    return f"{counted.rstrip('.')}."


def split_findings(
    findings: Sequence[FindingRecord], small: SmallFindingsRecord | None
) -> tuple[list[int], list[int]]:
    """Return the places of findings that are told one by one, and of those that do not matter, which one
    line tells: none where they are fewer than MIN_GROUPED. The order is theirs, by size."""
    main = [k for k, finding in enumerate(findings) if finding.matters]
    rest = [k for k, finding in enumerate(findings) if not finding.matters]
    if small is None or len(rest) < MIN_GROUPED:
        return sorted([*main, *rest]), []
    return main, rest


def find_named(verdict: Sequence[str], labels: Sequence[str]) -> set[int]:
    """Find the places of the findings, given by their labels, that a verdict names; of those with one
    label the first."""
    told = " ".join(verdict)
    first: dict[str, int] = {}
    for place, label in enumerate(labels):
        first.setdefault(label, place)
    return {place for label, place in first.items() if _has_name(told, label)}


def _has_name(told: str, label: str) -> bool:
    """Return whether a text has a name, and not as a part of another: backlash:1, approach-backlash:1."""
    before, after = r"(?<![\w-])", r"(?!\w)"
    whole = f"{before}{re.escape(label)}{after}"
    return re.search(whole, told) is not None


def choose_shown(told: Sequence[int], named: set[int], most: int) -> list[int]:
    """Choose the places of findings that a table of `most` rows has, in their order: those that the
    verdict names are never left out."""
    kept = [place for place in told if place in named]
    others = [place for place in told if place not in named]
    room = max(most - len(kept), 0)
    return sorted([*kept, *others[:room]])
