"""Hysteresis that remembers stands against what a joint's own motion explains, and is found where the
joint would else be said not to repeat."""

from __future__ import annotations

import numpy as np
import pytest
from builders import bind, drawn, measured, one, seeds, small_arm
from searches import search_separated

from modelsel._typing import Array
from modelsel.diagnosis.candidates.candidate import Candidate
from modelsel.diagnosis.candidates.candidate_list import build_candidates
from modelsel.diagnosis.candidates.signatures import read_signatures
from modelsel.diagnosis.findings.sentences import describe_candidate
from modelsel.diagnosis.rivals.finding_groups import list_finding_groups
from modelsel.diagnosis.rivals.joint_drags import (
    MIN_VISITS,
    build_drag,
    generate_drags,
    generate_drags_instead,
    generate_other_widths,
    list_told_widths,
)
from modelsel.diagnosis.rivals.joint_functions import list_joint_functions
from modelsel.diagnosis.rivals.unlisted_shapes import list_rivals
from modelsel.diagnosis.shapes.candidate_kinds import CandidateKind
from modelsel.fitting.design import Model
from modelsel.measurements.measurements import build_measurements
from modelsel.mechanisms.cause_formulas import parse
from modelsel.mechanisms.causes import Named, q
from modelsel.mechanisms.registry import every, mechanism
from modelsel.robot.kinematics import forward

SIGMA = 0.03
KIND = CandidateKind.HYSTERESIS


def keep_drags(found: list[Candidate]) -> set[str]:
    return {one.mechanism.name for one in found if one.kind is KIND}


@seeds(1)
def test_widths_that_the_rows_tell_are_used_up_at_some_visits_alone(
    rng: np.random.Generator,
) -> None:
    at = drawn("puma760", rng, 40)
    told = list_told_widths(at, 4)
    assert len(told) > 4
    for width in told:
        lead = np.abs(at.state.value(f"drag4_{width}"))
        full = int(np.isclose(lead, width / 1000, rtol=1e-5).sum())
        assert MIN_VISITS <= full <= 40 - MIN_VISITS
    assert not {4, 5, 6} & set(told)


def test_none_is_offered_without_a_path_or_for_a_joint_at_rest() -> None:
    rng = np.random.default_rng(3)
    readings = drawn("puma760", rng, 30).data.q.copy()
    readings[:, 3] = 0.1
    at = bind("puma760", build_measurements(readings, np.zeros((30, 3))))
    assert list(generate_drags(at, 4)) == []
    assert list(generate_drags(at, 2))
    given = build_measurements(readings, np.zeros((30, 3)), approach=np.ones((30, 6)))
    assert list(generate_drags(bind("puma760", given), 2)) == []


@pytest.mark.parametrize(
    "name", ["approach-backlash:4", "settle:4", "encoder-scale:4", "joint-compliance:3"]
)
@seeds(1)
def test_hysteresis_stands_against_what_depends_on_how_the_joint_moved(
    name: str, rng: np.random.Generator
) -> None:
    at = drawn("puma760", rng, 40)
    found = Candidate(mechanism(name, at.robot), CandidateKind.MECHANISM, 0.1)
    rivals = [one for one in list_rivals(at, found) if one.candidate.kind is KIND]
    expected: set[str] = set()
    if name in ("approach-backlash:4", "settle:4"):
        expected = {drag.name for drag in generate_drags(at, 4)}
    assert {rival.candidate.mechanism.name for rival in rivals} == expected
    assert {rival.agrees for rival in rivals} <= {"place"}
    for rival in rivals:
        assert list(rival.candidate.mechanism.names_by_place()) == [(4, "rz")]


@seeds(1)
def test_hysteresis_stands_against_other_widths_and_the_other_form(
    rng: np.random.Generator,
) -> None:
    at = drawn("puma760", rng, 40)
    own = build_drag(at, 4, 500)
    finer = list(generate_other_widths(at, own))
    assert {one.names() for one in finer} == {
        frozenset({f"drag4_{width}"})
        for width in (335, 355, 375, 400, 425, 450, 475, 530, 560, 600, 630, 670, 710)
    }
    rivals = [
        one for one in list_rivals(at, Candidate(own, KIND, 0.01)) if one.candidate.kind is KIND
    ]
    alike = {one.candidate.mechanism for one in rivals if one.agrees == "shape"}
    assert alike == set(finer)
    others = {one.candidate.mechanism for one in rivals} - alike
    assert others == set(generate_drags_instead(at, own))
    assert all("q4" in one.names() for one in others)
    follows = build_drag(at, 4, 500, follows=True)
    assert all("q4" in one.names() for one in generate_other_widths(at, follows))
    # whatever its width it says the same of place, drivers and shape
    said = read_signatures([Candidate(m, KIND, 0.01) for m in (own, *finer, follows)])
    for level in said[:3]:
        assert len(set(level[:-1])) == 1
    assert said[1][-1] != said[1][0]


@seeds(1)
def test_hysteresis_stands_against_several_findings_of_a_joints_motion(
    rng: np.random.Generator,
) -> None:
    at = drawn("puma760", rng, 40)
    drags = {drag.name for drag in generate_drags(at, 4)}
    play = Candidate(mechanism("approach-backlash:4", at.robot), CandidateKind.MECHANISM, 0.1)
    scale = Candidate(mechanism("encoder-scale:4", at.robot), CandidateKind.MECHANISM, 0.1)
    (together,) = list_finding_groups(at, {5: play, 7: scale})
    assert keep_drags(list(together.shapes)) == drags
    foreign = Candidate(one(4, "rz", q(2)), CandidateKind.CELL, 0.1)
    (together,) = list_finding_groups(at, {5: play, 7: foreign})
    assert not keep_drags(list(together.shapes))


@pytest.mark.integration
@seeds(1)
def test_hysteresis_is_offered_at_a_joint_that_seems_not_to_repeat(
    rng: np.random.Generator,
) -> None:
    at = drawn("puma760", rng, 40)
    found = build_candidates(at, Model((mechanism("geometric", at.robot),)), every(at.robot))
    assert not keep_drags(list(found))
    drags = {drag.name for drag in generate_drags(at, 3)}
    assert keep_drags(list_joint_functions(at, found, 3)) == drags


@seeds(1)
def test_hysteresis_is_told_by_the_way_over_which_it_builds_up(rng: np.random.Generator) -> None:
    at = drawn("puma760", rng, 40)
    own = Candidate(build_drag(at, 4, 500), KIND, 0.01)
    assert own.label == "frame 4 rz · hysteresis that builds up over 57°"
    said = describe_candidate(own, np.array([1e-3]))
    assert "Joint 4 is off its reading by hysteresis that builds up over 57° after each" in said
    follows = Candidate(build_drag(at, 4, 45, follows=True), KIND, 0.01)
    assert follows.label == "frame 4 rz · what it draws along with 5.2° of slack"
    assert follows.mechanism.usual_causes == ("cable or hose that is drawn along",)
    names = [build_drag(at, 4, width).name for width in list_told_widths(at, 4)]
    assert len(set(names)) == len(names)
    # as an export writes it
    (term,) = follows.mechanism.terms
    (screw,) = term.screws
    again = parse(str(screw.cause), at.names())
    values = at.state.value("q4") - at.state.value("drag4_45")
    np.testing.assert_array_equal(again.of(at.state), values)


@seeds(1)
def test_a_slide_drags_by_millimetres(rng: np.random.Generator) -> None:
    at = drawn(small_arm(prismatic=True), rng, 40)
    own = Candidate(build_drag(at, 3, 11800), KIND, 0.01)
    assert own.label == "frame 3 tz · hysteresis that builds up over 24 mm"
    assert all(one.names_by_place().keys() == {(3, "tz")} for one in generate_drags(at, 3))
    assert {Named("drag3_11800", "mm")} == {s.cause for t in own.mechanism.terms for s in t.screws}


def wind_up(path: Array, stiffness: float, slips_at: float) -> Array:
    """The force of a spring in line with a slider, over the one at which it slips: the slider has a
    place of its own."""
    slider = path[0]
    forces = []
    for place in path:
        force = stiffness * (place - slider)
        if abs(force) > slips_at:
            slider = place - np.sign(force) * slips_at / stiffness
            force = stiffness * (place - slider)
        forces.append(force / slips_at)
    return np.array(forces)


def walk(rng: np.random.Generator, m: int, low: float, high: float) -> Array:
    """A reading that goes to and fro in steps of 0.2 to 2 degrees."""
    place, way, left = 0.5 * (low + high), 1.0, 10
    places = []
    for _ in range(m):
        places.append(place)
        step = way * np.radians(rng.uniform(0.2, 2))
        left -= 1
        if left < 0 or not low < place + step < high:
            way, left = -way, int(rng.integers(4, 25))
            step = -step
        place += step
    return np.array(places)


@pytest.mark.slow
@pytest.mark.parametrize(("steps", "width"), [("small", (0.01, 0.025)), ("large", (0.6, 1.4))])
@seeds(11, 12, 13)
def test_friction_and_what_is_dragged_are_found_as_hysteresis(
    steps: str, width: tuple[float, float], rng: np.random.Generator
) -> None:
    """Steps within the way over which friction builds up, and long ones that draw a cable along."""
    m = 240 if steps == "small" else 90
    at = drawn("puma760", rng, m)
    q = at.data.q.copy()
    if steps == "small":
        q = np.stack([walk(rng, m, *joint.range) for joint in at.robot.joints], 1)
    joint = int(rng.integers(1, 4))
    half = rng.uniform(*width)
    off = q.copy()
    off[:, joint - 1] += 6e-4 * wind_up(q[:, joint - 1], 1 / half, 1.0)
    position = forward(at.robot, off, at.tools[0]) + rng.normal(0, SIGMA, (m, 3))
    bent = bind("puma760", build_measurements(q, position))
    base = Model((mechanism("geometric", at.robot),))
    found = search_separated(bent, base, build_candidates(bent, base, every(at.robot)))
    assert not [name for name in found.errors.names if name.startswith("joint")], found.path
    # a loud one whose way lies between two that have a name may be told as both
    assert 1 <= len(found.effects) <= 2, found.path
    for effect in found.effects:
        assert effect.candidate.kind is KIND, found.path
        (name,) = effect.candidate.mechanism.names()
        stem, _, told = name.partition("_")
        assert stem == f"drag{joint}"
        assert int(told) / 1000 == pytest.approx(half, rel=0.15)
    left = measured(bent, position)
    assert np.sqrt(np.square(found.fit.residuals(left)).mean()) < 1.15 * SIGMA
