"""Linear algebra that several folders share."""

from __future__ import annotations

import numpy as np
import pytest
from builders import seeds
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components as by_scipy

from modelsel._linalg import (
    connected_components,
    invert_factors,
    invert_root,
    orthonormalise,
    orthonormalise_in_place,
)


@seeds(1, 2)
@pytest.mark.parametrize("known", [True, False])  # another matrix's triangle: by Householder
def test_a_known_triangle_gives_the_orthonormal_basis(
    rng: np.random.Generator, known: bool
) -> None:
    """Columns nearly dependent and of sizes from mm to rad, against their span."""
    A = rng.normal(size=(300, 12))
    A[:, 1] = A[:, 0] + 1e-7 * A[:, 1]
    A *= 10.0 ** rng.uniform(-3, 3, 12)
    triangle = np.linalg.qr(A if known else rng.normal(size=(300, 12)), mode="r")
    Q, R = orthonormalise(A, triangle)
    assert np.abs(Q.T @ Q - np.eye(12)).max() < 1e-13
    np.testing.assert_allclose(Q @ R, A, rtol=1e-12, atol=1e-13 * np.abs(A).max())


def test_nothing_to_orthonormalise() -> None:
    Q, R = orthonormalise(np.zeros((5, 0)), np.zeros((0, 0)))
    assert Q.shape == (5, 0)
    assert R.shape == (0, 0)


@pytest.mark.parametrize("count", [0, 1, 12])
def test_columns_are_made_orthonormal_where_they_stand(rng, count) -> None:
    A = rng.normal(size=(300, count)) * 10.0 ** rng.uniform(-3, 3, count)
    Q = np.array(A, order="F")
    R = orthonormalise_in_place(Q)
    assert (np.tril(R, -1) == 0).all()
    np.testing.assert_allclose(Q.T @ Q, np.eye(count), atol=1e-13)
    np.testing.assert_allclose(Q @ R, A, rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize("edges", [0, 5, 60, 400])
def test_components_as_scipy_labels_them(rng, edges) -> None:
    count = 100
    pairs = rng.integers(0, count, (edges, 2))
    graph = coo_array((np.ones(edges), pairs.T), shape=(count, count))
    assert (connected_components(count, pairs) == by_scipy(graph, directed=False)[1]).all()


def test_a_chain_backwards_is_one_component() -> None:
    """The longest way from a node to the first of its component."""
    order = np.random.default_rng(1).permutation(20_000)
    label = connected_components(20_000, np.stack([order[:-1], order[1:]], 1))
    assert not label.any()
    assert connected_components(3, np.zeros((0, 2), np.intp)).tolist() == [0, 1, 2]


@seeds(3)
@pytest.mark.parametrize("size", [1, 2, 4, 6])
def test_factors_of_many_matrices_are_inverted_at_once(rng: np.random.Generator, size: int) -> None:
    X = rng.normal(size=(20, 9, size))
    gram = X.swapaxes(1, 2) @ X
    inverse = invert_factors(gram)
    np.testing.assert_allclose(inverse, np.linalg.inv(np.linalg.cholesky(gram)), atol=1e-12)
    gram[3] = 0.0  # nothing, and an indefinite one: these cannot pass for small numbers
    gram[4] = -gram[4]
    again = invert_factors(gram)
    size = np.square(again).sum((1, 2))
    assert not (size[3:5] < 1e10).any()
    assert np.array_equal(np.delete(again, [3, 4], 0), np.delete(inverse, [3, 4], 0))


def test_the_root_of_an_inverse_gives_the_inverse(rng) -> None:
    X = rng.normal(size=(40, 12)) * 10.0 ** rng.uniform(-3, 3, 12)
    matrix = X.T @ X
    root = invert_root(matrix)
    assert not np.triu(root, 1).any()
    unit = np.sqrt(np.diagonal(matrix))
    np.testing.assert_allclose(root.T @ root @ matrix * unit[:, None] / unit, np.eye(12), atol=1e-9)


def test_a_matrix_that_rounding_made_indefinite_has_a_root_yet(rng) -> None:
    turn = np.linalg.qr(rng.normal(size=(6, 6)))[0]
    values = np.array([3.0, 2.0, 1.0, 0.5, 0.1, -1e-17])
    root = invert_root(turn * values @ turn.T)
    assert not np.triu(root, 1).any()
    told = turn[:, :5].T @ root.T @ root @ turn[:, :5]
    np.testing.assert_allclose(told, np.diag(1 / values[:5]), atol=1e-6)
