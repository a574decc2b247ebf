"""Steps of the set-up between two sessions stand where the sessions meet, for held-out rows, too."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from builders import OFF_AXIS, bind
from exact import flanges_of

from modelsel.diagnosis.candidates.session_steps import list_changes, place_steps
from modelsel.diagnosis.procedure import diagnose_split
from modelsel.diagnosis.separation import Inquiry
from modelsel.fitting.design import Model
from modelsel.fitting.problem import Problem
from modelsel.measurements.measurements import build_measurements
from modelsel.mechanisms.environment import STEPS, tracker_bumped
from modelsel.mechanisms.registry import build_faults, every, mechanism
from modelsel.mechanisms.terms import Mechanism
from modelsel.robot.files import load_robot
from modelsel.selection.evaluation import Split

ROBOT = load_robot("puma760")


def campaign(groups: list[int], step_mm: float, rng: np.random.Generator) -> Problem:
    """A campaign by the exact chain, whose instrument is moved by a step between two groups."""
    q = ROBOT.draw(rng, len(groups))
    flange = flanges_of(ROBOT, q)
    position = flange[:, :3, 3] + flange[:, :3, :3] @ np.array(OFF_AXIS)
    position += step_mm * np.array(groups)[:, None] * [0.6, -0.8, 0.0]
    position += rng.normal(0, 0.03, position.shape)
    names = [f"station {k}" for k in groups]
    return bind(ROBOT, build_measurements(q, position, group=names))


def move(at: Problem) -> list[np.ndarray]:
    """What every step of the instrument that is scanned is at the rows."""
    placed = place_steps(at, training(at), build_faults(ROBOT))
    causes = [one.terms[0].screws[0].cause for one in placed if one.name == "fault:tracker-bumped"]
    return [np.asarray(cause.of(at.state)) for cause in causes]


def without_sentence(one: Mechanism) -> Mechanism:
    return replace(one, sentence="")


def training(problem: Problem) -> np.ndarray:
    """All rows but the first ones of the second group."""
    rows = np.ones(len(problem), bool)
    first = int(np.argmax(problem.data.group > 0))
    rows[first : first + 4] = False
    return rows


@pytest.mark.unit
def test_a_step_stands_where_the_groups_meet(rng: np.random.Generator) -> None:
    count = int(rng.integers(20, 60))
    at = campaign([0] * count + [1] * 45, 0.0, rng)
    used = training(at)
    is_later = at.data.group > 0
    moved = move(at)
    like_the_groups = [own for own in moved if (own[used] == is_later[used]).all()]
    assert len(like_the_groups) == 1
    np.testing.assert_array_equal(like_the_groups[0], is_later)


@pytest.mark.unit
def test_it_is_told_by_the_group(rng: np.random.Generator) -> None:
    """Where the rows on both sides estimate, the group it is; where some are held out, about that."""
    at = campaign([0] * 30 + [1] * 30, 0.0, rng)
    every_row = np.ones(60, bool)
    told = {"from": every_row, "from about the beginning of": training(at)}
    for begins, used in told.items():
        placed = place_steps(at, used, build_faults(ROBOT))
        sentences = [one.sentence for one in placed if one.name == "fault:tracker-bumped"]
        assert sum(one.endswith(f' {begins} the group "station 1" on.') for one in sentences) == 1


@pytest.mark.unit
def test_one_session_has_the_steps_that_are_scanned(rng: np.random.Generator) -> None:
    at = campaign([0] * 60, 0.0, rng)
    faults = build_faults(ROBOT)
    placed = place_steps(at, np.ones(60, bool), faults)
    assert list(map(without_sentence, placed)) == list(map(without_sentence, faults))
    assert {tracker_bumped(ROBOT, at) for at in STEPS} <= set(faults)


@pytest.mark.unit
@pytest.mark.parametrize("name", ["tracker-step", "fault:tracker-bumped", "target-step"])
def test_a_step_of_the_set_up_is_told_by_the_rows_around_it(name, rng: np.random.Generator) -> None:
    """Row 30 is held out: a step there begins with row 31, after row 29."""
    at = campaign([0] * 60, 0.0, rng)
    used = np.arange(60) != 30
    placed = place_steps(at, used, (*every(ROBOT), *build_faults(ROBOT)))
    own = [one for one in placed if one.name == name]
    assert own
    rows = set()
    for one in own:
        moved = np.asarray(one.terms[0].screws[0].cause.of(at.state)) > 0
        first, last = np.flatnonzero(moved & used)[0], np.flatnonzero(~moved & used)[-1]
        gap = "" if first == last + 1 else f", after row {last}"
        assert one.sentence.endswith(f" from about row {first} on{gap}.")
        rows.add((last, first))
    assert (29, 31) in rows


@pytest.mark.unit
def test_many_groups_are_no_sessions(rng: np.random.Generator) -> None:
    """A group for every pose leaves the steps that are scanned."""
    at = campaign(list(range(60)), 0.0, rng)
    faults = build_faults(ROBOT)
    placed = place_steps(at, np.ones(60, bool), faults)
    assert list(map(without_sentence, placed)) == list(map(without_sentence, faults))


@pytest.mark.unit
def test_a_group_that_goes_on_meets_none(rng: np.random.Generator) -> None:
    """By the clock the first group begins before and ends after the second one."""
    at = campaign([0] * 20 + [1] * 20 + [2] * 20, 0.0, rng)
    progress = at.data.progress.copy()
    progress[19], progress[39] = progress[39], progress[19]
    mixed = replace(at.data, progress=progress)
    assert [begins for _, begins in list_changes(mixed)] == ['from the group "station 2" on']


@pytest.mark.integration
def test_a_held_out_row_stands_with_its_group(rng: np.random.Generator) -> None:
    groups = [0] * 50 + [1] * 50
    at = campaign(groups, 4.0, rng)
    used = training(at)
    split = Split(at, used, np.zeros(100, bool), np.arange(100) % 5, known_sigma=False)
    base = Model((mechanism("geometric", ROBOT),))
    _, diagnosis, _ = diagnose_split(split, Inquiry(base, build_faults(ROBOT), 1, cells=False))
    left = diagnosis.fit.residuals(at)[~used]
    assert np.linalg.norm(left, axis=1).max() < 0.3


@pytest.mark.unit
def test_steps_of_a_zero_are_told_by_the_row_and_stand_where_groups_meet(
    rng: np.random.Generator,
) -> None:
    first = int(rng.integers(20, 50))
    at = campaign([0] * first + [1] * (100 - first), 0.0, rng)
    used = training(at)
    placed = place_steps(at, used, every(ROBOT))
    own = [one for one in placed if one.name == "zero-step:4"]
    told = 'from about the beginning of the group "station 1" on.'
    (of_group,) = [one for one in own if one.sentence.endswith(told)]
    assert of_group.sentence.startswith("The zero of joint 4 is another one from ")
    cause = of_group.terms[0].screws[0].cause
    np.testing.assert_array_equal(np.asarray(cause.of(at.state)), at.data.group > 0)
    for one in own:
        if one is of_group:
            continue
        moved = np.asarray(one.terms[0].screws[0].cause.of(at.state))[used] > 0
        row = at.data.row[used][moved].min()
        assert one.sentence == f"The zero of joint 4 is another one from about row {row} on."


@pytest.mark.unit
def test_what_may_begin_with_either_of_two_groups_is_told_so(rng: np.random.Generator) -> None:
    """A group without estimation rows lies between them."""
    at = campaign([0] * 40 + [1] * 6 + [2] * 54, 0.0, rng)
    used = np.asarray(at.data.group != 1)
    placed = place_steps(at, used, build_faults(ROBOT))
    told = 'from about the beginning of the group "station 1" or "station 2" on.'
    sentences = [one.sentence for one in placed if one.name == "fault:tracker-bumped"]
    assert sum(one.endswith(told) for one in sentences) == 2
    assert not any(one.endswith('the group "station 1" on.') for one in sentences)


@pytest.mark.unit
def test_a_first_row_at_the_very_moment_of_a_step_is_before_it(rng: np.random.Generator) -> None:
    """Of 101 rows the second is where a step may be; with the first held out, a study ended in an error."""
    at = campaign([0] * 101, 0.0, rng)
    used = np.ones(101, bool)
    used[0] = False
    (moment,) = set(at.data.progress[[1]].tolist()) & set(STEPS)
    placed = place_steps(at, used, build_faults(ROBOT))
    own = tracker_bumped(ROBOT, moment)
    (told,) = (one for one in placed if one.terms == own.terms)
    row = at.data.where.name_row_alone(2)
    assert told.sentence.endswith(f" from about {row} on.")
