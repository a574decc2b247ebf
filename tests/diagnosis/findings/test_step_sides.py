"""Held-out rows between the two estimation rows that a step lies between stand on an unknown side."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from builders import OFF_AXIS, bind

from modelsel.diagnosis.findings.step_sides import find_open_sides, mark_open
from modelsel.fitting.problem import Problem
from modelsel.measurements.measurements import build_measurements
from modelsel.mechanisms.causes import Named, sin
from modelsel.mechanisms.drifts import tracker_drift
from modelsel.mechanisms.environment import step_after, target_step, tracker_bumped, zero_step
from modelsel.mechanisms.moved_targets import limit_to_targets
from modelsel.mechanisms.step_moments import find_step_moments
from modelsel.mechanisms.terms import Mechanism
from modelsel.robot.files import load_robot
from modelsel.robot.kinematics import forward

pytestmark = pytest.mark.unit

ROBOT = load_robot("puma760")


def campaign(groups: list[int], rng: np.random.Generator) -> Problem:
    """A row every hundredth of the campaign."""
    q = ROBOT.draw(rng, len(groups))
    names = [f"station {k}" for k in groups]
    return bind(ROBOT, build_measurements(q, forward(ROBOT, q, np.array(OFF_AXIS)), group=names))


def without(*rows: int) -> np.ndarray:
    used = np.ones(101, bool)
    used[list(rows)] = False
    return used


def likely(*mechanisms: Mechanism) -> list[SimpleNamespace]:
    """An effect, the first of some mechanisms, and its credible set."""
    entries = [
        SimpleNamespace(candidate=SimpleNamespace(mechanism=one), probability=0.5)
        for one in mechanisms
    ]
    named = SimpleNamespace(entries=entries)
    return [SimpleNamespace(candidate=entries[0].candidate, named=named)]


def test_rows_between_the_estimation_rows_around_a_step_are_open(rng: np.random.Generator) -> None:
    at = campaign([0] * 101, rng)
    used = without(20, 59, 60, 61, 63)
    step = tracker_bumped(ROBOT, 0.605)
    (side,) = find_open_sides(at, used, [tracker_drift(ROBOT, 1.0), step], likely(step))
    assert np.flatnonzero(side.rows).tolist() == [59, 60, 61]
    assert (side.before, side.after) == (58, 62)
    np.testing.assert_array_equal(mark_open([side], ~used), side.rows)


def test_what_was_measured_there_does_not_matter(rng: np.random.Generator) -> None:
    at = campaign([0] * 101, rng)
    used = without(59, 60, 61)
    position = at.data.position.copy()
    position[~used] += rng.normal(0, 50, (3, 3))
    other = replace(at, data=replace(at.data, position=position))
    step = zero_step(ROBOT, 4, 0.605)
    (one,) = find_open_sides(at, used, [step], likely(step))
    (same,) = find_open_sides(other, used, [step], likely(step))
    np.testing.assert_array_equal(one.rows, same.rows)


def test_a_step_of_one_target_leaves_rows_of_others_where_they_are(
    rng: np.random.Generator,
) -> None:
    """Rows of the two targets follow one another; those of the one that stays tell its side, not
    the other's."""
    q = ROBOT.draw(rng, 101)
    names = ["left" if k % 2 else "right" for k in range(101)]
    at = bind(ROBOT, build_measurements(q, forward(ROBOT, q, np.array(OFF_AXIS)), target=names))
    used = without(57, 58, 59, 60, 61)
    number = at.data.targets.index("left")
    step = limit_to_targets(target_step(ROBOT, 0.605), {number: "left"})
    (side,) = find_open_sides(at, used, [step], likely(step))
    assert np.flatnonzero(side.rows).tolist() == [57, 59, 61]
    assert (side.before, side.after) == (55, 63)


def three_targets(rng: np.random.Generator) -> tuple[Problem, np.ndarray]:
    """Three targets in turn, with a row every hundredth of the campaign, and whose row each is."""
    q = ROBOT.draw(rng, 101)
    number = np.arange(101) % 3
    names = np.array(["A", "B", "C"])[number]
    position = forward(ROBOT, q, np.array(OFF_AXIS))
    return bind(ROBOT, build_measurements(q, position, target=names)), number


@pytest.mark.parametrize(
    ("fitted", "opened", "later"),
    [
        (np.zeros(101, bool), 59, True),
        (np.arange(101) < 40, 59, True),
        (np.arange(101) > 80, -62, False),
    ],
)
def test_a_target_that_was_not_fitted_on_both_sides_is_open(
    fitted: np.ndarray, opened: int, later: bool, rng: np.random.Generator
) -> None:
    """Two slipped at 0.605; what the third did from there on, or up to there, no fitted row tells."""
    at, number = three_targets(rng)
    is_third = number == 2
    used = ~is_third | fitted
    step = limit_to_targets(target_step(ROBOT, 0.605), {0: "A", 1: "B"})
    (side,) = find_open_sides(at, used, [step], likely(step))
    row = np.arange(101)
    beyond = row > opened if later else row < -opened
    np.testing.assert_array_equal(side.rows, is_third & ~used & beyond)
    assert (side.target, side.later) == (2, later)
    whole = target_step(ROBOT, 0.605)
    sides = find_open_sides(at, used, [whole], likely(whole))
    assert 2 in [one.target for one in sides]


def test_a_target_stands_where_it_stood_if_another_one_did(rng: np.random.Generator) -> None:
    at, number = three_targets(rng)
    step = limit_to_targets(target_step(ROBOT, 0.605), {0: "A"})
    assert not find_open_sides(at, number < 2, [step], likely(step))


def test_none_is_open_where_no_row_lies_between(rng: np.random.Generator) -> None:
    at = campaign([0] * 101, rng)
    step = tracker_bumped(ROBOT, 0.605)
    assert not find_open_sides(at, without(59, 62), [step], likely(step))


def test_every_likely_moment_counts(rng: np.random.Generator) -> None:
    """Of the credible set those of the same name; a step of another joint is another step."""
    at = campaign([0] * 101, rng)
    used = without(57, 60, 70)
    steps = [zero_step(ROBOT, 4, 0.605), zero_step(ROBOT, 4, 0.565), zero_step(ROBOT, 5, 0.7)]
    (side,) = find_open_sides(at, used, steps[:1], likely(*steps))
    assert np.flatnonzero(side.rows).tolist() == [57, 60]


@pytest.mark.parametrize("step", [zero_step(ROBOT, 4, 0.595), tracker_bumped(ROBOT, 0.595)])
def test_what_stepped_may_have_done_so_beside_where_groups_meet(
    step: Mechanism, rng: np.random.Generator
) -> None:
    """The estimation rows alone tell when: of 14 instruments that were bumped two or three rows from
    there, four held-out errors were 1.5 to 3 times too large."""
    at = campaign([0] * 60 + [1] * 41, rng)
    (side,) = find_open_sides(at, without(58, 59, 60, 61), [step], likely(step))
    assert np.flatnonzero(side.rows).tolist() == [58, 59, 60, 61]
    assert not find_open_sides(at, without(57, 62), [step], likely(step))


def test_a_group_without_estimation_rows_is_open(rng: np.random.Generator) -> None:
    """The instrument may have been moved before it or after it."""
    at = campaign([0] * 60 + [1] * 2 + [2] * 39, rng)
    step = tracker_bumped(ROBOT, 0.595)
    (side,) = find_open_sides(at, without(59, 60, 61, 62), [step], likely(step))
    assert np.flatnonzero(side.rows).tolist() == [59, 60, 61, 62]


def test_moments_of_a_cause_are_found() -> None:
    assert find_step_moments(step_after(0.3) * sin(step_after(0.5))) == {0.3, 0.5}
    assert find_step_moments(sin(Named("progress"))) == frozenset()
