"""Marginal likelihood of the whitened residuals: the coefficients β that are not sampled are
integrated out.

With normal noise of one scale s, residuals ρ of N measured coordinates and k of a prior, and Q an
orthonormal basis of the r columns of β,
    ln p = −(rows + k − r) ln s − |(I − QQᵀ) ρ|² / 2s²;
with several scales, ½ ln |Σ_t s_t⁻² Q_tᵀQ_t| stands in place of −r ln s (restricted likelihood;
Patterson & Thompson 1971). Under a Student-t per measured point the residual is minimised by
expectation-maximisation (Lange, Little & Taylor 1989), and the normal integral about the minimum is
taken (Laplace): the information of a row, w (1 − 2 w d² / (ν + c) c) in units of s⁻² with
w = (ν + c) / (ν + d²), is averaged over the rows."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from .._typing import Array, Index

# steps of expectation-maximisation; each leaves about 2/(ν + 5) of the distance to the minimum
EM_STEPS = 5
# least average information of a row, as a share of that under normal noise
MIN_INFORMATION = 0.05


@dataclass(frozen=True, eq=False)
class MarginalLikelihood:
    """Likelihood of residuals (W, N + k) of W walkers, N of the data and k of a prior.

    basis: (N + k, r) orthonormal basis Q, turned so that the data's part of QᵀQ is diagonal.
    share: (r,) that diagonal h; the rest of every direction is the prior's.
    component: (N,) noise component of every measured coordinate; the prior's rows have the first.
    grams: (T + 1, r, r) QᵀQ of the rows of each of the T components, and of the prior's.
    coordinates, configurations: c and m, N = c m where all is measured.
    by_prior: coefficients that a prior holds, added to the rows of the first component.
    """

    basis: Array = field(repr=False)
    share: Array = field(repr=False)
    component: Index = field(repr=False)
    grams: Array = field(repr=False)
    coordinates: int
    configurations: int
    by_prior: int

    @property
    def scales(self) -> int:
        """Number T of noise scales."""
        return len(self.grams) - 1

    def log_density(self, residual: Array, log_s: Array, nu: Array | None) -> Array:
        """Compute the log marginal likelihood (W,) up to a constant.

        residual: (W, N + k); log_s: (W, T) log scales; nu: (W,) degrees of freedom of the
        Student-t, None for normal noise."""
        inverse = self._inverse_scale(log_s, residual.shape[1])
        if nu is None:
            residual = self._minimise(residual, log_s, inverse, 1.0)
            scaled = residual * inverse
            curvature = np.ones(len(residual))
            density = self._scale_term(log_s) - self._prior_cost(scaled)
            density = density - 0.5 * np.square(scaled[:, : self._measured]).sum(1)
        else:
            residual, weight = self._minimise_student(residual, log_s, inverse, nu)
            scaled = residual * inverse
            distance = self._distance(scaled)
            curvature = self._student_curvature(weight, distance, nu)
            density = self._scale_term(log_s) - self._prior_cost(scaled)
            density = self._add_student(density, distance, nu)
        return self._add_laplace(density, log_s, curvature)

    @property
    def _measured(self) -> int:
        return len(self.component)

    def _inverse_scale(self, log_s: Array, rows: int) -> Array:
        """1/s of every row: (W, rows), or (W, 1) for one scale."""
        if self.scales == 1:
            return np.asarray(np.exp(-log_s))
        component = np.zeros(rows, dtype=np.intp)
        component[: self._measured] = self.component
        return np.asarray(np.exp(-log_s)[:, component])

    def _information(self, log_s: Array, curvature: Array | None = None) -> Array:
        """(W, r, r) information Σ_t s_t⁻² Q_tᵀQ_t about β; that of the data times the curvature
        (W,)."""
        precision = np.exp(-2 * log_s[:, [*range(self.scales), 0]])
        if curvature is not None:
            data = np.repeat(curvature[:, None], self.scales, 1)
            precision = np.concatenate([data, np.ones((len(data), 1))], 1) * precision
        return np.asarray(np.einsum("wt,tij->wij", precision, self.grams))

    def _minimise(
        self, residual: Array, log_s: Array, inverse: Array, weight: Array | float
    ) -> Array:
        """Minimise weighted residuals (W, N + k) over β: one step of weighted least squares.

        With equal scales and weights this is the projection (I − QQᵀ) ρ. Weights enter the gradient
        alone, which is a step of expectation-maximisation."""
        if self.scales == 1:
            projection = (weight * residual) @ self.basis
            return np.asarray(residual - projection @ self.basis.T)
        gradient = (weight * residual * inverse**2) @ self.basis
        information = self._information(log_s)
        step = np.linalg.solve(information, gradient[:, :, None])[:, :, 0]
        return np.asarray(residual - step @ self.basis.T)

    def _minimise_student(
        self, residual: Array, log_s: Array, inverse: Array, nu: Array
    ) -> tuple[Array, Array]:
        """Minimise residuals under a Student-t; returns them with the points' weights (W, m)."""
        weight: Array | float = 1.0
        for _ in range(1 + EM_STEPS):
            residual = self._minimise(residual, log_s, inverse, weight)
            distance = self._distance(residual * inverse)
            point_weight = (nu[:, None] + self.coordinates) / (nu[:, None] + distance)
            weight = np.ones_like(residual)
            weight[:, : self._measured] = np.tile(point_weight, (1, self.coordinates))
        return residual, point_weight

    def _distance(self, scaled: Array) -> Array:
        """Squared length d² (W, m) of every point's residual in units of the noise."""
        squares = np.square(scaled[:, : self._measured])
        return np.asarray(
            squares.reshape(len(scaled), self.coordinates, self.configurations).sum(1)
        )

    def _scale_term(self, log_s: Array) -> Array:
        """−Σ rows_t ln s_t (W,), the coefficients held by a prior counted with the first scale."""
        rows = np.bincount(self.component, minlength=self.scales)
        rows[0] += self.by_prior
        return np.asarray(-log_s @ rows)

    def _prior_cost(self, scaled: Array) -> Array:
        """Half the squared length (W,) of the prior's rows."""
        return np.asarray(0.5 * np.square(scaled[:, self._measured :]).sum(1))

    def _student_curvature(self, weight: Array, distance: Array, nu: Array) -> Array:
        """Average information (W,) of a row under the Student-t, of 1 under normal noise."""
        c = self.coordinates
        information = weight * (1 - 2 / c * weight * distance / (nu[:, None] + c))
        return np.asarray(information.mean(1).clip(MIN_INFORMATION))

    def _add_student(self, density: Array, distance: Array, nu: Array) -> Array:
        """Add ln of the multivariate t densities of all points to a log density (W,)."""
        from scipy.special import gammaln

        c = self.coordinates
        constant = gammaln((nu + c) / 2) - gammaln(nu / 2) - c / 2 * np.log(nu)
        kernel = np.log1p(distance / nu[:, None]).sum(1)
        return np.asarray(density + self.configurations * constant - (nu + c) / 2 * kernel)

    def _add_laplace(self, density: Array, log_s: Array, curvature: Array) -> Array:
        """Add the integral over β: −½ ln of the determinant of its information (W, r, r)."""
        if self.scales > 1:
            information = self._information(log_s, curvature)
            return np.asarray(density - 0.5 * np.linalg.slogdet(information)[1])
        h = self.share
        spread = len(h) * log_s[:, 0]
        return np.asarray(density + spread - 0.5 * np.log(h * curvature[:, None] + 1 - h).sum(1))
