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
        matrices = len(self.grams)
        return matrices - 1

    def log_density(self, residual: Array, log_s: Array, nu: Array | None) -> Array:
        """Compute the log marginal likelihood (W,) up to a constant.

        residual: (W, N + k); log_s: (W, T) log scales; nu: (W,) degrees of freedom of the
        Student-t, None for normal noise."""
        rows = residual.shape[1]
        inverse = self._inverse_scale(log_s, rows)
        density = self._scale_term(log_s)
        if nu is None:
            residual = self._minimise(residual, residual, log_s, inverse)
            curvature = np.ones(len(residual))
            scaled = residual * inverse
            density = density - 0.5 * np.einsum("wn,wn->w", scaled, scaled)
        else:
            residual, weight, distance = self._minimise_student(residual, log_s, inverse, nu)
            density = density - self._prior_cost(residual, inverse)
            curvature = self._student_curvature(weight, distance, nu)
            density = self._add_student(density, distance, nu)
        return self._add_laplace(density, log_s, curvature)

    @property
    def _measured(self) -> int:
        return len(self.component)

    def _inverse_scale(self, log_s: Array, rows: int) -> Array:
        """Compute 1/s of every row: (W, rows), or (W, 1) for one scale."""
        measured = self._measured
        inverse = np.exp(-log_s)
        if self.scales == 1:
            return np.asarray(inverse)
        component = np.zeros(rows, dtype=np.intp)
        own = self.component
        component[:measured] = own
        by_row = inverse[:, component]
        return np.asarray(by_row)

    def _information(self, log_s: Array, curvature: Array | None = None) -> Array:
        """Compute the information (W, r, r) Σ_t s_t⁻² Q_tᵀQ_t about β; that of the data times the
        curvature (W,)."""
        scales = self.scales
        component = [*range(scales), 0]
        log_scale = log_s[:, component]
        precision = np.exp(-2 * log_scale)
        if curvature is not None:
            data = np.repeat(curvature[:, None], scales, 1)
            prior = np.ones((len(data), 1))
            factor: Array = np.concatenate([data, prior], 1)
            precision = factor * precision
        information = np.einsum("wt,tij->wij", precision, self.grams)
        return np.asarray(information)

    def _minimise(self, residual: Array, weighted: Array, log_s: Array, inverse: Array) -> Array:
        """Minimise residuals (W, N + k) over β: one step of weighted least squares.

        weighted: the residuals times their weights. With equal scales and weights this is the
        projection (I − QQᵀ) ρ. Weights enter the gradient alone, which is a step of
        expectation-maximisation."""
        basis = self.basis
        transposed = basis.T
        if self.scales == 1:
            projection = weighted @ basis
            change = projection @ transposed
            return np.subtract(residual, change, out=change)
        precision = inverse**2
        gradient = (weighted * precision) @ basis
        gradient = gradient[:, :, None]
        information = self._information(log_s)
        step = np.linalg.solve(information, gradient)
        step = step[:, :, 0]
        change = step @ transposed
        least = residual - change
        return np.asarray(least)

    def _minimise_student(
        self, residual: Array, log_s: Array, inverse: Array, nu: Array
    ) -> tuple[Array, Array, Array]:
        """Minimise residuals under a Student-t; returns them with the points' weights and squared
        lengths (W, m)."""
        degrees = nu[:, None]
        numerator = degrees + self.coordinates
        residual = self._minimise(residual, residual, log_s, inverse)
        distance = self._distance(residual, inverse)
        for _ in range(EM_STEPS):
            weighted = residual.copy()
            by_point = self._by_point(weighted)
            by_point *= (numerator / (degrees + distance))[:, None]
            residual = self._minimise(residual, weighted, log_s, inverse)
            distance = self._distance(residual, inverse)
        return residual, numerator / (degrees + distance), distance

    def _by_point(self, residual: Array) -> Array:
        """View the data's part of residuals (W, N + k) as (W, c, m)."""
        data = residual[:, : self._measured]
        return data.reshape(len(residual), self.coordinates, self.configurations)

    def _distance(self, residual: Array, inverse: Array) -> Array:
        """Compute the squared length d² (W, m) of every point's residual in units of the noise."""
        if self.scales > 1:
            residual = residual * inverse
        by_point = self._by_point(residual)
        distance = np.einsum("wcm,wcm->wm", by_point, by_point)
        if self.scales == 1:
            distance *= inverse**2
        return np.asarray(distance)

    def _scale_term(self, log_s: Array) -> Array:
        """Compute −Σ rows_t ln s_t (W,), the coefficients held by a prior counted with the first
        scale."""
        component = self.component
        count = self.scales
        rows = np.bincount(component, minlength=count)
        rows[0] += self.by_prior
        term = -log_s @ rows
        return np.asarray(term)

    def _prior_cost(self, residual: Array, inverse: Array) -> Array:
        """Compute half the squared length (W,) of the prior's rows, in units of the noise."""
        measured = self._measured
        # one scale: a single column, of all rows
        scale = inverse if self.scales == 1 else inverse[:, measured:]
        prior = residual[:, measured:] * scale
        return np.asarray(0.5 * np.einsum("wk,wk->w", prior, prior))

    def _student_curvature(self, weight: Array, distance: Array, nu: Array) -> Array:
        """Compute the average information (W,) of a row under the Student-t, of 1 under normal
        noise."""
        c = self.coordinates
        degrees = nu[:, None] + c
        excess = 2 / c * weight
        excess = excess * distance
        excess = excess / degrees
        share = 1 - excess
        information = weight * share
        average = information.mean(1)
        average = average.clip(MIN_INFORMATION)
        return np.asarray(average)

    def _add_student(self, density: Array, distance: Array, nu: Array) -> Array:
        """Add ln of the multivariate t densities of all points to a log density (W,)."""
        from scipy.special import gammaln

        c = self.coordinates
        degrees = nu[:, None]
        power = (nu + c) / 2
        constant = gammaln(power)
        constant = constant - gammaln(nu / 2)
        constant = constant - c / 2 * np.log(nu)
        ratio = distance / degrees
        kernel = np.log1p(ratio)
        kernel = kernel.sum(1)
        constants = self.configurations * constant
        density = density + constants
        density = density - power * kernel
        return np.asarray(density)

    def _add_laplace(self, density: Array, log_s: Array, curvature: Array) -> Array:
        """Add the integral over β: −½ ln of the determinant of its information (W, r, r)."""
        if self.scales > 1:
            information = self._information(log_s, curvature)
            _, log_det = np.linalg.slogdet(information)
            half = 0.5 * log_det
            density = density - half
            return np.asarray(density)
        h = self.share
        integrated = len(h)
        log_scale = log_s[:, 0]
        spread = integrated * log_scale
        data = h * curvature[:, None]
        information = data + 1 - h
        log_information = np.log(information)
        log_det = log_information.sum(1)
        half = 0.5 * log_det
        density = density + spread
        density = density - half
        return np.asarray(density)
