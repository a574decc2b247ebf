"""A search may take back: sets of effects are weighed exactly, a wrong one gives way to what was
planted, and what is told of an effect is what holds in most sets."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import combinations, pairwise, product
from typing import Any

import numpy as np
import pytest
from builders import drawn, planted, seeds
from hidden_arm import Effect as Planted
from hidden_arm import State, arm, measured
from hidden_effects import at, together
from searches import ignore

from modelsel import Model, mechanism
from modelsel._typing import Array
from modelsel.diagnosis import conclusion, reshaping
from modelsel.diagnosis.candidates.candidate import Candidate
from modelsel.diagnosis.candidates.candidate_list import build_candidates
from modelsel.diagnosis.candidates.signatures import (
    Parts,
    number_forms,
    read_parts,
    read_signatures,
)
from modelsel.diagnosis.conclusion import Conclusion, conclude, confirm, prove
from modelsel.diagnosis.findings.claims import Weighed
from modelsel.diagnosis.inference.evidence import MIN_LOG_ODDS
from modelsel.diagnosis.search.model_pool import Pool, _Group
from modelsel.diagnosis.search.model_sampler import sample_models
from modelsel.diagnosis.search.model_search import BY_SAMPLING, FOR_CLAIMS, _Walk, visit_models
from modelsel.diagnosis.search.state import Search
from modelsel.diagnosis.search.stepwise import Exploration, explore, explore_further
from modelsel.diagnosis.search.views import View
from modelsel.diagnosis.search.weighed_models import VisitedModels
from modelsel.diagnosis.shapes.candidate_kinds import CandidateKind
from modelsel.fitting.least_squares import fit
from modelsel.fitting.problem import Problem
from modelsel.measurements.measurements import build_measurements
from modelsel.mechanisms.registry import build_faults, every
from modelsel.robot.files import load_robot

SIGMA = 0.05
COORDINATES = 60
# candidates that have no part in common
APART: dict[int, Parts] = {g: (frozenset([g]), frozenset([g])) for g in range(3)}
# none of them is a form of another
NO_FORMS = np.full(3, -1)


# -- exact evidence


def draw_pool(
    rng: np.random.Generator, signs: Array | None = None
) -> tuple[Pool, list[Array], Array]:
    """A pool of members of one and of two directions, their directions (60, k), and a response."""
    sizes = [1, 1, 1, 2, 2]
    shared = rng.standard_normal((COORDINATES, 3))
    raw = [
        shared[:, : 1 + g % 3] @ rng.standard_normal((1 + g % 3, k)) for g, k in enumerate(sizes)
    ]
    Z = [np.linalg.qr(x + 0.7 * rng.standard_normal(x.shape))[0] for x in raw]
    response = 4 * Z[0][:, 0] - 3 * Z[3][:, 1] + rng.standard_normal(COORDINATES)
    every_one = np.hstack(Z)
    starts = np.cumsum([0, *sizes])
    rows = tuple(np.arange(a, b) for a, b in pairwise(starts))
    groups = []
    for k in (1, 2):
        which = np.array([g for g, size in enumerate(sizes) if size == k])
        index = np.array([rows[g] for g in which])
        terms, free = None, np.full((len(which), k), np.inf)
        if signs is not None and k == 1:
            terms = signs[:, None, None] * np.ones((3, 1, 1))
            free = np.zeros((3, 1))
        groups.append(_Group(which, index, terms, free))
    pool = Pool(
        members=(10, 11, 12, 13, 14),
        rows=rows,
        H=every_one.T @ every_one,
        z=every_one.T @ response,
        square=float(response @ response),
        freedom=COORDINATES,
        log_prior=rng.uniform(-8, -2, 5),
        kind=np.array([0, 1, 0, 3, 4]),
        single=np.zeros(5, np.intp),
        groups=tuple(groups),
    )
    return pool, Z, response


def compute_posterior(
    pool: Pool, Z: list[Array], response: Array, ratios: dict[int, float]
) -> float:
    """The log posterior of a set, from the covariance of all coordinates."""
    C = np.eye(COORDINATES) + sum((r * Z[g] @ Z[g].T for g, r in ratios.items()), np.zeros(()))
    left = response @ np.linalg.solve(C, response) / (response @ response)
    evidence = -0.5 * np.linalg.slogdet(C)[1] - COORDINATES / 2 * np.log(left)
    # members 0 and 2 are one mechanism in two joints
    kin = np.log(20) if {0, 2} <= ratios.keys() else 0.0
    return float(evidence + sum(pool.log_prior[g] for g in ratios) + kin)


@seeds(1, 2, 3)
def test_a_set_is_weighed_by_its_whole_covariance(rng: np.random.Generator) -> None:
    pool, Z, response = draw_pool(rng)
    for size in range(6):
        for members in combinations(range(5), size):
            ratios = {g: float(10 ** rng.uniform(0.5, 5)) for g in members}
            value, gains = pool.weigh(ratios)
            assert value == pytest.approx(compute_posterior(pool, Z, response, ratios), abs=1e-8)
            assert np.isinf(gains.value[list(members)]).all()
            for g in set(range(5)) - set(members):
                more = {**ratios, g: float(gains.ratio[g])}
                expected = compute_posterior(pool, Z, response, more) - value
                assert gains.value[g] == pytest.approx(expected, abs=1e-8)


def draw_ratios(rng: np.random.Generator) -> dict[int, float]:
    """Some of the five members, with their ratios."""
    members = np.flatnonzero(rng.random(5) < 0.5).tolist()
    return {g: float(10 ** rng.uniform(0.5, 5)) for g in members}


@seeds(1, 2, 3)
def test_a_set_is_weighed_alike_from_the_one_beside_it(rng: np.random.Generator) -> None:
    signs = rng.choice([-1.0, 1.0], 3)
    pool, _, _ = draw_pool(rng, signs)
    for _ in range(20):
        ratios = draw_ratios(rng)
        near = pool.nothing.change_into(ratios).gather()
        others = {**ratios, int(rng.integers(5)): 1e3}
        others.pop(int(rng.integers(5)), None)
        sets = [ratios, others]
        for one, (nearly, more) in zip(sets, pool.weigh_together(sets, near), strict=True):
            value, gains = pool.weigh(one)
            # taking an effect of ratio 1e5 out costs ten digits
            assert nearly == pytest.approx(value, abs=1e-5)
            assert more.value == pytest.approx(gains.value, abs=1e-5)


@seeds(1, 2, 3)
def test_many_changes_leave_a_set_what_it_is(rng: np.random.Generator) -> None:
    pool, Z, response = draw_pool(rng)
    near = pool.nothing
    for _ in range(60):  # more than are kept apart
        ratios = draw_ratios(rng)
        near = near.change_into(ratios)
    C = np.eye(COORDINATES) + sum((r * Z[g] @ Z[g].T for g, r in ratios.items()), np.zeros(()))
    assert near.left == pytest.approx(response @ np.linalg.solve(C, response), rel=1e-4)
    assert near.price == pytest.approx(0.5 * np.linalg.slogdet(C)[1], abs=1e-4)
    assert near.z == pytest.approx(np.hstack(Z).T @ np.linalg.solve(C, response), abs=1e-4)


@seeds(1, 2)
def test_a_sign_takes_its_share_of_what_an_effect_may_be(rng: np.random.Generator) -> None:
    state = rng.bit_generator.state
    free, _, _ = draw_pool(rng)
    sums = np.zeros(3)
    for sign in (1.0, -1.0):
        rng.bit_generator.state = state
        pool, _, _ = draw_pool(rng, signs=sign * np.ones(3))
        for g in range(3):
            ratios = {g: 30.0}
            factor = pool.weigh(ratios)[0] - free.weigh(ratios)[0]
            sums[g] += np.exp(factor)
        # member 0 was planted with a positive term
        if sign > 0:
            assert pool.weigh({0: 30.0})[0] - free.weigh({0: 30.0})[0] == pytest.approx(
                np.log(2), abs=1e-2
            )
        else:
            assert pool.weigh({0: 30.0})[0] - free.weigh({0: 30.0})[0] < -3
    assert sums == pytest.approx(2.0)


# -- the search


def search_lags(rng: np.random.Generator) -> tuple[Search, list[int], list[int]]:
    """A search where joints 1 to 3 lag behind their moves, each by its own share; what is planted, and
    what the stepwise search once told instead."""
    robot = load_robot(("puma760", "ur10e", "irb120")[int(rng.integers(3))])
    body = arm(robot, rng, (40.0, -25.0, 100.0))
    state = State(body, body.draw(rng, 80), {})
    exact = measured(body, state, ())
    parts = []
    for joint in (1, 2, 3):
        term = together(at(joint, "rz", lambda s, j=joint: -s.move[:, j - 1]))
        effect = Planted("planted", "", (term,), np.ones(1))
        size = np.linalg.norm(measured(body, state, (effect.scaled(1e-4),)) - exact, axis=1).max()
        parts.append(effect.scaled(1e-4 * SIGMA * rng.uniform(5, 8) / size))
    position = measured(body, state, tuple(parts)) + SIGMA * rng.standard_normal(exact.shape)
    problem = Problem(robot, build_measurements(state.q, position), body.tool[None])
    base = Model((mechanism("geometric", robot),))
    found = build_candidates(problem, base, (*build_faults(robot), *every(robot)))
    search = Search(problem, base, found, rng, fit(problem, base))
    place = {one.label: g for g, one in enumerate(found)}
    planted = [place[f"settle:{j}"] for j in (1, 2, 3)]
    mistaken = [place[name] for name in ("fault:read-too-early", "settle:4", "settle:5")]
    return search, planted, mistaken


def draw_alike(rng: np.random.Generator, pairs: int) -> Pool:
    """A pool of pairs that hardly differ, one of each in the response."""
    count = 2 * pairs
    first = np.linalg.qr(rng.standard_normal((COORDINATES, pairs)))[0]
    second = first + 0.1 * rng.standard_normal(first.shape) / np.sqrt(COORDINATES)
    Z = np.hstack([first, second / np.linalg.norm(second, axis=0)])
    response = first @ rng.uniform(8.0, 12.0, pairs) + rng.standard_normal(COORDINATES)
    which = np.arange(count)
    group = _Group(which, which[:, None], None, np.full((count, 1), np.inf))
    return Pool(
        members=tuple(range(count)),
        rows=tuple(which[:, None]),
        H=Z.T @ Z,
        z=Z.T @ response,
        square=float(response @ response),
        freedom=COORDINATES,
        log_prior=np.full(count, -3.0),
        kind=which,
        single=np.zeros(count, np.intp),
        groups=(group,),
    )


def include(weights: Mapping[frozenset[int], float], count: int) -> Array:
    """The probability of every member, from those of the sets."""
    included = np.zeros(count)
    for members, weight in weights.items():
        included[list(members)] += weight
    return included


@seeds(1, slow=(2, 3))
def test_sampled_sets_are_as_probable_as_all_sets_say(rng: np.random.Generator) -> None:
    pairs = 4
    pool = draw_alike(rng, pairs)
    start = pool.settle(frozenset(range(pairs)))
    ratio = float(np.median(list(start.values())))
    values = {}
    for size in range(2 * pairs + 1):
        for members in combinations(range(2 * pairs), size):
            values[frozenset(members)] = pool.weigh(dict.fromkeys(members, ratio))[0]
    highest = max(values.values())
    weights = {members: np.exp(value - highest) for members, value in values.items()}
    total = sum(weights.values())
    exact = include(weights, 2 * pairs) / total
    sampled = include(sample_models(pool, start, rng, 3000), 2 * pairs)
    assert np.abs(sampled - exact).max() < 0.06


@pytest.mark.integration
@seeds(1, slow=(2, 3))
def test_of_many_sets_those_near_the_first_are_not_told_as_likelier(
    rng: np.random.Generator,
) -> None:
    """Of fourteen pairs, 16,384 sets with one of each explain about as much."""
    pairs = 14
    pool = draw_alike(rng, pairs)
    first = frozenset(range(pairs))
    walk = _Walk(pool, (), (), rng)
    ratios = walk.pool.settle(first)
    sets = np.array(list(product((0, pairs), repeat=pairs))) + np.arange(pairs)
    H = pool.H[sets[:, :, None], sets[:, None, :]]
    ratio = float(np.median(list(ratios.values())))
    inner = H + np.eye(pairs) / ratio
    z = pool.z[sets]
    explained = (z * np.linalg.solve(inner, z[:, :, None])[:, :, 0]).sum(1)
    value = -0.5 * np.linalg.slogdet(inner)[1]
    value -= pool.freedom / 2 * np.log1p(-explained / pool.square)
    weight = np.exp(value - value.max())
    expected = np.array([weight[(sets == p).any(1)].sum() for p in range(2 * pairs)]) / weight.sum()
    assert not walk.walk(first, FOR_CLAIMS)
    walked = np.abs(walk._include() - expected).mean()
    sampled = include(sample_models(pool, ratios, rng, BY_SAMPLING), 2 * pairs)
    assert np.abs(sampled - expected).mean() < walked / 2


def test_no_more_sets_are_weighed_where_none_that_is_likely_is_left(
    rng: np.random.Generator,
) -> None:
    pool, _, _ = draw_pool(rng)
    walk = _Walk(pool, (), (), rng)
    assert walk.walk(frozenset(), FOR_CLAIMS)
    # all sets of five members
    assert len(walk.weighed) <= 2**5


@pytest.mark.slow
@seeds(1, 2, 3)
def test_a_mistaken_set_gives_way_to_what_was_planted(rng: np.random.Generator) -> None:
    search, planted, mistaken = search_lags(rng)
    view = search.fit_model(mistaken, None)
    better = visit_models(search, view, mistaken).find_better(mistaken, MIN_LOG_ODDS)
    assert better is not None
    assert set(better) >= set(planted)
    assert set(better).isdisjoint(mistaken)
    # a further joint that lags is likely enough to be tried: chance explains it
    further = explore_further(search, list(better), view.fitted, [])
    assert further is not None
    told = confirm(conclude(further)).diagnosis.effects
    assert {effect.candidate for effect in told} == {search.candidates[g] for g in planted}


@pytest.mark.slow
@seeds(1)
def test_a_diagnosis_tells_the_sets_that_were_weighed(rng: np.random.Generator) -> None:
    search, planted, _ = search_lags(rng)
    diagnosis = prove(conclude(explore(search, (), ignore)))
    first = diagnosis.models[0]
    assert first.chosen
    assert set(first.effects) == {search.candidates[g] for g in planted}
    assert first.probability > 0.5
    told = [model.probability for model in diagnosis.models]
    assert told == sorted(told, reverse=True)
    assert sum(told) <= 1 + 1e-12


# -- what is told of an effect


def test_a_level_holds_as_often_as_the_sets_say_it() -> None:
    # candidates 0 and 1 share their place, 2 is elsewhere; each has a cause of its own
    place, cause = np.array([7, 7, 8]), np.array([0, 1, 2])
    odds = np.array([0.5, 0.3, 0.15, 0.05])
    visited = VisitedModels(((0,), (1,), (2,), ()), np.log(odds))
    included = visited.include([0], [place, cause], APART, NO_FORMS)
    # the empty set says that there is no effect
    assert included[0] == pytest.approx([0.8, 0.5])
    assert visited.find_better([1], 0.4) == (0,)
    assert visited.find_better([1], 0.6) is None


def test_effects_are_not_added_alone_by_taking_back() -> None:
    sets = ((0, 1, 2), (0, 3, 4, 5), (3, 4), (3,), (0, 1))
    visited = VisitedModels(sets, np.array([5.0, 4.0, 3.0, 2.0, 0.0]))
    # the first only adds, the second adds three in the place of one
    assert visited.find_better([0, 1], 1.0) == (3, 4)
    assert visited.find_better([0, 1], 2.5) == (3, 4)
    assert visited.find_better([0, 1], 3.5) is None


def test_effects_that_are_held_are_not_taken_back() -> None:
    visited = VisitedModels(((0, 3), (1, 3), (0, 1)), np.array([5.0, 4.0, 0.0]))
    assert visited.find_better([0, 1], 1.0) == (0, 3)
    # effect 1 was given up once, and named again
    assert visited.find_better([0, 1], 1.0, held={1}) == (1, 3)
    assert visited.find_better([0, 1], 1.0, held={0, 1}) is None


def test_two_effects_of_a_place_are_not_held_by_one() -> None:
    place = np.array([7, 7, 8])
    visited = VisitedModels(((0, 1), (0, 2)), np.log([0.6, 0.4]))
    included = visited.include([0, 1], [place], APART, NO_FORMS)
    assert included[1] == pytest.approx([0.6])
    # what both sets have is as sure as ever
    assert included[0] == pytest.approx([1.0])


def test_what_several_effects_say_together_counts() -> None:
    """The twists of joints 2 and 3, each by itself, say what the twist of both says."""
    robot = load_robot("puma760")
    names = ("gravity-twist", "joint2-twist", "joint3-twist", "encoder-scale:2", "settle:4")
    found = [Candidate(mechanism(name, robot), CandidateKind.MECHANISM, 0.01) for name in names]
    parts = {g: read_parts(one, one) for g, one in enumerate(found)}
    signatures = read_signatures(found)
    sets = ((0, 4), (1, 2, 4), (2, 3, 4), (2, 4))
    visited = VisitedModels(sets, np.log([0.4, 0.3, 0.2, 0.1]))
    included = visited.include([0, 4], signatures, parts, number_forms(found))
    # the third turns the same joints by another driver, the last one of them only
    assert included[0] == pytest.approx([0.9, 0.7, 0.7, 0.7])
    assert included[4] == pytest.approx([1.0] * 4)


def test_a_link_that_bends_holds_by_any_of_its_forms() -> None:
    """A set that has another form of a link's bending agrees at all levels; one that bends another link
    does not."""
    robot = load_robot("ur10e")
    forms = [one for one in every(robot) if one.name == "link-bending:2"]
    others = [one for one in every(robot) if one.name in ("link-bending:3", "encoder-scale:2")]
    mechanisms = [*forms, *others]
    found = [Candidate(one, CandidateKind.MECHANISM, 0.01) for one in mechanisms]
    parts = {g: read_parts(one, one) for g, one in enumerate(found)}
    signatures = read_signatures(found)
    known = number_forms(found)
    same = [g for g in range(1, len(forms)) if known[g] == known[0]]
    # by its signature, one of another place is another thing
    other_form = next(g for g in same if signatures[0][g] != signatures[0][0])
    elsewhere = len(forms)
    sets = ((0,), (other_form,), (elsewhere,))
    visited = VisitedModels(sets, np.log([0.5, 0.3, 0.2]))
    included = visited.include([0], signatures, parts, known)
    assert included[0] == pytest.approx([0.8] * 4)


# -- shapes that are offered


def explore_scale(rng: np.random.Generator) -> Exploration:
    """An arm whose joint 3 moves more than it reads, explored."""
    scale = mechanism("encoder-scale:3", load_robot("irb120"))
    at = planted(drawn("irb120", rng, 40), scale.terms, np.array([2e-3]), rng, SIGMA)
    base = Model((mechanism("geometric", at.robot),))
    found = build_candidates(at, base, every(at.robot))
    return explore(Search(at, base, found, rng, fit(at, base)), (), ignore)


@pytest.mark.slow
def test_a_shape_that_leads_back_is_not_offered_again(
    monkeypatch: pytest.MonkeyPatch, rng: np.random.Generator
) -> None:
    """Its own effects, found again, end the search: each round of a large study takes seconds."""
    concluded = conclude(explore_scale(rng))
    found = concluded.explored.search.candidates
    better = [((0,), found[0])]
    weigh = conclusion._weigh
    asked: list[object] = []

    def offer(before: Conclusion, weighed: Weighed) -> Conclusion:
        asked.append(weighed.better)
        return before

    monkeypatch.setattr(conclusion, "_weigh", lambda one: weigh(one)._replace(better=better))
    monkeypatch.setattr(conclusion, "_take_shapes", offer)
    told = prove(concluded)
    assert asked == [better]
    assert [one.candidate.label for one in told.effects] == ["encoder-scale:3"]


@pytest.mark.slow
def test_a_set_that_leads_back_is_put_in_its_place_once(
    monkeypatch: pytest.MonkeyPatch, rng: np.random.Generator
) -> None:
    """The search from there finds what stood before: it would go round once more."""
    concluded = conclude(explore_scale(rng))
    search = concluded.explored.search
    place = {one.mechanism.name: g for g, one in enumerate(search.candidates)}
    other, own = place["encoder-scale:2"], place["encoder-scale:3"]
    likelier = VisitedModels(((other,), (own,)), np.array([5.0, 0.0]))
    monkeypatch.setattr(conclusion, "visit_models", lambda *given: likelier)
    starts: list[list[int]] = []

    def note(search: Search, chosen: list[int], *given: Any) -> Exploration | None:
        starts.append(chosen)
        return explore_further(search, chosen, *given)

    monkeypatch.setattr(conclusion, "explore_further", note)
    taken = conclusion._take_back(concluded)
    assert starts == [[other]]
    assert taken.chosen == [own]


@pytest.mark.slow
def test_a_shape_that_leads_to_less_probable_effects_is_not_kept(
    monkeypatch: pytest.MonkeyPatch, rng: np.random.Generator
) -> None:
    """Effects that the data hardly tell apart took each other's place again and again, ever less probable
    together, in half of the time of a large study."""
    concluded = conclude(explore_scale(rng))
    search = concluded.explored.search
    other = next(g for g, c in enumerate(search.candidates) if c.label == "encoder-scale:2")
    astray = Conclusion(concluded.explored, [other], search.fit_model([other], None))
    assert confirm(astray).log_posterior < confirm(concluded).log_posterior
    better = [((0,), search.candidates[other])]
    weigh = conclusion._weigh
    monkeypatch.setattr(conclusion, "_weigh", lambda one: weigh(one)._replace(better=better))
    monkeypatch.setattr(conclusion, "_take_shapes", lambda *given: astray)
    monkeypatch.setattr(conclusion, "_settle", confirm)
    told = prove(concluded)
    assert [one.candidate.label for one in told.effects] == ["encoder-scale:3"]


@pytest.mark.slow
def test_shapes_that_the_data_do_not_determine_change_nothing(
    monkeypatch: pytest.MonkeyPatch, rng: np.random.Generator
) -> None:
    """The effects that were found before stay, and the way to them is told once."""
    prune = conclusion.prune_effects

    def note(*given: Any) -> tuple[list[int], View]:
        given[-1].append("pruned")
        return prune(*given)

    monkeypatch.setattr(conclusion, "prune_effects", note)
    concluded = conclude(explore_scale(rng))
    found = concluded.explored.search.candidates
    before = [found[g].label for g in concluded.chosen]
    place = {one.mechanism.name: g for g, one in enumerate(found)}
    better = [((place["encoder-scale:3"],), found[place["encoder-scale:2"]])]
    weigh = conclusion._weigh
    monkeypatch.setattr(conclusion, "_weigh", lambda one: weigh(one)._replace(better=better))
    monkeypatch.setattr(reshaping, "explore_further", lambda *given: None)
    told = prove(concluded)
    assert [one.candidate.label for one in told.effects] == before
    assert told.path.count("pruned") == 1


@pytest.mark.slow
@seeds(3)
def test_an_effect_is_named_again_where_those_beside_it_are_dropped(
    rng: np.random.Generator, monkeypatch: pytest.MonkeyPatch
) -> None:
    """One kept a name that its own set gave no probability, and was fitted as nothing."""
    monkeypatch.setattr(conclusion, "MAX_TAKEN_BACK", 0)
    search, planted, _ = search_lags(rng)
    explored = explore(search, (), ignore)
    proxy = next(g for g, c in enumerate(search.candidates) if c.label == "approach-backlash:2")
    chosen = [planted[0], proxy, planted[2]]
    mistaken = Conclusion(explored, chosen, search.fit_model(chosen, explored.fitted))
    settled = conclusion._settle(mistaken)
    assert set(settled.chosen) == set(planted)
    assert "approach-backlash:2 -> settle:2" in explored.progress.path
