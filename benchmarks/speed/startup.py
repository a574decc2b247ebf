"""What a user waits for: `modelsel --help` against importing numpy, the PUMA study without report and
sampling, its first verdict on the terminal, and the study whole; fresh processes taking turns."""

from __future__ import annotations

import os
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path

VERDICT = "On held-out configurations"  # begins the first sentence on the terminal
STUDY = Path(__file__).parents[2] / "studies" / "puma760" / "study.toml"


def _prepare(compiled: Path) -> dict[str, str]:
    """The environment of a fresh process; modules are compiled once, as an installer does, whatever
    this machine's PYTHONDONTWRITEBYTECODE says."""
    env = {name: value for name, value in os.environ.items() if name != "PYTHONDONTWRITEBYTECODE"}
    return env | {"PYTHONPYCACHEPREFIX": str(compiled)}


def _cpu(compiled: Path, *command: str) -> float:
    """CPU seconds of a fresh process, children of it included."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    subprocess.run(
        [sys.executable, *command],
        check=True,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        env=_prepare(compiled),
    )
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def _wait(compiled: Path, *command: str) -> tuple[float, float]:
    """Wall seconds from a fresh process's command to its first verdict, and to its end. Raises
    RuntimeError where it fails, or gives none."""
    start = time.perf_counter()
    verdict = 0.0
    with subprocess.Popen(
        [sys.executable, *command],
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        env=_prepare(compiled),
        text=True,
    ) as process:
        for line in process.stdout or ():
            if line.startswith(VERDICT) and not verdict:
                verdict = time.perf_counter() - start
    if process.returncode or not verdict:
        raise RuntimeError(f"{' '.join(command)} ended with {process.returncode}")
    return verdict, time.perf_counter() - start


def run() -> dict[str, float]:
    best = dict.fromkeys(("help", "numpy", "study", "verdict", "whole"), float("inf"))
    with tempfile.TemporaryDirectory() as folder:
        compiled = Path(folder) / "compiled"
        whole = ("-m", "modelsel", "study", str(STUDY), "--out", folder)
        study = (*whole, "--no-report", "--no-sampling")
        for k in range(7):
            best["help"] = min(best["help"], _cpu(compiled, "-m", "modelsel", "--help"))
            best["numpy"] = min(best["numpy"], _cpu(compiled, "-c", "import numpy"))
            if k < 5:
                best["study"] = min(best["study"], _cpu(compiled, *study))
            if k < 3:
                verdict, end = _wait(compiled, *whole)
                best["verdict"] = min(best["verdict"], verdict)
                best["whole"] = min(best["whole"], end)
    return {
        "help_vs_numpy": best["help"] / best["numpy"],
        "help_seconds": best["help"],
        "study_seconds": best["study"],
        "first_verdict_seconds": best["verdict"],
        "whole_study_seconds": best["whole"],
    }
