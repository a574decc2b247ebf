"""Studies on two workers against one, and what the fleet adds to each; wall time, both cores."""

from __future__ import annotations

import os
import tempfile
import time
from pathlib import Path

import numpy as np
import pandas as pd

from modelsel.config.fleet_file import read_fleet
from modelsel.config.study_file import read_study
from modelsel.robot.files import load_robot
from modelsel.robot.kinematics import forward
from modelsel.study.fleet_runner import FleetOptions, cluster, run_fleet
from modelsel.study.pipeline.runner import run_study as alone

from .timing import TOOL

STUDY = """
name = "arm"
seed = 1
[robot]
name = "puma760"
tool_mm = [0, 0, 100]
[measurements]
file = "measurements.csv"
[split]
estimation = 40
[model]
candidates = ["backlash:3", "wrist-coupling"]
"""


def run(count: int = 500) -> dict[str, float]:
    os.sched_setaffinity(0, range(os.cpu_count() or 1))
    arm, rng = load_robot("puma760"), np.random.default_rng(4)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        q = arm.draw(rng, 60)
        names = [*(f"q{j}_rad" for j in range(1, 7)), "x_mm", "y_mm", "z_mm"]
        pd.DataFrame(
            np.column_stack([q, forward(arm, q, TOOL) + rng.normal(0, 0.05, (60, 3))]),
            columns=names,
        ).to_csv(folder / "measurements.csv", index=False)
        (folder / "study.toml").write_text(STUDY)
        entries = "".join(
            f'[[study]]\nfile = "study.toml"\nname = "s{k}"\nseed = {k}\n' for k in range(count)
        )
        (folder / "fleet.toml").write_text(f'name = "speed"\n{entries}')
        fleet = read_fleet(folder / "fleet.toml")
        seconds = {}
        for workers in (1, 2):
            with cluster(workers) as client:
                small = read_fleet(folder / "fleet.toml")
                run_fleet(
                    type(small)(small.name, small.tasks[: 2 * workers], (), small.folder),
                    folder / "warm",
                    client,
                    FleetOptions(sampling=False),
                )
                start = time.perf_counter()
                rows = run_fleet(
                    fleet, folder / f"out{workers}", client, FleetOptions(sampling=False)
                )
                seconds[workers] = time.perf_counter() - start
                if any(row["state"] != "done" for row in rows):
                    raise RuntimeError(f"a study failed: {rows}")
        study, some = read_study(folder), min(count, 20)
        start = time.perf_counter()
        for k in range(some):
            alone(study, folder, sampling=False).save(folder / f"alone{k}")
        each = (time.perf_counter() - start) / some
    return {
        "fleet_two_workers": seconds[1] / seconds[2],
        "fleet_overhead_ms": 1e3 * (seconds[1] / count - each),
        "fleet_study_ms": 1e3 * each,
        "fleet_studies": float(count),
    }
