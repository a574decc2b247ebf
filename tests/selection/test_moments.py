"""Moments of folds against the rows themselves: leaving terms out, units, and what is drawn."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from builders import drawn, estimate_gain, one, planted, seeds, small_arm
from scipy.stats import mannwhitneyu

from modelsel.fitting.design import Model, compute_design
from modelsel.fitting.least_squares import Fit, fit
from modelsel.fitting.problem import Problem
from modelsel.fitting.whitening import Whitening
from modelsel.mechanisms.causes import q, sin
from modelsel.mechanisms.registry import mechanism
from modelsel.selection import gain, moments, splits
from modelsel.selection.held_out_comparison import FAR, compare_held_out, find_far_held_out
from modelsel.selection.moments import (
    Coordinates,
    LinearRows,
    leave_out,
    measure_moments,
    rows_by_unit,
)

ARM = small_arm()
MODEL = Model((mechanism("geometric", ARM), one(2, "rz", sin(q(1))), one(3, "rz", sin(2.0 * q(2)))))


def weighed(rng: np.random.Generator, m: int = 60) -> tuple[Problem, Fit]:
    """Rows of unequal weights, and a fit that holds what they hardly determine by its prior."""
    at = planted(drawn(ARM, rng, m), MODEL.terms, np.zeros(len(MODEL.terms)), rng, 0.1)
    root = rng.normal(size=(m, 3, 3)) + 4 * np.eye(3)
    at = replace(at, whitening=Whitening(matrices=root))
    return at, fit(at, MODEL, held="all")


def dense(problem: Problem, fitted: Fit) -> tuple[np.ndarray, np.ndarray]:
    """(X (3m, k) of the fitted columns, response (3m,) as if fitted from nought), whitened."""
    X, r = compute_design(problem, fitted.terms, fitted.at())
    kept = list(fitted.found.kept)
    return X[:, :, kept].reshape(-1, len(kept)), (r + X @ fitted.theta).ravel()


@seeds(1, 2)
def test_left_out_terms_are_those_of_a_refit(rng) -> None:
    """Without its last two terms, fold by fold: the fit of the other columns and the prior to the
    other rows; in whitened coordinates, and in mm."""
    problem, fitted = weighed(rng)
    X, y = dense(problem, fitted)
    fold_of = np.arange(len(problem)) % 4
    coordinates = Coordinates.of(fitted)
    lost = list(fitted.found.kept[-2:])
    directions, change = leave_out(coordinates, fitted.theta, lost)
    rows = LinearRows(problem, fitted.terms, fitted.at())
    reduced = measure_moments(rows, coordinates, fold_of).reduced(directions, change)
    shift = reduced.shift()
    plain = measure_moments(rows, coordinates, fold_of, weighted=False).moved(change + shift)
    X, prior = X[:, :-2], fitted.root[:, list(fitted.found.kept[:-2])]
    inverse = np.linalg.inv(problem.whitening.matrices)
    for k in range(4):
        own = (fold_of == k).repeat(3)
        A = np.vstack([X[~own], prior])
        b = np.append(y[~own], np.zeros(len(prior)))
        left = y[own] - X[own] @ np.linalg.lstsq(A, b, rcond=1e-15)[0]
        assert reduced.moved(shift)[k] == pytest.approx(left @ left, rel=1e-8)
        in_mm = np.einsum("mij,mj->mi", inverse[fold_of == k], left.reshape(-1, 3))
        assert plain[k] == pytest.approx(np.square(in_mm).sum(), rel=1e-8)


@pytest.mark.parametrize("kept", [0, moments.MAX_KEPT])
def test_blocks_of_rows_and_a_single_one(kept, rng, monkeypatch) -> None:
    """Moments and held-out residuals do not depend on how many rows stand in a block, or are
    kept."""
    problem, fitted = weighed(rng)
    fold_of = rng.integers(0, 3, len(problem))
    coordinates = Coordinates.of(fitted)
    without = rng.normal(size=(3, len(fitted.theta))) * 1e-3

    def found() -> tuple[np.ndarray, np.ndarray]:
        rows = LinearRows(problem, fitted.terms, fitted.at())
        return measure_moments(rows, coordinates, fold_of).gram, rows.held_out(fold_of, without)

    once = found()
    monkeypatch.setattr(moments, "MAX_KEPT", kept)
    monkeypatch.setattr("modelsel.fitting.problem.Problem.parts.__defaults__", (7,))
    for a, b in zip(once, found(), strict=True):
        np.testing.assert_allclose(a, b, atol=1e-10)


@pytest.mark.parametrize("units", [2, 7, 60])
def test_units_keep_their_products(units, rng) -> None:
    """Units taller and shorter than the model is wide; tall ones are reduced."""
    problem, fitted = weighed(rng)
    unit = rng.permutation(np.arange(60) % units)
    coordinates = Coordinates.of(fitted)
    rows, unit_of = rows_by_unit(problem, fitted, coordinates, unit)
    rows_of = LinearRows(problem, fitted.terms, fitted.at())
    whole = measure_moments(rows_of, coordinates, unit)
    assert len(rows) == min(180, units * (coordinates.rank + 1))
    for k in range(units):
        own = rows[unit_of == k]
        np.testing.assert_allclose(own[:, :-1].T @ own[:, :-1], whole.gram[k], atol=1e-10)
        np.testing.assert_allclose(own[:, :-1].T @ own[:, -1], whole.score[k], atol=1e-10)


def test_models_share_the_draws(rng, monkeypatch) -> None:
    """Three models drawn together have the gains of each pair, drawn at once or block by block."""
    residuals = rng.normal(size=(3, 50, 3))
    block = np.arange(50) // 2
    whole = gain.resample_errors(residuals, block, np.random.default_rng(4))
    monkeypatch.setattr(gain, "MAX_DRAWN", 1000)
    first, second, third = gain.resample_errors(residuals, block, np.random.default_rng(4))
    pair = estimate_gain(residuals[0], residuals[2], block, np.random.default_rng(4))
    assert first.gain_of(third).interval_mm == pytest.approx(pair.interval_mm, rel=1e-12)
    assert second.drawn == pytest.approx(whole[1].drawn, rel=1e-12)


@pytest.mark.parametrize("digits", [0, 8], ids=["ties", "no-ties"])
def test_rank_sum_is_that_of_scipy(digits, rng) -> None:
    expected = np.round(rng.gamma(2, 2, 40), digits)
    found = np.round(rng.gamma(2, 3, 25), digits)
    _, p = compare_held_out(expected, np.arange(40), found, np.arange(25))
    want = mannwhitneyu(
        found**2, expected**2, alternative="greater", method="asymptotic", use_continuity=False
    )
    assert p == pytest.approx(want.pvalue, rel=1e-12)


def test_exchanges_update_what_they_would_work_out(rng, monkeypatch) -> None:
    """The chosen configurations are the same when the information is worked out anew at every
    exchange."""
    data = drawn(ARM, rng, 150).data
    turns = (False,) * 3
    chosen = splits.split_configurations(data, 60, turns, np.random.default_rng(2))
    monkeypatch.setattr(splits, "MAX_UPDATES", 1)
    anew = splits.split_configurations(data, 60, turns, np.random.default_rng(2))
    assert np.array_equal(chosen, anew)


@seeds(31)
@pytest.mark.parametrize(("estimation", "held_out"), [(20, 80), (60, 30), (30, 600)])
def test_far_held_out_rows_are_rare_under_heavy_tails(
    estimation: int, held_out: int, rng: np.random.Generator
) -> None:
    """Student's t with three degrees of freedom on both sides: far ones are told in few studies."""
    told = 0
    for _ in range(2000):
        errors = np.linalg.norm(rng.standard_t(3, (estimation + held_out, 3)), axis=1)
        blocks = np.arange(len(errors))
        before, after = errors[:estimation], errors[estimation:]
        far, p = find_far_held_out(before, blocks[:estimation], after, blocks[estimation:])
        assert (far == (after > FAR * before.max())).all()
        told += p < 1e-3
    assert told / 2000 < 5e-3


def test_two_configurations_very_far_off_are_told(rng: np.random.Generator) -> None:
    """Two just beyond twice the largest error may be chance, two at ten times it are not."""
    near, blocks = rng.uniform(0.1, 0.2, 60), np.arange(60)
    after = np.append(near, near.max() * np.array([2.1, 2.2]))
    assert find_far_held_out(near, blocks, after, np.arange(62))[1] > 5e-3
    after[-2:] *= 5
    assert find_far_held_out(near, blocks, after, np.arange(62))[1] < 1e-5


def test_few_configurations_and_rounding_tell_nothing_of_far_rows(rng: np.random.Generator) -> None:
    near, far = rng.uniform(0.1, 0.2, 40), rng.uniform(1.0, 2.0, 6)
    blocks = np.arange(40)
    mask, p = find_far_held_out(near, blocks, np.append(near, far), np.arange(46))
    assert p < 1e-5
    assert np.flatnonzero(mask).tolist() == list(range(40, 46))
    # one posture measured six times is one configuration, as far off as the farthest
    same = np.append(blocks, np.full(6, 40))
    once = find_far_held_out(near, blocks, np.append(near, far.max()), np.arange(41))
    assert find_far_held_out(near, blocks, np.append(near, far), same)[1] == once[1] > 5e-4
    assert find_far_held_out(near, blocks, far[:4], blocks[:4])[1] == 1
    assert find_far_held_out(near * 1e-12, blocks, far * 1e-9, blocks[:6])[1] == 1
