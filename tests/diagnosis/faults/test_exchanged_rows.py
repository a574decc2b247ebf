"""Rows whose positions stand in each other's place."""

from __future__ import annotations

import numpy as np
import pytest
from builders import bind, measured

from modelsel.diagnosis.faults.exchanged_rows import MOST_ROWS, put_back_exchanged
from modelsel.diagnosis.faults.mistaken_rows import describe_slips
from modelsel.fitting.design import residuals
from modelsel.measurements.measurements import build_measurements
from modelsel.robot.files import load_robot
from modelsel.robot.kinematics import forward

ROWS = 40
TOOL = (30.0, 0.0, 100.0)
NEAR = 1.0


def draw_places(rng: np.random.Generator, count: int) -> np.ndarray:
    return rng.uniform(-1000, 1000, (count, 3))


@pytest.mark.parametrize("count", [2, 3, 5])
def test_a_cycle_of_rows_is_put_right(count: int, rng: np.random.Generator) -> None:
    predicted = draw_places(rng, count + 2)
    cycle = rng.permutation(count + 2)[:count]
    position = predicted + rng.normal(0, 0.05, predicted.shape)
    position[cycle] = position[np.roll(cycle, 1)]
    found = put_back_exchanged(position, predicted, NEAR)
    assert np.abs(found - predicted).max() < NEAR


def test_a_chain_whose_end_is_lost_is_left(rng: np.random.Generator) -> None:
    """Rows that have the position of the row before are no exchange: the last position is lost."""
    predicted = draw_places(rng, 6)
    position = np.vstack([draw_places(rng, 1), predicted[:-1]])
    assert (put_back_exchanged(position, predicted, NEAR) == position).all()


def test_two_exchanged_rows_are_found_beside_a_chain(rng: np.random.Generator) -> None:
    predicted = draw_places(rng, 8)
    position = predicted.copy()
    position[[1, 6]] = position[[6, 1]]
    position[3:5] = predicted[2:4]
    position[2] = 0.0
    expected = position.copy()
    expected[[1, 6]] = predicted[[1, 6]]
    assert (put_back_exchanged(position, predicted, NEAR) == expected).all()


def test_too_many_rows_are_not_compared() -> None:
    many = np.arange(3.0 * (MOST_ROWS + 1)).reshape(-1, 3)
    assert put_back_exchanged(many, many[::-1], NEAR) is many


def test_exchanged_rows_are_told(rng: np.random.Generator) -> None:
    robot = load_robot("ur5")
    q = robot.draw(rng, ROWS)
    position = forward(robot, q, np.array(TOOL)) + rng.normal(0, 0.05, (ROWS, 3))
    first, second, bad = rng.permutation(ROWS)[:3]
    position[[first, second]] = position[[second, first]]
    position[bad] += 500.0
    at = measured(bind(robot, build_measurements(q, position), TOOL), position)
    suspected = np.zeros(ROWS, bool)
    suspected[[first, second, bad]] = True
    (sentence,) = describe_slips(at, residuals, suspected)
    assert "2 rows are given with each other's positions (" in sentence
    assert "put every position beside its own readings" in sentence
