"""Scenes for the tests: a built-in robot, drawn configurations, every covariate, an exact plant
with noise."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from functools import cache

import numpy as np
import pandas as pd
import pytest

from modelsel._typing import Array, Index
from modelsel.config.study_file import Study
from modelsel.fitting.design import residuals
from modelsel.fitting.problem import Problem
from modelsel.measurements.measurements import Measurements, build_measurements
from modelsel.mechanisms.registry import mechanism
from modelsel.mechanisms.terms import Mechanism, Screw, Term
from modelsel.robot.files import load_robot
from modelsel.robot.kinematics import Joint, Robot, forward
from modelsel.selection.evaluation import Split
from modelsel.selection.gain import Gain, ResamplingOptions, resample_errors

ON_AXIS, OFF_AXIS = (
    (0.0, 0.0, 100.0),
    (40.0, -25.0, 100.0),
)  # target on and off the last joint's axis


def seeds(*values: int, slow: Sequence[int] = ()) -> pytest.MarkDecorator:
    """The `rng` fixture once per seed, each in the test's id; those of `slow` in that stage."""
    each = [pytest.param(value, id=f"seed{value}") for value in values]
    each += [pytest.param(value, id=f"seed{value}", marks=pytest.mark.slow) for value in slow]
    return pytest.mark.parametrize("rng", each, indirect=True)


def leave_to_slow(values: Iterable[object], *kept: object) -> list[object]:
    """Parameters of a test that takes seconds for each: all but the kept ones are in the stage
    `slow`."""
    return [
        value if value in kept else pytest.param(value, marks=pytest.mark.slow) for value in values
    ]


def estimate_gain(
    before: Array, after: Array, block: Index, rng: np.random.Generator, *options: ResamplingOptions
) -> Gain:
    """The gain between two models' residuals (m, 3) of the same rows; `block` (m,): the rows'
    configurations."""
    first, second = resample_errors([before, after], block, rng, *options)
    return first.gain_of(second)


# one robot of a name: it is frozen, and keeps what was prepared for it
load_once = cache(load_robot)


def bind(robot: Robot | str, data: Measurements, tool: Sequence[float] = OFF_AXIS) -> Problem:
    robot = load_once(robot) if isinstance(robot, str) else robot
    return Problem(robot, data, np.array(tool, float))


def drawn(
    robot: Robot | str,
    rng: np.random.Generator,
    m: int,
    tool: Sequence[float] = OFF_AXIS,
    **more: object,
) -> Problem:
    """m configurations within the limits, measured where the nominal model has them, with every
    named covariate."""
    robot = load_once(robot) if isinstance(robot, str) else robot
    q = robot.draw(rng, m)
    covariates = {
        "payload_kg": rng.uniform(0, 5, m),
        "temperature_C": rng.uniform(15, 35, m),
        "time_s": np.arange(m) * 30.0,
        "current_A": rng.normal(size=m),
    }
    return bind(
        robot,
        build_measurements(
            q,
            forward(robot, q, np.array(tool)),
            **({"covariates": covariates} | more),
            prismatic=robot.prismatic,
        ),
        tool,
    )


def measured(at: Problem, position: Array) -> Problem:
    return replace(at, data=replace(at.data, position=position))


def planted(
    at: Problem,
    terms: Sequence[Term],
    theta: Array,
    rng: np.random.Generator | None = None,
    sigma: float = 0.0,
) -> Problem:
    """The problem with its positions moved to where the exact chain has them at theta, plus noise of
    sigma [mm]."""
    position = at.data.position - residuals(at, terms, theta)[:, :3]
    return measured(
        at, position if rng is None else position + rng.normal(0, sigma, position.shape)
    )


def one(frame: int, axis: str, *cause: object) -> Mechanism:
    """A mechanism of one screw, to plant or to try."""
    screw = Screw(frame, axis, *cause)  # type: ignore[arg-type]
    return Mechanism(str(screw), (Term(f"k{frame}{axis}", (screw,)),))


def small_arm(prismatic: bool = False) -> Robot:
    """Three joints, the last one sliding where asked: a study of it takes milliseconds."""
    first, second, third = (np.eye(4) for _ in range(3))
    first[2, 3], second[0, 3], third[0, 3] = 300.0, 50.0, 400.0
    second[:3, :3] = [[1, 0, 0], [0, 0, -1], [0, 1, 0]]
    last = np.eye(4)
    last[0, 3] = 350.0
    slide = Joint(third, True, (0.0, 300.0)) if prismatic else Joint(third)
    return Robot("small", "made up for tests", (Joint(first), Joint(second), slide), last)


def study_of(at: Problem, held_out: int = 0, folds: int = 5) -> Split:
    """A problem as a study's data: the last configurations held out, folds by row."""
    m = len(at)
    estimation = np.arange(m) < m - held_out
    return Split(
        at, estimation, np.zeros(m, bool), np.where(estimation, np.arange(m) % folds, -1), False
    )


def study_with(
    tool: Sequence[float] | None = OFF_AXIS,
    seed: int = 1,
    *,
    register: bool | str = False,
    estimation: int | None = None,
    column: str | None = None,
    held_out: str = "held-out",
    noise: dict[str, float] | None = None,
) -> Study:
    """A study of a set-up, for tests that read no file; without a tool and registration it is the
    flange."""
    robot = {"name": "ur5", "register": register}
    if tool is not None or not register:
        robot["tool_mm"] = [float(v) for v in tool or (0, 0, 0)]
    split = {"held_out": held_out} | {
        key: value
        for key, value in (("estimation", estimation), ("column", column))
        if value is not None
    }
    return Study(
        name="test", seed=seed, robot=robot, measurements="none.csv", split=split, noise=noise or {}
    )


def small_campaign() -> tuple[Problem, pd.DataFrame, Study]:
    """Forty configurations of the small arm with geometric errors, as a problem, as a table, and as a
    study of the geometric model alone."""
    rng = np.random.default_rng(5)
    arm = small_arm()
    at = drawn(arm, rng, 40, covariates={})
    terms = mechanism("geometric", arm).terms
    at = planted(at, terms, rng.normal(0, 1e-3, len(terms)), rng, 0.02)
    frame = pd.DataFrame(at.data.q, columns=["q1_rad", "q2_rad", "q3_rad"])
    frame[["x_mm", "y_mm", "z_mm"]] = at.data.position
    study = Study(
        name="small",
        robot={"nominal": arm, "tool_mm": OFF_AXIS},
        measurements=frame,
        split={"estimation": 30},
        model={"candidates": ["encoder-scale"]},
    )
    return at, frame, study


def split_of(at: Problem, rng: np.random.Generator) -> Split:
    """Return a split of four folds: one row in five is held out, and one row is outlying."""
    rows = len(at)
    estimation = np.arange(rows) % 5 > 0
    folds = np.where(estimation, rng.integers(0, 4, rows), -1)
    outlying = np.zeros(rows, bool)
    outlying[7] = True
    return Split(at, estimation, outlying, folds, known_sigma=False)
