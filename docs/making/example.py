"""The PUMA study, run once for all pages that show its figures."""

from __future__ import annotations

from functools import cache
from pathlib import Path

from modelsel import Result, run_study

STUDY = Path(__file__).parents[2] / "studies" / "puma760"


@cache
def run_example() -> Result:
    """Run the PUMA study with its posterior sampled."""
    return run_study(STUDY)
