"""What a user waits for: `modelsel --help` against importing numpy, and a whole study; fresh
processes taking turns."""

from __future__ import annotations

import os
import resource
import subprocess
import sys
import tempfile
from pathlib import Path

STUDY = Path(__file__).parents[2] / "studies" / "puma760" / "study.toml"


def _cpu(compiled: Path, *command: str) -> float:
    """CPU seconds of a fresh process, children of it included; modules are compiled once, as an
    installer does, whatever this machine's PYTHONDONTWRITEBYTECODE says."""
    env = {name: value for name, value in os.environ.items() if name != "PYTHONDONTWRITEBYTECODE"}
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    subprocess.run(
        [sys.executable, *command],
        check=True,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        env=env | {"PYTHONPYCACHEPREFIX": str(compiled)},
    )
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def run() -> dict[str, float]:
    best = dict.fromkeys(("help", "numpy", "study"), float("inf"))
    with tempfile.TemporaryDirectory() as folder:
        compiled = Path(folder) / "compiled"
        study = (
            "-m",
            "modelsel",
            "study",
            str(STUDY),
            "--out",
            folder,
            "--no-report",
            "--no-sampling",
        )
        for k in range(7):
            best["help"] = min(best["help"], _cpu(compiled, "-m", "modelsel", "--help"))
            best["numpy"] = min(best["numpy"], _cpu(compiled, "-c", "import numpy"))
            if k < 5:
                best["study"] = min(best["study"], _cpu(compiled, *study))
    return {
        "help_vs_numpy": best["help"] / best["numpy"],
        "help_seconds": best["help"],
        "study_seconds": best["study"],
    }
