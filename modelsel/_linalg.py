"""Linear algebra that several folders share, with one policy on tolerances.

Columns are compared after scaling to unit length, so that a tolerance has no unit. A direction
counts when its singular value exceeds `RANK_TOLERANCE`: far above rounding in double precision
(2e-16 times a condition number of about 1e4), far below anything a measurement can resolve.
`TINY` only keeps a quotient of norms finite; it never decides anything.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from ._typing import Array, Index

RANK_TOLERANCE = 1e-9
TINY = 1e-300
# how far QᵀQ may be from the identity for one step of Cholesky to make it so to rounding
NEARLY_ORTHONORMAL = 1e-3
# values that are multiplied row by row together
TOGETHER = 16


def unit_columns(matrix: Array) -> Array:
    """Scale every column of a matrix (m, p) to unit length; zero columns stay zero."""
    norms = np.linalg.norm(matrix, axis=0)
    length = np.maximum(norms, TINY)
    unit: Array = matrix / length
    return unit


def orthonormal_basis(matrix: Array) -> Array:
    """Compute an orthonormal basis (m, r) of the span of a matrix's columns (m, p), r its rank."""
    unit = unit_columns(matrix)
    decomposition = np.linalg.svd(unit, full_matrices=False)
    U, singular, _ = decomposition
    counts = singular > RANK_TOLERANCE
    basis: Array = U[:, counts]
    return basis


def orthonormalise(matrix: Array, triangle: Array) -> tuple[Array, Array]:
    """Compute Q (m, r) and R (r, r), matrix = Q R, from a triangle that is known to rounding.

    The triangle comes from an earlier reduction of the same rows: Q = A R⁻¹ is orthonormal but for
    rounding times its condition number, and once more by Cholesky of QᵀQ (Yamamoto, Nakatsukasa,
    Yanagisawa & Fukaya 2015, ETNA 44, 306). Where it is another matrix's triangle, by Householder."""
    from scipy.linalg import solve_triangular

    nearly = solve_triangular(triangle, matrix.T, trans="T", check_finite=False).T
    gram = nearly.T @ nearly
    if not np.abs(gram - np.eye(len(gram))).max(initial=0) < NEARLY_ORTHONORMAL:
        return np.linalg.qr(matrix)
    lower = np.linalg.cholesky(gram)
    Q = solve_triangular(lower, nearly.T, lower=True, check_finite=False).T
    return np.ascontiguousarray(Q), lower.T @ triangle


def orthonormalise_in_place(matrix: Array) -> Array:
    """Put Q (m, k), m >= k, in the place of a matrix = Q R; returns the upper triangle R (k, k).

    The matrix is contiguous by columns ("F"): LAPACK works in it, and nothing is copied."""
    from scipy.linalg.lapack import dgeqrf, dgeqrf_lwork, dorgqr

    count = matrix.shape[1]
    if not count:
        return np.zeros((0, 0))
    size, _ = dgeqrf_lwork(*matrix.shape)
    room = int(size)
    _, scales, _, _ = dgeqrf(matrix, lwork=room, overwrite_a=1)
    triangle = np.triu(matrix[:count])
    dorgqr(matrix, scales, lwork=room, overwrite_a=1)
    return triangle


def invert_factors(matrices: Array) -> Array:
    """Invert the lower Cholesky factors of many small matrices (n, k, k), number by number.

    Where a matrix is not positive definite, what is returned is large or not a number."""
    count = matrices.shape[1]
    rest = matrices.transpose(1, 2, 0).copy()
    inverse = np.zeros_like(rest)
    with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
        for j in range(count):
            # the row of L⁻¹, from what is left of the matrix beyond the columns before
            inverse[j, j] = 1.0
            for i in range(j):
                inverse[j] -= rest[i, j] * inverse[i]
            inverse[j] /= np.sqrt(rest[j, j])
            rest[j] /= np.sqrt(rest[j, j])
            rest[j + 1 :, j + 1 :] -= rest[j, j + 1 :, None] * rest[j, None, j + 1 :]
    return np.ascontiguousarray(inverse.transpose(2, 0, 1))


def invert_root(matrix: Array) -> Array:
    """Compute the lower triangle W (n, n) with WᵀW the inverse of a positive definite matrix (n, n).

    By Cholesky, at a quarter of the cost of the inverse; where rounding made the matrix indefinite,
    by its eigenvalues, none of which counts for less than rounding."""
    try:
        lower = np.asarray(np.linalg.cholesky(matrix), dtype=np.float64)
    except np.linalg.LinAlgError:
        values, vectors = np.linalg.eigh(matrix)
        least = np.finfo(float).eps * values[-1]
        rows = vectors.T * np.sqrt(np.maximum(values, least))[:, None]
        triangle: Array = np.asarray(np.linalg.qr(rows, mode="r"))
        lower = triangle.T
    return invert_triangle(lower)


def invert_triangle(lower: Array) -> Array:
    """Invert a lower triangle (n, n)."""
    from scipy.linalg.lapack import dtrtri

    inverse, _ = dtrtri(lower.T, lower=0)
    return np.asarray(inverse.T)


def project_out(matrix: Array, basis: Array) -> Array:
    """Remove from every column of a matrix (m, p) its part in an orthonormal basis (m, r)."""
    share = basis.T @ matrix
    inside: Array = basis @ share
    return matrix - inside


def multiply_by_row(matrices: Array, values: Array) -> Array:
    """Multiply values (..., c, m) row by row by matrices (m, d, c): (..., d, m).

    In the order of a sum by einsum, to the same bits, on a few values at a time that stay in cache."""
    *leading, c, m = values.shape
    d = matrices.shape[1]
    count = math.prod(leading)
    flat = values.reshape(count, c, m)
    factors = np.ascontiguousarray(matrices.transpose(1, 2, 0))
    out = np.empty((count, d, m))
    for start in range(0, count, TOGETHER):
        own = flat[start : start + TOGETHER]
        total = out[start : start + TOGETHER]
        np.multiply(own[:, None, 0], factors[:, 0], out=total)
        for k in range(1, c):
            total += own[:, None, k] * factors[:, k]
    return out.reshape(*leading, d, m)


def connected_components(count: int, pairs: NDArray[np.intp]) -> Index:
    """Label (count,) the connected components of a graph whose edges are pairs (e, 2) of nodes, in the
    order of their first nodes.

    Every node points to a smaller one of its component, in the end to the smallest. Ours, because
    scipy's takes longer to import than any of our graphs takes."""
    first, second = np.asarray(pairs, dtype=np.intp).reshape(-1, 2).T
    root = np.arange(count)
    while True:
        smaller = np.minimum(root[first], root[second])
        if (smaller == root[first]).all() and (smaller == root[second]).all():
            break
        np.minimum.at(root, root[first], smaller)
        np.minimum.at(root, root[second], smaller)
        while (root[root] != root).any():
            root = root[root]
    _, label = np.unique(root, return_inverse=True)
    return np.asarray(label, dtype=np.intp)
