"""A base that tilts more towards some sides is told as that, and not as joints 1 and 2. Campaigns by exact
chains of the tests' own."""

from __future__ import annotations

import numpy as np
import pytest
from builders import drawn, seeds
from hidden_arm import State, arm, turned
from hidden_arm import measured as measure

from modelsel.diagnosis.candidates.candidate import Candidate
from modelsel.diagnosis.candidates.signatures import PROVEN
from modelsel.diagnosis.findings.effects import Effect
from modelsel.diagnosis.procedure import diagnose
from modelsel.diagnosis.rivals.finding_groups import list_finding_groups
from modelsel.diagnosis.rivals.uneven_bases import generate_uneven_bases
from modelsel.diagnosis.rivals.unlisted_shapes import list_rivals
from modelsel.diagnosis.shapes.candidate_kinds import CandidateKind
from modelsel.fitting.problem import Problem
from modelsel.measurements.measurements import build_measurements
from modelsel.mechanisms.registry import mechanism
from modelsel.robot.files import load_robot

TOOL = (60.0, -40.0, 120.0)
SIGMA = 0.02
ROWS = 120
KIND = CandidateKind.UNEVEN_BASE
Rng = np.random.Generator


@seeds(1)
def test_an_uneven_base_turns_away_from_axis_1(rng: Rng) -> None:
    robot = load_robot("irb120")
    body = arm(robot, rng, TOOL)
    readings = body.draw(rng, 60, 0.6)
    readings[:, 0] = rng.uniform(-2.5, 2.5, 60)
    data = build_measurements(readings, measure(body, State(body, readings), ()))
    at = Problem(robot, data, np.array([TOOL]))
    (twice,) = [
        one
        for one in generate_uneven_bases(at)
        if one.name == "1 rx the reach, unevenly twice a turn"
    ]
    x, y, _ = at.data.position.T
    reach = np.hypot(x, y)
    q1 = at.data.q[:, 0]
    for term, factor in zip(
        twice.terms, (np.ones(60), np.cos(2 * q1), np.sin(2 * q1)), strict=True
    ):
        turn = np.zeros((60, 3))
        for screw in term.screws:
            if screw.axis[0] == "r":
                turn[:, "xyz".index(screw.axis[1])] += screw.cause.of(at.state)
        # by the reach in metres that the drawing has; frame 1 stands upright on the base: forward is away from axis 1, as the target is on the whole
        assert np.hypot(*turn.T[:2]) == pytest.approx(1e-3 * reach * np.abs(factor), abs=0.01)
        ahead = (x * turn[:, 1] - y * turn[:, 0]) / reach
        assert np.corrcoef(ahead, reach * factor)[0, 1] > 0.9


@seeds(1)
def test_what_depends_on_the_load_of_the_base_is_weighed_against_it(rng: Rng) -> None:
    at = drawn("irb120", rng, 60)
    tilts = set(generate_uneven_bases(at))
    loads = {one.names() for one in tilts}
    assert loads == {frozenset(("q1", "reach_mm")), frozenset(("q1", "moment_x", "moment_y"))}
    base, waves, other = (
        Candidate(mechanism(name, at.robot), CandidateKind.MECHANISM, 0.1)
        for name in ("base-tilt", "encoder-eccentricity:1", "encoder-eccentricity:5")
    )
    for one in (base, waves):
        beside = [r for r in list_rivals(at, one) if r.candidate.kind is KIND]
        assert {r.candidate.mechanism for r in beside} == tilts
        assert {r.agrees for r in beside} == {""}
    assert not [r for r in list_rivals(at, other) if r.candidate.kind is KIND]
    (together,) = list_finding_groups(at, {2: base, 5: waves, 7: other})
    assert together.members == (2, 5)
    assert {one.mechanism for one in together.others} == tilts
    assert list_finding_groups(at, {7: other}) == []
    # uneven bases stand against each other, at their place
    own, *_ = together.others
    beside = [r for r in list_rivals(at, own) if r.candidate.kind is KIND]
    assert {r.candidate.mechanism for r in beside} == tilts - {own.mechanism}
    assert {r.agrees for r in beside} == {"place"}
    assert not list_finding_groups(at, {2: own, 5: waves})


def explain(rng: Rng, uneven: bool) -> list[Effect]:
    """Plant a base that tilts by the moment of the arm's weight, twice a turn more than between where it
    is `uneven`, or else evenly with a wave of joint 1 twice a turn: the effects that are found."""
    robot = load_robot("irb120")
    body = arm(robot, rng, TOOL)
    readings = body.draw(rng, ROWS, 2.6)
    stands = readings.copy()
    towards = 2 * readings[:, 0] + rng.uniform(0, 6)
    stiffness = np.ones(ROWS)
    if uneven:
        stiffness += 0.8 * np.cos(towards)
    else:
        stands[:, 0] += 3e-4 * np.sin(towards)
    moment = State(body, readings).moment(0)
    share = moment / np.sqrt(np.square(moment).sum(1).mean())
    tilt = 6e-4 * share * stiffness[:, None]
    about = turned(0, tilt[:, 0]) @ turned(1, tilt[:, 1])
    position = measure(body, State(body, stands), ())
    position = np.einsum("mij,mj->mi", about[:, :3, :3], position)
    position = position + rng.normal(0, SIGMA, position.shape)
    data = build_measurements(readings, position)
    return list(diagnose(Problem(robot, data, np.array([TOOL]))).effects)


def list_causes(effects: list[Effect]) -> list[str]:
    """List the causes that are claimed."""
    claimed = [one for one in effects if one.claim is not None and one.claim.levels[3] >= PROVEN]
    return [one.candidate.label for one in claimed]


@pytest.mark.slow
@seeds(1, 2)
def test_an_uneven_base_is_told_as_one(rng: Rng) -> None:
    """It was told as a joint 2 that depends on joint 1, with an oval encoder at joint 1."""
    effects = explain(rng, uneven=True)
    assert effects[0].candidate.kind is KIND
    assert list_causes(effects) == []


@pytest.mark.slow
@seeds(3, 4)
def test_an_oval_encoder_on_an_even_base_is_still_named(rng: Rng) -> None:
    effects = explain(rng, uneven=False)
    assert "encoder-eccentricity:1" in list_causes(effects)
    assert KIND not in [one.candidate.kind for one in effects]
