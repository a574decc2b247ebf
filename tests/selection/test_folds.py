"""Exact cross-validation against brute-force refits, and folds that keep together what belongs
together."""

from __future__ import annotations

import numpy as np
import pytest
from builders import drawn, planted, seeds
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from scipy import stats

from modelsel.exceptions import NotEstimable
from modelsel.fitting.design import Model, compute_design
from modelsel.fitting.least_squares import fit
from modelsel.fitting.whitening import Whitening
from modelsel.measurements.measurements import build_measurements
from modelsel.mechanisms.registry import mechanism
from modelsel.robot.files import load_robot
from modelsel.selection.cross_validation import FoldedData, cross_validate, fold, pad_blocks
from modelsel.selection.moments import LinearRows
from modelsel.selection.splits import assign_folds


def parts_of(X: np.ndarray, y: np.ndarray, fold_of: np.ndarray) -> FoldedData:
    blocks = [np.column_stack([X, y])[fold_of == k] for k in range(fold_of.max() + 1)]
    return pad_blocks(blocks, [len(b) for b in blocks])


def brute(
    X: np.ndarray, y: np.ndarray, fold_of: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(beta without every fold, held-out sum of squares, log t density): a refit a fold, scipy's
    multivariate t."""
    size = np.linalg.norm(X, axis=0)
    X, betas, squares, densities = X / size, [], [], []
    for k in range(fold_of.max() + 1):
        held = fold_of == k
        beta, *_ = np.linalg.lstsq(X[~held], y[~held], rcond=None)
        rss = np.square(y[~held] - X[~held] @ beta).sum()
        nu = (~held).sum() - X.shape[1]
        spread = np.eye(held.sum()) + X[held] @ np.linalg.inv(X[~held].T @ X[~held]) @ X[held].T
        betas.append(beta / size)
        squares.append(np.square(y[held] - X[held] @ beta).sum())
        densities.append(
            stats.multivariate_t(X[held] @ beta, rss / nu * spread, nu).logpdf(y[held])
            if nu > 0
            else -np.inf
        )
    return np.array(betas), np.array(squares), np.array(densities)


@settings(max_examples=60)
@given(st.integers(0, 10**6), st.integers(1, 5), st.sampled_from([2, 5, 40]))
def test_exact_is_brute_force(seed, p, folds) -> None:
    """K-fold and leave-one-out, folds taller and shorter than the model is wide, of unequal height,
    badly scaled columns."""
    rng = np.random.default_rng(seed)
    X, y = rng.normal(size=(40, p)) * 10.0 ** rng.integers(-4, 5, p), rng.normal(size=40)
    fold_of = (
        rng.permutation(40) % folds
        if folds == 40
        else np.r_[np.arange(folds), rng.integers(0, folds, 40 - folds)]
    )
    assume(np.bincount(fold_of).max() < 40 - p)
    betas, squares, densities = brute(X, y, fold_of)
    found = cross_validate(parts_of(X, y, fold_of))
    size = np.linalg.norm(X, axis=0)
    np.testing.assert_allclose(
        found.without * size,
        betas * size,
        rtol=1e-10,
        atol=1e-10 * np.abs(betas * size).max(),
        err_msg=f"seed {seed}",
    )
    np.testing.assert_allclose(found.held_out, squares, rtol=1e-10)
    np.testing.assert_allclose(found.density, densities, rtol=1e-10, atol=1e-10)
    assert found.rms == pytest.approx(np.sqrt(squares.sum() / 40), rel=1e-10)


@pytest.mark.integration
def test_leave_one_out_density_is_the_studentised_residual(rng) -> None:
    """n_k = 1: t of the externally studentised residual (methods.md A.4), from statsmodels."""
    import statsmodels.api as sm

    X, y = rng.normal(size=(25, 3)), rng.normal(size=25)
    influence = sm.OLS(y, X).fit().get_influence()
    outside, leverage = influence.resid_studentized_external, influence.hat_matrix_diag
    spread = (
        influence.resid / (1 - leverage) / outside
    )  # scale of the t: left-out residual over the studentised
    want = stats.t.logpdf(outside, 21) - np.log(np.abs(spread))
    np.testing.assert_allclose(
        cross_validate(parts_of(X, y, np.arange(25))).density, want, rtol=1e-9
    )


def test_no_freedom_left_has_no_density(rng) -> None:
    """Six rows in two folds, three columns: the other fold fits exactly, its density is no
    density."""
    found = cross_validate(
        parts_of(rng.normal(size=(6, 3)), rng.normal(size=6), np.repeat([0, 1], 3))
    )
    assert np.isneginf(found.density).all()


@pytest.mark.parametrize("folds", [2, 5])
def test_a_parameter_that_rests_on_one_fold(folds, rng) -> None:
    X, y = rng.normal(size=(30, 3)), rng.normal(size=30)
    fold_of = np.arange(30) % folds
    X[fold_of != 1, 2] = 0
    with pytest.raises(
        NotEstimable, match=f"without fold 2 of {folds} the model is not estimable"
    ) as caught:
        cross_validate(parts_of(X, y, fold_of))
    assert caught.value.exit_code == 4
    assert cross_validate(parts_of(X, y, fold_of), kept=[0, 1]).held_out.shape == (folds,)


def test_dependent_columns_are_left_at_nought(rng) -> None:
    X, y = rng.normal(size=(30, 3)), rng.normal(size=30)
    twice = np.column_stack([X, 2 * X[:, 0], np.zeros(30)])
    fold_of = np.arange(30) % 5
    found, alone = (
        cross_validate(parts_of(twice, y, fold_of)),
        cross_validate(parts_of(X, y, fold_of)),
    )
    np.testing.assert_allclose(
        found.without, np.column_stack([alone.without, np.zeros((5, 2))]), atol=1e-12
    )
    np.testing.assert_allclose(found.held_out, alone.held_out, rtol=1e-11)


# -- problems
# -----------------------------------------------------------------------------------------------------------


@seeds(1, 2)
@pytest.mark.parametrize("folds", [5, 0], ids=["5-fold", "leave-one-out"])
def test_scene_against_refits(folds, rng) -> None:
    """Linear about the fit, a refit without every fold: the coefficients, and every row's held-out
    residual."""
    which = Model(
        tuple(mechanism(name, load_robot("puma760")) for name in ("geometric", "joint3-twist"))
    )
    at = drawn("puma760", rng, 40)
    at = planted(at, which.terms, rng.normal(size=len(which.terms)) * 1e-3, rng, 0.1)
    plain = fit(at, which, held="nothing")
    about = plain.at()
    fold_of = assign_folds(at.data, folds, rng)
    assert fold_of.max() + 1 == (folds or 40)
    kept = list(plain.found.kept)
    found = cross_validate(fold(at, which.terms, fold_of, about), kept)
    left = LinearRows(at, which.terms, about).held_out(fold_of, found.without)
    X, r = compute_design(at, which.terms, about)
    for k in range(fold_of.max() + 1):
        held = fold_of == k
        beta, *_ = np.linalg.lstsq(
            X[~held][:, :, kept].reshape(-1, len(kept)), r[~held].ravel(), rcond=None
        )
        size = np.linalg.norm(X[:, :, kept], axis=(0, 1))
        np.testing.assert_allclose(
            found.without[k, kept] * size,
            beta * size,
            rtol=1e-9,
            atol=1e-10 * np.abs(beta * size).max(),
        )
        np.testing.assert_allclose(left[held], r[held] - X[held][:, :, kept] @ beta, atol=1e-10)
        assert found.held_out[k] == pytest.approx(np.square(left[held]).sum(), rel=1e-9)
    assert np.array_equal(found.rows, 3 * np.bincount(fold_of))


@pytest.mark.parametrize("size", [3, 16])
def test_folds_stream(size, rng, monkeypatch) -> None:
    """Folds that many blocks of rows feed, with weights, are those of one block."""
    from dataclasses import replace

    from modelsel.fitting import reduction
    from modelsel.selection import cross_validation as folds

    which = Model((mechanism("geometric", load_robot("ur5")),))
    at = planted(drawn("ur5", rng, 60), which.terms, np.zeros(len(which.terms)), rng, 0.1)
    at = replace(at, whitening=Whitening(matrices=rng.uniform(0.5, 2, (60, 1, 1)) * np.eye(3)))
    fold_of = assign_folds(at.data, 4, rng)
    once = cross_validate(fold(at, which.terms, fold_of))
    monkeypatch.setattr(folds, "BLOCK", size)
    monkeypatch.setattr(reduction, "STREAM", size)
    again = cross_validate(fold(at, which.terms, fold_of))
    np.testing.assert_allclose(again.held_out, once.held_out, rtol=1e-10)
    np.testing.assert_allclose(again.density, once.density, rtol=1e-10)


# -- who is together
# --------------------------------------------------------------------------------------------------


def repeated(rng: np.random.Generator):
    """30 readings visited once or several times, apart in time, two targets a visit, in three
    groups."""
    q = (
        load_robot("ur5")
        .draw(rng, 30)[rng.permutation(np.r_[np.arange(30), rng.integers(0, 30, 20)])]
        .repeat(2, axis=0)
    )
    return build_measurements(
        q, rng.normal(size=(100, 3)), target=["a", "b"] * 50, group=np.arange(100) // 36
    )


@seeds(1, 2, 3)
@pytest.mark.parametrize("folds", [2, 7, 0])
def test_equal_readings_stay_together(folds, rng) -> None:
    data = repeated(rng)
    fold_of = assign_folds(data, folds, rng)
    key = np.round(data.q, 6)
    for reading in np.unique(key, axis=0):
        assert len(np.unique(fold_of[(key == reading).all(1)])) == 1
    count = np.bincount(fold_of)
    assert len(count) == (folds or 30)
    blocks = [len(np.unique(data.block[fold_of == k])) for k in range(len(count))]
    assert max(blocks) - min(blocks) <= 1  # folds of equal size in readings


def test_by_group(rng) -> None:
    data = repeated(rng)
    fold_of = assign_folds(data, 10, rng, by="group")
    assert len(np.unique(fold_of)) == 3
    assert all(len(np.unique(fold_of[data.group == g])) == 1 for g in range(3))


def test_folds_come_from_the_generator_alone(rng) -> None:
    data = repeated(rng)
    first, again, other = (assign_folds(data, 5, np.random.default_rng(seed)) for seed in (1, 1, 2))
    assert np.array_equal(first, again)
    assert not np.array_equal(first, other)
