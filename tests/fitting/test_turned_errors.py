"""Joints that rows of a visit or of a posture tell: errors of heavy tails are no joint, nor is what these
rows share in all directions."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from builders import OFF_AXIS, bind, seeds, small_arm
from numpy.random import Generator

from modelsel._typing import Array
from modelsel.fitting.design import Model
from modelsel.fitting.error_structure import _build_model, find_structure
from modelsel.fitting.largest_likelihood import maximise_likelihood
from modelsel.fitting.least_squares import fit
from modelsel.fitting.part_trials import LEVEL, _Beside, _score_parts, _try
from modelsel.fitting.possible_parts import PossiblePart, list_parts
from modelsel.fitting.problem import Problem
from modelsel.fitting.restricted_likelihood import Likelihood, evaluate_likelihood
from modelsel.fitting.turned_errors import compute_turned_p
from modelsel.measurements.measurements import build_measurements
from modelsel.mechanisms.registry import mechanism
from modelsel.robot.kinematics import forward

ARM = small_arm()
BASE = Model((mechanism("geometric", ARM),))
SIGMA, POSTURES = 0.05, 25
Draw = Callable[[Generator, int], Array]
TOOLS = np.array([OFF_AXIS, (-60.0, 30.0, 140.0)])


def normal(rng: Generator, rows: int) -> Array:
    return SIGMA * rng.normal(size=(rows, 3))


def loud(rng: Generator, rows: int) -> Array:
    """Student's with three degrees of freedom: a few rows are off by many times the others."""
    return normal(rng, rows) / np.sqrt(rng.chisquare(3, (rows, 1)) / 3)


def come_back(rng: Generator, errors: Array, readings: Array | float = 0.0) -> Problem:
    """Postures visited again and again, one target, the joints off their readings."""
    q = np.tile(ARM.draw(rng, POSTURES), (len(errors) // POSTURES, 1))
    position = forward(ARM, q + readings, TOOLS[0]) + errors
    return bind(ARM, build_measurements(q, position), TOOLS[:1])


def see_targets(rng: Generator, shared: float) -> Problem:
    """Sixty visits with two targets, whose errors are in part the same."""
    q = ARM.draw(rng, 60)
    own = shared * rng.normal(size=(60, 3))
    measured = [forward(ARM, q, tool) + own + normal(rng, 60) for tool in TOOLS]
    position = np.stack(measured, axis=1).reshape(-1, 3)
    target = np.tile(["a", "b"], 60)
    data = build_measurements(q.repeat(2, axis=0), position, target=target)
    return bind(ARM, data, TOOLS)


def look(at: Problem) -> tuple[Likelihood, dict[tuple[str, str], PossiblePart]]:
    """Return the likelihood of independent errors at the geometric base, and what may be there."""
    every = np.ones(len(at), bool)
    model = _build_model(at, fit(at, BASE))
    parts = {(part.name, part.told_by): part for part in list_parts(at, every)}
    return evaluate_likelihood(model, ()), parts


def tell_joints(at: Problem) -> set[str]:
    every = np.ones(len(at), bool)
    found = find_structure(at, every, fit(at, BASE), list_parts(at, every))
    return {name for name in found.names if name.startswith("joint")}


@pytest.mark.integration
@pytest.mark.parametrize("draw", [normal, loud])
@pytest.mark.parametrize("shared", [0.0, 2 * SIGMA])
@seeds(1, slow=(2,))
def test_chance_is_as_often_as_it_says(rng: Generator, draw: Draw, shared: float) -> None:
    """Of sixty joints that repeat, also where the visits of a posture share an error."""
    ps = []
    for _ in range(20):
        own = shared * rng.normal(size=(POSTURES, 3))
        at = come_back(rng, draw(rng, 3 * POSTURES) + np.tile(own, (3, 1)))
        none, parts = look(at)
        posture = replace(parts["configuration", "repeats"].error, variance=1.0)
        given = maximise_likelihood(none.model, [posture], exact=False)
        ps += [compute_turned_p(given, parts[f"joint {j}", "repeats"].error) for j in (1, 2, 3)]
    # beyond these by chance in less than one of a thousand, if the three were independent
    assert np.mean(np.array(ps) <= 0.1) <= 0.25
    assert 0.35 <= np.mean(ps) <= 0.7


@pytest.mark.integration
@seeds(1, slow=(2,))
def test_loud_rows_of_repeats_are_rarely_a_joint(rng: Generator) -> None:
    told = [tell_joints(come_back(rng, loud(rng, 4 * POSTURES))) for _ in range(20)]
    assert sum(map(bool, told)) <= 3


@seeds(1, 2)
def test_a_joint_is_told_by_repeats_among_loud_rows(rng: Generator) -> None:
    readings = np.zeros((4 * POSTURES, ARM.n))
    readings[:, 1] = rng.uniform(-1, 1, 4 * POSTURES) * 1.2e-3
    at = come_back(rng, loud(rng, 4 * POSTURES), readings)
    assert tell_joints(at) == {"joint 2"}


@seeds(1, 2, 3)
def test_what_targets_share_is_no_joint(rng: Generator) -> None:
    none, parts = look(see_targets(rng, 3 * SIGMA))
    scores = _score_parts(none, list(parts.values()), [])
    beside = _Beside.of(none, scores)
    joints = [score for score in scores if score.part.name.startswith("joint")]
    trials = [_try(none, score.part, score.variance, 0.0) for score in joints]
    held = [beside.hold(trial) for trial in trials]
    assert min(trial.p for trial in trials) < 1e-6
    assert all(trial.p > LEVEL / 10 for trial in held)


@seeds(1, 2, 3)
def test_a_few_wild_rows_do_not_hide_a_joint(rng: Generator) -> None:
    rows = 4 * POSTURES
    readings = np.zeros((rows, ARM.n))
    readings[:, 1] = rng.uniform(-1, 1, rows) * 5e-4
    errors = normal(rng, rows)
    errors[rng.permutation(rows)[:4]] *= 20
    none, parts = look(come_back(rng, errors, readings))
    assert compute_turned_p(none, parts["joint 2", "repeats"].error) < LEVEL / 10


def test_joints_told_by_directions_are_one_test(rng: Generator) -> None:
    q = ARM.draw(rng, 40)
    once = bind(ARM, build_measurements(q, forward(ARM, q, TOOLS[0])), TOOLS[:1])
    again = come_back(rng, normal(rng, 2 * POSTURES))
    for at, tests in ((once, ARM.n), (again, 1)):
        listed = list_parts(at, np.ones(len(at), bool))
        joints = [part for part in listed if part.name.startswith("joint")]
        assert [part.tests for part in joints] == [tests] * ARM.n
