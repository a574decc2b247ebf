"""A covariate that went with the sessions or with time is no proven driver; one that went its own way
is."""

from __future__ import annotations

import numpy as np
import pytest
from builders import OFF_AXIS, bind, seeds
from exact import flanges_of
from searches import search_separated

from modelsel.diagnosis.candidates.candidate import Candidate
from modelsel.diagnosis.candidates.candidate_list import build_candidates
from modelsel.diagnosis.candidates.signatures import LEVELS, PROVEN
from modelsel.diagnosis.findings.name_legend import explain_names
from modelsel.diagnosis.findings.sentences import describe_candidate
from modelsel.diagnosis.rivals import unlisted_shapes
from modelsel.diagnosis.rivals.confounded_covariates import (
    find_confounded,
    generate_confounded,
    substitute,
    substitute_time,
    substitute_value,
)
from modelsel.diagnosis.rivals.covariate_jumps import find_stretch
from modelsel.diagnosis.rivals.free_functions import build_function
from modelsel.diagnosis.rivals.unlisted_shapes import list_rivals
from modelsel.diagnosis.shapes.candidate_kinds import CandidateKind
from modelsel.diagnosis.shapes.driver_functions import IN_TIME
from modelsel.fitting.design import Model
from modelsel.fitting.problem import Problem
from modelsel.measurements.measurements import build_measurements
from modelsel.mechanisms.causes import Applied, Cause, Named, cos, q
from modelsel.mechanisms.environment import temperature_rise
from modelsel.mechanisms.registry import every, mechanism
from modelsel.mechanisms.terms import Mechanism, Screw, Term
from modelsel.robot.files import load_robot

ARM = load_robot("ur5e")
ROWS = 100
ZERO = 3  # the joint whose zero moves


def measure(
    warm: np.ndarray, moved: np.ndarray, sessions: int, rng: np.random.Generator
) -> Problem:
    """Positions of an arm of which one joint's zero moves by so many rad (m,), by the exact chain."""
    q_read = ARM.draw(rng, ROWS)
    stands = q_read.copy()
    stands[:, ZERO - 1] += moved
    flange = flanges_of(ARM, stands)
    position = flange[:, :3, 3] + flange[:, :3, :3] @ np.array(OFF_AXIS)
    position += rng.normal(0, 0.03, position.shape)
    groups = [f"session {k}" for k in np.arange(ROWS) * sessions // ROWS]
    covariates = {"temperature_C": warm}
    return bind(ARM, build_measurements(q_read, position, group=groups, covariates=covariates))


def list_sorts(at: Problem, found: Mechanism) -> list[list[Mechanism]]:
    """What stands beside a finding's covariate, by sorts."""
    return [sort.mechanisms for sort in generate_confounded(at, found)]


def twice(low: float, high: float) -> np.ndarray:
    """A value that is another one in the second half."""
    return np.repeat([low, high], ROWS // 2)


@pytest.mark.unit
def test_another_course_takes_a_covariates_place() -> None:
    course = Named("progress")
    assert str(substitute(temperature_rise(20.0) * cos(q(2)), "temperature_C", course)) == (
        "progress*cos(q2)"
    )
    assert str(substitute(cos(2.0 * Named("load")), "load", course)) == "cos(2*progress)"
    assert substitute(q(2), "load", course) == q(2)
    # with what it is counted from
    warm = substitute_value(temperature_rise(20.0) * cos(q(2)), "temperature_C", course)
    assert str(warm) == "(progress-20)*cos(q2)"


@pytest.mark.unit
def test_growth_of_every_frame_stands_against_time_that_temperature_went_with(
    rng: np.random.Generator, monkeypatch: pytest.MonkeyPatch
) -> None:
    """However many frames it moves: where they are many, it has no other rivals."""
    monkeypatch.setattr(unlisted_shapes, "MAX_PARTS", 1)
    at = measure(np.linspace(20.0, 29.0, ROWS), np.zeros(ROWS), 1, rng)
    grown = Candidate(mechanism("thermal-expansion", ARM), CandidateKind.MECHANISM, 0.01)
    rivals = list_rivals(at, grown)
    assert rivals
    assert all(one.candidate.mechanism.names() & IN_TIME for one in rivals)
    own_way = measure(rng.uniform(20.0, 29.0, ROWS), np.zeros(ROWS), 1, rng)
    assert not list_rivals(own_way, grown)


@pytest.mark.unit
def test_what_goes_its_own_way_has_no_such_rivals(rng: np.random.Generator) -> None:
    at = measure(rng.uniform(18, 30, ROWS), np.zeros(ROWS), 2, rng)
    thermal = mechanism(f"thermal-zero:{ZERO}", ARM)
    assert find_confounded(at, thermal) is None
    assert not list(generate_confounded(at, thermal))


@pytest.mark.unit
def test_steps_between_sessions_are_rivals(rng: np.random.Generator) -> None:
    at = measure(twice(21, 27), np.zeros(ROWS), 2, rng)
    thermal = mechanism(f"thermal-zero:{ZERO}", ARM)
    assert find_confounded(at, thermal) == "temperature_C"
    (stepping,), *_ = list_sorts(at, thermal)
    cause = stepping.terms[0].screws[0].cause
    np.testing.assert_array_equal(cause.of(at.state), at.data.group)
    assert (
        stepping.sentence
        == f'The zero of joint {ZERO} is another one from the group "session 1" on.'
    )


def carry(begins: int, ends: int) -> np.ndarray:
    """1 on some rows, 0 on the others."""
    rows = np.arange(ROWS)
    return ((rows >= begins) & (rows < ends)).astype(float)


@pytest.mark.unit
@pytest.mark.parametrize("sessions", [1, 4])
def test_a_stretch_that_a_covariate_tells_from_the_rest_is_a_rival(
    sessions: int, rng: np.random.Generator
) -> None:
    """One number, whatever the sessions, and of a free function of the covariate, too."""
    there = carry(50, 75)
    at = measure(21 + 3.5 * there + rng.normal(0, 0.1, ROWS), np.zeros(ROWS), sessions, rng)
    thermal = mechanism(f"thermal-zero:{ZERO}", ARM)
    free = build_function(at, (ZERO, "rz"), "temperature_C", 6)
    for found in (thermal, free):
        assert find_confounded(at, found) == "temperature_C"
        told = [one for (one, *_) in list_sorts(at, found) if "between" in one.sentence]
        (stretch,) = told
        (term,) = stretch.terms
        cause = term.screws[0].cause
        np.testing.assert_array_equal(cause.of(at.state), there)
        assert stretch.sentence == (
            f"The zero of joint {ZERO} is another one between 50.0 % and 75.0 % of the campaign."
        )


@pytest.mark.unit
@pytest.mark.parametrize("levels", [(0, 1, 2, 1), (0, 1, 0, 1), (0, 1, 2, 3)])
def test_a_covariate_that_changes_otherwise_tells_no_stretch(
    levels: tuple[int, ...], rng: np.random.Generator
) -> None:
    values = np.repeat(np.array(levels, float), ROWS // 4)
    at = measure(20 + values, np.zeros(ROWS), 4, rng)
    assert find_stretch(at.data, "temperature_C") is None


@pytest.mark.slow
@pytest.mark.parametrize("sessions", [1, 4])
@seeds(1, 2)
def test_what_was_another_one_for_a_while_is_not_proven_to_follow_what_changed_then(
    sessions: int, rng: np.random.Generator
) -> None:
    """A zero was set anew, and back, on the one day that was warm; the temperature does nothing."""
    there = carry(50, 75)
    warm = 21 + rng.uniform(2, 5) * there + rng.normal(0, 0.1, ROWS)
    at = measure(warm, rng.uniform(3e-4, 5e-4) * there, sessions, rng)
    base = Model((mechanism("geometric", ARM),))
    found = search_separated(at, base, build_candidates(at, base, every(ARM)))
    assert found.effects
    for effect in found.effects:
        assert effect.claim is not None
        claimed = dict(zip(LEVELS, effect.claim.levels, strict=True))
        drivers = dict(effect.claim.drivers)
        assert drivers.get("temperature_C", 0.0) < PROVEN
        follows = "temperature_C" in effect.candidate.mechanism.names()
        assert not follows or claimed["drivers"] < PROVEN


def warm_up(constant: float) -> np.ndarray:
    """What warms up from 0 to 1 with a time constant, in campaigns."""
    time = np.linspace(0, 1, ROWS)
    return (1 - np.exp(-time / constant)) / (1 - np.exp(-1 / constant))


def explain(values: np.ndarray, rival: Mechanism, at: Problem) -> float:
    """The share of the variance of values (m,) that the first cause of a rival explains."""
    cause = np.asarray(rival.terms[0].screws[0].cause.of(at.state))
    return float(np.corrcoef(values, cause)[0, 1] ** 2)


@pytest.mark.unit
@pytest.mark.parametrize("constant", [0.03, 0.07, 0.17, 0.33, 0.8, 1.7, 50.0])
def test_what_warms_up_with_any_constant_is_a_rival(
    constant: float, rng: np.random.Generator
) -> None:
    """Of a temperature that warms up with the same, or with another constant."""
    thermal = mechanism(f"thermal-zero:{ZERO}", ARM)
    warm = warm_up(constant)
    for own in (constant, 0.2):
        read = 21 + 5 * warm_up(own) + rng.normal(0, 0.1, ROWS)
        at = measure(read, np.zeros(ROWS), 1, rng)
        in_time, _ = list_sorts(at, thermal)
        assert max(explain(warm, one, at) for one in in_time) > 0.999


@pytest.mark.unit
@pytest.mark.parametrize("constant", [0.03, 0.17, 0.8])
def test_the_course_that_a_temperature_was_read_off_is_a_rival(
    constant: float, rng: np.random.Generator
) -> None:
    """By itself as likely as all that may have changed in time in another way."""
    warm = warm_up(constant)
    at = measure(21 + 5 * warm + rng.normal(0, 0.1, ROWS), np.zeros(ROWS), 1, rng)
    found = Candidate(mechanism(f"thermal-zero:{ZERO}", ARM), CandidateKind.MECHANISM, 0.01)
    _, (alike,) = list_sorts(at, found.mechanism)
    cause = np.asarray(alike.terms[0].screws[0].cause.of(at.state))
    assert np.std(cause - 5 * warm) < 0.05
    assert alike.terms[0].screws[0].cause.unit == "°C"
    (rival,) = (one for one in list_rivals(at, found) if one.candidate.mechanism == alike)
    assert rival.agrees == "place"
    assert rival.candidate.prior == pytest.approx(0.005)
    # its formula has ten numbers
    label = rival.candidate.label
    assert label == f"frame {ZERO} rz · the smooth course of temperature_C in time"
    told = "the smooth course of temperature_C in time: a smooth curve in time through the readings of temperature_C"
    assert told in explain_names([label])


@pytest.mark.unit
@pytest.mark.parametrize("constant", [0.3, 1e3])
def test_what_bends_with_a_temperature_bends_with_time_from_the_same_value(
    constant: float, rng: np.random.Generator
) -> None:
    """The square is counted from a temperature within the range, not from the start of the campaign."""
    course = 20 + 8 * warm_up(constant)
    at = measure(course + rng.normal(0, 0.03, ROWS), np.zeros(ROWS), 1, rng)
    rise = temperature_rise(24.0)
    square = Mechanism("square", (Term("m", (Screw(ZERO, "rz", rise * rise),)),))
    in_time, (alike,) = list_sorts(at, square)
    bent = (course - 24) ** 2
    assert max(explain(bent, one, at) for one in in_time) > 0.99
    words = Candidate(in_time[0], CandidateKind.COURSE, 0.01).causes(" and ")
    assert words == "temperature_C as it follows progress in time"
    assert explain(bent, alike, at) > 0.99


def in_time(cause: Cause) -> Mechanism:
    """A joint that is off by a function of time."""
    return Mechanism("in time", (Term("m", (Screw(ZERO, "rz", cause),)),))


@pytest.mark.unit
def test_all_that_depends_on_time_gives_way_to_a_covariate() -> None:
    warm = temperature_rise(20.0)
    decay = Applied("exp", (Named("time_s", "s") - 17.0) / -455.0)
    assert substitute_time(decay, warm) == warm
    assert str(substitute_time(cos(q(2)) * decay, warm)) == "cos(q2)*(temperature_C-20)"
    assert substitute_time(cos(q(2)), warm) == cos(q(2))


@pytest.mark.unit
def test_a_temperature_that_went_with_time_is_a_rival_of_time(rng: np.random.Generator) -> None:
    """Without its reading's own errors: alone, and with its square."""
    course = 1 - np.exp(-4 * np.linspace(0, 1, ROWS))
    at = measure(21 + 5 * course + rng.normal(0, 0.1, ROWS), np.zeros(ROWS), 1, rng)
    drift = in_time(Named("progress"))
    assert find_confounded(at, drift) == "temperature_C"
    ((linear, squared),) = list_sorts(at, drift)
    first, second = (np.asarray(t.screws[0].cause.of(at.state)) for t in squared.terms)
    np.testing.assert_allclose(second, first**2)
    assert linear.terms[0].screws == squared.terms[0].screws
    named = Candidate(squared, CandidateKind.COURSE, 0.01)
    assert named.causes(" and ") == "the smooth course of temperature_C in time and its square"
    assert np.std(first - 5 * course) < 0.05


@pytest.mark.unit
def test_a_temperature_of_its_own_course_is_no_rival_of_time(rng: np.random.Generator) -> None:
    at = measure(rng.uniform(18, 30, ROWS), np.zeros(ROWS), 1, rng)
    drift = in_time(Named("progress"))
    assert find_confounded(at, drift) is None
    assert not list(generate_confounded(at, drift))


@pytest.mark.unit
def test_rivals_of_time_stand_for_the_temperature(rng: np.random.Generator) -> None:
    """Whatever their formula: what lasts in time is not proven by them."""
    course = np.linspace(0, 1, ROWS)
    at = measure(21 + 5 * course + rng.normal(0, 0.1, ROWS), np.zeros(ROWS), 1, rng)
    found = Candidate(in_time(Named("progress")), CandidateKind.CELL, 0.01)
    own = [one for one in list_rivals(at, found) if one.stands_for is not None]
    assert len(own) == 2
    assert {one.stands_for for one in own} == {frozenset(("temperature_C",))}
    assert sum(one.candidate.prior for one in own) == pytest.approx(0.01)


def plant(course: str, rng: np.random.Generator) -> Problem:
    """A zero that moves between the sessions, with time, or with a temperature of its own course."""
    size = float(rng.uniform(3e-4, 5e-4))
    time = np.linspace(0, 1, ROWS)
    if course == "sessions":
        return measure(twice(21, 27), twice(0, size), 2, rng)
    if course == "time alone":
        return measure(rng.uniform(21, 27, ROWS), size * time, 1, rng)
    if course == "warming up":
        warm = warm_up(float(rng.uniform(0.13, 0.8)))
        return measure(21 + 6 * warm + rng.normal(0, 0.02, ROWS), size * warm, 1, rng)
    if course == "warming up in a hall":
        warm = 21 + 6 * warm_up(0.3) + rng.normal(0, 0.5, ROWS)
        return measure(warm, size * (warm - 21) / 6, 1, rng)
    if course == "time":
        return measure(21 + 6 * time + rng.normal(0, 0.02, ROWS), size * time, 1, rng)
    warm = rng.uniform(21, 27, ROWS)
    return measure(warm, size * (warm - 21) / 6, 2, rng)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("course", "proven"),
    [
        ("sessions", 0),
        ("time", 0),
        ("warming up", 0),
        ("warming up in a hall", 4),
        ("its own", 4),
        ("time alone", 4),
    ],
)
def test_a_temperature_is_proven_where_it_went_its_own_way(
    course: str, proven: int, rng: np.random.Generator
) -> None:
    """In none of five campaigns, or in four at least: one of them may have a rival by chance. The air of a
    hall comes and goes."""
    base = Model((mechanism("geometric", ARM),))
    told = []
    for _ in range(5):
        at = plant(course, rng)
        found = build_candidates(at, base, every(ARM))
        (effect,) = search_separated(at, base, found).effects
        assert effect.claim is not None
        assert effect.claim.levels[LEVELS.index("place")] >= PROVEN
        told.append(effect.claim.levels[LEVELS.index("drivers")] >= PROVEN)
    assert sum(told) >= proven
    assert proven or not any(told)


@pytest.mark.unit
def test_what_moves_many_frames_by_one_number_is_told_together(rng: np.random.Generator) -> None:
    """And no longer as what the first of them does, with every factor in a row."""
    at = measure(np.linspace(20.0, 29.0, ROWS), np.zeros(ROWS), 1, rng)
    grown = mechanism("thermal-expansion", load_robot("puma760"))
    course = list_sorts(at, grown)[0][0]
    candidate = Candidate(course, CandidateKind.CELL, 0.01)
    frames = sorted({screw.frame for screw in course.terms[0].screws})
    assert candidate.label == f"frames {frames[0]} to {frames[-1]} · progress"
    assert describe_candidate(candidate, np.ones(1)).startswith(
        f"Frames {frames[0]} to {frames[-1]} move together, depending on the course of the campaign"
    )
