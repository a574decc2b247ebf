"""Linear algebra that several folders share, with one policy on tolerances.

Columns are compared after scaling to unit length, so that a tolerance has no unit. A direction
counts when its singular value exceeds `RANK_TOLERANCE`: far above rounding in double precision
(2e-16 times a condition number of about 1e4), far below anything a measurement can resolve.
`TINY` only keeps a quotient of norms finite; it never decides anything.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ._typing import Array, Index

RANK_TOLERANCE = 1e-9
TINY = 1e-300


def unit_columns(matrix: Array) -> Array:
    """Scale every column of a matrix (m, p) to unit length; zero columns stay zero."""
    return np.asarray(matrix / np.maximum(np.linalg.norm(matrix, axis=0), TINY))


def orthonormal_basis(matrix: Array) -> Array:
    """Orthonormal basis (m, r) of the span of a matrix's columns (m, p), r its rank."""
    U, singular, _ = np.linalg.svd(unit_columns(matrix), full_matrices=False)
    return np.asarray(U[:, singular > RANK_TOLERANCE])


def project_out(matrix: Array, basis: Array) -> Array:
    """Remove from every column of a matrix (m, p) its part in an orthonormal basis (m, r)."""
    return np.asarray(matrix - basis @ (basis.T @ matrix))


def connected_components(count: int, pairs: NDArray[np.intp]) -> Index:
    """Label (count,) the connected components of a graph whose edges are pairs (e, 2) of nodes."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components as components

    ends = np.asarray(pairs, dtype=np.intp).reshape(-1, 2)
    graph = coo_array((np.ones(len(ends)), (ends[:, 0], ends[:, 1])), shape=(count, count))
    return np.asarray(components(graph, directed=False)[1], dtype=np.intp)
