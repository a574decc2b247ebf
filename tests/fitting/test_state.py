"""State variables: one table of names, and values that never outlive what they depend on."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from builders import drawn
from scipy.spatial.transform import Rotation

from modelsel.exceptions import StudyError
from modelsel.fitting.design import residuals
from modelsel.fitting.problem import Problem
from modelsel.measurements.campaign.state_names import (
    covariate_unit,
    is_state_name,
    parse_state_name,
    state_units,
)
from modelsel.measurements.measurements import Orientation, build_measurements
from modelsel.mechanisms.causes import Named, q, torque
from modelsel.robot.files import load_robot
from modelsel.robot.kinematics import forward, pose

NAMES = (
    "q2",
    "approach3",
    "move1",
    "drag2_250",
    "range_mm",
    "beam_azimuth",
    "beam_rise_x",
    "beam_face_z",
    "reach_mm",
    "x_mm",
    "on_flange_y_mm",
    "load_on_flange_y_mm",
    "load_x_mm",
    "down3_x",
    "torque2",
    "moment_y",
    "moment2_x_3",
)


def test_every_name_of_the_table_is_read_back_as_it_was_written() -> None:
    robot = load_robot("puma760")
    for name, unit in state_units(robot).items():
        variable = parse_state_name(name)
        assert variable is not None
        assert (variable.name, variable.unit(robot)) == (name, unit)
    assert not any(map(is_state_name, ("payload_kg", "temperature_C", "quality", "q", "moment2")))


def test_every_name_has_values_and_no_other_name_has(rng) -> None:
    at = drawn("puma760", rng, 20)
    for name in at.names():
        assert at.value(name).shape == (20,)
    for name in ("q7", "torque3_3", "moment9_x", "down_w", "humidity"):
        with pytest.raises(StudyError, match="the model depends on "):
            at.value(name)


@pytest.mark.parametrize("change", ["placement", "tools", "data", "tracker", "robot"])
def test_a_changed_problem_carries_no_stale_value(rng, change: str) -> None:
    at = drawn("puma760", rng, 20)
    changes = {
        "placement": (at.placement[0], at.placement[1] + 1000.0),
        "tools": at.tools + np.array([0.0, 50.0, 0.0]),
        "data": build_measurements(at.data.q + 0.1, at.data.position),
        "tracker": (1000.0, 0.0, 0.0),
        "robot": load_robot("ur5"),
    }
    causes = [*map(Named, NAMES), q(2), torque(2)]
    before = [at.cause(cause) for cause in causes]
    changed = replace(at, **{change: changes[change]})
    fresh = type(at)(changed.robot, changed.data, changed.tools, changed.placement)
    fresh = replace(fresh, tracker=changed.tracker)
    after = [changed.cause(cause) for cause in causes]
    np.testing.assert_array_equal(after, [fresh.cause(cause) for cause in causes])
    assert not np.array_equal(before, after)


def test_the_angles_of_the_beam_and_where_they_turn_it(rng) -> None:
    """By polar coordinates in the instrument's frame, and differences of positions there."""
    at = drawn("puma760", rng, 20)
    turn = Rotation.from_rotvec(rng.normal(0, 1, 3)).as_matrix()
    stand = np.array([2500.0, -900.0, 400.0])
    at = replace(at, placement=(turn[None], stand[None]), tracker=(100.0, 200.0, -300.0))
    reached = pose(at.robot, at.data.q, at.tools[at.data.target])
    line = reached.target.T @ turn.T + stand - np.array(at.tracker)
    far = np.linalg.norm(line, axis=1)
    azimuth, zenith = np.arctan2(line[:, 1], line[:, 0]), np.arccos(line[:, 2] / far)

    def place(r: np.ndarray, h: np.ndarray, v: np.ndarray) -> np.ndarray:
        return np.stack([r * np.sin(v) * np.cos(h), r * np.sin(v) * np.sin(h), r * np.cos(v)], 1)

    def value(stem: str) -> np.ndarray:
        return np.stack([at.value(f"{stem}_{axis}") for axis in "xyz"], 1)

    np.testing.assert_allclose(at.value("beam_azimuth"), azimuth, atol=1e-12)
    np.testing.assert_allclose(at.value("beam_zenith"), zenith, atol=1e-12)
    step = 1e-6
    aside = place(far, azimuth + step, zenith) - place(far, azimuth - step, zenith)
    aside /= 2 * step * (far * np.sin(zenith))[:, None]
    rise = place(far, azimuth, zenith - step) - place(far, azimuth, zenith + step)
    rise /= 2 * step * far[:, None]
    np.testing.assert_allclose(value("beam_aside"), aside @ turn, atol=1e-8)
    np.testing.assert_allclose(value("beam_rise"), rise @ turn, atol=1e-8)
    beam = line @ turn / far[:, None]
    face = np.einsum("aim,mi->ma", reached.axes[-1, :3], beam)
    np.testing.assert_allclose(value("beam_face"), face, atol=1e-12)


def test_what_does_not_depend_on_a_change_is_not_evaluated_again(rng) -> None:
    at = drawn("puma760", rng, 20)
    values = at.value("torque2")
    moved = replace(at, data=replace(at.data, position=at.data.position + 1.0))
    assert moved.value("torque2") is values
    assert np.array_equal(at.take(slice(3, 9)).value("torque2"), values[3:9])


def test_a_problem_needs_the_robot_the_measurements_and_the_tools(rng) -> None:
    robot = load_robot("puma760")
    q_rad = robot.draw(rng, 12)
    data = build_measurements(
        q_rad,
        np.zeros((12, 3)),
        target=["a", "b", "c"] * 4,
        group=["x"] * 6 + ["y"] * 6,
        orientation=Orientation(np.tile(np.eye(3), (12, 1, 1))),
    )
    problem = Problem(robot, data, tools=[[0, 0, 100]])  # type: ignore[arg-type]
    assert problem.tools.shape == (3, 3)
    assert problem.placement[0].shape == (2, 3, 3)
    assert np.array_equal(problem.tool_rotations, np.tile(np.eye(3), (3, 1, 1)))
    assert residuals(problem).shape == (12, 6)
    with pytest.raises(ValueError, match="expected \\(3, 3\\)"):
        Problem(robot, data, tools=np.zeros((2, 3)))


@pytest.mark.parametrize(
    ("name", "unit"),
    [
        ("temperature_C", "°C"),
        ("flow_l", "flow_l"),
        ("kg", "kg"),
        ("qd3_rad_per_s", "rad/s"),
        ("speed_mm_per_s", "mm/s"),
        ("pumped_l_per_s", "pumped_l_per_s"),
        ("turns_per_s", "turns_per_s"),
        ("rad_per_s", "rad_per_s"),
    ],
)
def test_a_covariate_has_the_unit_at_its_end(name, unit) -> None:
    assert covariate_unit(name) == unit


@pytest.mark.parametrize("name", ["puma760", "ur5e"])
def test_what_an_arm_carries_does_not_depend_on_the_target_that_is_seen(name, rng) -> None:
    """At rest it has one gravity torque, of what hangs at the mean of its targets."""
    robot = load_robot(name)
    tools = rng.uniform(-150, 150, (3, 3)) + np.array([0.0, 0.0, 100.0])
    q = robot.draw(rng, 20)
    rows = np.repeat(q, 3, axis=0)
    target = np.tile(["a", "b", "c"], 20)
    data = build_measurements(rows, np.zeros((60, 3)), target=target)
    at = Problem(robot, data, tools)
    alone = Problem(robot, build_measurements(q, np.zeros((20, 3))), tools.mean(0))
    for state in ("torque2", "torque2_7", "moment3_x", "moment_y"):
        by_posture = at.value(state).reshape(20, 3)
        np.testing.assert_array_equal(by_posture, np.repeat(by_posture[:, :1], 3, axis=1))
        np.testing.assert_allclose(by_posture[:, 0], alone.value(state), atol=1e-9)
        # rows of one target have what they had among the others
        some = at.take(target == "b")
        np.testing.assert_allclose(some.value(state), alone.value(state), atol=1e-9)


@pytest.mark.parametrize("name", ["puma760", "ur5e"])
def test_a_payload_hangs_where_the_robot_says(name, rng) -> None:
    """Its torque is that of 1 kg there, whatever the targets are, and is in proportion to the lever."""
    place = rng.uniform(-300, 300, 3)
    robot = replace(load_robot(name), payload_at_mm=tuple(place.tolist()))
    q = robot.draw(rng, 20)
    tools = rng.uniform(-150, 150, (1, 3))
    at = Problem(robot, build_measurements(q, np.zeros((20, 3))), tools)
    where = forward(robot, q, place)
    found = np.array([at.value(f"load_{axis}_mm") for axis in "xyz"]).T
    np.testing.assert_allclose(found, where, atol=1e-9)
    # by moving each joint a little: a weight's torque is minus the slope of its potential energy
    step = 1e-6
    for joint in range(1, robot.n + 1):
        moved = q.copy()
        moved[:, joint - 1] += step
        rise = forward(robot, moved, place)[:, 2] - where[:, 2]
        np.testing.assert_allclose(
            at.value(f"torque{joint}_{robot.n + 1}"), -9.81 * rise / 1e3 / step, atol=1e-4
        )
