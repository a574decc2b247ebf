"""The closed-form posterior: the exact chain at many draws, intervals against statsmodels and
quadrature, and calibration by simulation."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from builders import drawn, one, planted, small_arm
from scipy.stats import chi2

from modelsel._typing import Array
from modelsel.fitting.batch import Ensemble
from modelsel.fitting.batch_positions import SMALL_ANGLE, BatchPositions, cos_sin
from modelsel.fitting.design import Model, compute_design, residuals, whitened
from modelsel.fitting.least_squares import fit
from modelsel.fitting.prior import usual_sizes
from modelsel.fitting.problem import Problem
from modelsel.fitting.whitening import Whitening
from modelsel.mechanisms.causes import cos, q
from modelsel.mechanisms.geometry import build_setup
from modelsel.mechanisms.registry import mechanism
from modelsel.robot.kinematics import pose
from modelsel.uncertainty.posterior import linear_posterior, summarise_importance, weight_draws

ARM = small_arm()
MODEL = Model((mechanism("geometric", ARM), mechanism("joint-compliance:2", ARM)))


def rotations(rng: np.random.Generator, m: int) -> Array:
    """(m, 3, 3) drawn by QR."""
    Q = np.linalg.qr(rng.normal(size=(m, 3, 3)))[0]
    return np.asarray(Q * np.linalg.det(Q)[:, None, None])


def oriented(rng: np.random.Generator, m: int = 9) -> Problem:
    bare = drawn(ARM, rng, m)
    data = replace(bare.data, rotation=np.einsum("ijm->mij", bare.pose(slice(None)).rotation))
    whiten = np.tile(np.diag([10.0, 10, 10, 2000, 2000, 2000]), (m, 1, 1))
    return replace(
        bare, data=data, tool_rotations=rotations(rng, 1), whitening=Whitening(matrices=whiten)
    )


def placed(rng: np.random.Generator) -> Problem:
    """Two targets, two groups with a placement each, blocks of weights, a sliding joint."""
    bare = drawn(
        small_arm(prismatic=True),
        rng,
        12,
        target=np.array(["a", "b"] * 6),
        group=np.array(["x"] * 6 + ["y"] * 6),
        configuration=np.arange(12) // 2,
    )
    return replace(
        bare,
        placement=(rotations(rng, 2), rng.normal(0, 100, (2, 3))),
        whitening=Whitening(matrices=rng.normal(size=(12, 3, 3))),
        tools=rng.normal(0, 50, (2, 3)),
    )


@pytest.mark.parametrize("kind", ["puma760", "orientation", "placed"])
def test_ensemble_is_the_exact_chain(rng: np.random.Generator, kind: str) -> None:
    at = {"orientation": oriented, "placed": placed}.get(kind, lambda r: drawn("puma760", r, 11))(
        rng
    )
    named = (
        ()
        if kind != "puma760"
        else (mechanism("gravity-twist", at.robot), mechanism("backlash:3", at.robot))
    )
    model = Model(
        (
            build_setup(
                at.robot,
                len(at.data.targets),
                len(at.data.groups),
                kind == "placed",
                kind == "orientation",
            ),
            mechanism("geometric", at.robot),
            *named,
        )
    )
    theta = rng.normal(0, 1e-2, (5, len(model.terms)))
    expected = np.stack([whitened(at, residuals(at, model.terms, t)).T for t in theta])
    assert (
        np.abs(Ensemble(at, model.terms).residuals(theta) - expected).max()
        < 1e-9 * np.abs(expected).max()
    )


def test_entries_that_vary_between_rows_about_every_axis(rng: np.random.Generator) -> None:
    """Among constant ones of the same frame, small and large; in groups placed apart."""
    at = placed(rng)
    frames, m = at.robot.n + 1, len(at)
    constant = rng.normal(0, 1, (3, 1, frames, 6)) * [5, 5, 5, 0.01, 0.01, 0.3]
    varying = rng.normal(0, 1, (3, m, frames, 6)) * [5, 5, 5, 0.01, 0.3, 0.01]
    is_varying = rng.random((frames, 6)) < 0.5
    is_varying[at.robot.n] = False
    entries = np.where(is_varying, varying, constant)
    twist = {
        (k, axis): (varying if is_varying[k, axis] else constant)[:, :, k, axis]
        for k in range(frames)
        for axis in range(6)
    }
    found = BatchPositions.prepare(at).residuals(twist, 3)
    for draw in range(3):
        there = pose(at.robot, at.data.q, at.tool, entries[draw].transpose(1, 2, 0), None)
        R, t = at.placement
        group = at.data.group
        expected = at.data.position - t[group] - np.einsum("mij,jm->mi", R[group], there.target)
        np.testing.assert_allclose(found[draw].T, expected, rtol=0, atol=1e-9)


def test_small_angles_by_series() -> None:
    angle = np.linspace(-1, 1, 2001) * 0.99 * SMALL_ANGLE
    for series, exact in zip(cos_sin(angle), (np.cos(angle), np.sin(angle)), strict=True):
        np.testing.assert_allclose(series, exact, rtol=4e-16, atol=0)
    assert cos_sin(np.array([2.0]))[0] == np.cos(2.0)


@pytest.mark.integration
def test_intervals_are_those_of_least_squares(rng: np.random.Generator) -> None:
    import statsmodels.api as sm

    at = drawn(ARM, rng, 15)
    problem = planted(at, MODEL.terms, np.zeros(len(MODEL.terms)), rng, 0.1)
    fitted = fit(problem, MODEL, held="nothing")
    kept = list(fitted.found.kept)
    X, r = compute_design(problem, MODEL.terms, fitted.at())
    X = X.reshape(-1, len(MODEL.terms))[:, kept]
    plain = sm.OLS(r.ravel() + X @ fitted.theta[kept], X).fit()
    low, high = linear_posterior(fitted).quantile(np.array([0.025, 0.975])).T
    assert np.allclose(np.stack([low[kept], high[kept]], 1), plain.conf_int(), rtol=1e-6, atol=1e-9)
    assert linear_posterior(fitted).scale == pytest.approx(np.sqrt(plain.scale), rel=1e-6)


def test_shrunk_posterior_is_the_conjugate_one(rng: np.random.Generator) -> None:
    """Against the textbook's formulas for a normal prior in units of the noise, its rows written
    out."""
    at = drawn(ARM, rng, 15)
    problem = planted(at, MODEL.terms, np.zeros(len(MODEL.terms)), rng, 0.1)
    precision = np.zeros(len(MODEL.terms))
    precision[-1] = 1e8
    fitted = fit(problem, MODEL, precision=precision, held="nothing")
    kept = list(fitted.found.kept)
    X, r = compute_design(problem, MODEL.terms, fitted.at())
    X = X.reshape(-1, len(MODEL.terms))[:, kept]
    y = r.ravel() + X @ fitted.theta[kept]
    gram = X.T @ X + np.diag(precision[kept])
    beta = np.linalg.solve(gram, X.T @ y)
    cost = y @ y - beta @ gram @ beta
    known = linear_posterior(fitted)
    assert known.freedom == len(y) - (len(kept) - 1)
    assert known.cost == pytest.approx(cost, rel=1e-6)
    spread = np.sqrt(np.diag(np.linalg.inv(gram)) * cost / known.freedom)
    assert np.allclose(known.spread[kept], spread, rtol=1e-6)


def test_weights_find_the_curved_posterior() -> None:
    """One angle known to half a radian: quadrature of the exact posterior against weighted draws,
    which the plain draws miss."""
    rng = np.random.default_rng(0)
    at = drawn(ARM, rng, 8, tool=(0.0, 0.0, 0.0))
    model = Model((one(1, "rz", 0.02 * cos(q(2)) + 1.0),))
    problem = planted(at, model.terms, np.array([0.4]), rng, 300.0)
    fitted = fit(problem, model)
    known = linear_posterior(fitted)
    draws = known.draw(rng, 40_000)
    good = weight_draws(problem, fitted, draws)
    grid = fitted.theta[0] + np.linspace(-3.0, 3.0, 6001)
    cost = np.square(Ensemble(problem, model.terms).residuals(grid[:, None])).sum((1, 2))
    density = cost ** (-known.freedom / 2 - 0.5)  # σ integrated out
    density /= density.sum()
    mean = float(density @ grid)
    spread = float(np.sqrt(density @ np.square(grid - mean)))
    assert 0.5 < good.effective / 40_000 < 0.95
    assert abs(good.spread[0] - spread) < 0.03 * spread
    assert abs(draws.spread[0] - spread) > 0.06 * spread
    assert abs(float(good.weight @ good.theta[:, 0]) - mean) < 4 * spread / np.sqrt(good.effective)
    assert "believe" in summarise_importance(replace(good, weight=np.eye(1, 40_000)[0])).sentence


STUDIES, DRAWS, BINS = 2000, 99, 20


@pytest.mark.slow
def test_calibrated_by_simulation(rng: np.random.Generator) -> None:
    """2,000 studies: ranks of the planted values among weighted draws are uniform, and 95 %
    intervals cover 95 ± 1 %."""
    at = drawn(ARM, rng, 12)
    p = len(MODEL.terms)
    kept = list(fit(at, MODEL, held="nothing").found.kept)
    size = np.array([t.size[1] if t.size else 1e-4 for t in MODEL.terms])
    ranks, covered, effective = (
        np.zeros((STUDIES, len(kept))),
        np.zeros((STUDIES, len(kept) + 1)),
        0.0,
    )
    for study in range(STUDIES):
        truth = np.zeros(p)
        truth[kept] = rng.normal(0, 0.3 * size[kept])
        sigma = float(np.exp(rng.normal(-2, 0.5)))
        problem = planted(at, MODEL.terms, truth, rng, sigma)
        fitted = fit(problem, MODEL, start=truth, held="nothing")
        known = linear_posterior(fitted)
        draws = weight_draws(problem, fitted, known.draw(rng, DRAWS))
        below = draws.weight @ (draws.theta[:, kept] < truth[kept])
        ranks[study] = below
        low, high = known.quantile(np.array([0.025, 0.975])).T
        covered[study, :-1] = (low[kept] < truth[kept]) & (truth[kept] < high[kept])
        covered[study, -1] = known.scale_quantile(0.025) < sigma < known.scale_quantile(0.975)
        effective += draws.effective / DRAWS / STUDIES
    counts = np.stack([np.histogram(r, BINS, (0, 1))[0] for r in ranks.T])
    statistic = np.square(counts - STUDIES / BINS).sum(1) / (STUDIES / BINS)
    assert chi2.sf(statistic, BINS - 1).min() > 0.01 / len(kept), statistic
    assert abs(covered[:, :-1].mean() - 0.95) < 0.01
    assert (np.abs(covered.mean(0) - 0.95) < 0.015).all(), covered.mean(
        0
    )  # three standard deviations of one parameter's
    assert effective > 0.9


@pytest.mark.long
def test_covers_parameters_of_usual_size(rng: np.random.Generator) -> None:
    """300 arms whose every geometric parameter is drawn about its drawing, whether the data tell it
    or not: 95 % intervals hold 95 ± 2 % of all, and of those that the data hardly determine; none
    goes beyond what its size allows."""
    inside, weakly, most = [], [], 0.0
    sizes = usual_sizes(MODEL)
    for _ in range(300):
        at, scale = drawn(ARM, rng, 20), rng.uniform(0.7, 2.0)
        truth = np.where(
            np.isfinite(sizes), scale * np.where(np.isfinite(sizes), sizes, 0.0), 0.0
        ) * rng.normal(size=len(sizes))
        fitted = fit(planted(at, MODEL.terms, truth, rng, 0.05), MODEL)
        low, high = linear_posterior(fitted).quantile(np.array([0.025, 0.975])).T
        fitted_terms = [k for k in fitted.found.kept if np.isfinite(sizes[k])]
        held = (low < truth) & (truth < high)
        inside += held[fitted_terms].tolist()
        weakly += held[list(fitted.leaning)].tolist()
        most = max(most, float(np.abs(fitted.theta[fitted_terms] / sizes[fitted_terms]).max()))
    assert len(weakly) > 1000
    assert 0.93 < np.mean(inside) < 0.975
    assert 0.92 < np.mean(weakly) < 0.98
    assert most < 10
