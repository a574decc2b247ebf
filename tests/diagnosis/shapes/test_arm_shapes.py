"""Shapes of more than one joint's own reading, and simple shapes that stand against a finding."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from builders import drawn, planted, seeds, small_arm

from modelsel import diagnose
from modelsel.diagnosis.candidates.candidate import Candidate
from modelsel.diagnosis.rivals.finer_waves import generate_finer_waves
from modelsel.diagnosis.rivals.simple_shapes import generate_products, generate_pulls, generate_saws
from modelsel.diagnosis.rivals.unlisted_shapes import UNLISTED_ODDS, list_rivals
from modelsel.diagnosis.shapes.arm_shapes import generate_arm_shapes
from modelsel.diagnosis.shapes.candidate_kinds import CandidateKind
from modelsel.diagnosis.shapes.shape_constants import find_own_wave
from modelsel.diagnosis.shapes.slide_waves import build_pitch_wave
from modelsel.diagnosis.shapes.unregistered import Unregistered, build_cell, build_wave
from modelsel.fitting.problem import Problem
from modelsel.measurements.measurements import build_measurements
from modelsel.mechanisms.causes import Applied, Named, cos, q, sin
from modelsel.mechanisms.registry import mechanism
from modelsel.mechanisms.terms import Mechanism
from modelsel.robot.files import load_robot
from modelsel.robot.kinematics import forward

ROBOTS = ("puma760", "ur5", "irb120")


def shapes_of(problem: Problem, kind: CandidateKind) -> list[Unregistered]:
    return [one for one in generate_arm_shapes(problem) if one.kind is kind]


def place_of(mechanism: Mechanism) -> tuple[int, str]:
    (place,) = mechanism.names_by_place()
    return place


@pytest.mark.parametrize("robot", ROBOTS)
def test_the_reach_is_how_far_the_target_is_from_the_upright_first_axis(
    robot: str, rng: np.random.Generator
) -> None:
    at = drawn(robot, rng, 20)
    x, y, _ = forward(at.robot, at.data.q, at.tools[0]).T
    np.testing.assert_allclose(at.value("reach_mm"), np.hypot(x, y), atol=1e-9)


def test_the_reach_is_counted_from_an_axis_wherever_it_is(rng: np.random.Generator) -> None:
    """Neither a turn about axis 1 nor a shift of the arm along or across it changes the reach."""
    at = drawn("puma760", rng, 20)
    turned = at.data.q + np.eye(6)[0]
    first = at.robot.joints[0]
    moved = first.before.copy()
    moved[:3, 3] += (120.0, -40.0, 300.0)
    joints = (replace(first, before=moved), *at.robot.joints[1:])
    data = build_measurements(turned, at.data.position)
    elsewhere = Problem(replace(at.robot, joints=joints), data, at.tools)
    np.testing.assert_allclose(elsewhere.value("reach_mm"), at.value("reach_mm"), atol=1e-9)


@pytest.mark.parametrize("robot", ROBOTS)
def test_the_reach_acts_once_at_the_base_and_at_the_column(
    robot: str, rng: np.random.Generator
) -> None:
    at = drawn(robot, rng, 40)
    found = shapes_of(at, CandidateKind.REACH)
    assert {place_of(one.mechanism)[0] for one in found} == {1, 2}
    assert all(one.mechanism.names() == {"reach_mm"} for one in found)
    places = {place_of(one.mechanism) for one in found}
    assert len(found) == 3 * len(places)
    # shifts along axis 1 are those of the base alone
    upright = np.argmax(np.abs(at.robot.joints[1].before[2, :3]))
    assert len(places) == 11
    assert (2, f"t{'xyz'[upright]}") not in places


def test_a_joint_is_pulled_by_its_neighbours_where_data_are_on_either_side(
    rng: np.random.Generator,
) -> None:
    at = drawn("puma760", rng, 40)
    found = shapes_of(at, CandidateKind.PULL)
    pairs = {(place_of(one.mechanism)[0], *one.mechanism.names()) for one in found}
    neighbours = {(j, f"q{k}") for j in range(1, 7) for k in (j - 1, j + 1) if 1 <= k <= 6}
    assert pairs == neighbours
    for one in found:
        values = np.asarray(one.mechanism.terms[0].screws[0].cause.of(at.state))
        assert (values >= 0).all()
        assert 4 <= (values == 0).sum() <= 36
    still = at.data.q.copy()
    still[3:, 1] = still[0, 1]
    resting = replace(at, data=replace(at.data, q=still))
    pulled = shapes_of(resting, CandidateKind.PULL)
    assert all("q2" not in one.mechanism.names() for one in pulled)


@pytest.mark.slow
@pytest.mark.parametrize("jitter", [0.0, 1e-5])
def test_a_joint_that_stands_still_has_no_shapes_of_its_readings(
    jitter: float, rng: np.random.Generator
) -> None:
    at = drawn("puma760", rng, 40)
    still = at.data.q.copy()
    still[:, 5] = 0.3 + jitter * rng.uniform(-1, 1, 40)
    resting = replace(at, data=replace(at.data, q=still))
    for kind in (CandidateKind.WOUND, CandidateKind.PRODUCT, CandidateKind.PULL):
        found = shapes_of(resting, kind)
        assert found
        assert all("q6" not in one.mechanism.names() for one in found)
    assert diagnose(resting, seed=1).effects is not None


def test_a_joint_turns_with_the_product_of_any_two_readings(rng: np.random.Generator) -> None:
    at = drawn("puma760", rng, 40)
    found = shapes_of(at, CandidateKind.PRODUCT)
    assert len(found) == 6 * 15
    own = next(
        one.mechanism
        for one in found
        if place_of(one.mechanism) == (5, "rz") and one.mechanism.names() == {"q1", "q6"}
    )
    columns = [np.asarray(term.screws[0].cause.of(at.state)) for term in own.terms]
    # wherever a reading counts as zero, the product is among what the columns span
    span = np.stack([*columns, np.ones(40)], axis=1)
    q1, q6 = at.data.q[:, 0] + 0.7, at.data.q[:, 5] - 2.0
    _, left, rank, _ = np.linalg.lstsq(span, q1 * q6, rcond=None)
    assert rank == 4
    assert left.item() < 1e-18


def test_a_saw_rises_and_falls_back_as_often_as_the_wave_that_was_found(
    rng: np.random.Generator,
) -> None:
    at = drawn("puma760", rng, 40)
    wave = build_cell((3, "rz"), (sin(6.0 * q(3)), cos(6.0 * q(3))))
    saws = list(generate_saws(at, wave))
    # between every two readings, each a saw of its own
    assert len(saws) == 40
    sorted_readings = np.sort(np.mod(6 * at.data.q[:, 2], 2 * np.pi))
    orders = set()
    for saw in saws:
        values = np.asarray(saw.terms[0].screws[0].cause.of(at.state))
        assert np.abs(values).max() <= 1
        rising = values[np.argsort(np.mod(6 * at.data.q[:, 2], 2 * np.pi))]
        falls = np.flatnonzero(np.diff(rising) < 0)
        assert len(falls) <= 1
        steps = np.diff(rising) * np.pi - np.diff(sorted_readings)
        np.testing.assert_allclose(np.delete(steps, falls), 0, atol=1e-9)
        orders.add(tuple(falls))
    assert len(orders) == 40
    quarter = build_cell((3, "rz"), (sin(6.25 * q(3)), cos(6.25 * q(3))))
    across = build_cell((4, "rz"), (sin(6.0 * q(3)), cos(6.0 * q(3))))
    assert not [*generate_saws(at, quarter), *generate_saws(at, across)]


@pytest.mark.parametrize("kind", ["turns", "slides"])
def test_finer_waves_fill_the_gaps_beside_a_wave(kind: str, rng: np.random.Generator) -> None:
    """Neighbours come apart by an eighth of a radian over the measured range."""
    arm = replace(small_arm(prismatic=True), gravity=(0.0, 0.0, -1.0))
    at = Problem(
        arm, build_measurements(arm.draw(rng, 40), rng.normal(size=(40, 3))), np.zeros((1, 3))
    )
    slides = [j for j, joint in enumerate(arm.joints, 1) if joint.prismatic]
    joint = slides[0] if kind == "slides" else next(j for j in (1, 2, 3) if j not in slides)
    width = np.ptp(at.data.q[:, joint - 1])
    count = float(rng.integers(12, 160)) / 4
    found = build_pitch_wave(joint, count, width) if kind == "slides" else build_wave(joint, count)
    gap, unit = (0.125, 2 * np.pi / width) if kind == "slides" else (0.25, 1.0)
    numbers = [find_own_wave(one)[1] / unit for one in generate_finer_waves(at, found)]
    every = np.array(sorted([*numbers, count]))
    assert len(every) == len(numbers) + 1
    assert np.abs(every - count).max() < gap
    step = 0.125 / (unit * width)
    np.testing.assert_allclose(np.diff(every), step, atol=2e-3)
    assert gap - np.abs(every - count).max() < step + 1e-3


def test_only_a_wave_of_a_joint_has_finer_ones(rng: np.random.Generator) -> None:
    at = drawn("puma760", rng, 40)
    others = [
        mechanism("encoder-eccentricity:3", at.robot),
        mechanism("encoder-scale:3", at.robot),
        build_cell((4, "rz"), (sin(6.0 * q(3)), cos(6.0 * q(3)))),
        build_cell((3, "rz"), tuple(f(k * q(3)) for k in (4.0, 8.0) for f in (sin, cos))),
    ]
    assert not any(list(generate_finer_waves(at, one)) for one in others)


def test_rivals_are_products_of_two_drivers_or_pulls_of_another_joint(
    rng: np.random.Generator,
) -> None:
    at = drawn("puma760", rng, 40)
    both = build_cell((4, "rz"), (sin(q(1)), cos(q(4))))
    products = list(generate_products(at, both))
    assert {m.names() for m in products} == {frozenset(("q1", "q4"))}
    assert len({m.terms for m in products}) == len(products) == 2 * 7 * 7
    turned = build_cell((3, "rz"), (q(2),))
    pulls = list(generate_pulls(at, turned))
    assert {(place_of(m), *m.names()) for m in pulls} == {((3, "rz"), "q2")}
    for other in (build_cell((3, "rx"), (q(2),)), build_cell((7, "tx"), (q(2),)), both):
        assert not list(generate_pulls(at, other))


@pytest.mark.parametrize(
    ("causes", "kind"),
    [((sin(6.0 * q(4)), cos(6.0 * q(4))), CandidateKind.SAW), ((q(3),), CandidateKind.PULL)],
    ids=["wave", "turn with joint 3"],
)
def test_simple_rivals_have_half_of_what_other_shapes_have(
    causes: tuple[Applied | Named, ...], kind: CandidateKind, rng: np.random.Generator
) -> None:
    at = drawn("puma760", rng, 40)
    own = Candidate(build_cell((4, "rz"), causes), CandidateKind.CELL, 0.01)
    rivals = list_rivals(at, own)
    alike = [r.candidate for r in rivals if r.agrees == "drivers"]
    assert sum(one.prior for one in alike) == pytest.approx(UNLISTED_ODDS * own.prior)
    simple = sum(one.prior for one in alike if one.kind is kind)
    free = sum(one.prior for one in alike if one.kind is CandidateKind.SHAPE)
    assert simple == pytest.approx(free)
    assert free > 0


@pytest.mark.slow
@seeds(1, 2)
@pytest.mark.parametrize("robot", ROBOTS)
def test_a_base_that_sags_is_told_as_the_base(robot: str, rng: np.random.Generator) -> None:
    at = drawn(robot, rng, 80)
    metres = 1e-3 * Named("reach_mm", "mm")
    sag = build_cell((1, "tz"), (metres * metres * metres,))
    reach = at.value("reach_mm").max() / 1e3
    at = planted(at, sag.terms, np.array([-0.5 / reach**3]), rng, 0.05)
    (effect,) = diagnose(at, seed=1).effects
    assert effect.candidate.kind is CandidateKind.REACH
    assert place_of(effect.candidate.mechanism) == (1, "tz")
    assert effect.claim is not None
    assert effect.claim.level in ("drivers", "shape")


def test_a_robot_on_a_rail_has_no_reach(rng: np.random.Generator) -> None:
    robot = load_robot("puma760")
    first = replace(robot.joints[0], prismatic=True)
    railed = replace(robot, joints=(first, *robot.joints[1:]))
    at = drawn("puma760", rng, 40)
    moved = Problem(railed, at.data, at.tools)
    assert not shapes_of(moved, CandidateKind.REACH)
    pulled = shapes_of(moved, CandidateKind.PULL)
    assert all("q1" not in one.mechanism.names() for one in pulled)


def test_a_table_of_two_joints_has_no_shapes_of_an_arm(rng: np.random.Generator) -> None:
    robot = load_robot("puma760")
    for count, has_shapes in ((2, False), (3, True)):
        table = replace(robot, joints=robot.joints[:count])
        found = list(generate_arm_shapes(drawn(table, rng, 40)))
        assert bool(found) == has_shapes
