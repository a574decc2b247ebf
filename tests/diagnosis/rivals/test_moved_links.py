"""A link that a collision bent in the middle of a campaign is told as that, not as an instrument or a target
that moved. Campaigns by exact chains of the tests' own."""

from __future__ import annotations

import numpy as np
import pytest
from builders import drawn, seeds
from hidden_arm import State, arm

from modelsel.diagnosis.candidates.candidate import Candidate
from modelsel.diagnosis.findings.outcome import Diagnosis
from modelsel.diagnosis.findings.step_sides import find_open_sides
from modelsel.diagnosis.procedure import diagnose
from modelsel.diagnosis.rivals.moved_links import find_moved_frame, generate_moved_links
from modelsel.diagnosis.rivals.unlisted_shapes import list_rivals
from modelsel.diagnosis.shapes.candidate_kinds import CandidateKind
from modelsel.fitting.problem import Problem
from modelsel.measurements.measurements import build_measurements
from modelsel.mechanisms.environment import target_step, tracker_step, zero_step
from modelsel.mechanisms.registry import mechanism
from modelsel.mechanisms.step_moments import list_step_moments
from modelsel.robot.files import load_robot

TOOL = (60.0, -40.0, 120.0)
SIGMA = 0.02
ROWS = 120
KIND = CandidateKind.MOVED_LINK
Rng = np.random.Generator


@seeds(1)
def test_every_link_may_have_moved_about_when_something_stepped(rng: Rng) -> None:
    at = drawn("puma760", rng, 60)
    progress = at.data.progress
    for step in (tracker_step, target_step, lambda robot, when: zero_step(robot, 3, when)):
        own = step(at.robot, 0.4)
        moved = list(generate_moved_links(at, own))
        assert {find_moved_frame(one) for one in moved} == {2, 3, 4, 5, 6}
        before = {int((progress < min(list_step_moments(one.terms))).sum()) for one in moved}
        # three rows to either side of the step, which is after the 24th
        assert before == {21, 22, 23, 24, 25, 26, 27}
        rivals = list_rivals(at, Candidate(own, CandidateKind.MECHANISM, 0.1))
        offered = [one for one in rivals if one.candidate.kind is KIND]
        assert {one.candidate.mechanism for one in offered} == set(moved)
        assert {one.agrees for one in offered} == {""}
        # all of them together are rarer than what was found
        assert sum(one.candidate.prior for one in offered) == pytest.approx(0.005)
    # the screws are those of the whole frame
    wrist = next(one for one in moved if find_moved_frame(one) == 5)
    places = wrist.names_by_place()
    assert set(places) == {(5, axis) for axis in ("tx", "ty", "tz", "rx", "ry", "rz")}
    # nothing that does not step, and no moment without rows enough on both sides
    assert not list(generate_moved_links(at, mechanism("gear-eccentricity:3", at.robot)))
    early = list(generate_moved_links(at, tracker_step(at.robot, 0.04)))
    first = min(min(list_step_moments(one.terms)) for one in early)
    assert (progress < first).sum() == 4
    # of a moment that has all rows on one side nothing is tried
    assert not list(generate_moved_links(at.take(progress < 0.5), tracker_step(at.robot, 0.99)))
    assert not list(generate_moved_links(at.take(progress > 0.5), tracker_step(at.robot, 0.01)))


@seeds(1)
def test_a_link_that_moved_a_little_sooner_or_later_is_the_same_shape(rng: Rng) -> None:
    at = drawn("puma760", rng, 60)
    moved = list(generate_moved_links(at, tracker_step(at.robot, 0.4)))
    own = next(one for one in moved if find_moved_frame(one) == 4)
    rivals = [r for r in list_rivals(at, Candidate(own, KIND, 0.1)) if r.candidate.kind is KIND]
    assert own not in {one.candidate.mechanism for one in rivals}
    for rival in rivals:
        is_own = find_moved_frame(rival.candidate.mechanism) == 4
        assert (rival.agrees == "shape") == is_own
        assert rival.candidate.prior == pytest.approx(0.1)


@seeds(1)
def test_held_out_rows_around_the_moment_are_open(rng: Rng) -> None:
    at = drawn("puma760", rng, 60)
    used = np.ones(60, bool)
    used[[23, 24]] = False
    training = at.take(used)
    moved = list(generate_moved_links(training, tracker_step(at.robot, 0.4)))
    progress = at.data.progress
    own = next(
        one
        for one in moved
        if progress[22] < min(list_step_moments(one.terms)) < progress[25]
        and find_moved_frame(one) == 3
    )
    (side,) = find_open_sides(at, used, [own], ())
    assert np.flatnonzero(side.rows).tolist() == [23, 24]
    assert side.step == "of frame 3"


def explain(rng: Rng, frame: int) -> Diagnosis:
    """Plant a move of a frame (from 1), with all that follows, from a row of the middle on."""
    body = arm(load_robot("irb120"), rng, TOOL)
    readings = body.draw(rng, ROWS, 2.4)
    later = np.arange(ROWS) >= rng.integers(45, 75)
    twist = np.zeros((ROWS, body.n + 1, 6))
    shift = rng.normal(0, 0.15, 3)
    turn = rng.normal(size=3)
    turn *= 1e-3 / np.linalg.norm(turn)
    number = 3 if frame > body.n else 6
    twist[:, frame - 1, :number] = np.outer(later, [*shift, *turn][:number])
    position, _ = body.chain(State(body, readings).q, twist)
    position = position + rng.normal(0, SIGMA, position.shape)
    data = build_measurements(readings, position)
    return diagnose(Problem(load_robot("irb120"), data, np.array([TOOL])))


@pytest.mark.slow
@pytest.mark.parametrize("frame", [3, 5])
@seeds(1, 2)
def test_a_link_that_was_bent_is_told_as_that(rng: Rng, frame: int) -> None:
    """It was told as a target or an instrument that stepped, with a probability of 1.00, and a frame that
    turns with the course of the campaign beside it."""
    found = explain(rng, frame)
    (effect,) = found.effects
    assert effect.candidate.kind is KIND
    assert find_moved_frame(effect.candidate.mechanism) == frame


@pytest.mark.slow
@pytest.mark.parametrize(("frame", "name"), [(1, "tracker-step"), (7, "target-step")])
@seeds(3, 4)
def test_an_instrument_or_a_target_that_moved_is_no_bent_link(
    rng: Rng, frame: int, name: str
) -> None:
    found = explain(rng, frame)
    (effect,) = found.effects
    own = effect.candidate.mechanism
    (at,) = list_step_moments(own.terms)
    build = {"tracker-step": tracker_step, "target-step": target_step}[name]
    assert own.terms == build(load_robot("irb120"), at).terms
