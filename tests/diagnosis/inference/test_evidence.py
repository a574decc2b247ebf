"""The evidence of every candidate and its null: what is left out for speed must not matter."""

from __future__ import annotations

import numpy as np
import pytest
from builders import drawn, seeds

from modelsel.diagnosis.candidates.candidate import Candidate
from modelsel.diagnosis.candidates.candidate_list import build_candidates
from modelsel.diagnosis.columns.candidate_columns import build_columns, stack_design
from modelsel.diagnosis.inference.evidence import (
    RATIOS,
    Chance,
    compute_factors,
    compute_log_bayes_factors,
    compute_p_value,
    draw_null,
    normalise_strength,
    sum_evidence,
)
from modelsel.diagnosis.inference.scan import Scan, build_scan, compute_basis
from modelsel.fitting.design import Model
from modelsel.fitting.least_squares import fit
from modelsel.mechanisms.registry import every, mechanism

DRAWS = 40


def seen_from_base(
    rng: np.random.Generator, m: int
) -> tuple[Scan, tuple[Candidate, ...], np.ndarray]:
    at = drawn("puma760", rng, m)
    base = Model((mechanism("geometric", at.robot),))
    fitted = fit(at, base)
    found = build_candidates(at, base, every(at.robot))
    X, r = stack_design(at, base.terms, fitted.at())
    Q = compute_basis(X[:, list(fitted.found.kept)])
    return build_scan(build_columns(at, found, fitted.at()), Q), found, r + rng.normal(size=len(r))


@pytest.mark.slow
@seeds(1, 2)
@pytest.mark.parametrize(
    "m", [20, 80]
)  # few degrees of freedom: large shares, large ratios; and many
def test_the_null_leaves_out_no_ratio_that_matters(rng: np.random.Generator, m: int) -> None:
    """Against every ratio of every draw in double precision; free functions and signed compliances
    among the candidates."""
    seen, found, _ = seen_from_base(rng, m)
    assert len(seen.signed)
    assert len(seen.smooth[0]) or m < 80
    log_prior = np.log([c.prior for c in found])
    drawn_null, _ = draw_null(seen, log_prior, DRAWS, np.random.default_rng(7))
    u = np.random.default_rng(7).standard_normal((len(seen.Q), DRAWS))
    u -= seen.Q @ (seen.Q.T @ u)
    share = normalise_strength(seen.strength(seen.columns.dot(u)), np.square(u).sum(0))
    values = []
    for ratio in RATIOS:
        joint = compute_log_bayes_factors(seen, share, float(ratio)) + log_prior[:, None]
        values.append(np.log(np.exp(joint - joint.max(0)).sum(0)) + joint.max(0))
    assert drawn_null == pytest.approx(np.sort(np.max(values, axis=0)), abs=2e-4)
    single = u.astype(np.float32)
    products = seen.columns.dot(single)
    chance = Chance(seen, log_prior, products, np.square(single).sum(0))
    assert chance.share.whole.dtype == np.float32
    np.testing.assert_allclose(chance.share.whole, share.whole, rtol=1e-4, atol=1e-7)


@pytest.mark.slow
def test_evidence_of_a_response_is_that_of_its_strengths(rng: np.random.Generator) -> None:
    """One response alone and among others; the ratio that maximises the sum; candidates that would
    be large have no part."""
    seen, found, r = seen_from_base(rng, 60)
    y = r - seen.Q @ (seen.Q.T @ r)
    log_prior = np.log([c.prior for c in found])
    known = compute_factors(seen, seen.see(y))
    share = normalise_strength(
        seen.strength(seen.columns.dot(np.stack([y, r], 1))), np.array([y @ y, r @ r])
    )
    small = seen.judge(seen.see(y))[1]
    assert small.any()
    for ratio, row in zip(RATIOS, known, strict=True):
        assert row[small] == pytest.approx(
            compute_log_bayes_factors(seen, share, float(ratio))[small, 0]
        )
    assert np.isneginf(known[:, np.logical_not(small)]).all()
    value, joint = sum_evidence(known, log_prior)
    sums = np.log(np.exp(known + log_prior).sum(1))
    assert value == pytest.approx(sums.max())
    assert joint == pytest.approx(known[int(sums.argmax())] + log_prior)


def test_no_evidence_without_candidates_that_are_left() -> None:
    value, joint = sum_evidence(np.zeros((len(RATIOS), 3)), np.full(3, -np.inf))
    assert value == -np.inf
    assert np.isneginf(joint).all()
    assert compute_p_value(value, np.zeros(9)) == 1.0


@pytest.mark.integration
def test_no_evidence_in_draws_without_candidates_that_are_left(rng: np.random.Generator) -> None:
    """A base with a direction for nearly every number absorbs every candidate."""
    at = drawn("puma760", rng, 20)
    base = Model((mechanism("geometric", at.robot),))
    fitted = fit(at, base)
    found = build_candidates(at, base, every(at.robot))[:30]
    columns = build_columns(at, found, fitted.at())
    Q = np.eye(columns.rows)
    seen = build_scan(columns, Q)
    assert not seen.by_size
    nothing = np.zeros((columns.screws.count, DRAWS), np.float32)
    chance = Chance(seen, np.zeros(len(found)), nothing, np.ones(DRAWS, np.float32))
    for values in (chance.evidence, chance.below(0.0), chance.take(slice(3, 9)).evidence):
        assert np.isneginf(values).all()
    assert (chance.smallest_p == 1).all()
    assert chance.evidence.shape == chance.smallest_p.shape == (DRAWS,)
