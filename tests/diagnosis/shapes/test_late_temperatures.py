"""A link that follows the temperature late is told by the temperature, not by waves in time."""

from __future__ import annotations

import numpy as np
import pytest
from builders import OFF_AXIS, bind, drawn, seeds
from exact import flanges_of
from searches import search_separated

from modelsel.diagnosis.candidates.candidate import Candidate
from modelsel.diagnosis.candidates.candidate_list import build_candidates, find_cell_prior
from modelsel.diagnosis.candidates.signatures import LEVELS, read_signatures
from modelsel.diagnosis.findings.told_explanations import find_constant, sum_constants
from modelsel.diagnosis.rivals.confounded_covariates import find_confounded
from modelsel.diagnosis.rivals.unlisted_shapes import Price, list_rivals
from modelsel.diagnosis.shapes.candidate_kinds import CandidateKind
from modelsel.diagnosis.shapes.cause_words import append_cause
from modelsel.diagnosis.shapes.late_temperatures import generate_campaign_cells, is_late
from modelsel.diagnosis.shapes.unregistered import build_cell
from modelsel.fitting.design import Model
from modelsel.fitting.problem import Problem
from modelsel.measurements.campaign.clock_history import LAGS, find_lags
from modelsel.measurements.measurements import build_measurements
from modelsel.mechanisms.campaign_registry import set_reference
from modelsel.mechanisms.environment import find_references, temperature_rise
from modelsel.mechanisms.registry import BUILTIN, build_mechanisms, every, mechanism
from modelsel.robot.files import load_robot

ARM = load_robot("irb120")
ROWS = 100
SIGMA = 0.03
PLACE = (3, "tx")


def measure(
    rng: np.random.Generator, air: np.ndarray, time: np.ndarray, zero: np.ndarray
) -> Problem:
    """Positions of an arm of which joint 3's zero moves by so many rad (m,), by the exact chain."""
    read = ARM.draw(rng, ROWS)
    stands = read.copy()
    stands[:, 2] += zero
    flange = flanges_of(ARM, stands)
    position = flange[:, :3, 3] + flange[:, :3, :3] @ np.array(OFF_AXIS)
    position += rng.normal(0, SIGMA, position.shape)
    covariates = {"temperature_C": air, "time_s": time}
    return bind(ARM, build_measurements(read, position, covariates=covariates))


def swing(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Times (m,) [s] of some hours, and a temperature (m,) that swings and wanders meanwhile."""
    time = np.cumsum(rng.uniform(40, 160, ROWS))
    waves = rng.uniform(1.2, 2.3) * time / time[-1]
    air = 20 + 5 * np.sin(2 * np.pi * waves + rng.uniform(0, 6))
    return time, air + np.cumsum(rng.normal(0, 0.15, ROWS))


def follow(air: np.ndarray, time: np.ndarray, minutes: float) -> np.ndarray:
    """What a mass has, by small steps of its equation."""
    fine = np.arange(time[0], time[-1], 2.0)
    path = np.interp(fine, time, air)
    late = np.empty_like(path)
    late[0] = path[0]
    for k in range(1, len(fine)):
        late[k] = late[k - 1] + 2.0 / (60 * minutes) * (path[k] - late[k - 1])
    return np.interp(time, fine, late)


def search(at: Problem) -> tuple[Candidate, ...]:
    """What is told of the data, where mechanisms may be late as a study lets them be."""
    lags = find_lags(at.data.covariates["temperature_C"], at.data.late_temperature)
    registry = set_reference(BUILTIN, at.data.reference_celsius, lags)
    base = Model((mechanism("geometric", at.robot),))
    candidates = build_candidates(at, base, every(at.robot, registry))
    return tuple(search_separated(at, base, candidates).effects)


@seeds(1)
def test_all_lags_of_a_mechanism_weigh_like_one(rng: np.random.Generator) -> None:
    at = drawn(ARM, rng, 40)
    base = Model((mechanism("geometric", at.robot),))
    names = ("thermal-growth", "thermal-zero", "thermal-expansion", "gear-eccentricity")
    few = {name: BUILTIN[name] for name in names}
    registry = set_reference(few, 20.0, (10, 25, 80))
    plain = build_candidates(at, base, every(at.robot, few), cells=False)
    lagging = build_candidates(at, base, every(at.robot, registry), cells=False)

    def sum_priors(found: tuple[Candidate, ...], name: str, late: bool) -> float:
        own = [c for c in found if c.registered_name == name]
        return sum(c.prior for c in own if is_late(c.mechanism) is late)

    for name in ("thermal-growth:2", "thermal-zero:3", "thermal-expansion"):
        whole = sum_priors(plain, name, late=False)
        assert whole > 0
        assert sum_priors(lagging, name, late=False) == pytest.approx(whole / 2)
        assert sum_priors(lagging, name, late=True) == pytest.approx(whole / 2)
    other = "gear-eccentricity:1"
    assert sum_priors(lagging, other, late=False) == sum_priors(plain, other, late=False)


@seeds(1)
def test_late_cells_of_a_place_weigh_like_a_cell(rng: np.random.Generator) -> None:
    at = drawn(ARM, rng, 40)
    offered = [one for one in generate_campaign_cells(at) if is_late(one.mechanism)]
    own = [one for one in offered if PLACE in one.mechanism.names_by_place()]
    assert 1 < len(own) <= len(LAGS)
    assert sum(one.weight for one in own) == pytest.approx(1)
    late = [Candidate(one.mechanism, one.kind, 0.01 * one.weight) for one in own]
    plain = Candidate(build_cell(PLACE, (temperature_rise(20.0),)), CandidateKind.CELL, 0.01)
    assert find_cell_prior([*late, plain]) == 0.01


@seeds(1)
def test_nothing_is_late_without_a_clock(rng: np.random.Generator) -> None:
    at = drawn(ARM, rng, 40)
    for left_out in ("time_s", "temperature_C"):
        some = {name: own for name, own in at.data.covariates.items() if name != left_out}
        data = build_measurements(at.data.q, at.data.position, covariates=some)
        offered = [one.mechanism for one in generate_campaign_cells(bind(ARM, data))]
        assert offered
        assert not any(map(is_late, offered))


@seeds(1)
def test_lags_are_one_question_about_the_temperature(rng: np.random.Generator) -> None:
    at = drawn(ARM, rng, 40)
    lagging = [build_cell(PLACE, (temperature_rise(20.0, lag),)) for lag in (20, 25)]
    plain = build_cell(PLACE, (temperature_rise(20.0),))
    found = [Candidate(m, CandidateKind.CELL, 0.01) for m in (*lagging, plain)]
    said = read_signatures(found)
    drivers, shape = said[LEVELS.index("drivers")], said[LEVELS.index("shape")]
    assert drivers[0] == drivers[1] == drivers[2]
    assert shape[0] == shape[1] != shape[2]
    assert sum_constants(found, 0) == pytest.approx(0.02)
    better = find_constant(found, 0, np.array([10.0, 12.0, 30.0]))
    assert better is not None
    assert better.mechanism == lagging[1]
    assert append_cause(lagging[0], "") == (
        " in proportion to the temperature 20 min late, counted from 20 °C"
    )
    assert find_references(temperature_rise(21.0, 25)) == {21.0}
    rivals = list_rivals(at, found[0], Price(0.02, 0.04))
    free = [r.candidate for r in rivals if r.agrees == "drivers"]
    # a free function of one lag has no more than that lag's share
    assert sum(c.prior for c in free) <= 0.5 * 0.04 * 0.5 + 1e-12


@seeds(1)
def test_a_late_temperature_that_only_rose_is_no_proven_driver(rng: np.random.Generator) -> None:
    time = np.arange(ROWS) * 60.0
    rising = measure(rng, 18 + time / 1000, time, np.zeros(ROWS))
    late = build_cell(PLACE, (temperature_rise(20.0, 25),))
    assert find_confounded(rising, late) == "temperature_25_min_late"
    air = 20 + 5 * np.sin(2 * np.pi * rng.uniform(5, 7) * time / time[-1])
    own_way = measure(rng, air, time, np.zeros(ROWS))
    soon = build_cell(PLACE, (temperature_rise(20.0, 5),))
    assert find_confounded(own_way, soon) is None


@seeds(1)
def test_the_sentence_of_a_late_mechanism_says_so(rng: np.random.Generator) -> None:
    registry = set_reference(BUILTIN, 22.0, (25,))
    names = ("thermal-growth:2", "thermal-zero:1", "thermal-expansion")
    for name in names:
        plain, late = build_mechanisms(name, ARM, registry)
        assert "late" not in plain.sentence
        assert "temperature, 25 min late, counted from 22 °C" in late.sentence
        assert plain.names() == {"temperature_C"}
        assert late.names() == {"temperature_25_min_late"}
        assert late.name == plain.name


@pytest.mark.slow
@seeds(1, 2, 3)
def test_a_zero_that_follows_late_is_told_with_its_lag(rng: np.random.Generator) -> None:
    """By small steps of the test's own, with a lag that is drawn."""
    time, air = swing(rng)
    minutes = np.exp(rng.uniform(np.log(12), np.log(60)))
    zero = 1.5e-4 * (follow(air, time, minutes) - 20)
    (effect,) = search(measure(rng, air, time, zero))
    told = effect.candidate
    assert told.registered_name == "thermal-zero:3"
    (name,) = told.mechanism.names()
    lag = int(name.split("_")[1])
    assert abs(np.log(lag / minutes)) < 0.4
    assert effect.claim.level in ("drivers", "cause")


@pytest.mark.slow
@seeds(1, 2, 3)
def test_a_zero_that_follows_at_once_is_not_late(rng: np.random.Generator) -> None:
    time, air = swing(rng)
    (effect,) = search(measure(rng, air, time, 1.5e-4 * (air - 20)))
    assert effect.candidate.registered_name == "thermal-zero:3"
    assert not is_late(effect.candidate.mechanism)
    assert effect.claim.level == "cause"


@pytest.mark.slow
@seeds(1, 2, 3)
def test_a_temperature_that_does_nothing_is_not_told(rng: np.random.Generator) -> None:
    time, air = swing(rng)
    assert not search(measure(rng, air, time, np.zeros(ROWS)))
