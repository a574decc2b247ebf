"""The PUMA study, run once for all pages that show its figures."""

from __future__ import annotations

import os
from functools import cache
from pathlib import Path

from modelsel import Result, load_result, run_study

STUDY = Path(__file__).parents[2] / "studies" / "puma760"


@cache
def run_example() -> Result:
    """Run the PUMA study with its posterior sampled; read it where MODELSEL_EXAMPLE says that it was
    run."""
    folder = os.environ.get("MODELSEL_EXAMPLE")
    return load_result(folder) if folder else run_study(STUDY)
