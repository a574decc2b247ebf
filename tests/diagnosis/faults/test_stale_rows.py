"""Rows that have the position of the row before: of their own group and target, whichever that is."""

from __future__ import annotations

import numpy as np
import pytest
from builders import bind, measured

from modelsel._typing import Array
from modelsel.diagnosis.faults.mistaken_rows import describe_slips
from modelsel.fitting.design import residuals
from modelsel.fitting.problem import Problem
from modelsel.measurements.measurements import build_measurements
from modelsel.robot.files import load_robot
from modelsel.robot.kinematics import forward

ROWS = 40
TOOL = (30.0, 0.0, 100.0)


def build_problem(rng: np.random.Generator, **labels: object) -> Problem:
    """Rows of a UR5, measured where it is, with noise; every other one of a second target where
    targets are given."""
    robot = load_robot("ur5")
    q = robot.draw(rng, ROWS)
    position = forward(robot, q, np.array(TOOL)) + rng.normal(0, 0.05, (ROWS, 3))
    return bind(robot, build_measurements(q, position, **labels), TOOL)


def tell_stale(at: Problem, rows: list[int], source: list[int]) -> tuple[str, ...]:
    """Give rows the positions of others, and tell what slip explains them."""
    position: Array = at.data.position.copy()
    position[rows] = at.data.position[source]
    suspected = np.zeros(ROWS, bool)
    suspected[rows] = True
    return describe_slips(measured(at, position), residuals, suspected)


def test_the_row_before_is_told(rng: np.random.Generator) -> None:
    (sentence,) = tell_stale(build_problem(rng), [10, 30], [9, 29])
    assert "2 rows are given with the position of the row before (" in sentence


def test_the_first_row_has_none_before_it(rng: np.random.Generator) -> None:
    assert tell_stale(build_problem(rng), [0], [ROWS - 1]) == ()


def test_another_group_has_no_row_before(rng: np.random.Generator) -> None:
    groups = np.repeat(["a", "b"], ROWS // 2)
    at = build_problem(rng, group=groups)
    assert tell_stale(at, [20], [19]) == ()
    assert len(tell_stale(at, [21], [20])) == 1


@pytest.mark.parametrize(("source", "count"), [(18, 1), (19, 0)])
def test_the_row_of_the_same_target_is_told_as_such(
    rng: np.random.Generator, source: int, count: int
) -> None:
    at = build_problem(rng, target=np.tile(["A", "B"], ROWS // 2))
    told = tell_stale(at, [20], [source])
    assert len(told) == count
    for sentence in told:
        assert "the position of the row of the same target that was measured before" in sentence
