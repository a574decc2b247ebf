"""What lasts is told from an effect: a base that settles is named, errors that fade are not, and what
the data do not tell apart is named together."""

from __future__ import annotations

import numpy as np
import pytest
from builders import OFF_AXIS, drawn, planted, seeds, study_of
from hidden_arm import Effect as Planted
from hidden_arm import State, arm, measured
from hidden_effects import at, together
from searches import ignore

from modelsel.diagnosis.candidates.candidate import Candidate
from modelsel.diagnosis.candidates.candidate_list import build_candidates
from modelsel.diagnosis.candidates.options import DEFAULT_OPTIONS
from modelsel.diagnosis.columns.kept_causes import KeptCauses
from modelsel.diagnosis.findings.effect_sentences import list_cautions
from modelsel.diagnosis.findings.effects import Claim, Effect
from modelsel.diagnosis.findings.outcome import Diagnosis
from modelsel.diagnosis.inference.credible_sets import CredibleSet, Entry
from modelsel.diagnosis.procedure import diagnose, diagnose_split
from modelsel.diagnosis.search.stepwise import explore
from modelsel.diagnosis.separation import Inquiry, _is_in_time, _Separation, _share_with_lasting
from modelsel.diagnosis.shapes.candidate_kinds import CandidateKind
from modelsel.fitting.design import Model, assemble, whiten
from modelsel.fitting.error_structure import ErrorStructure
from modelsel.fitting.least_squares import fit
from modelsel.fitting.possible_parts import ORDER, list_parts
from modelsel.fitting.problem import Problem
from modelsel.measurements.measurements import build_measurements
from modelsel.mechanisms.causes import q
from modelsel.mechanisms.registry import build_faults, every, mechanism
from modelsel.mechanisms.terms import Mechanism, Screw, Term
from modelsel.robot.files import load_robot
from modelsel.robot.kinematics import forward

SIGMA = 0.05
ROBOTS = ("puma760", "ur10e", "irb120")


def observe(rng: np.random.Generator, settles: float, fading: float) -> Problem:
    """Measure an arm whose base settles exponentially, by so many mm, with errors beside the noise
    that fade from one configuration to the next."""
    name = ROBOTS[int(rng.integers(3))]
    body = arm(load_robot(name), rng, (40.0, -25.0, 100.0))
    state = State(body, body.draw(rng, 80), {})
    lasts = rng.uniform(0.1, 0.3)
    axis = str(rng.choice(["tx", "ty", "tz"]))
    term = together(at(1, axis, lambda s: settles * (1 - np.exp(-s.progress / lasts))))
    exact = measured(body, state, (Planted("planted", "", (term,), np.ones(1)),))
    errors = rng.standard_normal(exact.shape)
    for k in range(1, len(errors)):
        errors[k] = 0.8 * errors[k - 1] + 0.6 * errors[k]
    noisy = exact + fading * errors + SIGMA * rng.standard_normal(exact.shape)
    return Problem(load_robot(name), build_measurements(state.q, noisy), body.tool[None])


def list_words(told: Diagnosis) -> set[str]:
    """List what the findings depend on."""
    return {name for effect in told.effects for name in effect.candidate.mechanism.names()}


@pytest.mark.slow
@seeds(1, 2)
def test_a_base_that_settles_is_an_effect(rng: np.random.Generator) -> None:
    told = diagnose(observe(rng, settles=14 * SIGMA, fading=0.0), seed=1)
    assert list_words(told) == {"progress"}
    assert "lasting" not in told.errors.names


@pytest.mark.slow
@seeds(1, 2)
def test_errors_that_fade_are_none(rng: np.random.Generator) -> None:
    told = diagnose(observe(rng, settles=0.0, fading=2 * SIGMA), seed=1)
    assert told.effects == ()
    assert "lasting" in told.errors.names


@pytest.mark.slow
@seeds(2, 3)
def test_a_small_drift_is_named_beside_errors_that_last(rng: np.random.Generator) -> None:
    told = diagnose(observe(rng, settles=3 * SIGMA, fading=0.0), seed=1)
    assert "progress" not in list_words(told)
    in_words = ("progress", "along the campaign")
    (lasting,) = [part for part in told.errors.parts if part.name == "lasting"]
    assert any(word in label for label in lasting.instead for word in in_words), told.errors.names


def test_a_search_goes_on_with_a_shape_that_is_not_listed(rng: np.random.Generator) -> None:
    at_ = drawn("puma760", rng, 60)
    shape = Mechanism("3 rz own", (Term("own", (Screw(3, "rz", q(1) * q(2) * q(3)),)),))
    problem = planted(at_, shape.terms, np.array([1e-3]), rng, SIGMA)
    base = Model((mechanism("geometric", problem.robot),))
    listed = build_candidates(problem, base, ())[:50]
    known = (Candidate(shape, CandidateKind.PRODUCT, 1e-3),)
    inquiry = Inquiry(base, (), 1, True, ignore, DEFAULT_OPTIONS)
    search = inquiry.search(problem, listed, known, KeptCauses(), fit(problem, base))
    chosen = explore(search, known, ignore).chosen
    assert chosen[: len(known)] == known


@pytest.mark.slow
@seeds(1, 2)
def test_what_was_found_is_fitted_with_the_weights_of_the_errors_it_leaves(
    rng: np.random.Generator,
) -> None:
    """At the base a joint that turns unevenly looks like one that does not repeat, and is sought with
    these weights; another does not repeat in fact. The fit is that of the rows as they are weighed in
    the end, and so are the sizes of the effects."""
    robot = load_robot("irb120")
    q = np.repeat(robot.draw(rng, 70), 2, axis=0)
    moved = q.copy()
    moved[:, 1] += 3e-4 * np.sin(q[:, 1])
    moved[:, 3] += np.repeat(rng.normal(0, 2e-4, 70), 2)
    tools = np.array([OFF_AXIS, (-60.0, 30.0, 140.0)])
    position = np.empty((140, 3))
    for target, tool in enumerate(tools):
        position[target::2] = forward(robot, moved[target::2], tool)
    position += rng.normal(0, 0.02, position.shape)
    data = build_measurements(q, position, target=["a", "b"] * 70)
    split = study_of(Problem(robot, data, tools))
    base = Model((mechanism("geometric", robot),))
    weighed, told, _ = diagnose_split(split, Inquiry(base, every(robot), 1, cells=False))
    assert told.effects
    assert told.errors.shared
    there = weighed.training
    design = whiten(there, assemble(there, told.fit.terms, told.fit.at()))
    R = told.fit.reduction.R
    squares = np.square(R).sum(0)
    np.testing.assert_allclose(np.square(design).sum((1, 2)), squares, rtol=1e-3, atol=1e-3)
    place = {term.key: k for k, term in enumerate(told.fit.terms)}
    for effect in told.effects:
        own = [place[term.key] for term in effect.candidate.mechanism.terms]
        np.testing.assert_array_equal(effect.estimate, told.fit.theta[own])


@pytest.mark.slow
@seeds(1, 2)
def test_errors_that_last_are_tried_where_a_drift_has_explained_them_away(
    rng: np.random.Generator,
) -> None:
    """A search that knows of no part names a drift, which leaves nothing that lasts."""
    problem = observe(rng, settles=0.0, fading=2 * SIGMA)
    robot = problem.robot
    base = Model((mechanism("geometric", robot),))
    everything = (*build_faults(robot), *every(robot))
    inquiry = Inquiry(base, everything, 1, True, ignore, DEFAULT_OPTIONS)
    split = study_of(problem, held_out=0)
    found = build_candidates(split.training, base, everything)
    separation = _Separation(
        split, inquiry, found, list_parts(problem, split.used), fit(split.training, base)
    )
    drifting = separation.search(ErrorStructure())
    assert any(_is_in_time(one) for one in drifting.explored.chosen)
    hidden = drifting._replace(left=drifting.left.without(ORDER))
    tried = separation._try_lasting(hidden)
    assert tried.left.tells(ORDER)
    assert not any(_is_in_time(one) for one in tried.explored.chosen)
    assert tried.criterion < hidden.criterion


def test_what_an_effect_in_time_claims_is_shared_with_errors_that_last() -> None:
    robot = load_robot("puma760")
    drift = Candidate(mechanism("tracker-drift", robot), CandidateKind.MECHANISM, 0.1)
    claim = Claim("cause", (0.99, 0.99, 0.98, 0.97))
    named = CredibleSet(1.0, (Entry(drift, 0.99, True, np.ones(1), 0),), 0, "found", np.zeros(1), 0)
    terms = len(drift.mechanism.terms)
    effect = Effect(drift, named, 0.001, np.ones(terms), np.full(terms, 0.1), claim=claim)
    shared = _share_with_lasting(effect, 0.9)
    assert shared.claim is not None
    assert shared.claim.level == "place"
    assert shared.claim.levels == pytest.approx([0.891, 0.891, 0.882, 0.873])
    assert "errors that last" in "; ".join(list_cautions(shared))
    assert "errors that last" not in "; ".join(list_cautions(effect))


@pytest.mark.integration
@pytest.mark.parametrize("name", ["gear-ripple:4", "tracker-step", "target-step"])
def test_a_search_goes_on_with_the_constant_that_was_found(
    name: str, rng: np.random.Generator
) -> None:
    """Of the candidates that one scanned mechanism has, alike but for their constant, it took the last."""
    exact = drawn("puma760", rng, 90)
    base = Model((mechanism("geometric", exact.robot),))
    found = build_candidates(exact, base, every(exact.robot))
    constants = [one for one in found if one.mechanism.name == name]
    known = constants[int(rng.integers(len(constants) // 4, len(constants) // 2))]
    terms = known.mechanism.terms
    at = planted(exact, terms, [term.size[1] for term in terms if term.size], rng, SIGMA)
    inquiry = Inquiry(base, (), 1, True, ignore, DEFAULT_OPTIONS)
    search = inquiry.search(at, found, (known,), KeptCauses(), fit(at, base))
    explored = explore(search, (known,), ignore)
    assert explored.chosen[0] == known
    assert explored.progress.path[0] == f"+ {known.label}"
    assert not any(known.label in step for step in explored.progress.path[1:])
