"""Waves of a joint beyond 60 a turn: found where they are there, and nothing changes where they are not."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from builders import seeds
from planted_waves import Waved, plant_wave
from searches import ignore

from modelsel.diagnosis.candidates.candidate import Candidate
from modelsel.diagnosis.candidates.candidate_list import build_candidates
from modelsel.diagnosis.findings.claim_sentences import describe_proven
from modelsel.diagnosis.findings.effects import Effect
from modelsel.diagnosis.findings.outcome import Diagnosis
from modelsel.diagnosis.findings.wave_aliases import list_aliases, weigh_aliases
from modelsel.diagnosis.high_waves import find_high_waves, find_ripples, list_high_waves
from modelsel.diagnosis.procedure import diagnose
from modelsel.diagnosis.search.state import Search
from modelsel.diagnosis.search.stepwise import Exploration, explore
from modelsel.diagnosis.shapes.candidate_kinds import CandidateKind
from modelsel.diagnosis.shapes.shape_constants import find_own_wave
from modelsel.fitting.design import Model
from modelsel.fitting.least_squares import fit
from modelsel.mechanisms.drives import HIGH_WAVES, WAVES, gear_ripple
from modelsel.mechanisms.registry import build_mechanisms, mechanism
from modelsel.robot.files import load_robot

RIPPLES = ("gear-eccentricity", "encoder-eccentricity", "gear-ripple")


def find_wave(found: Diagnosis) -> Effect:
    """The one high wave that was found; a lower one is found by chance in one of twenty campaigns."""
    (effect,) = [
        one for one in found.effects if find_own_wave(one.candidate.mechanism)[1] > WAVES[-1]
    ]
    return effect


def search_ripples(waved: Waved, rng: np.random.Generator) -> Exploration:
    """A search for waves of every joint, which ends before any is screened."""
    problem = waved.problem
    robot = problem.robot
    base = Model((mechanism("geometric", robot),))
    listed = [m for name in RIPPLES for m in build_mechanisms(name, robot)]
    found = build_candidates(problem, base, listed, cells=False)
    search = Search(problem, base, found, rng, fit(problem, base))
    return explore(search, (), ignore)


@pytest.mark.integration
@seeds(1, 2, 3, slow=(4, 5, 6, 7, 8))
def test_a_planted_wave_is_found_with_its_number(rng: np.random.Generator) -> None:
    """It was missed, and told as a joint that does not repeat, or as noise."""
    waved = plant_wave(rng, rng.uniform(2, 4))
    found = diagnose(waved.problem, candidates=RIPPLES, seed=1)
    effect = find_wave(found)
    assert effect.candidate.label == f"gear-ripple:{waved.joint}"
    joint, count = find_own_wave(effect.candidate.mechanism)
    assert (joint, count) == (waved.joint, waved.count)
    size = float(np.hypot(*effect.estimate))
    assert size == pytest.approx(waved.size, rel=0.15)
    assert not any(part.name.startswith("joint") for part in found.errors.parts)


@pytest.mark.slow
@seeds(1, 2, 3, 4)
def test_it_is_found_among_all_candidates(rng: np.random.Generator) -> None:
    waved = plant_wave(rng, 3.0)
    effect = find_wave(diagnose(waved.problem, seed=1))
    joint, count = find_own_wave(effect.candidate.mechanism)
    assert joint == waved.joint
    assert count == pytest.approx(waved.count, abs=0.3)
    assert effect.candidate.registered


@seeds(1, 2)
def test_where_there_is_none_the_search_goes_on_as_it_was(rng: np.random.Generator) -> None:
    waved = plant_wave(rng, 0.0)
    explored = search_ripples(waved, rng)
    before = rng.bit_generator.state
    assert list_high_waves(explored, waved.problem) == []
    again, offered = find_high_waves(explored, waved.problem)
    assert again is explored
    assert offered == ()
    assert rng.bit_generator.state == before


@seeds(1, 2)
def test_a_lower_wave_is_left_to_every_search(rng: np.random.Generator) -> None:
    waved = plant_wave(rng, 3.0, counts=(WAVES[0], WAVES[-1]))
    explored = search_ripples(waved, rng)
    assert [find_own_wave(c.mechanism) for c in explored.chosen] == [(waved.joint, waved.count)]
    assert list_high_waves(explored, waved.problem) == []


@seeds(1, 2, 3)
def test_harmonics_of_a_square_wave_are_left_to_its_shape(rng: np.random.Generator) -> None:
    """Three and five times as many waves were found in the place of a shape that jumps."""
    waved = plant_wave(rng, 12.0, rows=200, counts=(25, 50), is_square=True)
    found = search_ripples(waved, rng)
    assert waved.count in {find_own_wave(one.mechanism)[1] for one in found.chosen}
    offered = {find_own_wave(one.mechanism) for one in list_high_waves(found, waved.problem)}
    beside = {abs(count - 3 * waved.count) for joint, count in offered if joint == waved.joint}
    assert min(beside, default=9) > 1


@seeds(1, 2)
def test_what_is_offered_shares_the_prior_of_its_name(rng: np.random.Generator) -> None:
    waved = plant_wave(rng, 3.0)
    explored = search_ripples(waved, rng)
    more = list_high_waves(explored, waved.problem)
    name = f"gear-ripple:{waved.joint}"
    listed = sum(c.prior for c in explored.search.candidates if c.registered_name == name)
    waves = [find_own_wave(one.mechanism) for one in more]
    assert (waved.joint, waved.count) in waves
    assert {one.prior for one in more} == {listed / len(HIGH_WAVES)}
    assert {count for _, count in waves} <= set(HIGH_WAVES)


def test_only_ripples_that_are_scanned_are_screened(rng: np.random.Generator) -> None:
    waved = plant_wave(rng, 3.0)
    robot = waved.problem.robot
    listed = [
        Candidate(m, CandidateKind.MECHANISM, 0.001) for m in build_mechanisms("gear-ripple", robot)
    ]
    joint = waved.joint
    own = [c for c in listed if c.registered_name == f"gear-ripple:{joint}"]
    assert sorted(find_ripples(waved.problem, listed)) == list(range(1, robot.n + 1))
    assert find_ripples(waved.problem, own)[joint].prior == pytest.approx(0.001 * len(own))
    assert find_ripples(waved.problem, own[:1]) == {}
    other = [replace(c, mechanism=replace(c.mechanism, sentence="Another one.")) for c in own]
    assert find_ripples(waved.problem, other) == {}


@pytest.mark.integration
@seeds(1, 2, slow=(3, 4))
def test_waves_that_readings_do_not_tell_apart_are_told_as_alike(rng: np.random.Generator) -> None:
    """Every 1° a wave of k a turn is one of 360 - k."""
    waved = plant_wave(rng, 3.0, counts=(61, 175), grid_degrees=1.0)
    count = waved.count
    if rng.random() < 0.5:
        # the higher of both was planted: it is the same at these readings
        count = 360 - count
    effect = find_wave(diagnose(waved.problem, candidates=RIPPLES, seed=1))
    _, fitted = find_own_wave(effect.candidate.mechanism)
    assert effect.claim is not None
    told = {fitted, *effect.claim.waves}
    assert {waved.count, 360 - waved.count} & set(range(3, 331)) <= told
    assert count > 330 or count in told
    if 360 - waved.count <= HIGH_WAVES[-1]:
        assert effect.claim.level == "drivers"
        said = describe_proven(effect)
        same = "waves a turn do the same at these readings as the fitted wave"
        assert f"{same} of {fitted:g} a turn;" in said
        assert "turns unevenly" not in said


def test_a_screened_wave_is_as_likely_as_those_like_it(rng: np.random.Generator) -> None:
    """A lower one is likelier than those that are higher than usual."""
    waved = plant_wave(rng, 3.0, counts=(100, 150), grid_degrees=1.0)
    explored = search_ripples(waved, rng)
    further, _ = find_high_waves(explored, waved.problem)
    search = further.search
    (chosen,) = further.progress.chosen
    assert weigh_aliases(search, [chosen]) == {chosen: pytest.approx(1 / 2)}
    joint = waved.joint
    low = next(
        g
        for g, c in enumerate(search.candidates)
        if c.mechanism == gear_ripple(waved.problem.robot, joint, 45)
    )
    assert list_aliases(waved.problem, search.candidates[low]) == (315,)
    others = len(WAVES) / len(HIGH_WAVES)
    assert weigh_aliases(search, [low]) == {low: pytest.approx(1 / (1 + others))}


def test_a_study_may_name_a_wave_that_was_found() -> None:
    robot = load_robot("ur10e")
    (ripple,) = build_mechanisms("gear-ripple:2:202", robot)
    assert ripple.sentence == "Joint 2 turns unevenly, 202 waves a turn."
    assert len(build_mechanisms("gear-ripple:2", robot)) == len(WAVES)
