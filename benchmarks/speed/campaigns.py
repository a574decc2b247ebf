"""Whole studies of large campaigns (without report and sampling), each in a fresh process: CPU
seconds, wall seconds and peak memory.

Beside every study a fixed piece of work is measured, a matrix product of numpy and a loop of the
interpreter: seconds belong to one machine at one time, their ratio to this work can be compared
(`..._study_of_peer`). With `before`, the folder of another checkout, its studies are run in turn
with this one's; their figures begin with `before_`. The million's study is a long one: it is run
once, like all but the shortest."""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ..campaigns import CAMPAIGNS, write

ROOT = Path(__file__).parents[2]
UR5 = ROOT / "studies" / "ur5-tracker" / "study.toml"
ROUNDS = {"drawn": 5}  # of the studies that are run more than once
NAMES = ("drawn", "torques", "ur5", "reflectors", "ripple", "million")
SIZE, STEPS = 2000, 5_000_000  # of the peer's matrices, and of its loop
# a small process starts the study: on Linux a child's peak is at least that of the process that
# starts it
LAUNCHER = """
import resource, subprocess, sys
code = subprocess.run(sys.argv[1:], stdout=subprocess.DEVNULL).returncode
used = resource.getrusage(resource.RUSAGE_CHILDREN)
print(used.ru_utime + used.ru_stime, used.ru_maxrss)
sys.exit(code)
"""


class Usage(NamedTuple):
    """What a process used: CPU seconds (those of its children included), wall seconds, and MB."""

    cpu: float
    wall: float
    mb: float


def run_peer() -> float:
    """CPU seconds of the fixed piece of work."""
    matrix = np.random.default_rng(0).normal(size=(SIZE, SIZE))
    start = time.process_time()
    matrix @ matrix
    total = 0
    for k in range(STEPS):
        total += k & 3
    return time.process_time() - start


def run_process(command: list[str], env: Mapping[str, str], folder: Path) -> Usage:
    """Run a process to its end in a folder, whose package would go before that of the environment's
    path. Raises RuntimeError where it fails."""
    start = time.perf_counter()
    done = subprocess.run(
        [sys.executable, "-c", LAUNCHER, *command],
        check=False,
        env=env,
        cwd=folder,
        capture_output=True,
        text=True,
    )
    wall = time.perf_counter() - start
    if done.returncode:
        raise RuntimeError(f"{' '.join(command)}: {done.stderr}")
    seconds, kilobytes = done.stdout.split()
    return Usage(float(seconds), wall, float(kilobytes) / 1024)


def run_study(study: Path, checkout: Path, folder: Path) -> Usage:
    """Run a study by a checkout's package, compiled beforehand as an installer does."""
    env = {name: value for name, value in os.environ.items() if name != "PYTHONDONTWRITEBYTECODE"}
    env |= {"PYTHONPATH": str(checkout), "PYTHONPYCACHEPREFIX": str(folder / "compiled")}
    compiling = [sys.executable, "-m", "compileall", "-q", str(checkout / "modelsel")]
    subprocess.run(compiling, check=True, env=env)
    with tempfile.TemporaryDirectory(dir=folder) as out:
        command = [sys.executable, "-m", "modelsel", "study", str(study), "--out", out]
        return run_process([*command, "--no-report", "--no-sampling"], env, folder)


def list_studies(names: Sequence[str], folder: Path) -> dict[str, Path]:
    """Write the campaigns and list the study files by name; the UR5's only where its data are."""
    studies = {}
    for name in names:
        if name in CAMPAIGNS:
            studies[name] = write(name, folder / name)
        elif "MODELSEL_DATA" in os.environ:
            studies[name] = UR5
    return studies


def run(before: Path | None = None, names: Sequence[str] = NAMES) -> dict[str, float]:
    checkouts = {"": ROOT}
    if before is not None:
        checkouts = {"before_": before.resolve(), "": ROOT}
    figures: dict[str, float] = {}
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for study, path in list_studies(names, folder).items():
            runs: dict[str, list[tuple[Usage, float]]] = {prefix: [] for prefix in checkouts}
            for _ in range(ROUNDS.get(study, 1)):
                for prefix, checkout in checkouts.items():
                    peer = run_peer()
                    runs[prefix].append((run_study(path, checkout, folder), peer))
            for prefix, measured in runs.items():
                figures |= _summarise(f"{prefix}{study}_study", measured)
    return figures


def _summarise(name: str, runs: list[tuple[Usage, float]]) -> dict[str, float]:
    """The least of several runs, and its ratio to the least of the peer's."""
    cpu = min(used.cpu for used, _ in runs)
    return {
        f"{name}_seconds": cpu,
        f"{name}_wall_seconds": min(used.wall for used, _ in runs),
        f"{name}_mb": min(used.mb for used, _ in runs),
        f"{name}_of_peer": cpu / min(peer for _, peer in runs),
    }
