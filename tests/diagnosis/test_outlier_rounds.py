"""Outliers and names in turn: a slip that resembles outliers, and outliers at random places."""

from __future__ import annotations

import re

import numpy as np
import pytest
from builders import seeds, study_of
from hidden_arm import arm
from slipped_targets import TOOLS, Rng, bind_targets, draw_slip, measure, offer

from modelsel.diagnosis import outlier_rounds
from modelsel.diagnosis.candidates.candidate_list import build_candidates
from modelsel.diagnosis.candidates.options import DEFAULT_OPTIONS
from modelsel.diagnosis.faults.outlier_runs import propose_steps
from modelsel.diagnosis.findings.claim_sentences import describe_proven
from modelsel.diagnosis.findings.outcome import Diagnosis
from modelsel.diagnosis.findings.sentences import label_effect
from modelsel.diagnosis.outlier_rounds import alternate
from modelsel.diagnosis.separation import Inquiry
from modelsel.fitting.design import Model
from modelsel.fitting.problem import Problem
from modelsel.mechanisms.geometry import build_setup
from modelsel.mechanisms.registry import mechanism
from modelsel.mechanisms.step_moments import list_step_moments
from modelsel.robot.files import load_robot
from modelsel.selection.evaluation import Split


def ask(at: Problem) -> tuple[Split, Inquiry]:
    """A study of the data beyond the geometry and where each target sits, registered causes alone."""
    offsets = build_setup(at.robot, len(at.data.targets), 1, register=False, orientation=False)
    base = Model((offsets, mechanism("geometric", at.robot)))
    inquiry = Inquiry(base, offer(at), 1, False, lambda news: None, DEFAULT_OPTIONS)
    return study_of(at), inquiry


def draw_slips(rng: Rng, *slips: tuple[int, int, int], count: int = 3) -> Problem:
    """A campaign of 70 configurations; each slip is of a target by 0.4 mm, from a configuration on
    until before another one."""
    robot = load_robot("irb120")
    body = arm(robot, rng)
    q = body.draw(rng, 70, 2.6)
    shifts = np.zeros((70, count, 3))
    for target, begins, ends in slips:
        slip = draw_slip(rng)
        shifts[begins:ends, target] = 0.4 * slip / np.linalg.norm(slip)
    return bind_targets(robot, q, measure(body, q, TOOLS[:count], shifts, rng))


@pytest.mark.slow
@seeds(1, 2, 3, 4)
def test_a_short_slip_is_told_with_its_return(rng: Rng) -> None:
    """A slip and its return some configurations later were told as outliers, and no finding."""
    at = draw_slips(rng, (0, 30, 34))
    split, diagnosis, _ = alternate(*ask(at))
    assert not split.outlying.any()
    assert [label_effect(e) for e in diagnosis.effects] == [
        "target-step:A (1)",
        "target-step:A (2)",
    ]
    told = [describe_proven(effect) for effect in diagnosis.effects]
    rows = sorted(int(re.search(r"from about row (\d+) on", one)[1]) for one in told)
    assert abs(rows[0] - 90) <= 3
    assert abs(rows[1] - 102) <= 3


@pytest.mark.slow
@seeds(1, 2, 3, 4)
def test_rows_far_off_at_random_places_stay_outliers(rng: Rng) -> None:
    at = draw_slips(rng)
    chosen = rng.choice(len(at), 9, replace=False)
    position = at.data.position.copy()
    direction = rng.normal(size=(9, 3))
    direction /= np.linalg.norm(direction, axis=1)[:, None]
    position[chosen] += rng.uniform(1, 4, (9, 1)) * direction
    order = np.lexsort((at.data.target, at.data.configuration))
    assert (order == np.arange(len(at))).all()
    q = at.data.q[::3]
    split, diagnosis, _ = alternate(*ask(bind_targets(at.robot, q, position.reshape(-1, 3, 3))))
    assert set(np.flatnonzero(split.outlying)) == set(chosen)
    assert not diagnosis.effects


@pytest.mark.slow
@seeds(1)
def test_rows_far_off_beside_a_slip_stay_outliers(rng: Rng) -> None:
    at = draw_slips(rng, (1, 40, 70))
    chosen = [20, 77, 133, 191]
    position = at.data.position.copy()
    position[chosen] += 2.0
    q = at.data.q[::3]
    split, diagnosis, _ = alternate(*ask(bind_targets(at.robot, q, position.reshape(-1, 3, 3))))
    assert np.flatnonzero(split.outlying).tolist() == chosen
    assert [label_effect(effect) for effect in diagnosis.effects] == ["target-step:B"]


@pytest.mark.slow
def test_no_rows_are_searched_twice(rng: Rng, monkeypatch: pytest.MonkeyPatch) -> None:
    """All rows were searched anew in every round."""
    at = draw_slips(rng, (1, 40, 70))
    position = at.data.position.copy()
    position[[20, 77, 133, 191]] += 2.0
    q = at.data.q[::3]
    searched = []
    separate = outlier_rounds.separate

    def count(split: Split, *rest: object) -> tuple[Split, Diagnosis]:
        searched.append((split.outlying.tobytes(), rest[4]))
        return separate(split, *rest)

    monkeypatch.setattr(outlier_rounds, "separate", count)
    alternate(*ask(bind_targets(at.robot, q, position.reshape(-1, 3, 3))))
    assert len(set(searched)) == len(searched) > 1


def propose(at: Problem, rows: list[int]) -> list[tuple[str, float]]:
    """The names and moments of the steps that are proposed for some outliers."""
    split, inquiry = ask(at)
    found = build_candidates(at, inquiry.base, inquiry.everything, cells=False)
    outlying = np.zeros(len(at), bool)
    outlying[rows] = True
    steps = propose_steps(split, inquiry.base, found, outlying)
    moments = [list_step_moments(step.mechanism.terms).pop() for step in steps]
    return [(step.label, at) for step, at in zip(steps, moments, strict=True)]


@pytest.mark.slow
def test_steps_are_proposed_where_a_run_begins_and_ends(rng: Rng) -> None:
    at = draw_slips(rng, (0, 30, 37))
    first, second = propose(at, [90, 93, 96, 99, 102, 105, 108])
    assert first[0] == second[0] == "target-step:A"
    progress = at.data.progress
    assert progress[87] < first[1] < progress[90]
    assert progress[108] < second[1] < progress[111]


@pytest.mark.slow
def test_a_run_to_the_end_needs_one_step(rng: Rng) -> None:
    at = draw_slips(rng, (2, 65, 70))
    ((name, moment),) = propose(at, [197, 200, 203, 206, 209])
    assert name == "target-step:C"
    assert at.data.progress[194] < moment < at.data.progress[197]


@pytest.mark.unit
def test_no_steps_are_proposed_for_scattered_outliers(rng: Rng) -> None:
    """Two rows of a target after each other are no run; nor is a configuration of three targets."""
    at = draw_slips(rng)
    assert not propose(at, [10, 40, 43, 90, 91, 92, 150])


@pytest.mark.integration
def test_all_targets_that_slip_for_a_while_get_one_pair(rng: Rng) -> None:
    at = draw_slips(rng)
    position = at.data.position.copy().reshape(-1, 3, 3)
    robot, q = at.robot, at.data.q[::3]
    at = bind_targets(robot, q, position)
    position[30:36] += draw_slip(rng)
    moved = bind_targets(robot, q, position)
    proposed = propose(moved, list(range(90, 108)))
    assert [name for name, _ in proposed] == ["tracker-step", "tracker-step"]
