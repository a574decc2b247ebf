"""A base that sways slowly is found and predicted, and is no error that lasts."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from builders import drawn, measured, seeds
from searches import search_separated

from modelsel.diagnosis.candidates.candidate_list import build_candidates
from modelsel.diagnosis.shapes.candidate_kinds import CandidateKind
from modelsel.diagnosis.shapes.distinct_places import find_frames
from modelsel.diagnosis.shapes.time_waves import (
    COUNTS,
    SPACING,
    generate_finer_time_waves,
    generate_time_waves,
)
from modelsel.fitting.design import Model
from modelsel.fitting.problem import Problem
from modelsel.mechanisms.registry import every, mechanism
from modelsel.mechanisms.terms import Mechanism

SIGMA = 0.03


def with_clock(at: Problem, time: np.ndarray | None) -> Problem:
    """The same rows with another clock, or none."""
    covariates = {name: own for name, own in at.data.covariates.items() if name != "time_s"}
    if time is not None:
        covariates["time_s"] = time
    return replace(at, data=replace(at.data, covariates=covariates))


def evaluate(wave: Mechanism, at: Problem) -> np.ndarray:
    """The values (2, m) of its sine and cosine."""
    return np.array([term.screws[0].cause.of(at.state) for term in wave.terms])


@seeds(1)
def test_each_place_has_its_waves_on_either_clock(rng: np.random.Generator) -> None:
    at = with_clock(drawn("puma760", rng, 30), None)
    places = find_frames(at.robot)
    by_progress = [one.mechanism for one in generate_time_waves(at)]
    # rotations of a target of which positions alone are known show nowhere
    assert len(by_progress) == (len(places) - 3) * len(COUNTS)
    clocked = with_clock(at, 1000.0 + 600.0 * at.state.value("progress"))
    by_time = [one.mechanism for one in generate_time_waves(clocked)]
    for first, second in zip(by_progress, by_time, strict=True):
        assert first.names() == {"progress"}
        assert second.names() == {"time_s"}
        assert evaluate(first, at) == pytest.approx(evaluate(second, clocked), abs=1e-4)
    assert not list(generate_time_waves(with_clock(at, np.full(len(at), 5.0))))


@seeds(1)
def test_waves_are_looked_for_where_rows_cover_them(rng: np.random.Generator) -> None:
    """A wave of a day was fitted through windows of an hour, 22 hours apart, with any amplitude."""
    at = drawn("puma760", rng, 30)
    evenly = 600.0 * np.arange(30)
    whole = [one.mechanism for one in generate_time_waves(with_clock(at, evenly))]
    days = evenly % 9000 + 86400 * (np.arange(30) // 15)
    assert not list(generate_time_waves(with_clock(at, days)))
    # a gap of 3 hours in some 8: as long as a quarter of a wave's period, or longer, but for the slowest
    gap = with_clock(at, evenly + 10800 * (np.arange(30) >= 15))
    covered = [one.mechanism for one in generate_time_waves(gap)]
    assert len(covered) == len(whole) / len(COUNTS)
    assert {wave.name.split()[2] for wave in covered} == {"0.5"}
    finer = [one.name.split()[2] for one in generate_finer_time_waves(gap, covered[0])]
    assert 0.5 < max(map(float, finer)) < 0.75


@seeds(1)
def test_finer_waves_lie_between_the_neighbours(rng: np.random.Generator) -> None:
    at = drawn("ur5", rng, 40)
    wave = next(
        one.mechanism for one in generate_time_waves(at) if "1.5 waves" in one.mechanism.name
    )
    finer = [one.name.split()[2] for one in generate_finer_time_waves(at, wave)]
    counts = [1.0 if count == "one" else float(count) for count in finer]
    assert min(counts) > 1.5 - SPACING
    assert max(counts) < 1.5 + SPACING
    assert len(set(counts)) == len(counts)
    assert 1.5 not in counts
    drift = mechanism("tracker-drift", at.robot)
    assert not list(generate_finer_time_waves(at, drift))


@pytest.mark.slow
@seeds(1, 2, 3)
def test_a_base_that_sways_is_found_with_its_number(rng: np.random.Generator) -> None:
    """By a sine that the test writes itself, with a number that is drawn."""
    at = drawn("irb120", rng, 90)
    count, phase, axis = rng.uniform(0.8, 2.4), rng.uniform(0, 2 * np.pi), rng.integers(3)
    position = at.data.position + rng.normal(0, SIGMA, at.data.position.shape)
    position[:, axis] += 4 * SIGMA * np.sin(2 * np.pi * count * at.state.value("progress") + phase)
    swaying = measured(at, position)
    base = Model((mechanism("geometric", at.robot),))
    found = search_separated(swaying, base, build_candidates(swaying, base, every(at.robot)))
    (effect,) = found.effects
    told = effect.candidate
    assert told.kind is CandidateKind.TIME_WAVE, found.path
    assert told.mechanism.names_by_place() == {(1, ("tx", "ty", "tz")[axis]): {"time_s"}}
    word = told.mechanism.name.split()[2]
    assert (1.0 if word == "one" else float(word)) == pytest.approx(count, abs=0.12)
    assert not found.errors.names
