"""Half-samples: their products, least squares written out, and halves that determine nothing."""

from __future__ import annotations

import numpy as np
import pytest
from builders import drawn, measured, one, planted, small_arm
from scipy.stats import f as fisher

from modelsel.fitting.design import Model, compute_design
from modelsel.fitting.least_squares import fit
from modelsel.mechanisms.causes import Named, q, sin
from modelsel.uncertainty.bootstrap import draw_half_samples
from modelsel.uncertainty.stability import LEVEL, _sum_halves, measure_stability

ARM = small_arm()
MODEL = Model((one(1, "tx"), one(1, "rz"), one(2, "rz", sin(q(1))), one(3, "rz", sin(2.0 * q(2)))))


@pytest.mark.parametrize("count", [5, 6])
def test_halves_of_an_odd_number(count, rng) -> None:
    """Seven units of unequal size: each half's own products, though the second is a difference."""
    unit_of = np.sort(rng.integers(0, 7, 40))
    unit_of[:7] = np.arange(7)
    unit_of.sort()
    rows = rng.normal(size=(40, 4))
    halves = draw_half_samples(rng, count, 7)
    sums = list(_sum_halves(rows, unit_of, halves))
    assert len(sums) == count
    for half, products in zip(halves, sums, strict=True):
        own = rows[np.isin(unit_of, half)]
        np.testing.assert_allclose(products, own.T @ own, atol=1e-12)


def test_stability_is_that_of_refitted_halves(rng) -> None:
    """A weak effect's share of significant halves, by least squares of every half."""
    problem = planted(drawn(ARM, rng, 31), MODEL.terms, np.array([1.0, 1e-3, 0, 2e-4]), rng, 0.1)
    fitted = fit(problem, MODEL, held="nothing")
    found = measure_stability(
        problem, np.arange(31), fitted, [[2], [3]], np.random.default_rng(5), 40
    )
    X, r = compute_design(problem, MODEL.terms, fitted.at())
    y = r + X @ fitted.theta
    hits = np.zeros(2)
    for half in draw_half_samples(np.random.default_rng(5), 40, 31):
        A, b = X[half].reshape(-1, 4), y[half].ravel()

        def left(columns: list[int], A=A, b=b) -> float:
            beta = np.linalg.lstsq(A[:, columns], b, rcond=None)[0]
            return float(np.square(b - A[:, columns] @ beta).sum())

        whole = left([0, 1, 2, 3])
        for g, others in enumerate(([0, 1, 3], [0, 1, 2])):
            f = (left(others) - whole) / (whole / (len(b) - 4))
            hits[g] += fisher.sf(f, 1, len(b) - 4) < LEVEL
    assert found == pytest.approx(hits / 40)
    assert 0 < found[1] < 1


def test_a_half_that_does_not_determine_the_model(rng) -> None:
    """A parameter of one configuration: only halves that have it are judged; with none, nothing
    is."""
    at = drawn(ARM, rng, 12)
    current = at.data.covariates["current_A"]
    current[:] = 0.0
    current[3] = 5.0
    model = Model((one(1, "tx"), one(2, "ty", Named("current_A", "A"))))
    problem = measured(at, at.data.position + rng.normal(0, 0.01, (12, 3)) + [0.5, 0, 0])
    fitted = fit(problem, model, held="nothing")
    unit = np.arange(12)
    assert measure_stability(problem, unit, fitted, [[0]], rng, 20) == [1.0]
    lone = np.minimum(unit, 1)  # one configuration against all others
    assert measure_stability(problem, lone, fitted, [[0]], rng, 2) == [1.0]
    bare = fit(problem.take(unit[:4]), model, held="nothing")
    assert measure_stability(problem.take(unit[:1]), unit[:1], bare, [[0]], rng, 2) == [None]
