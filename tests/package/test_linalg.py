"""Linear algebra that several folders share."""

from __future__ import annotations

import numpy as np
import pytest
from builders import seeds

from modelsel._linalg import orthonormalise


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
