"""What a joint's own angle does is told as one curve, causes in time are told from each other, and
chance is not listed."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache

import numpy as np
import pytest
from builders import drawn, measured, planted, seeds
from searches import search_independent

from modelsel._typing import Array
from modelsel.diagnosis.candidates.candidate import Candidate
from modelsel.diagnosis.candidates.candidate_list import build_candidates
from modelsel.diagnosis.columns.candidate_columns import build_columns, stack_design
from modelsel.diagnosis.findings.outcome import Diagnosis
from modelsel.diagnosis.findings.sentences import describe_amount
from modelsel.diagnosis.inference.credible_sets import ask, include_candidate
from modelsel.diagnosis.inference.joint_curves import (
    chain_effects,
    collect_curves,
    find_own_joint,
    see_rest,
)
from modelsel.diagnosis.inference.scan import Released, build_scan, compute_basis
from modelsel.diagnosis.search.state import LEVEL, Search
from modelsel.diagnosis.shapes.shape_constants import find_own_wave
from modelsel.diagnosis.shapes.unregistered import BETWEEN
from modelsel.fitting.design import Model
from modelsel.fitting.least_squares import fit
from modelsel.fitting.problem import Problem
from modelsel.mechanisms.causes import Bump, Named, cos, q, sin
from modelsel.mechanisms.environment import STEPS
from modelsel.mechanisms.registry import every, mechanism
from modelsel.mechanisms.terms import Mechanism, Screw, Term
from modelsel.robot.kinematics import forward

SIGMA = 0.03


def turned(at: Problem, joint: int, curve: Array, rng: np.random.Generator) -> Problem:
    """The problem with a joint turned by a curve (m,) [rad], by moving its reading, and noise."""
    bent = at.data.q.copy()
    bent[:, joint - 1] += curve
    shift = forward(at.robot, bent, at.tools[0]) - forward(at.robot, at.data.q, at.tools[0])
    return measured(at, at.data.position + shift + rng.normal(0, SIGMA, shift.shape))


@cache
def offer() -> tuple[Model, tuple[Candidate, ...]]:
    """A PUMA's geometry and every candidate beside it, for tests that ask nothing of the rows they
    are made for."""
    at = drawn("puma760", np.random.default_rng(1), 80)
    base = Model((mechanism("geometric", at.robot),))
    return base, build_candidates(at, base, every(at.robot))


def named(at: Problem, rng: np.random.Generator) -> Diagnosis:
    base = Model((mechanism("geometric", at.robot),))
    return search_independent(at, base, build_candidates(at, base, every(at.robot)), rng)


def names(diagnosis: Diagnosis) -> list[str]:
    return [e.candidate.mechanism.name for e in diagnosis.effects]


@pytest.mark.slow
@seeds(1, 2, 3)
@pytest.mark.parametrize(
    "shape",
    [
        lambda x, c: np.tanh((x - c) / 0.2),
        lambda x, c: np.abs(x - c),
        lambda x, c: np.exp(-(((x - c) / 0.4) ** 2)),
    ],
    ids=["soft step", "kink", "bump"],
)
def test_a_shape_of_one_joint_is_one_free_function(
    rng: np.random.Generator, shape: Callable[[Array, float], Array]
) -> None:
    at = drawn("puma760", rng, 200)
    joint, centre = int(rng.integers(1, 5)), float(rng.uniform(-0.3, 0.3))
    found = named(turned(at, joint, 1.5e-3 * shape(at.data.q[:, joint - 1], centre), rng), rng)
    about = [
        n
        for e, n in zip(found.effects, names(found), strict=True)
        if find_own_joint(e.candidate) == joint
    ]
    (told,) = about
    free, kink = f"free(q{joint})", f"{joint} rz how far q{joint} is from "
    assert told.startswith((free, kink)), (joint, centre, found.path)
    if told.startswith(kink):
        # a kink is told as one, with its angle
        degrees = float(told.removeprefix(kink).partition("°")[0])
        assert degrees == pytest.approx(np.degrees(centre), abs=2)


@pytest.mark.slow
@seeds(1, 2, 3, 4)
def test_a_soft_step_in_pieces_claims_the_shape_of_none(rng: np.random.Generator) -> None:
    at = drawn("puma760", rng, 200)
    joint, centre = int(rng.integers(1, 5)), float(rng.uniform(-0.3, 0.3))
    curve = 1.5e-3 * np.tanh((at.data.q[:, joint - 1] - centre) / 0.2)
    found = named(turned(at, joint, curve, rng), rng)
    claims = [e.claim for e in found.effects if find_own_joint(e.candidate) == joint]
    levels = {claim.level for claim in claims if claim is not None}
    assert "drivers" in levels, found.path
    assert levels <= {"place", "drivers"}, found.path


@pytest.mark.slow
@seeds(4, 5, 6)
def test_two_waves_of_one_joint_stay_two_waves(rng: np.random.Generator) -> None:
    at = drawn("puma760", rng, 200)
    angle = at.data.q[:, 3]
    found = named(turned(at, 4, 4e-4 * np.sin(angle + 1) + 3e-4 * np.cos(2 * angle), rng), rng)
    assert sorted(names(found)) == ["encoder-eccentricity:4", "gear-eccentricity:4"], found.path


@pytest.mark.slow
@seeds(7, 8)
def test_a_number_of_waves_between_whole_ones_is_told(rng: np.random.Generator) -> None:
    at = drawn("puma760", rng, 150)
    count = float(rng.choice([k for k in BETWEEN if k < 30]))
    found = named(turned(at, 4, 5e-4 * np.sin(count * at.data.q[:, 3] + 1), rng), rng)
    (effect,) = found.effects
    joint, told = find_own_wave(effect.candidate.mechanism)
    assert joint == 4
    # a wave is known by its phase at the ends of the range: the error of a slope
    strength = np.hypot(*effect.estimate) / effect.standard_error.max()
    error = np.sqrt(12) / (strength * np.ptp(at.data.q[:, 3]))
    assert error < 0.04
    assert told == pytest.approx(count, abs=3 * error), (count, found.path)


@pytest.mark.slow
@seeds(9, 10)
def test_a_warm_up_is_told_from_a_drift(rng: np.random.Generator) -> None:
    at = drawn("puma760", rng, 120)
    clock = at.data.covariates["time_s"]
    found = named(turned(at, 2, 1e-3 * np.exp(-clock / (0.1 * np.ptp(clock))), rng), rng)
    assert len(found.effects) == 1, found.path
    assert "exp(time_s/" in str(found.effects[0].candidate.mechanism.terms[0].screws[0].cause), (
        names(found)
    )


@pytest.mark.slow
@seeds(11, 12)
def test_a_product_of_two_joints_is_one_cell(rng: np.random.Generator) -> None:
    at = drawn("puma760", rng, 120)
    odd = Mechanism("odd", (Term("m", (Screw(5, "rx", sin(q(2)) * cos(q(6))),)),))
    found = named(planted(at, odd.terms, np.array([2e-3]), rng, SIGMA), rng)
    assert len(found.effects) == 1, found.path
    assert set(
        map(str, (s.cause for t in found.effects[0].candidate.mechanism.terms for s in t.screws))
    ) == {"sin(q2+q6)", "cos(q2+q6)", "sin(q2-q6)", "cos(q2-q6)"}


@pytest.mark.integration
def test_steps_in_time_are_offered_once_between_two_configurations(
    rng: np.random.Generator,
) -> None:
    at = drawn("puma760", rng, 40)
    base = Model((mechanism("geometric", at.robot),))
    found = build_candidates(at, base, every(at.robot))
    steps = [c for c in found if c.mechanism.name == "tracker-step"]
    # with four configurations, twelve coordinates, before and after it: six numbers
    assert len(steps) == 33 < len(STEPS)
    of_target = [c for c in found if c.mechanism.name == "target-step"]
    assert len(of_target) == 37
    assert sum(c.prior for c in steps) == pytest.approx(
        sum(c.prior for c in found if c.mechanism.name == "base-tilt")
    )
    assert sum(c.prior for c in found) == pytest.approx(1)


@pytest.mark.slow
@seeds(13, 14, 15, 16)
def test_no_finding_is_listed_that_chance_would_explain(rng: np.random.Generator) -> None:
    at = drawn("puma760", rng, 60)
    two = Mechanism(
        "two",
        (Term("m", (Screw(2, "rz", cos(q(2))),)), Term("n", (Screw(6, "tx", Named("approach3")),))),
    )
    found = named(planted(at, two.terms, np.array([4e-4, 0.06]), rng, SIGMA), rng)
    assert found.effects
    assert max(e.p for e in found.effects) <= LEVEL, [
        (n, e.p) for n, e in zip(names(found), found.effects, strict=True)
    ]


@pytest.mark.integration
def test_a_part_of_the_columns_scans_like_the_whole(rng: np.random.Generator) -> None:
    """Restricted to one joint's curve, columns, Gram blocks and evidence are those of the whole."""
    at = drawn("puma760", rng, 60)
    base, found = offer()
    whole = build_columns(at, found)
    curve = collect_curves(found, whole, np.log([c.prior for c in found]))[4]
    for k, g in enumerate(curve.which):
        X = whole.expand(g)
        assert np.array_equal(curve.index[curve.slices[k]], whole.slices[g])
        assert curve.multiply(k)[curve.slices[k]] == pytest.approx(X @ X.T)
    for block in curve.blocks:
        for k, i, gram in zip(block.which, block.index, block.gram, strict=True):
            assert np.array_equal(i, curve.slices[k])
            assert gram == pytest.approx(curve.multiply(k)[i])
    X, r = stack_design(at, base.terms, None)
    Q = compute_basis(X)
    wave = int(
        curve.which[[found[g].mechanism.name for g in curve.which].index("encoder-eccentricity:4")]
    )
    r = r + 5e-3 * whole.expand(wave).sum(0)
    seen = build_scan(whole, Q)
    nothing = Released(np.zeros((Q.shape[1], 0)), np.zeros(0))
    rest = see_rest(curve, seen, seen.see(r - Q @ (Q.T @ r)), nothing)
    value, best = chain_effects(rest.offer(np.logical_not(curve.free)), 4)
    assert best[0] == wave
    again = chain_effects(rest.offer(np.isin(curve.which, best)), len(best), at_any_cost=True)
    assert again == (pytest.approx(value), best)


@pytest.mark.integration
def test_a_name_that_its_own_set_does_not_hold_is_said_not_to_be_told_apart(
    rng: np.random.Generator,
) -> None:
    at = drawn("puma760", rng, 80)
    base, found = offer()
    fitted = fit(turned(at, 4, 1e-3 * np.sin(at.data.q[:, 3]), rng), base)
    strange = next(k for k, c in enumerate(found) if c.mechanism.name == "refraction")
    X, r = stack_design(turned(at, 4, 1e-3 * np.sin(at.data.q[:, 3]), rng), base.terms, fitted.at())
    seen = build_scan(build_columns(at, found, fitted.at()), compute_basis(X))
    y = seen.see(r - seen.Q @ (seen.Q.T @ r))
    log_prior = np.log([one.prior for one in found])
    question = ask(seen, found, log_prior, y)
    plain = question.answer(None)
    assert (plain.entries[0].candidate.mechanism.name, plain.verdict) == (
        "gear-eccentricity:4",
        "found",
    )
    assert include_candidate(question, plain, plain.top) is plain
    told = include_candidate(question, plain, strange)
    assert told.verdict == "cannot be told apart"
    assert told.entries[-1].candidate is found[strange]
    assert told.entries[-1].probability < 1e-6


@pytest.mark.slow
@seeds(17, 18)
def test_a_joint_that_turns_about_its_own_target_is_not_the_cause(rng: np.random.Generator) -> None:
    """With the target a hair off the last axis, a turn of that joint has the right shape and would
    need radians."""
    at = drawn("ur10", rng, 100, tool=(0.05, 0.0, 100.0))
    spin = Mechanism("spin", (Term("m", (Screw(7, "ty", sin(q(6))),)),))
    bent = planted(at, spin.terms, np.array([0.3]), rng, SIGMA)
    found = named(bent, rng)
    assert len(found.effects) == 1, found.path
    listed = [e.candidate.mechanism for e in found.effects[0].named.entries]
    assert all(m.name != "gear-eccentricity:6" for m in listed), listed
    assert "7 ty sin(q6) & cos(q6)" in [m.name for m in listed]


@pytest.mark.slow
def test_beyond_a_shrunk_model_is_beyond_it_with_its_terms_integrated_out(
    rng: np.random.Generator,
) -> None:
    """What the scan sees behind a free function against generalised least squares with its
    covariance written out, columns at the base's parameters."""
    at = drawn("puma760", rng, 150)
    bent = turned(at, 4, 4e-4 * np.tanh(at.data.q[:, 3] / 0.3), rng)
    base = Model((mechanism("geometric", at.robot),))
    found = build_candidates(bent, base, every(at.robot))
    base_fit = fit(bent, base)
    search = Search(bent, base, found, rng, base_fit)
    free = next(g for g, c in enumerate(found) if c.mechanism.name == "free(q4) 20")
    view = search.fit_model([free], None)
    fitted, kept = view.fitted, list(view.kept)
    precision = fitted.precision
    assert precision is not None
    A, _ = stack_design(bent, view.model.terms, base_fit.at())
    _, r = stack_design(bent, (), fitted.at())
    soft = [k for k in kept if precision[k] > 0]
    firm = [k for k in kept if precision[k] == 0]
    inverse = fitted.root[:, soft].T @ fitted.root[:, soft]
    V = np.eye(len(A)) + A[:, soft] @ np.linalg.solve(inverse, A[:, soft].T)
    y = r + A @ fitted.theta
    W = np.linalg.inv(V)
    X = A[:, firm]
    P = W - W @ X @ np.linalg.solve(X.T @ W @ X, X.T @ W)
    for name_ in ("encoder-scale:4", "refraction", "settle:2"):
        g = next(k for k, c in enumerate(found) if c.mechanism.name == name_)
        x = search.columns.expand(g)[0]
        bucket = next(b for b in view.scan.buckets if g in b.block.which)
        left = bucket.left[list(bucket.block.which).index(g)][0, 0]
        assert left == pytest.approx(x @ P @ x, rel=1e-6)
        strength = view.scan.strength(view.response.column).whole[g, 0]
        assert strength == pytest.approx((x @ P @ y) ** 2 / (x @ P @ x), rel=1e-5)
    assert view.residual @ view.residual == pytest.approx(y @ P @ y, rel=1e-6)


def test_waves_of_one_curve_share_a_unit() -> None:
    """0.114 mrad stood beside 67.7 µrad in one sentence."""
    width = np.radians(4.0)
    centres = np.arange(-np.pi, np.pi, width)
    terms = [Term(f"f{k}", (Screw(1, "rz", Bump("q1", c, width)),)) for k, c in enumerate(centres)]
    heights = 1.3e-4 * np.sin(13 * centres) + 9e-5 * np.sin(27 * centres)
    said = describe_amount(terms, heights, np.full(len(terms), 1e-6))
    assert said.count("in 13 waves a turn") == said.count("in 27 waves a turn") == 1
    assert " mrad in 27" in said
    assert "µrad" not in said
