"""The names that a chosen model has beyond its base, and what of them is not proven."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from .._records import parse_record
from ..results.schemas.finding_schema import FindingRecord

DOUBTFUL, OPEN = "doubtful", "name not proven"


def write_found_names(names: Sequence[str], findings: Sequence[dict[str, Any]]) -> str:
    """Write the names of effects with what result.json's findings hold back of each: that it is
    doubtful, or that the data leave its name open."""
    reserves = {}
    for value in findings:
        finding = parse_record(value, FindingRecord)
        reserves[finding.fitted_entry.name] = _find_reserve(finding)
    written = []
    for name in names:
        reserve = reserves.get(name)
        written.append(f"{name} ({reserve})" if reserve else name)
    return " + ".join(written)


def _find_reserve(finding: FindingRecord) -> str | None:
    if finding.doubtful:
        return DOUBTFUL
    is_open = finding.is_name_open or not finding.is_found
    return OPEN if is_open else None
