"""Errors of a joint around one reading, lags that level off, and shapes that change along the campaign."""

from __future__ import annotations

import numpy as np
import pytest
from builders import drawn, seeds, small_arm

from modelsel.diagnosis.candidates.candidate import Candidate
from modelsel.diagnosis.rivals.changing_shapes import generate_changing
from modelsel.diagnosis.rivals.finding_groups import list_finding_groups
from modelsel.diagnosis.rivals.simple_shapes import generate_soft_lags
from modelsel.diagnosis.rivals.unlisted_shapes import list_rivals
from modelsel.diagnosis.shapes.campaign_clocks import build_warming_causes
from modelsel.diagnosis.shapes.candidate_kinds import CandidateKind
from modelsel.diagnosis.shapes.joint_bumps import build_bump, generate_bumps, generate_finer_bumps
from modelsel.diagnosis.shapes.unregistered import build_cell
from modelsel.mechanisms.cause_formulas import parse
from modelsel.mechanisms.causes import ONE, Named, q
from modelsel.mechanisms.registry import build_faults, every, mechanism
from modelsel.mechanisms.terms import Mechanism, Screw, Term
from modelsel.robot.files import load_robot


@pytest.mark.parametrize("centre", [0.4, -0.4, 0.0])
@seeds(1)
def test_a_bump_is_half_as_high_half_a_width_aside(centre: float, rng: np.random.Generator) -> None:
    at = drawn("puma760", rng, 9)
    width = rng.uniform(0.2, 0.6)
    q3 = at.data.q[:, 2]
    q3[:3] = centre, centre + width / 2, centre - width
    (term,) = build_bump(at.robot, 3, centre, width).terms
    (screw,) = term.screws
    values = screw.cause.of(at.state)
    assert (screw.frame, screw.axis) == (3, "rz")
    assert values[:3] == pytest.approx([1, 1 / 2, 1 / 16], rel=1e-4)
    # as an export writes it
    assert parse(str(screw.cause), {"q3": "rad"}).of(at.state) == pytest.approx(values)


@pytest.mark.parametrize("joint", [1, 3])
@seeds(1)
def test_bumps_of_what_was_measured_stand_against_a_joints_own_function(
    joint: int, rng: np.random.Generator
) -> None:
    at = drawn(small_arm(prismatic=True), rng, 60)
    axis, unit = ("tz", "mm") if at.robot.joints[joint - 1].prismatic else ("rz", "rad")
    own = Mechanism("own", (Term("m", (Screw(joint, axis, q(joint, unit)),)),))
    bumps = list(generate_bumps(at, own))
    assert len(set(bumps)) == len(bumps) > 100
    for one in bumps:
        (screw,) = one.terms[0].screws
        assert (screw.frame, screw.axis) == (joint, axis)
        assert screw.cause.of(at.state).max() > 0.1
    label = Candidate(bumps[0], CandidateKind.BUMP, 0.1).label
    assert label.startswith(f"frame {joint} {axis} · a bump around q{joint} = ")
    assert ("mm" in label) == (unit == "mm")
    rivals = list_rivals(at, Candidate(own, CandidateKind.CELL, 0.1))
    assert set(bumps) <= {rival.candidate.mechanism for rival in rivals}
    # of another joint's reading, and beside another bump, there are none
    other = Mechanism("other", (Term("m", (Screw(joint, axis, q(2)),)),))
    assert list(generate_bumps(at, other)) == list(generate_bumps(at, bumps[0])) == []


def test_finer_bumps_are_near_a_found_one() -> None:
    robot = load_robot("puma760")
    at = drawn("puma760", np.random.default_rng(1), 20)
    found = build_bump(robot, 4, -0.3, 0.5)
    finer = list(generate_finer_bumps(at, found))
    assert found not in finer
    assert len(set(finer)) == len(finer) > 50
    at.data.q[:, 3] = np.linspace(-1.5, 1.5, 20)
    tops = [
        float(at.data.q[np.argmax(one.terms[0].screws[0].cause.of(at.state)), 3]) for one in finer
    ]
    assert min(tops) < -0.3 < max(tops)
    assert np.ptp(tops) < 0.8
    assert list(generate_finer_bumps(at, mechanism("encoder-scale:4", robot))) == []


@pytest.mark.parametrize("name", ["approach-backlash:4", "overshoot:4", "settle:4"])
@seeds(1)
def test_a_lag_stands_against_lags_that_level_off(name: str, rng: np.random.Generator) -> None:
    """From a side alone to a share of the move: the steepest is nearly the one, the flattest the other."""
    at = drawn("puma760", rng, 60)
    own = mechanism(name, at.robot)
    lags = list(generate_soft_lags(at, own))
    side, move = at.state.value("approach4"), at.state.value("move4")
    values = [lag.terms[0].screws[0].cause.of(at.state) for lag in lags]
    likeness = [
        [abs(np.corrcoef(one, like)[0, 1]) for one in values] for like in (side, side * move)
    ]
    assert likeness[0][0] > 0.9
    assert likeness[1][-1] > 0.9
    assert np.argmax(likeness[0]) == 0
    assert np.argmax(likeness[1]) == len(lags) - 1
    assert set(lags) <= {
        r.candidate.mechanism for r in list_rivals(at, Candidate(own, CandidateKind.MECHANISM, 0.1))
    }


@pytest.mark.parametrize("name", ["encoder-scale:4", "joint-compliance:3", "fault:read-too-early"])
@seeds(1)
def test_nothing_else_stands_against_lags_that_level_off(
    name: str, rng: np.random.Generator
) -> None:
    at = drawn("puma760", rng, 20)
    (own,) = [m for m in (*build_faults(at.robot), *every(at.robot)) if m.name == name][:1]
    assert list(generate_soft_lags(at, own)) == []


@seeds(1)
def test_a_finding_stands_against_itself_changing_along_the_campaign(
    rng: np.random.Generator,
) -> None:
    at = drawn("puma760", rng, 40)
    scale = mechanism("encoder-scale:4", at.robot)
    changing = list(generate_changing(at, scale))
    assert len(changing) == len(build_warming_causes(at)) > 1
    assert all(one.names() == {"q4", "time_s"} for one in changing)
    assert all(one.terms[0].screws == scale.terms[0].screws for one in changing)
    rivals = list_rivals(at, Candidate(scale, CandidateKind.MECHANISM, 0.1))
    assert set(changing) <= {rival.candidate.mechanism for rival in rivals}
    # what depends on time already, and free functions, have other rivals
    growing = Mechanism("own", (Term("m", (Screw(4, "rz", Named("time_s", "s") * q(4)),)),))
    assert list(generate_changing(at, growing)) == []
    assert list(generate_changing(at, mechanism("geometric", at.robot))) == []
    found = {
        1: Candidate(scale, CandidateKind.MECHANISM, 0.1),
        2: Candidate(growing, CandidateKind.GROWTH, 0.1),
    }
    (group,) = list_finding_groups(at, found)
    assert set(changing) <= {shape.mechanism for shape in group.shapes}


@pytest.mark.parametrize(
    ("name", "agrees"), [("approach-backlash:4", "place"), ("settle:4", "drivers")]
)
@seeds(1)
def test_a_side_says_less_than_the_last_move(
    name: str, agrees: str, rng: np.random.Generator
) -> None:
    """Of a joint that lags by how far it moved, "the side that it came from" is not what it depends
    on."""
    at = drawn("puma760", rng, 40)
    found = Candidate(mechanism(name, at.robot), CandidateKind.MECHANISM, 0.1)
    rivals = list_rivals(at, found)
    lags = {r.agrees for r in rivals if r.candidate.kind is CandidateKind.SOFT_LAG}
    assert lags == {agrees}


@pytest.mark.parametrize("place", [(3, "ty"), (4, "rz")])
@seeds(1)
def test_a_side_stands_against_any_function_of_the_last_move_there(
    place: tuple[int, str], rng: np.random.Generator
) -> None:
    at = drawn("puma760", rng, 60)
    side, move = at.state.value("approach4"), at.state.value("move4")
    own = build_cell(place, (Named("approach4"),))
    both = {"approach4", "move4"}
    (free,) = [
        r.candidate.mechanism
        for r in list_rivals(at, Candidate(own, CandidateKind.CELL, 0.1))
        if r.agrees == "place"
        and r.candidate.mechanism.names() == both
        and len(r.candidate.mechanism.terms) > 2
    ]
    assert set(free.names_by_place()) == {place}
    # any smooth function of the signed move to 0.97, such as its cube
    columns = np.array([term.screws[0].cause.of(at.state) for term in free.terms]).T
    cube = side * (move / move.max()) ** 3
    left = cube - columns @ np.linalg.lstsq(columns, cube, rcond=None)[0]
    assert left @ left < 0.03 * (cube @ cube)


@seeds(1)
def test_a_constant_is_no_lag(rng: np.random.Generator) -> None:
    at = drawn("puma760", rng, 20)
    for frame in (3, at.robot.n + 1):
        constant = Mechanism("c", (Term("c", (Screw(frame, "rz", ONE),)),))
        assert list(generate_soft_lags(at, constant)) == []


def test_constants_that_differ_have_names_that_differ() -> None:
    robot = load_robot("puma760")
    names = {build_bump(robot, 3, k * 0.002, 0.02).name for k in range(-20, 21)}
    assert len(names) == 41
    assert not any("-0°" in name or "-0.0°" in name for name in names)
    assert build_bump(robot, 3, 0.366519, 0.349066).name == "3 rz a bump around q3 = 21°, 20° wide"
