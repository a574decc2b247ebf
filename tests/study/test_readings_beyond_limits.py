"""Readings beyond a joint's limits: counted, and no part of the share of its range."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from modelsel.calibration.commands.command_notes import find_past_limits
from modelsel.measurements.measurements import build_measurements
from modelsel.robot.files import load_robot
from modelsel.robot.kinematics import forward
from modelsel.study.inspection.inspection import inspect_measurements
from modelsel.study.inspection.inspection_text import format_inspection


@pytest.mark.slow
def test_a_share_of_the_range_counts_what_lies_within_the_limits(rng: np.random.Generator) -> None:
    robot = load_robot("irb120")  # joint 3: -110 to 70 deg
    q = rng.uniform(-0.5, 0.5, (20, 6))
    q[0, 2], q[1, 2] = np.radians([-20.0, 100.0])
    q[2:, 2] = 0.3
    found = inspect_measurements(robot, build_measurements(q, np.zeros((20, 3))))
    (line,) = [line for line in format_inspection(found) if line.startswith("Joint 3")]
    assert (
        "-20.0 to 100.0 deg, 50 % of its range; 1 row (row 1, counted from 0) lies beyond its limits"
        in line
    )
    assert ", -110 to 70 deg: check the joint's zero" in line


@pytest.mark.parametrize(("past", "is_beyond"), [(1e-7, False), (1e-5, True)])
def test_check_and_compensate_agree_on_a_reading_at_the_limit(
    past: float, is_beyond: bool, rng: np.random.Generator
) -> None:
    robot = load_robot("irb120")
    q = rng.uniform(-0.5, 0.5, (20, 6))
    _, high = robot.joints[2].limits
    q[4, 2] = high + past
    position = forward(robot, q, np.array([40.0, 0.0, 120.0]))
    inspected = inspect_measurements(robot, build_measurements(q, position))
    commands = find_past_limits(SimpleNamespace(robot=robot), q)
    assert inspected["joints"][2]["rows_beyond_limits"] == is_beyond
    assert commands[4, 2] == is_beyond
    assert commands.sum() == is_beyond
