"""The statistic of new data against a calibration: T = rᵀ V⁻¹ r, V = noise + parameters' covariance
of all rows together; a set-up that may have moved is projected out."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from .._linalg import orthonormal_basis, project_out
from .._typing import Array


@dataclass(frozen=True)
class ResidualTest:
    """The statistic T = rᵀ V⁻¹ r of whitened residuals, its degrees of freedom, and the sum of squares
    of the residuals that V makes expected."""

    T: float
    count: int
    expected: float

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


def compute_chi2_p(count: int, value: Any) -> Any:
    """Compute the probability that a χ² of `count` degrees of freedom goes beyond a value."""
    from scipy.special import chdtrc

    return chdtrc(count, value)


def compute_ratio_p(count: int, freedom: float, ratio: float) -> float:
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
    inner = np.eye(W.shape[1]) + W.T @ W
    solution = np.linalg.solve(inner, projection)
    explained = projection @ solution
    statistic = float(r @ r - explained)
    count = len(r) - basis.shape[1]
    by_parameters = float(np.square(W).sum())
    return ResidualTest(statistic, count, count + by_parameters)


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
