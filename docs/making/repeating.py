"""The campaign of the page on repeatability: postures measured again in rounds, one joint that does
not repeat, and what a study says of it."""

from __future__ import annotations

import textwrap
from functools import cache

import numpy as np
import pandas as pd
from campaigns import BASE, ROBOT

from modelsel import Study, run_study
from modelsel.fitting.design import residuals
from modelsel.fitting.problem import Problem
from modelsel.measurements.measurements import build_measurements
from modelsel.report.figures.error_parts import draw_error_parts
from modelsel.results.repeatability.repeatability import write_repeatability_lines
from modelsel.results.schemas.schema import ErrorPartRecord
from modelsel.robot.kinematics import forward

POSTURES, ROUNDS = 30, 3
TARGETS = {"a": (40.0, -25.0, 100.0), "b": (-50.0, 30.0, 80.0), "c": (10.0, 60.0, 120.0)}
JOINT, SPREAD = 2, 40e-6  # rad
NOISE = 0.015  # mm per coordinate
WIDTH = 100  # letters of a line


def measure_rounds(seed: int) -> pd.DataFrame:
    """Simulate the table: readings as commanded; the joint goes elsewhere at every visit."""
    rng = np.random.default_rng(seed)
    drawn = ROBOT.draw(rng, POSTURES)
    q = drawn[np.concatenate([rng.permutation(POSTURES) for _ in range(ROUNDS)])]
    gone = q.copy()
    gone[:, JOINT - 1] += rng.normal(0, SPREAD, len(q))
    size = [0.3 if term.screws[0].axis[0] == "t" else 5e-4 for term in BASE.terms]
    theta = rng.normal(0, size)
    tables = []
    for target, tool in TARGETS.items():
        nominal = build_measurements(gone, forward(ROBOT, gone, np.array(tool)))
        at = Problem(ROBOT, nominal, np.array([tool]))
        position = nominal.position - residuals(at, BASE.terms, theta)[:, :3]
        position += rng.normal(0, NOISE, position.shape)
        columns = {f"q{j}_rad": readings for j, readings in enumerate(q.T, 1)}
        columns |= {f"{axis}_mm": position[:, k] for k, axis in enumerate("xyz")}
        tables.append(pd.DataFrame(columns | {"target": target, "configuration": range(len(q))}))
    return pd.concat(tables).sort_values(["configuration", "target"])


@cache
def run_repeated() -> list[ErrorPartRecord]:
    """Run the study of the page: every configuration estimates."""
    study = Study(
        name="repeatability",
        seed=1,
        robot={"name": "puma760", "tools_mm": {name: list(at) for name, at in TARGETS.items()}},
        measurements=measure_rounds(9283).reset_index(drop=True),
        split={"estimation": POSTURES * ROUNDS},
    )
    return run_study(study, sampling=False).record.repeatability


def said() -> str:
    """What the study prints of the parts."""
    lines = [
        textwrap.fill(line, WIDTH, subsequent_indent="    ")
        for line in write_repeatability_lines(run_repeated())
    ]
    return "\n".join(["```text", *lines, "```"])


@cache
def parts() -> tuple[bytes, str]:
    """The parts in a picture."""
    caption = (
        f"A simulated campaign: {POSTURES} postures in {ROUNDS} rounds, {len(TARGETS)} targets, noise of "
        f"{NOISE * 1e3:.0f} µm per coordinate; joint {JOINT} stops with a standard deviation of {SPREAD * 1e6:.0f} µrad about "
        "where it is sent. Left: the share of every part in what is left; right: its size at the target."
    )
    return draw_error_parts(run_repeated()), caption
