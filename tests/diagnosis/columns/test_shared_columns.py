"""The columns of the search where rows share errors: those of the design written out, made
independent; and a search that does not know the order of the rows."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from builders import drawn, measured, seeds, small_arm
from scipy.linalg import orth

from modelsel._typing import Array
from modelsel.diagnosis.candidates.candidate import Candidate
from modelsel.diagnosis.candidates.candidate_list import build_candidates
from modelsel.diagnosis.candidates.options import DEFAULT_OPTIONS
from modelsel.diagnosis.columns.candidate_columns import Columns, build_columns, stack_design
from modelsel.diagnosis.inference.scan import build_scan, compute_basis
from modelsel.fitting.design import Model
from modelsel.fitting.least_squares import fit
from modelsel.fitting.problem import Problem
from modelsel.fitting.shared_errors import SharedError, SharedErrors
from modelsel.fitting.whitening import Whitening
from modelsel.mechanisms.registry import every, mechanism

ARM = small_arm()
BASE = Model((mechanism("geometric", ARM),))
M = 60


def visits(rng: np.random.Generator) -> tuple[SharedError, ...]:
    """Visits of one to three rows, anywhere in the file."""
    level = rng.permutation(np.repeat(np.arange(30), [1, 2, 3] * 10))
    return (
        SharedError(np.tile(np.eye(3), (M, 1, 1)), level, 0.6),
        SharedError(rng.normal(size=(M, 3, 1)), level, 1.5),
    )


def lasting(rng: np.random.Generator) -> tuple[SharedError, ...]:
    loading = np.tile(np.eye(3), (M, 1, 1))
    return (SharedError(loading, np.arange(M) // 24, 2.0, np.arange(M) * 1.0, 4.0),)


def sharing(rng: np.random.Generator, kind: object, stated: bool) -> Problem:
    at = drawn(ARM, rng, M)
    at = measured(at, at.data.position + rng.normal(0, 0.1, (M, 3)))
    matrices = np.eye(3) + 0.2 * rng.normal(size=(M, 3, 3)) if stated else None
    parts = kind(rng)  # type: ignore[operator]
    return replace(at, whitening=Whitening(2.0, matrices, SharedErrors(parts)))


@cache
def offer() -> tuple[Candidate, ...]:
    """Every candidate, for tests that ask nothing of the rows they are made for."""
    at = drawn(ARM, np.random.default_rng(1), M)
    return build_candidates(at, BASE, tuple(every(ARM)), True, DEFAULT_OPTIONS)


def searched(at: Problem) -> tuple[tuple[Candidate, ...], Columns]:
    return offer(), build_columns(at, offer(), fit(at, BASE).at())


def write_out(at: Problem, candidate: Candidate) -> Array:
    """The columns (3 m, k) of a candidate: those of the rows by themselves, then made independent."""
    alone = replace(at, whitening=at.whitening.by_row())
    X = stack_design(alone, candidate.mechanism.terms, fit(at, BASE).at())[0]
    columns = np.ascontiguousarray(X.T.reshape(-1, 3, len(at)))
    return at.whitening.mix(columns).reshape(len(columns), -1).T


@pytest.mark.slow
@pytest.mark.parametrize("kind", [visits, lasting])
@pytest.mark.parametrize("stated", [False, True])
@seeds(1, 2)
def test_products_grams_and_columns_are_those_written_out(
    rng: np.random.Generator, kind: object, stated: bool
) -> None:
    at = sharing(rng, kind, stated)
    found, columns = searched(at)
    V = rng.normal(size=(3 * M, 4))
    products = columns.dot(V)
    for g in rng.choice(len(found), 60, replace=False):
        X = write_out(at, found[g])
        size = np.abs(X).max()
        np.testing.assert_allclose(columns.expand(g).T, X, atol=1e-9 * size)
        np.testing.assert_allclose(products[columns.slices[g]], X.T @ V, atol=1e-9 * size * len(X))
        block, row = columns.home[g]
        gram = columns.grams[block].gram[row]
        np.testing.assert_allclose(gram, X.T @ X, atol=1e-9 * size**2 * len(X))


@pytest.mark.parametrize("kind", [visits, lasting])
@seeds(1, 2)
def test_products_at_one_place_are_those_of_the_columns(
    rng: np.random.Generator, kind: object
) -> None:
    at = sharing(rng, kind, stated=True)
    screws = searched(at)[1].screws
    field = rng.choice(screws.lone_field[screws.lone_field >= 0])
    some = np.flatnonzero(screws.lone_field == field)
    others = rng.choice(some, 3)
    products = screws.multiply(some, others)
    wanted = screws.expand(some) @ screws.expand(others).T
    np.testing.assert_allclose(products, wanted, atol=1e-11 * np.abs(wanted).max())


@pytest.mark.slow
@seeds(1, 2)
def test_the_scan_is_that_of_generalised_least_squares(rng: np.random.Generator) -> None:
    """What a candidate of free sign explains alone, beyond the base."""
    at = sharing(rng, visits, True)
    found, columns = searched(at)
    fitted = fit(at, BASE)
    X, y = stack_design(at, BASE.terms, fitted.at())
    kept = X[:, list(fitted.found.kept)]
    Q = orth(kept / np.linalg.norm(kept, axis=0), rcond=1e-9)
    rest = y - Q @ (Q.T @ y)
    scan = build_scan(columns, compute_basis(kept))
    strength = scan.strength(scan.see(rest).column)[0][:, 0]
    compared = 0
    for g in rng.choice(len(found), 60, replace=False):
        own = write_out(at, found[g])
        own = own / np.linalg.norm(own, axis=0)
        own -= Q @ (Q.T @ own)
        well = np.linalg.svd(own, compute_uv=False)[-1] > 1e-2
        if well and not columns.signs[g].any():
            explained = own @ np.linalg.lstsq(own, rest, rcond=None)[0]
            assert strength[g] == pytest.approx(explained @ explained, rel=1e-5)
            compared += 1
    assert compared > 20


@pytest.mark.parametrize("order", ["C", "F"])
@pytest.mark.parametrize("responses", [1, 4])
def test_what_columns_are_multiplied_with_stays(
    rng: np.random.Generator, responses: int, order: str
) -> None:
    _, columns = searched(sharing(rng, visits, False))
    values = np.array(rng.normal(size=(3 * M, responses)), order=order)
    before = values.copy()
    columns.dot(values)
    np.testing.assert_array_equal(values, before)


@seeds(1, 2)
def test_the_order_of_rows_changes_no_product(rng: np.random.Generator) -> None:
    """Rows of a visit are made independent in their order; what they are together stays."""
    at = sharing(rng, visits, True)
    order = rng.permutation(M)
    found, columns = searched(at)
    mixed = build_columns(at.take(order), found, fit(at, BASE).at())
    for one, other in zip(columns.grams, mixed.grams, strict=True):
        largest = np.abs(one.gram).max(axis=(1, 2), keepdims=True)
        # what depends on a clock moves nothing without one
        size = np.where(largest > 0, largest, 1.0)
        np.testing.assert_allclose(one.gram / size, other.gram / size, atol=1e-9)
