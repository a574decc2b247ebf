"""Links that bend and joints that yield under masses that the robot file does not declare are not told as each
other: planted in exact positions, under masses drawn along the links."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from bent_links import Heavy, bend, draw_masses, line_of, load_by, place_target, without_masses
from builders import bind, seeds
from scipy.spatial.transform import Rotation
from searches import find_cause, search_separated

from modelsel._typing import Array
from modelsel.diagnosis.candidates.candidate_list import build_candidates
from modelsel.diagnosis.candidates.signatures import LEVELS, PROVEN
from modelsel.diagnosis.findings.outcome import Diagnosis
from modelsel.fitting.design import Model
from modelsel.fitting.problem import Problem
from modelsel.measurements.measurements import build_measurements
from modelsel.mechanisms.bending import OF_EACH, OF_EACH_TWISTED, OF_MAIN, OF_ONE, list_bendings
from modelsel.mechanisms.bodies import find_line_end, list_bodies, list_main_bodies, list_main_ends
from modelsel.mechanisms.registry import build_mechanisms, every, mechanism
from modelsel.robot.files import load_robot
from modelsel.robot.kinematics import Robot

NOISE_MM = 0.03
ROWS = 100
ARMS = ("irb1600", "puma760", "ur10e")
BENDING, COMPLIANCE = "link-bending", "joint-compliance"
TWISTS = ("joint2-twist", "joint3-twist", "gravity-twist")
Rng = np.random.Generator


def draw(rng: Rng, *names: str) -> tuple[Robot, Array, Array, Heavy]:
    """An arm without its masses, readings, a target, and the masses that the arm has."""
    arm = without_masses(load_robot(str(rng.choice(names or ARMS))))
    tool = np.array([60.0, -50.0, 90.0]) + rng.uniform(-20, 20, 3)
    return arm, arm.draw(rng, ROWS), tool, draw_masses(arm, tool, rng)


def declare_last(arm: Robot, heavy: Heavy) -> Robot:
    """The arm with the mass of its last link alone, as of a gripper that was weighed."""
    _, mass, where = heavy[-1]
    x, y, z = where.tolist()
    *others, last = arm.joints
    weighed = replace(last, mass=mass, com=(x, y, z))
    return replace(arm, joints=(*others, weighed))


def bend_link(arm: Robot, link: int, q: Array, tool: Array, heavy: Heavy) -> Array:
    """How the target moves where one link bends as a tube, with a compliance of 1e-6."""
    end, moment, force = load_by(arm, link + 1, q, heavy)
    turn, shift = bend(line_of(arm, link), moment, force, 1.3)
    axes = end[:, :3, :3]
    turned = Rotation.from_rotvec(1e-6 * np.einsum("mij,mj->mi", axes, turn))
    lever = place_target(arm, q, tool) - end[:, :3, 3]
    moved = turned.apply(lever) - lever + 1e-6 * np.einsum("mij,mj->mi", axes, shift)
    return np.asarray(moved)


def wind_up(arm: Robot, joints: dict[int, float], q: Array, tool: Array, heavy: Heavy) -> Array:
    """How the target moves where joints yield to their torque, with compliances of so many 1e-6."""
    wound = q.copy()
    for joint, share in joints.items():
        _, moment, _ = load_by(arm, joint, q, heavy)
        wound[:, joint - 1] += 1e-6 * share * moment[:, 2]
    return place_target(arm, wound, tool) - place_target(arm, q, tool)


def diagnose(arm: Robot, q: Array, tool: Array, moved: Array, rng: Rng) -> Diagnosis:
    """Diagnose an arm whose target moves like this, five to eight times as far as the noise."""
    noise = rng.normal(0, NOISE_MM, (ROWS, 3))
    size = rng.uniform(5, 8) * NOISE_MM * np.sqrt(3)
    shifted = moved * size / np.sqrt(np.square(moved).sum(1).mean())
    at = bind(arm, build_measurements(q, place_target(arm, q, tool) + shifted + noise), tool)
    base = Model((mechanism("geometric", arm),))
    return search_separated(at, base, build_candidates(at, base, every(arm)))


def list_causes(diagnosis: Diagnosis) -> list[str]:
    """The names that are claimed as causes, without their joints."""
    claimed = []
    for effect in diagnosis.effects:
        assert effect.claim is not None
        if effect.claim.levels[LEVELS.index("cause")] >= PROVEN:
            claimed.append(effect.candidate.mechanism.stem)
    return claimed


@pytest.mark.slow
@seeds(1, 2, 3)
def test_a_link_that_bends_under_masses_that_are_not_declared_is_told(rng: Rng) -> None:
    """The upper arm or the forearm: no joint is blamed for it."""
    arm, q, tool, heavy = draw(rng)
    link = int(rng.integers(2, 4))
    moved = bend_link(arm, link, q, tool, heavy)
    find_cause(diagnose(arm, q, tool, moved, rng), f"{BENDING}:{link}")


@pytest.mark.slow
@seeds(1, 2, 3)
def test_a_link_that_bends_is_told_where_one_mass_is_declared(rng: Rng) -> None:
    """It is told once, and no joint is blamed for it."""
    arm, q, tool, heavy = draw(rng)
    weighed = declare_last(arm, heavy)
    link = int(rng.integers(2, 4))
    moved = bend_link(arm, link, q, tool, heavy)
    diagnosis = diagnose(weighed, q, tool, moved, rng)
    assert list_causes(diagnosis) == [BENDING]
    bent = [one for one in diagnosis.effects if one.candidate.mechanism.stem == BENDING]
    assert [one.candidate.mechanism.joint for one in bent] == [link]


@pytest.mark.slow
@seeds(1, 2)
def test_a_column_that_bends_is_not_told_as_the_shoulder(rng: Rng) -> None:
    """At most both are: what the joint at its end does may be alike."""
    arm, q, tool, heavy = draw(rng)
    moved = bend_link(arm, 1, q, tool, heavy)
    causes = list_causes(diagnose(arm, q, tool, moved, rng))
    assert set(causes) <= {BENDING}


@pytest.mark.slow
@seeds(1, 2)
def test_joints_that_yield_to_masses_that_are_not_declared_keep_their_causes(rng: Rng) -> None:
    arm, q, tool, heavy = draw(rng, "irb1600", "ur10e")
    joints = {2: 1.0, 3: float(rng.uniform(0.8, 2.0))}
    moved = wind_up(arm, joints, q, tool, heavy)
    causes = list_causes(diagnose(arm, q, tool, moved, rng))
    assert set(causes) <= {COMPLIANCE, *TWISTS}
    assert causes


def twist_of(at: Problem, link: int, number: int) -> Array:
    """What each number of a form of a link does to its end: (k, 6 m)."""
    one = build_mechanisms(f"{BENDING}:{link}:{number}", at.robot)[0]
    every_term = []
    for term in one.terms:
        done = {axis: np.zeros(len(at)) for axis in ("rx", "ry", "rz", "tx", "ty", "tz")}
        for screw in term.screws:
            assert screw.frame == link + 1
            done[screw.axis] = done[screw.axis] + at.cause(screw.cause)
        every_term.append(np.concatenate(list(done.values())))
    return np.stack(every_term)


@seeds(1)
@pytest.mark.parametrize("name", ARMS)
@pytest.mark.parametrize(("number", "twist"), [(OF_EACH, 1.3), (OF_EACH_TWISTED, 0.4)])
def test_masses_anywhere_along_the_links_weigh_as_masses_at_the_joints(
    name: str, number: int, twist: float, rng: Rng
) -> None:
    arm, q, tool, heavy = draw(rng, name)
    at = bind(arm, build_measurements(q, np.zeros((ROWS, 3))), tool)
    for link in range(1, 4):
        _, moment, force = load_by(arm, link + 1, q, heavy)
        turn, shift = bend(line_of(arm, link), moment, force, twist)
        moved = np.hstack([turn, shift]).T.ravel()
        columns = twist_of(at, link, number).T
        if link == 1:
            # what is the same in every posture, as a mass at the shoulder is, is an error of its geometry
            constant = np.repeat(np.eye(6), ROWS, axis=0)
            columns = np.hstack([columns, constant])
        numbers, *_ = np.linalg.lstsq(columns, moved)
        np.testing.assert_allclose(columns @ numbers, moved, atol=1e-4 * np.abs(moved).max())


@pytest.mark.parametrize("weighed", [False, True])
def test_a_link_bends_under_masses_that_are_not_known_where_one_is_not_declared(
    weighed: bool,
) -> None:
    """And not the links of the wrist; `weighed`: the last link alone."""
    declared = load_robot("ur10e")
    arm = without_masses(declared)
    if weighed:
        arm = replace(arm, joints=(*arm.joints[:-1], declared.joints[-1]))
    unknown = {OF_EACH, OF_MAIN, OF_EACH_TWISTED}
    for link in range(1, arm.n):
        assert not unknown & set(list_bendings(declared, link))
        of_link = unknown & set(list_bendings(arm, link))
        assert of_link == (unknown if link < 4 else set())
        assert OF_ONE not in list_bendings(arm, link)
        built = build_mechanisms(f"{BENDING}:{link}", arm)
        assert len(built) == len(list_bendings(arm, link))
        for one in built:
            assert all(term.screws for term in one.terms)


def test_masses_sit_where_lines_between_joints_bend() -> None:
    """Frame 4 of this arm is on its forearm, between the elbow and the wrist; above its upright joint 1, a mass
    at the shoulder bends nothing."""
    arm = load_robot("irb1600")
    assert list_main_ends(arm) == [2, 3, 5]
    assert list_bodies(arm, 1) == (3, 5, 6, 7)
    assert list_main_bodies(arm, 1) == (3, 5)
    assert list_bodies(arm, 2) == (3, 5, 6, 7)
    assert list_main_bodies(arm, 2) == (3, 5)
    assert list_bodies(arm, 3) == (4, 5, 6, 7)
    assert list_main_bodies(arm, 3) == (4, 6)
    assert list_main_bodies(arm, 5) == ()
    assert [find_line_end(arm, link) for link in range(1, 6)] == [2, 3, 5, 5, 6]
    assert [link for link in range(1, 6) if OF_ONE in list_bendings(arm, link)] == [3]


def test_of_many_masses_that_at_the_end_itself_has_no_sign() -> None:
    """Masses beside the lines between the joints may have more moment than at these."""
    arm = without_masses(load_robot("ur10e"))
    signs = {}
    for number in (OF_EACH, OF_MAIN, OF_EACH_TWISTED):
        (one,) = build_mechanisms(f"{BENDING}:2:{number}", arm)
        signs[number] = {term.symbol: term.sign for term in one.terms}
    assert signs[OF_EACH] == {"b2m3": 0, "b2m4": 1, "b2m5": 1, "b2m6": 1, "b2m7": 1}
    assert signs[OF_MAIN] == {"b2m3": 1, "b2m4": 1}
    # what weighs at the end itself does not twist
    twisting = {symbol for symbol in signs[OF_EACH_TWISTED] if symbol.startswith("w")}
    assert twisting == {"w2m4", "w2m5", "w2m6", "w2m7"}
