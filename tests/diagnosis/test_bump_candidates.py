"""Errors of a joint around one reading are found where they are, one of a joint."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from builders import drawn, measured, seeds
from searches import search_independent

from modelsel._typing import Array
from modelsel.diagnosis.candidates.candidate_list import build_candidates
from modelsel.diagnosis.inference.joint_curves import find_own_joint
from modelsel.diagnosis.rivals.unlisted_shapes import list_rivals
from modelsel.diagnosis.search.pool_members import gather_pool
from modelsel.diagnosis.search.state import Search
from modelsel.diagnosis.shapes.candidate_kinds import CandidateKind
from modelsel.diagnosis.shapes.joint_bumps import generate_likely_bumps
from modelsel.fitting.design import Model
from modelsel.fitting.least_squares import fit
from modelsel.fitting.problem import Problem
from modelsel.mechanisms.registry import every, mechanism
from modelsel.robot.kinematics import forward

SIGMA = 0.03


def bent(
    at: Problem, joint: int, shape: Callable[[Array], Array], rng: np.random.Generator
) -> Problem:
    """The problem with a joint turned by a function of its reading [rad], by moving its reading."""
    q = at.data.q.copy()
    q[:, joint - 1] += shape(q[:, joint - 1])
    shift = forward(at.robot, q, at.tools[0]) - forward(at.robot, at.data.q, at.tools[0])
    return measured(at, at.data.position + shift + rng.normal(0, SIGMA, shift.shape))


def prepare(at: Problem, rng: np.random.Generator) -> Search:
    """The search that a study of these measurements begins with."""
    base = Model((mechanism("geometric", at.robot),))
    found = build_candidates(at, base, every(at.robot))
    return Search(at, base, found, rng, fit(at, base))


@cache
def prepare_puma() -> Search:
    """One for tests that ask about bumps and waves of single joints, whatever the rows; of the other
    candidates it has one in seven."""
    rng = np.random.default_rng(1)
    at = drawn("puma760", rng, 80)
    base = Model((mechanism("geometric", at.robot),))
    every_one = build_candidates(at, base, every(at.robot))
    kept = [c for k, c in enumerate(every_one) if c.bumped_joint or c.registered or k % 7 == 0]
    return Search(at, base, tuple(kept), rng, fit(at, base))


def test_bumps_are_looked_for_where_configurations_tell_of_them(rng: np.random.Generator) -> None:
    at = drawn("puma760", rng, int(rng.integers(20, 90)))
    by_joint: dict[int, int] = {}
    for bump, count in generate_likely_bumps(at):
        (term,) = bump.terms
        joint = term.screws[0].frame
        by_joint[joint] = by_joint.get(joint, 0) + 1
        height = term.screws[0].cause.of(at.state)
        assert (height > 0.5 - 1e-4).sum() >= 4
        assert (height < 0.5 + 1e-4).sum() >= 4
        assert count >= by_joint[joint]
    assert by_joint
    still = at.data.q.copy()
    still[:, 2] = 0.3
    stands = replace(at, data=replace(at.data, q=still))
    assert not any("q3" in bump.names() for bump, _ in generate_likely_bumps(stands))


@pytest.mark.slow
@seeds(21, 22, 23)
def test_a_dent_of_a_joint_is_found_where_it_is(rng: np.random.Generator) -> None:
    """A cosine's hump, which no candidate is."""
    at = drawn("puma760", rng, 100)
    joint = int(rng.integers(1, 6))
    own = at.data.q[:, joint - 1]
    centre, width = float(np.quantile(own, rng.uniform(0.3, 0.7))), float(rng.uniform(0.3, 0.6))

    def hump(x: Array) -> Array:
        return 3e-4 * (1 + np.cos(np.pi * np.minimum(np.abs(x - centre) / width, 1)))

    dented = bent(at, joint, hump, rng)
    base = Model((mechanism("geometric", at.robot),))
    found = search_independent(dented, base, build_candidates(dented, base, every(at.robot)), rng)
    joints = [find_own_joint(effect.candidate) for effect in found.effects]
    assert joints == [joint], found.path


@pytest.mark.slow
def test_a_model_has_one_bump_of_a_joint(rng: np.random.Generator) -> None:
    at = drawn("puma760", rng, 80)
    centre = float(np.median(at.data.q[:, 1]))
    search = prepare(
        bent(at, 2, lambda x: 1.5e-4 * np.exp(-np.square(x - centre) / 0.05), rng), rng
    )
    kinds = np.array([c.kind is CandidateKind.BUMP for c in search.candidates])
    assert (kinds == (search.traits.bumped > 0)).all()
    first, second = rng.choice(np.flatnonzero(search.traits.bumped == 2), 2, replace=False).tolist()
    elsewhere = int(np.flatnonzero(search.traits.bumped == 3)[0])
    chosen = [elsewhere, first]
    view = search.fit_model(chosen, None)
    added = search.name_strongest(view, chosen).log_probability
    assert np.isneginf(added[np.isin(search.traits.bumped, (2, 3))]).all()
    assert np.isfinite(added[search.traits.bumped == 4]).any()
    assert search.add(chosen, second) == [elsewhere, second]
    # neither is one named in another effect's place, nor weighed beside the first
    named = search.rename(elsewhere, view).named
    assert np.isneginf(named.log_probability[search.traits.bumped == 2]).all()
    assert np.isfinite(named.log_probability[search.traits.bumped == 3]).any()
    every_one = [*chosen, second]
    pool = gather_pool(search, search.fit_model(every_one, None), every_one)
    assert pool is not None
    place = {g: p for p, g in enumerate(pool.members)}
    _, gains = pool.weigh({place[g]: 1e3 for g in chosen})
    assert np.isneginf(gains.value[place[second]])
    _, gains = pool.weigh({place[elsewhere]: 1e3})
    assert np.isfinite(gains.value[[place[first], place[second]]]).all()


def test_repeats_are_one_configuration_and_centres_are_limited(rng: np.random.Generator) -> None:
    at = drawn("puma760", rng, 12)
    often = at.take(np.repeat(np.arange(12), 5))
    q = often.data.q + rng.normal(0, 1e-8, often.data.q.shape)
    again = replace(often, data=replace(often.data, q=q))
    once = [bump for bump, _ in generate_likely_bumps(at)]
    assert len(list(generate_likely_bumps(again))) <= len(once)
    # a reading that is far off, as a slip of the pen
    wide = drawn("puma760", rng, 60)
    wide.data.q[0, 2] = 1e5
    assert len(list(generate_likely_bumps(wide))) < 3 * 128 * wide.robot.n


@pytest.mark.integration
def test_what_was_tried_in_vain_rules_out_no_neighbour(rng: np.random.Generator) -> None:
    search = prepare_puma()
    first, second = rng.choice(np.flatnonzero(search.traits.bumped == 2), 2, replace=False).tolist()
    aside = np.append(search.list_set_aside(()), first)
    log_probability = search.ask_rest(search.first).answer(aside).log_probability
    assert np.isneginf(log_probability[first])
    assert np.isfinite(log_probability[second])


@pytest.mark.integration
def test_beside_a_bump_no_other_one_stands_against_a_finding(rng: np.random.Generator) -> None:
    """The wave of joint 2 has bumps of joint 2 as rivals, but where a bump of it is in the model."""
    search = prepare_puma()
    numbers = {one.label: g for g, one in enumerate(search.candidates)}
    wave = numbers["encoder-eccentricity:2"]
    bump = int(rng.choice(np.flatnonzero(search.traits.bumped == 2)))
    view = search.fit_model([wave, bump], None)
    assert search.list_bumped_beside(wave, view).tolist() == [2]
    assert search.list_bumped_beside(bump, view).tolist() == []
    named = search.rename(bump, view).named
    assert np.isfinite(named.log_probability[bump])
    rivals = list_rivals(search.problem, search.candidates[wave])
    bumps = [one for one in rivals if one.candidate.kind is CandidateKind.BUMP]
    assert bumps
    assert {one.candidate.bumped_joint for one in bumps} == {2}
    assert {one.candidate.bumped_joint for one in rivals} == {0, 2}
