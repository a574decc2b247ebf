"""What a command does not wait for."""

from __future__ import annotations

import subprocess
import sys

SAMPLER = """
import sys
from modelsel.cli.study import _import_sampler
import modelsel.study.runner
_import_sampler()
print("emcee" in sys.modules, "scipy.stats" in sys.modules)
from scipy.stats import norm
_import_sampler()
print(norm.ppf(0.5))
"""
STUDY = """
import sys
import modelsel.cli.study, modelsel.study.runner
print(sorted({"scipy.stats", "scipy.sparse", "scipy.spatial", "scipy.optimize", "pandas", "emcee",
              "matplotlib", "multiprocessing", "modelsel.report.drawing"} & set(sys.modules)))
"""


def printed(code: str) -> str:
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, check=True, text=True)
    return done.stdout


def test_the_sampler_comes_without_scipy_stats() -> None:
    """And leaves it to whoever asks for it."""
    assert printed(SAMPLER) == "True False\n0.0\n"


def test_a_study_loads_nothing_that_it_may_not_need() -> None:
    assert printed(STUDY) == "[]\n"
