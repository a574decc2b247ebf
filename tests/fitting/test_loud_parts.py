"""Parts of the errors that are far louder than the instrument: how large they, and it, are said to be.

The arm is moved by its exact kinematics; a 95 % interval that is widened by a quarter misses by chance
in less than one draw of 10,000."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from builders import OFF_AXIS, bind, seeds

from modelsel._typing import Array
from modelsel.fitting.design import Model
from modelsel.fitting.error_structure import ErrorStructure, find_structure
from modelsel.fitting.largest_likelihood import (
    MOST_OF_ALL,
    MOST_OF_FEW,
    _choose_most,
    _count_motions,
)
from modelsel.fitting.least_squares import fit
from modelsel.fitting.possible_parts import list_parts
from modelsel.fitting.shared_errors import SharedError
from modelsel.measurements.measurements import build_measurements
from modelsel.mechanisms.registry import mechanism
from modelsel.robot.files import load_robot
from modelsel.robot.kinematics import forward

SIGMA = 0.01
SCALE = 3e-4  # rad: about 0.2 mm at the target
ARM = load_robot("puma760")


def structure_of(draws: Array, rng: np.random.Generator) -> ErrorStructure:
    """The parts of a campaign whose joints are off by draws (m, n) [rad] that nothing records."""
    tool = np.array(OFF_AXIS)
    q = ARM.draw(rng, len(draws))
    position = forward(ARM, q + draws, tool) + rng.normal(0, SIGMA, (len(draws), 3))
    at = bind(ARM, build_measurements(q, position), OFF_AXIS)
    used = np.ones(len(draws), bool)
    fitted = fit(at, Model((mechanism("geometric", ARM),)))
    return find_structure(at, used, fitted, list_parts(at, used))


def draw_joints(joints: list[int], rng: np.random.Generator) -> Array:
    draws = np.zeros((120, ARM.n))
    for joint in joints:
        draws[:, joint - 1] = rng.normal(0, SCALE, len(draws))
    return draws


@seeds(1, 2, 3)
@pytest.mark.parametrize("count", [1, 2])
def test_few_joints_far_louder_than_the_instrument_have_their_size(
    rng: np.random.Generator, count: int
) -> None:
    joints = sorted(rng.choice(np.arange(1, 4), count, replace=False).tolist())
    instrument, *parts = structure_of(draw_joints(joints, rng), rng).parts
    assert sorted(part.name for part in parts) == [f"joint {joint}" for joint in joints]
    for part in parts:
        assert part.low / 1.25 < SCALE < part.high * 1.25
    assert 0 < instrument.low / 1.25 < SIGMA < instrument.high * 1.25


@seeds(1, 2)
def test_joints_that_explain_every_coordinate_leave_an_instrument_of_at_most_a_size(
    rng: np.random.Generator,
) -> None:
    """Three joints move the target in three directions: rows do not tell how quiet the instrument is."""
    instrument, *parts = structure_of(draw_joints([1, 2, 3], rng), rng).parts
    assert len(parts) == 3
    assert instrument.low == 0.0
    assert instrument.high > SIGMA


def test_targets_of_one_visit_move_as_one_body(rng: np.random.Generator) -> None:
    """Three targets have nine coordinates, of which joints and what a visit shares explain six at most."""
    visit = np.arange(24).repeat(3)
    joint = SharedError(rng.normal(size=(72, 3, 1)), visit, variance=1.0)
    shared = SharedError(rng.normal(size=(72, 3, 3)), visit, variance=1.0)
    assert _count_motions(joint) == 24 * 6
    assert _choose_most([joint, shared]) == MOST_OF_FEW
    assert _choose_most([joint, joint, shared]) == MOST_OF_ALL
    assert _choose_most([replace(joint, time=np.arange(72.0), length=3.0)]) == MOST_OF_ALL
