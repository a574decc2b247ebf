"""Gravity that points elsewhere is seen in how the joints wind up; what else moves them asks for none."""

from __future__ import annotations

import numpy as np
import pytest
from builders import OFF_AXIS, bind, seeds
from exact import flanges, flanges_of

from modelsel.fitting.design import Model
from modelsel.fitting.least_squares import fit
from modelsel.fitting.problem import Problem
from modelsel.measurements.measurements import build_measurements
from modelsel.mechanisms.causes import Named, cos, sin
from modelsel.mechanisms.registry import mechanism
from modelsel.mechanisms.terms import Mechanism, Screw, Term
from modelsel.notices import Note
from modelsel.robot.files import load_robot
from modelsel.robot.kinematics import Robot
from modelsel.setup.other_gravity import OtherGravity, find_other_gravity
from modelsel.study.preparation.gravity_direction import UPWARDS, note_other_gravity

ROWS = 100
STEP = 1e-5


def potential(robot: Robot, q: np.ndarray, gravity: np.ndarray) -> np.ndarray:
    """(m,) potential energy of 1 kg at every frame's origin, by the exact chain, N m."""
    before = [joint.before for joint in robot.joints]
    energy = np.zeros(len(q))
    for k in range(1, robot.n + 1):
        frames = flanges(before[:k], [False] * k, np.eye(4), q[:, :k])
        energy -= 9.81e-3 * frames[:, :3, 3] @ gravity
    return energy


def torques(robot: Robot, q: np.ndarray, gravity: np.ndarray) -> np.ndarray:
    """(m, n) torques that gravity has about the joints, by differences of the energy."""
    out = np.empty_like(q)
    for j in range(robot.n):
        step = STEP * np.eye(robot.n)[j]
        higher = potential(robot, q + step, gravity)
        lower = potential(robot, q - step, gravity)
        out[:, j] = -(higher - lower) / (2 * STEP)
    return out


def measure(robot: Robot, moved: np.ndarray, q: np.ndarray, rng: np.random.Generator) -> Problem:
    """Positions of joints that stand elsewhere than they read."""
    flange = flanges_of(robot, q + moved)
    position = flange[:, :3, 3] + flange[:, :3, :3] @ np.array(OFF_AXIS)
    position += rng.normal(0, 0.03, position.shape)
    return bind(robot, build_measurements(q, position))


def look(at: Problem) -> OtherGravity | None:
    return find_other_gravity(at, fit(at, Model((mechanism("geometric", at.robot),))))


@pytest.mark.unit
@seeds(1, slow=(2, 3))
@pytest.mark.parametrize("name", ["ur5e", "irb120", "irb1600"])
def test_a_direction_far_from_the_assumed_one_is_found(name: str, rng: np.random.Generator) -> None:
    robot = load_robot(name)
    q = robot.draw(rng, ROWS)
    assumed = np.array(robot.gravity)
    direction = rng.normal(size=3)
    direction -= (0.5 + direction @ assumed) * assumed  # 90 degrees and more from it
    direction /= np.linalg.norm(direction)
    moved = torques(robot, q, direction)
    # from the shoulder on, as all joints of a kind yield: 0.3 mrad rms
    moved *= [0, 1, 1, 0, 0, 0]
    moved *= 3e-4 / np.sqrt(np.square(moved[:, 1:3]).mean())
    found = look(measure(robot, moved, q, rng))
    assert found is not None
    assert np.degrees(np.arccos(found.direction @ direction)) < 8.0
    assert set(found.joints) & {2, 3}


@pytest.mark.unit
@seeds(1, 2, 3)
@pytest.mark.parametrize("what", ["gravity as assumed", "uneven gears", "nothing"])
def test_nothing_else_asks_for_another_direction(what: str, rng: np.random.Generator) -> None:
    robot = load_robot("ur5e")
    q = robot.draw(rng, ROWS)
    moved = np.zeros_like(q)
    if what == "gravity as assumed":
        moved[:, 1:3] = 1.5e-5 * torques(robot, q, np.array(robot.gravity))[:, 1:3]
    elif what == "uneven gears":
        moved = rng.uniform(1e-4, 4e-4, robot.n) * np.sin(q + rng.uniform(0, 6, robot.n))
    assert look(measure(robot, moved, q, rng)) is None


@pytest.mark.unit
def test_what_the_study_states_is_not_questioned(rng: np.random.Generator) -> None:
    robot = load_robot("ur5e")
    q = robot.draw(rng, ROWS)
    sideways = np.array([1.0, 0.0, 0.0])
    moved = 2e-5 * torques(robot, q, sideways) * [0, 1, 1, 0, 0, 0]
    at = measure(robot, moved, q, rng)
    fitted = fit(at, Model((mechanism("geometric", robot),)))
    (note,) = note_other_gravity(at, fitted, (), fitted, [], is_stated=False)
    assert "as if gravity were [1, 0, 0] in the robot's base frame, not [0, 0, -1]" in note.sentence
    assert not note_other_gravity(at, fitted, (), fitted, [], is_stated=True)
    assert not note_other_gravity(at, fitted, (), fitted, [Note(UPWARDS, "")], is_stated=False)


@pytest.mark.unit
@seeds(1, slow=(2, 3))
@pytest.mark.parametrize("is_elsewhere", [False, True])
def test_it_is_asked_beside_what_was_found(is_elsewhere: bool, rng: np.random.Generator) -> None:
    """A joint that turns too little resembles one that winds up against the weight: beside the base
    alone both ask for another direction, beside the joint's scale only where it is another."""
    robot = load_robot("irb1600")
    q = robot.draw(rng, ROWS)
    direction, joints, size, scale = (0, 0, -1), [2], 1e-4, 1e-3
    if is_elsewhere:
        direction, joints, size, scale = (1, 0, 0), [1, 2], 3e-4, 4e-4
    moved = np.zeros_like(q)
    moved[:, joints] = torques(robot, q, np.array(direction, float))[:, joints]
    moved *= rng.uniform(0.7, 1.0) * size / np.sqrt(np.square(moved[:, joints]).mean())
    moved[:, 1] -= rng.uniform(0.7, 1.0) * scale * q[:, 1]
    at = measure(robot, moved, q, rng)
    fitted = fit(at, Model((mechanism("geometric", robot),)))
    found = (mechanism("encoder-scale:2", robot), mechanism("joint-compliance:3", robot))
    assert note_other_gravity(at, fitted, (), fitted, [], is_stated=False)
    assert bool(note_other_gravity(at, fitted, found, fitted, [], is_stated=False)) == is_elsewhere


def turn_axis_1(robot: Robot, q: np.ndarray, twist: np.ndarray) -> np.ndarray:
    """(m, 3) how far an axis 1 that turns about x and y of its frame (m, 2) moves the target."""
    before = robot.joints[0].before
    flange = flanges_of(robot, q)
    place = flange[:, :3, 3] + flange[:, :3, :3] @ np.array(OFF_AXIS)
    about = np.column_stack([twist, np.zeros(len(q))]) @ before[:3, :3].T
    return np.cross(about, place - before[:3, 3])


@pytest.mark.unit
@seeds(1, slow=(2, 3))
@pytest.mark.parametrize("name", ["irb120", "puma760"])
@pytest.mark.parametrize("is_elsewhere", [False, True])
def test_what_explains_the_data_better_asks_for_no_other_gravity(
    is_elsewhere: bool, name: str, rng: np.random.Generator
) -> None:
    """An axis 1 that wobbles twice a turn resembles joints that wind up against another direction; told
    as that, it asks for none. Of joints that do wind up against one it explains too little."""
    robot = load_robot(name)
    drawn = robot.draw(rng, 8 * ROWS)
    place = flanges_of(robot, drawn)[:, :3, 3]
    ahead = (np.abs(drawn[:, 1:3]) < 1.25).all(1) & (place[:, 2] > 150)
    q = drawn[ahead & (np.hypot(place[:, 0], place[:, 1]) > 250)][:ROWS]
    moved = np.zeros_like(q)
    wobble = np.zeros((len(q), 2))
    if is_elsewhere:
        moved[:, 1:3] = torques(robot, q, np.array([1.0, 0.0, 0.0]))[:, 1:3]
        moved *= 4e-4 / np.sqrt(np.square(moved[:, 1:3]).mean())
    else:
        angle = 2 * q[:, 0] + rng.uniform(0, 6)
        wobble = 4e-4 * np.column_stack([np.cos(angle), np.sin(angle)])
    stands = measure(robot, moved, q, rng)
    position = stands.data.position + turn_axis_1(robot, q, wobble)
    at = bind(robot, build_measurements(q, position))
    geometric = mechanism("geometric", robot)
    base = fit(at, Model((geometric,)))
    twice = 2.0 * Named("q1", "rad")
    waves = [Screw(1, axis, wave) for axis in ("rx", "ry") for wave in (sin(twice), cos(twice))]
    told = Mechanism("told", tuple(Term(f"w{k}", (wave,)) for k, wave in enumerate(waves)))
    explained = fit(at, Model((geometric, told)))
    assert note_other_gravity(at, base, (), base, [], is_stated=False)
    assert bool(note_other_gravity(at, base, (), explained, [], is_stated=False)) == is_elsewhere
