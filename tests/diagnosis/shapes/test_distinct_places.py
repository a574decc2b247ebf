"""Places that move every target alike are one place."""

from __future__ import annotations

import numpy as np
import pytest
from builders import drawn, seeds

from modelsel.diagnosis.candidates.candidate_list import build_candidates
from modelsel.diagnosis.shapes.distinct_places import find_frames
from modelsel.fitting.design import Model, assemble
from modelsel.mechanisms.causes import ONE
from modelsel.mechanisms.registry import mechanism
from modelsel.mechanisms.terms import Screw, Term
from modelsel.robot.files import load_robot

ARMS = ("puma760", "ur5", "irb120", "iiwa14", "ur10e")


@pytest.mark.parametrize("name", ARMS)
def test_the_motions_of_joints_stay(name: str) -> None:
    robot = load_robot(name)
    frames = find_frames(robot)
    assert {(j, "rz") for j in range(1, robot.n + 1)} <= frames.keys()
    # a shift along the first joint's axis is the same after it has turned
    assert frames[1, "tz"] == (1, 2)
    assert (2, "ty") not in frames
    assert all(place[0] in own for place, own in frames.items())
    assert find_frames(robot) is frames


@seeds(1, 2)
@pytest.mark.parametrize("name", ARMS)
def test_what_is_left_out_moves_as_what_stands_for_it(name: str, rng: np.random.Generator) -> None:
    """At configurations, a tool and a table's own errors that the comparison has not seen."""
    at = drawn(name, rng, 25)
    frames = find_frames(at.robot)
    left_out = [
        (frame, axis)
        for frame in range(1, at.robot.n + 2)
        for axis in ("tx", "ty", "tz", "rx", "ry", "rz")
        if (frame, axis) not in frames
    ]
    assert left_out
    terms = [Term("", (Screw(*place, ONE),)) for place in (*frames, *left_out)]
    columns = assemble(at, terms)[: len(terms)].reshape(len(terms), -1)
    unit = columns / np.maximum(np.linalg.norm(columns, axis=1, keepdims=True), 1e-12)
    alike = np.abs(unit[len(frames) :] @ unit[: len(frames)].T)
    assert alike.max(1) == pytest.approx(1.0, abs=1e-9)
    # those that stay differ from one another
    among = np.abs(unit[: len(frames)] @ unit[: len(frames)].T) - np.eye(len(frames))
    assert among.max() < 1 - 1e-3


@seeds(1)
def test_no_two_cells_are_one_motion(rng: np.random.Generator) -> None:
    at = drawn("ur5", rng, 30)
    base = Model((mechanism("geometric", at.robot),))
    labels = {one.label for one in build_candidates(at, base, ())}
    assert "frame 1 tz · torque2" in labels
    assert "frame 2 ty · torque2" not in labels
