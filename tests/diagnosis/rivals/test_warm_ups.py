"""A warm-up is told with the time constant that the data tell, not with the nearest of four."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from builders import drawn, measured, seeds
from searches import search_separated

from modelsel.diagnosis.candidates.candidate import Candidate
from modelsel.diagnosis.candidates.candidate_list import build_candidates
from modelsel.diagnosis.candidates.signatures import read_signatures
from modelsel.diagnosis.findings.told_explanations import find_constant, sum_constants
from modelsel.diagnosis.rivals.unlisted_shapes import list_rivals
from modelsel.diagnosis.rivals.warm_ups import APART, fit_warm_up, generate_finer_warm_ups
from modelsel.diagnosis.shapes.campaign_clocks import build_warm_ups, build_warming_causes
from modelsel.diagnosis.shapes.candidate_kinds import CandidateKind
from modelsel.diagnosis.shapes.cause_words import write_cause
from modelsel.diagnosis.shapes.shape_constants import find_time_constant
from modelsel.diagnosis.shapes.unregistered import build_cell
from modelsel.fitting.design import Model
from modelsel.fitting.problem import Problem
from modelsel.measurements.measurements import build_measurements
from modelsel.mechanisms.causes import Applied, q
from modelsel.mechanisms.environment import PROGRESS
from modelsel.mechanisms.registry import every, mechanism
from modelsel.mechanisms.terms import Mechanism

SIGMA = 0.03
PLACE = (1, "tx")


def warm_up(at: Problem, share: float) -> Mechanism:
    """A warm-up of the first frame, by its time constant in shares of the campaign."""
    return build_cell(PLACE, build_warm_ups(at, [share]))


def cell(warming: Mechanism, prior: float = 0.01) -> Candidate:
    return Candidate(warming, CandidateKind.CELL, prior)


def test_finer_constants_lie_between_the_neighbours(rng: np.random.Generator) -> None:
    at = drawn("ur5", rng, 40)
    duration = float(np.ptp(at.data.covariates["time_s"]))
    found = warm_up(at, 0.1)
    assert find_time_constant(found) == pytest.approx(0.1 * duration)
    finer = list(generate_finer_warm_ups(at, found))
    shares = np.array([find_time_constant(one) for one in finer]) / duration
    assert {tuple(one.names_by_place()) for one in finer} == {(PLACE,)}
    assert found not in finer
    assert 0.1 / APART < shares.min() < 0.045
    assert 0.22 < shares.max() < 0.1 * APART
    nearest = np.sort(np.abs(np.log(shares / 0.1)))
    assert nearest[0] < 0.002
    assert nearest[-1] < np.log(APART)


def test_what_is_no_warm_up_has_no_constant(rng: np.random.Generator) -> None:
    at = drawn("ur5", rng, 40)
    others = [
        mechanism("tracker-drift", at.robot),
        build_cell(PLACE, (PROGRESS,)),
        build_cell(PLACE, (Applied("exp", q(1) / -0.5),)),
        build_cell(PLACE, build_warm_ups(at, [0.1, 0.5])),
    ]
    for other in others:
        assert find_time_constant(other) is None
        assert not list(generate_finer_warm_ups(at, other))


def test_constants_of_a_warm_up_are_one_question(rng: np.random.Generator) -> None:
    at = drawn("ur5", rng, 40)
    beside = cell(build_cell((2, "tx"), build_warm_ups(at, [0.1])))
    found = [cell(warm_up(at, 0.1)), cell(warm_up(at, 0.13)), beside]
    assert sum_constants(found, 0) == found[0].prior
    better = find_constant(found, 0, np.array([10.0, 12.0, 30.0]))
    assert better is not None
    assert better.mechanism == found[1].mechanism
    shape = read_signatures(found)[2]
    assert shape[0] == shape[1] != shape[2]


def test_rivals_of_a_warm_up_have_other_constants(rng: np.random.Generator) -> None:
    at = drawn("ur5", rng, 40)
    own = cell(warm_up(at, 0.1))
    same = [rival for rival in list_rivals(at, own) if rival.agrees == "shape"]
    assert {rival.candidate.mechanism for rival in same} == set(
        generate_finer_warm_ups(at, own.mechanism)
    )
    assert sum(rival.candidate.prior for rival in same) == pytest.approx(own.prior)


def test_a_course_that_warms_up_tells_its_constant(rng: np.random.Generator) -> None:
    at = drawn("ur5", rng, 40)
    time = at.data.covariates["time_s"]
    share = rng.uniform(0.03, 1.5)
    course = 3.0 - 2.0 * np.exp(-time / share / np.ptp(time))
    told = fit_warm_up(at, PLACE, course)
    assert find_time_constant(told) == pytest.approx(share * np.ptp(time), rel=3e-3)


def with_days(at: Problem, days: int) -> Problem:
    """The same rows, measured in a part of each of some days."""
    m = len(at)
    day = np.arange(m) * days // m
    time = 86400.0 * day + 120.0 * np.arange(m)
    again = build_measurements(at.data.q, at.data.position, covariates={"time_s": time})
    return replace(at, data=again)


def test_a_warm_up_may_start_afresh_after_a_rest(rng: np.random.Generator) -> None:
    at = drawn("ur5", rng, 60)
    lasting = build_warming_causes(at)
    assert all(cause.names() == {"time_s"} for cause in lasting)
    days = with_days(at, 3)
    afresh = [c for c in build_warming_causes(days) if c.names() == {"since_rest_s"}]
    assert len(afresh) == len(lasting)
    since = days.state.value("since_rest_s")
    constant = rng.uniform(400, 900)
    told = fit_warm_up(days, PLACE, 1.0 + 2.0 * np.exp(-since / constant))
    assert told is not None
    assert told.names() == {"since_rest_s"}
    assert find_time_constant(told) == pytest.approx(constant, rel=3e-3)
    finer = list(generate_finer_warm_ups(days, told))
    assert finer
    assert all(one.names() == {"since_rest_s"} for one in finer)
    (screw,) = told.terms[0].screws
    assert write_cause(screw.cause).endswith("min after each rest")
    lasting_course = np.exp(-days.state.value("time_s") / 80_000)
    slow = fit_warm_up(days, PLACE, lasting_course)
    assert slow is not None
    assert slow.names() == {"time_s"}


@pytest.mark.slow
@seeds(1, 2)
def test_a_base_that_warms_up_every_day_is_told_so(rng: np.random.Generator) -> None:
    """By an exponential that the test writes itself; a wave of a day was told, 20 times as large."""
    at = drawn("irb120", rng, 120)
    axis, constant = rng.integers(3), rng.uniform(600, 1500)
    days = with_days(at, 3)
    since = 120.0 * (np.arange(120) % 40)
    position = at.data.position + rng.normal(0, SIGMA, at.data.position.shape)
    position[:, axis] += 8 * SIGMA * (1 - np.exp(-since / constant))
    warming = measured(days, position)
    base = Model((mechanism("geometric", at.robot),))
    found = search_separated(warming, base, build_candidates(warming, base, every(at.robot)))
    (effect,) = found.effects
    told = effect.candidate.mechanism
    assert told.names_by_place() == {(1, ("tx", "ty", "tz")[axis]): {"since_rest_s"}}
    assert find_time_constant(told) == pytest.approx(constant, rel=0.4)
    assert abs(effect.estimate[0]) == pytest.approx(8 * SIGMA, rel=0.3)
    assert effect.claim.level == "shape"


@pytest.mark.slow
@seeds(1, 2)
@pytest.mark.parametrize("size", [30, 200])
def test_a_base_that_warms_up_is_told_with_its_constant(
    size: float, rng: np.random.Generator
) -> None:
    """By an exponential that the test writes itself, with a constant that is drawn; a large one was told
    as several functions of time."""
    at = drawn("irb120", rng, 90)
    share, axis = np.exp(rng.uniform(np.log(0.04), np.log(0.6))), rng.integers(3)
    position = at.data.position + rng.normal(0, SIGMA, at.data.position.shape)
    position[:, axis] += size * SIGMA * (1 - np.exp(-at.state.value("progress") / share))
    warming = measured(at, position)
    base = Model((mechanism("geometric", at.robot),))
    found = search_separated(warming, base, build_candidates(warming, base, every(at.robot)))
    (effect,) = found.effects
    told = effect.candidate.mechanism
    assert told.names_by_place() == {(1, ("tx", "ty", "tz")[axis]): {"time_s"}}
    constant = find_time_constant(told)
    duration = float(np.ptp(at.data.covariates["time_s"]))
    assert constant == pytest.approx(share * duration, rel=5 / size)
    assert effect.claim.level == "shape"
