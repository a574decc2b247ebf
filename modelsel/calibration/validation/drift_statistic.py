"""The statistic of new data against a calibration: T = rᵀ V⁻¹ r, V = noise + parameters' covariance
of all rows together; a set-up that may have moved is projected out."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from ..._linalg import orthonormal_basis, project_out
from ..._typing import Array


@dataclass(frozen=True)
class ResidualTest:
    """The statistic T = rᵀ V⁻¹ r of whitened residuals and its degrees of freedom; the sum of squares
    rᵀ r of the residuals, what V makes expected of it, and its variance."""

    T: float
    count: int
    squares: float
    expected: float
    variance: float

    @property
    def factor(self) -> float:
        """Errors over those expected."""
        variance = self.T / self.count
        ratio = np.sqrt(variance)
        return float(ratio)

    def p(self, freedom: float) -> float:
        """Return the probability of a larger T under no change: χ², or F where the noise has a
        finite `freedom`."""
        count = self.count
        if not np.isfinite(freedom):
            p = compute_chi2_p(count, self.T)
            return float(p)
        ratio = self.T / count
        return compute_ratio_p(count, freedom, ratio)

    def size_p(self, freedom: float) -> float:
        """Return the probability of a larger rᵀ r under no change, approximately (Satterthwaite
        1946): errors in the few directions that the parameters leave open are a small part of T."""
        count = 2 * self.expected**2 / self.variance
        ratio = self.squares / self.expected
        if not np.isfinite(freedom):
            p = compute_chi2_p(count, ratio * count)
            return float(p)
        return compute_ratio_p(count, freedom, ratio)

    def least_p(self, freedom: float) -> float:
        """Return the p of both tests: that of T, or of the size where this is far less probable,
        doubled for the choice."""
        of_size = 2 * self.size_p(freedom)
        return min(self.p(freedom), of_size)


def compute_chi2_p(count: float, value: Any) -> Any:
    """Compute the probability that a χ² of `count` degrees of freedom goes beyond a value."""
    from scipy.special import chdtrc

    return chdtrc(count, value)


def compute_ratio_p(count: float, freedom: float, ratio: float) -> float:
    """Compute the probability that the F of `count` and `freedom` degrees goes beyond a ratio."""
    from scipy.special import fdtrc

    return float(fdtrc(count, freedom, ratio))


def compute_statistic(residual: Array, spread: Array, free: Array) -> ResidualTest:
    """Test residuals (m, 3) in units of the noise, with parameters' factors `spread` (m, 3, r) and
    `free` columns (m, 3, k) projected out."""
    r = residual.ravel()
    W = spread.reshape(residual.size, -1)
    columns = free.reshape(residual.size, free.shape[2])
    basis = orthonormal_basis(columns)
    r = project_out(r, basis)
    W = project_out(W, basis)
    projection = W.T @ r
    # Woodbury: V⁻¹ = I − W (I + WᵀW)⁻¹ Wᵀ
    products = W.T @ W
    inner = np.eye(W.shape[1]) + products
    solution = np.linalg.solve(inner, projection)
    explained = projection @ solution
    squares = float(r @ r)
    count = len(r) - basis.shape[1]
    by_parameters = float(np.trace(products))
    # traces of V and of V², V = I + W Wᵀ where the free set-up is projected out
    expected = count + by_parameters
    of_square = expected + by_parameters + float(np.square(products).sum())
    statistic = float(squares - explained)
    return ResidualTest(statistic, count, squares, expected, 2 * of_square)


def standardise_residual(residual: Array, spread: Array, sigma: float) -> Array:
    """Return lengths (m,) of residuals (m, 3) in standard deviations of each row."""
    noise = sigma**2 * np.eye(3)
    parameters = np.einsum("mcr,mdr->mcd", spread, spread)
    covariance = noise + parameters
    factor = np.linalg.cholesky(covariance)
    columns = residual[:, :, None]
    whitened = np.linalg.solve(factor, columns)
    lengths = np.linalg.norm(whitened[:, :, 0], axis=1)
    return np.asarray(lengths)
