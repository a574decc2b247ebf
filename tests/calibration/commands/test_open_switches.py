"""An error that switches with a gravity torque of masses that nobody declared: commands reckon with where it may
switch."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from builders import planted, seeds

from modelsel.calibration.calibration import Calibration, calibrate
from modelsel.calibration.commands.compensation import compensate_commands
from modelsel.calibration.commands.open_switches import count_open_switches
from modelsel.fitting.design import Model
from modelsel.fitting.least_squares import fit
from modelsel.fitting.noise import Floor
from modelsel.fitting.problem import Problem
from modelsel.measurements.measurements import build_measurements
from modelsel.mechanisms.causes import sign, torque
from modelsel.mechanisms.terms import Mechanism, Screw, Term
from modelsel.robot.files import load_robot
from modelsel.robot.gravity import declares_masses
from modelsel.robot.kinematics import Robot, forward
from modelsel.selection.evaluation import Split

TOOL = np.array([40.0, -25.0, 100.0])
NOISE_MM, STEP_RAD = 0.02, 1e-3
ROWS, JOINT = 80, 3
SWITCH = Mechanism("switch", (Term("s", (Screw(JOINT, "rz", sign(torque(JOINT))),)),), "", "", "")
Rng = np.random.Generator


def calibrate_switch(arm: Robot, rng: Rng) -> Calibration:
    """A calibration of an arm whose joint steps with its gravity torque."""
    data = build_measurements(arm.draw(rng, ROWS), np.zeros((ROWS, 3)))
    at = planted(Problem(arm, data, TOOL[None]), SWITCH.terms, np.array([STEP_RAD]), rng, NOISE_MM)
    every = np.ones(ROWS, bool)
    split = Split(at, every, ~every, np.zeros(ROWS, np.intp), True)
    fitted = fit(at, Model((SWITCH,)))
    return calibrate("switch", split, fitted, Floor(NOISE_MM, "stated"), None, False, {})


def without_masses(name: str) -> Robot:
    robot = load_robot(name)
    return replace(robot, joints=tuple(replace(joint, mass=None) for joint in robot.joints))


@seeds(1, 2, 3)
def test_where_nothing_is_reckoned_with_no_masses_switch(rng: Rng) -> None:
    """Whatever masses sit at the later frames, rows without a variance stay on their side; where masses switch
    it, the whole step is reckoned with as often as they do."""
    arm = without_masses(str(rng.choice(["ur5e", "puma760", "irb120"])))
    c = calibrate_switch(arm, rng)
    q = arm.draw(rng, 400)
    at = Problem(arm, build_measurements(q, np.zeros((400, 3))), TOOL[None])
    variance = count_open_switches(c, at)
    bodies = range(JOINT + 1, arm.n + 2)
    alone = np.array([at.value(f"torque{JOINT}_{body}") for body in bodies])
    side = np.sign(at.value(f"torque{JOINT}"))
    weights = rng.exponential(size=(500, len(alone)))
    switched = np.sign(weights @ alone) != side
    sure = variance == 0
    assert not switched[:, sure].any()
    assert switched[:, ~sure].any()
    # the whole step, by exact kinematics
    moved = q.copy()
    moved[:, JOINT - 1] += 2 * float(c.theta[0])
    square = np.square(forward(arm, moved, TOOL) - forward(arm, q, TOOL)).sum(1)
    share = (np.sign(alone) != side).mean(0)
    np.testing.assert_allclose(variance, share * square, rtol=1e-2, atol=1e-9)


def test_commands_are_expected_to_be_off_by_it(rng: Rng) -> None:
    arm = without_masses("ur5e")
    c = calibrate_switch(arm, rng)
    q = arm.draw(rng, 200)
    commands = compensate_commands(c, build_measurements(q, np.full((200, 3), np.nan)))
    at = Problem(arm, build_measurements(commands.q, np.zeros((200, 3))), TOOL[None])
    variance = count_open_switches(c, at)
    is_open = variance > 0
    assert is_open.any()
    assert (commands.expected_mm[is_open] >= np.sqrt(variance[is_open])).all()
    assert commands.expected_mm[~is_open].max() < 3 * NOISE_MM


def test_declared_masses_leave_nothing_open(rng: Rng) -> None:
    arm = load_robot("ur5e")
    masses = [12.0, 9.0, 4.0, 2.0, 2.0, 0.5]
    joints = [replace(one, mass=mass) for one, mass in zip(arm.joints, masses, strict=True)]
    heavy = replace(arm, joints=tuple(joints))
    assert declares_masses(heavy)
    c = calibrate_switch(heavy, rng)
    at = Problem(heavy, build_measurements(heavy.draw(rng, 50), np.zeros((50, 3))), TOOL[None])
    assert not count_open_switches(c, at).any()
