"""The noise floor from repeats and from pairs of targets: as sure as its degrees of freedom say, and
a bad shot does not set it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from builders import OFF_AXIS, bind, seeds, small_arm
from scipy.spatial.transform import Rotation

from modelsel._typing import Array
from modelsel.fitting.noise import Floor, from_repeats, from_target_pairs, weigh
from modelsel.measurements.measurements import build_measurements
from modelsel.robot.kinematics import forward

ARM = small_arm()
SIGMA = 0.05
STUDIES = 200


def repeated(rng: np.random.Generator, error: Array) -> Floor | None:
    """Ten postures, each measured three times."""
    q = ARM.draw(rng, 10).repeat(3, axis=0)
    data = build_measurements(q, forward(ARM, q, np.array(OFF_AXIS)) + error)
    return from_repeats(data, data.group)


def paired(rng: np.random.Generator, error: Array) -> Floor | None:
    """Thirty configurations of two targets."""
    q = ARM.draw(rng, 30)
    places = [forward(ARM, q, np.array(tool)) for tool in (OFF_AXIS, (-60.0, 30.0, 140.0))]
    position = np.stack(places, axis=1).reshape(60, 3)
    return from_target_pairs(
        build_measurements(q.repeat(2, axis=0), position + error, target=["a", "b"] * 30)
    )


def seen_in_part(rng: np.random.Generator, error: Array) -> Floor | None:
    """Ten configurations of eight targets, of which the last configuration shows three."""
    q = ARM.draw(rng, 10)
    tools = rng.uniform(-150, 150, (8, 3))
    places = [forward(ARM, q, tool) for tool in tools]
    position = np.stack(places, axis=1).reshape(80, 3)
    names = [f"t{k}" for k in range(8)] * 10
    seen = slice(0, len(error))
    every = q.repeat(8, axis=0)
    data = build_measurements(every[seen], position[seen] + error, target=names[seen])
    return from_target_pairs(data)


@pytest.mark.integration
@seeds(1, slow=(2,))
@pytest.mark.parametrize(("measure", "rows"), [(repeated, 30), (paired, 60), (seen_in_part, 75)])
@pytest.mark.parametrize("bad", [0, 1])
def test_a_floor_is_as_sure_as_its_freedom(rng: np.random.Generator, measure, rows, bad) -> None:
    scales = []
    for _ in range(STUDIES):
        error = rng.normal(0, SIGMA, (rows, 3))
        error[:bad] += 100 * SIGMA
        floor = measure(rng, error)
        scales.append(floor.coordinate_mm / SIGMA)
    expected = 1 / np.sqrt(2 * floor.freedom)
    # a posture with a bad shot has its other rows off, too
    assert np.mean(scales) == pytest.approx(1, abs=0.05)
    assert np.std(scales) < 1.25 * expected


@seeds(1)
def test_repeats_are_compared_where_the_instrument_stood_alike(rng: np.random.Generator) -> None:
    """The tracker was moved between two rounds of the same postures: what it moved is no noise."""
    q = np.tile(ARM.draw(rng, 12), (4, 1))
    position = forward(ARM, q, np.array(OFF_AXIS)) + rng.normal(0, SIGMA, (48, 3))
    position[24:] += 300.0
    moved = build_measurements(q, position, group=["first"] * 24 + ["second"] * 24)
    problem = bind(ARM, moved)
    places = np.zeros((2, 3))
    places[1] = 300.0
    two = replace(problem, placement=(np.tile(np.eye(3), (2, 1, 1)), places))
    _, floor = weigh(two, None, None)
    assert floor.source == "repeats"
    assert floor.coordinate_mm == pytest.approx(SIGMA, rel=0.3)
    assert floor.freedom == 72
    _, mixed = weigh(problem, None, None)
    assert mixed.coordinate_mm > 50


@seeds(1, 2)
def test_readings_that_differ_a_little_leave_the_noise(rng: np.random.Generator) -> None:
    """The arm does not come back exactly: what its readings say it moved, three times the noise and
    more, is no noise. Its joints are off by milliradians, the tool by millimetres."""
    q = np.tile(ARM.draw(rng, 15), (4, 1)) + rng.uniform(-4e-4, 4e-4, (60, 3))
    true_tool = np.array(OFF_AXIS) + rng.normal(0, 2, 3)
    position = forward(ARM, q + rng.normal(0, 2e-3, 3), true_tool)
    errors = rng.normal(0, SIGMA, (60, 3))
    turn = Rotation.random(random_state=rng).as_matrix()
    data = build_measurements(q, (position + errors) @ turn.T + 500.0)
    placed = replace(bind(ARM, data), placement=(turn[None], np.full((1, 3), 500.0)))
    _, floor = weigh(placed, None, None)
    assert floor.source == "repeats"
    assert floor.freedom == 3 * 45
    assert floor.coordinate_mm == pytest.approx(SIGMA, rel=0.2)
    assert from_repeats(data, data.group) is None


def test_two_targets_at_one_place_tell_no_floor(rng: np.random.Generator) -> None:
    """No line is between them, along which the noise could be seen."""
    robot = small_arm()
    q = robot.draw(rng, 12)
    points = forward(robot, np.repeat(q, 2, axis=0), OFF_AXIS)
    data = build_measurements(
        np.repeat(q, 2, axis=0),
        points,
        target=["A", "B"] * 12,
        configuration=[f"{row // 2}" for row in range(24)],
    )
    assert from_target_pairs(data) is None
