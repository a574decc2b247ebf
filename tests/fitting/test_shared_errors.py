"""Errors that rows share: what makes rows independent, against the covariance written out."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from builders import drawn, measured, seeds

from modelsel._typing import Array
from modelsel.fitting.design import Model, compute_design
from modelsel.fitting.gradient import Rows
from modelsel.fitting.least_squares import fit
from modelsel.fitting.linearisation import Linearisation
from modelsel.fitting.problem import Problem
from modelsel.fitting.shared_errors import (
    MAX_BLOCK,
    MOST_ROWS,
    Layout,
    SharedError,
    SharedErrors,
    keep_within,
    list_blocks,
    mix,
)
from modelsel.fitting.whitening import Whitening
from modelsel.mechanisms.registry import mechanism
from modelsel.robot.files import load_robot

ARM = load_robot("puma760")
GEOMETRY = Model((mechanism("geometric", ARM),))
M, C = 45, 3


def visits(rng: np.random.Generator) -> list[SharedError]:
    """Visits of one to four rows, in any order, one number of each moving them."""
    level = rng.permutation(np.repeat(np.arange(19), [1, 2, 4] * 6 + [3]))
    return [SharedError(rng.normal(size=(M, C, 1)), level, 0.8)]


def repeats(rng: np.random.Generator) -> list[SharedError]:
    """Visits within postures that are visited again, and a joint a visit."""
    visit = np.arange(M) // 3
    loading = np.tile(np.eye(3), (M, 1, 1))
    return [
        SharedError(loading, visit, 0.5),
        SharedError(loading, visit % 5, 0.3),
        SharedError(rng.normal(size=(M, C, 1)), visit, 2.0),
    ]


def groups(rng: np.random.Generator) -> list[SharedError]:
    """Groups and visits that reach from one group into another: crossed, one block of all."""
    loading = np.tile(np.eye(3), (M, 1, 1))
    return [
        SharedError(loading, rng.integers(0, 4, M), 0.4),
        SharedError(rng.normal(size=(M, C, 1)), np.arange(M) // 2, 0.9),
    ]


def lasting(rng: np.random.Generator) -> list[SharedError]:
    """What lasts within stretches, at times of no equal steps, beside visits that end with them."""
    loading = np.tile(np.eye(3), (M, 1, 1))
    time = np.cumsum(rng.uniform(0.2, 2, M))
    return [
        SharedError(loading, np.arange(M) // 20, 1.3, time, 2.5),
        SharedError(rng.normal(size=(M, C, 1)), np.arange(M) // 2, 0.6),
    ]


KINDS = [visits, repeats, groups, lasting]
Kind = Callable[[np.random.Generator], list[SharedError]]


def spread_of(parts: list[SharedError]) -> Array:
    """The covariance (m·c, m·c) of all rows, one draw after the other; where something lasts, rows of
    two stretches share nothing."""
    stretch = next((part.level for part in parts if part.time is not None), np.zeros(M, int))
    near = stretch[:, None] == stretch[None]
    total = np.eye(M * C)
    for part in parts:
        alike = (part.level[:, None] == part.level[None]).astype(float) * near
        if part.time is not None:
            alike *= np.exp(-np.abs(np.subtract.outer(part.time, part.time)) / part.length)
        for d in range(part.loading.shape[2]):
            own = part.loading[:, :, d].reshape(-1)
            total += part.variance * np.outer(own, own) * np.kron(alike, np.ones((C, C)))
    return total


def by_row(values: Array) -> Array:
    """Values (..., c, m) as (..., m·c)."""
    return np.swapaxes(values, -1, -2).reshape(*values.shape[:-2], -1)


def operator(parts: list[SharedError]) -> Array:
    """What `apply` does, as a matrix (m·c, m·c)."""
    unit = np.eye(M * C).reshape(M * C, M, C).swapaxes(1, 2).copy()
    return by_row(mix(keep_within(parts)).apply(unit)).T


@pytest.mark.parametrize("kind", KINDS)
@seeds(1, 2)
def test_mixed_rows_are_independent(rng: np.random.Generator, kind: Kind) -> None:
    parts = kind(rng)
    L = operator(parts)
    np.testing.assert_allclose(L @ spread_of(parts) @ L.T, np.eye(M * C), atol=1e-10)


@pytest.mark.parametrize("kind", KINDS)
@seeds(1, 2)
def test_the_transpose_is_adjoint(rng: np.random.Generator, kind: Kind) -> None:
    mixing = mix(keep_within(kind(rng)))
    one, other = rng.normal(size=(2, 4, C, M))
    left = np.einsum("kcm,kcm->k", mixing.apply(one.copy()), other)
    right = np.einsum("kcm,kcm->k", one, mixing.apply_transposed(other.copy()))
    np.testing.assert_allclose(left, right, rtol=1e-11)


@pytest.mark.parametrize("kind", KINDS)
def test_a_part_multiplies_by_its_covariance(rng: np.random.Generator, kind: Kind) -> None:
    for part in keep_within(kind(rng)):
        values = rng.normal(size=(M, C, 2))
        expected = (spread_of([replace(part, variance=1.0)]) - np.eye(M * C)) @ values.reshape(
            -1, 2
        )
        np.testing.assert_allclose(part.multiply(values).reshape(-1, 2), expected, atol=1e-10)
        both = np.vdot(values.reshape(-1, 2), expected)
        np.testing.assert_allclose(part.measure(values), both, rtol=1e-10)


@pytest.mark.parametrize("kind", KINDS)
def test_rows_are_multiplied_by_the_inverse_of_their_covariance(
    rng: np.random.Generator, kind: Kind
) -> None:
    parts = kind(rng)
    values = rng.normal(size=(M, C, 2))
    expected = np.linalg.solve(spread_of(parts), values.reshape(-1, 2))
    kept = keep_within(parts)
    inverse = Layout.of(kept).invert([part.variance for part in kept])
    np.testing.assert_allclose(inverse.multiply(values).reshape(-1, 2), expected, atol=1e-10)
    log_determinant = np.linalg.slogdet(spread_of(parts))[1]
    assert inverse.log_determinant == pytest.approx(log_determinant, rel=1e-10)


@pytest.mark.parametrize("kind", [visits, repeats, groups])
@seeds(1, 2)
def test_some_rows_are_as_if_there_were_no_others(rng: np.random.Generator, kind: Kind) -> None:
    """What is taken has the covariance of these rows, whatever the others share with them."""
    parts = kind(rng)
    rows = np.sort(rng.choice(M, 20, replace=False))
    numbers = (rows[:, None] * C + np.arange(C)).reshape(-1)
    taken = SharedErrors(tuple(parts)).take(rows)
    unit = np.eye(20 * C).reshape(20 * C, 20, C).swapaxes(1, 2).copy()
    L = by_row(taken.mixing.apply(unit)).T
    own = spread_of(parts)[np.ix_(numbers, numbers)]
    np.testing.assert_allclose(L @ own @ L.T, np.eye(20 * C), atol=1e-10)
    built = tuple(
        SharedError(part.loading[rows], part.level[rows], part.variance) for part in parts
    )
    values = rng.normal(size=(C, 20))
    np.testing.assert_array_equal(
        taken.mixing.apply(values.copy()), SharedErrors(built).mixing.apply(values.copy())
    )


@pytest.mark.parametrize("kind", KINDS)
def test_no_values_are_made_independent(rng: np.random.Generator, kind: Kind) -> None:
    """A model without terms has no columns."""
    mixing = mix(keep_within(kind(rng)))
    nothing = np.zeros((0, C, M))
    assert mixing.apply(nothing.copy()).shape == nothing.shape
    assert mixing.apply_transposed(nothing.copy()).shape == nothing.shape


def test_blocks_join_rows_that_share_by_others() -> None:
    level = np.array([0, 0, 1, 1, 2, 3])
    other = np.array([0, 1, 1, 2, 3, 4])
    ones = np.ones((6, 1, 1))
    blocks = list_blocks([SharedError(ones, level), SharedError(ones, other)])
    assert [rows.tolist() for rows in blocks] == [[[4], [5]], [[0, 1, 2, 3]]]


def test_blocks_of_more_than_a_hundred_rows_are_inverted_too() -> None:
    rng = np.random.default_rng(3)
    level = np.zeros(MAX_BLOCK, np.intp)
    part = SharedError(rng.normal(size=(MAX_BLOCK, 1, 1)), level, 5.0)
    own = part.loading[:, 0, 0]
    values = mix([part]).apply(own[None, None].copy())
    # bᵀ(I + v b bᵀ)⁻¹b, by Sherman and Morrison
    assert np.square(values).sum() == pytest.approx(own @ own / (1 + 5.0 * own @ own))


def test_no_block_that_parts_join_is_larger_than_is_bounded() -> None:
    """Rounds in which all postures are measured again, two targets a visit."""
    rows, postures = 2 * MOST_ROWS + 40, 60
    visit = np.arange(rows) // 2
    loading = np.ones((rows, 1, 1))
    parts = [SharedError(loading, visit, 0.5), SharedError(loading, visit % postures, 0.5)]
    assert len(list_blocks(parts)[-1][0]) < MOST_ROWS
    crossed = [*parts, SharedError(loading, np.arange(rows) // 50, 0.5)]
    assert len(list_blocks(crossed)[-1][0]) == rows
    blocks = list_blocks(keep_within(crossed))
    assert max(len(own[0]) for own in blocks) == MOST_ROWS
    assert sorted(np.concatenate([own.ravel() for own in blocks])) == list(range(rows))
    for part, kept in zip(crossed, keep_within(crossed), strict=True):
        # rows share a draw as before, within a stretch
        near = np.subtract.outer(np.arange(rows) // MOST_ROWS, np.arange(rows) // MOST_ROWS) == 0
        same = (part.level[:, None] == part.level[None]) & near
        np.testing.assert_array_equal(kept.level[:, None] == kept.level[None], same)


# -- problems whose rows share errors


def sharing(rng: np.random.Generator, stated: bool = False) -> Problem:
    """Postures measured three times, their rows weighed by matrices where stated."""
    at = drawn(ARM, rng, M // 3)
    at = replace(at, data=at.data.take(np.tile(np.arange(M // 3), 3)))
    at = measured(at, at.data.position + rng.normal(0, 0.1, (M, 3)))
    matrices = np.eye(3) + 0.2 * rng.normal(size=(M, 3, 3)) if stated else None
    loading = np.tile(np.eye(3), (M, 1, 1))
    parts = (
        SharedError(loading, np.tile(np.arange(M // 3), 3), 0.5),
        SharedError(rng.normal(size=(M, C, 1)), np.arange(M) // 3, 2.0),
    )
    return replace(at, whitening=Whitening(3.0, matrices, SharedErrors(parts)))


@pytest.mark.parametrize("stated", [False, True])
@seeds(1, 2)
def test_cost_and_slope_are_those_of_generalised_least_squares(
    rng: np.random.Generator, stated: bool
) -> None:
    at = sharing(rng, stated)
    rows = Rows(at, GEOMETRY.terms)
    theta = rng.normal(0, 1e-4, len(GEOMETRY.terms))
    plain = replace(at, whitening=Whitening())
    X, residual = compute_design(plain, GEOMETRY.terms, Linearisation(GEOMETRY.terms, theta))
    W = 3.0 * np.eye(M * C)
    if stated:
        for i, matrix in enumerate(at.whitening.matrices):
            W[i * C : (i + 1) * C, i * C : (i + 1) * C] = 3.0 * matrix
    inside = W.T @ np.linalg.solve(spread_of(list(at.whitening.shared.parts)), W)
    y = residual.reshape(-1)
    slope = rows.at(theta)
    assert slope.squares == pytest.approx(y @ inside @ y, rel=1e-9)
    expected = X.reshape(M * C, -1).T @ inside @ y
    np.testing.assert_allclose(slope.products, expected, rtol=1e-7, atol=1e-7 * abs(expected).max())


@seeds(1, 2)
def test_slope_is_that_of_finite_differences(rng: np.random.Generator) -> None:
    at = sharing(rng)
    rows = Rows(at, GEOMETRY.terms)
    theta = rng.normal(0, 1e-4, len(GEOMETRY.terms))
    products = rows.at(theta).products
    for k in rng.choice(len(theta), 8, replace=False):
        step = np.zeros(len(theta))
        step[k] = 1e-6 if GEOMETRY.terms[k].unit != "mm" else 1e-3
        change = rows.at(theta + step).squares - rows.at(theta - step).squares
        expected = -2 * products[k]
        assert change / (2 * step[k]) == pytest.approx(expected, rel=1e-4, abs=1e-3)


@seeds(1, 2)
def test_the_order_of_rows_changes_nothing(rng: np.random.Generator) -> None:
    at = sharing(rng, stated=True)
    order = rng.permutation(M)
    one, other = fit(at, GEOMETRY), fit(at.take(order), GEOMETRY)
    assert other.rss == pytest.approx(one.rss, rel=1e-9)
    np.testing.assert_allclose(other.theta, one.theta, rtol=1e-6, atol=1e-9)
    assert at.take(order).whitening.shared is not None
