"""Log density of the posterior that emcee samples, vectorised over walkers.

Sampled: some coefficients ψ (those of the named effects, or all), the logarithm of every noise
scale, the tail 1/ν of a Student-t per measured point, the inner constants of scanned mechanisms.
Integrated out: all other coefficients β. At each point the exact chain is evaluated at (ψ, β*(ψ)),
β* the linear answer of β to ψ; what is left is minimised over β in the columns J_β at the optimum,
and the integral about that minimum is taken (`marginal_likelihood`; exact for normal noise up to
the curvature of the chain in β). With 12 coefficients integrated out of 25 points, tails of ν < 4
come out up to 0.4 too unlikely in ln p, and the noise scale too certain (89 % intervals for 95 %,
benchmarks/calibration.py).

Priors: flat on coefficients and constants, 1/s on every scale (within a factor of 1,000), 1/ν
uniform below ½. Shrunk coefficients keep their normal prior, its variance held at the most probable
one; those that a constant affects have the scan's (`conditional_priors`). Constants of mechanisms
of one name keep their order."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from .._typing import Array, Index, Mask
from ..fitting.batch import Ensemble
from ..fitting.design import compute_design
from ..fitting.least_squares import Fit
from ..fitting.reduction import Reduction
from .conditional_priors import ConditionalPrior, build_conditionals
from .marginal_likelihood import MarginalLikelihood
from .nuisance import Components, Constant
from .posterior import Posterior, linear_posterior

TAIL = "tail 1/ν"
# range of the tail 1/ν
MIN_TAIL, MAX_TAIL = 1e-6, 0.5
# largest departure of a log scale from the closed form's
MAX_LOG_RATIO = np.log(1000)
# spread of the first walkers over the closed form's: walkers that start together cannot show that
# they differ
START_SPREAD = 2.0
# spread of the tail, and of a constant as a share of its range, that is one in walkers' units
TAIL_SPREAD, CONSTANT_SPREAD = 0.05, 0.1


@dataclass(frozen=True, eq=False)
class LogPosterior:
    """Log posterior density of d numbers: coefficients, log scales, tail (if `tail`), constants.

    Walkers live in units of the closed form (`natural` converts them).

    fitted: the model at its optimum.
    noise: components of the noise, T scales.
    sampled: term indices of the sampled coefficients.
    names, units: of the d numbers.
    tail: whether points have Student-t noise.
    constants: inner constants that are sampled.
    exact: whether the chain is evaluated, or its QR-reduced linear form.
    """

    fitted: Fit
    noise: Components
    sampled: tuple[int, ...]
    names: tuple[str, ...]
    units: tuple[str, ...]
    tail: bool = False
    constants: tuple[Constant, ...] = ()
    exact: bool = True

    @property
    def size(self) -> int:
        """Number d of sampled numbers."""
        return len(self.names)

    # -- layout of the d numbers

    @cached_property
    def _scales(self) -> slice:
        """Positions of the log scales."""
        first = len(self.sampled)
        scales = self.noise.count
        stop = first + scales
        return slice(first, stop)

    @property
    def _tail(self) -> int:
        """Position of the tail, where there is one."""
        coefficients = len(self.sampled)
        scales = self.noise.count
        return coefficients + scales

    def _position(self, constant: Constant) -> int:
        """Return the position of a constant."""
        order = [c is constant for c in self.constants].index(True)
        return self._tail + self.tail + order

    def _values(self, points: Array, constant: Constant) -> Array:
        """Return the values (W,) of a constant at natural points (W, d)."""
        position = self._position(constant)
        return np.asarray(points[:, position])

    # -- the linear problem at the optimum

    @cached_property
    def _known(self) -> Posterior:
        """The posterior in closed form."""
        return linear_posterior(self.fitted)

    @cached_property
    def _integrated(self) -> list[int]:
        """Term indices of the coefficients β that are integrated out."""
        return [k for k in self.fitted.found.kept if k not in self.sampled]

    @cached_property
    def _ensemble(self) -> Ensemble:
        problem = self.noise.problem
        terms = self.fitted.terms
        return Ensemble(problem, terms)

    @cached_property
    def _rows(self) -> Mask | slice:
        """Which of the rows (coordinate, configuration) are measured."""
        measured = self.noise.problem.measured
        if measured is None:
            return slice(None)
        by_coordinate = measured.T
        return by_coordinate.reshape(-1)

    @cached_property
    def _component(self) -> Index:
        """(N,) noise component of every measured row."""
        return np.repeat(self.noise.component, len(self.noise.problem))[self._rows]

    @cached_property
    def _tangent(self) -> tuple[Array, Array]:
        """Columns (N + k, p) and residual (N + k,) at the optimum: the N data rows in the order
        (coordinate, configuration), then a row per shrunk coefficient."""
        fitted = self.fitted
        X, residual = compute_design(self.noise.problem, fitted.terms, fitted.at())
        columns = X.transpose(1, 0, 2).reshape(-1, len(fitted.theta))[self._rows]
        response = residual.T.reshape(-1)[self._rows]
        return (
            np.vstack([columns, fitted.root]),
            np.concatenate([response, -fitted.root @ fitted.theta]),
        )

    @cached_property
    def _basis(self) -> tuple[Array, Array, Array]:
        """Basis Q (N + k, r) of β's columns, turned so that the data's part of QᵀQ is diagonal; that
        diagonal h (r,); and the response B (r, ψ) of β to ψ."""
        beta, psi = self._integrated, list(self.sampled)
        X = self._tangent[0]
        N = len(self._component)
        Q, R = np.linalg.qr(X[:, beta])
        if not beta:
            return Q, np.ones(0), np.zeros((0, len(psi)))
        B = np.linalg.solve(R, Q.T @ X[:, psi])
        h = np.ones(len(beta))
        if len(X) > N:
            h, V = np.linalg.eigh(Q[:N].T @ Q[:N])
            Q = Q @ V
        return Q, h.clip(0, 1), B

    @cached_property
    def _grams(self) -> Array:
        """(T + 1, r, r) QᵀQ of each component's rows, and of the prior's."""
        Q = self._basis[0]
        N = len(self._component)
        prior = Q[N:].T @ Q[N:]
        if self.noise.problem.measured is not None:
            parts = [Q[:N][self._component == t] for t in range(self.noise.count)]
            return np.stack([*(part.T @ part for part in parts), prior])
        by_coordinate = Q[:N].reshape(len(self.noise.component), len(self.noise.problem), -1)
        parts = [by_coordinate[self.noise.component == t] for t in range(self.noise.count)]
        return np.stack([*(np.einsum("cmi,cmj->ij", part, part) for part in parts), prior])

    @cached_property
    def _likelihood(self) -> MarginalLikelihood:
        Q, h, _ = self._basis
        return MarginalLikelihood(
            Q,
            h,
            self._component,
            self._grams,
            len(self.noise.component),
            len(self.noise.problem),
            self.fitted.by_prior,
        )

    @cached_property
    def _reduced(self) -> Array:
        """(ψ, ψ) triangle of the linear problem with β projected out, the prior's rows included."""
        fitted = self.fitted
        reduction = fitted.reduction
        prior = fitted.prior
        if prior is not None:
            joined = reduction.add(prior)
            reduction = Reduction(joined.R, reduction.rows)
        integrated = self._integrated
        count = len(integrated)
        order = [*integrated, *self.sampled]
        selected = reduction.select(order)
        R = selected.R
        return R[count:-1, count:-1]

    @cached_property
    def _conditionals(self) -> tuple[ConditionalPrior, ...]:
        """Of the constants that affect a sampled coefficient: where there are none, no basis of very
        many rows is made."""
        if not self.constants:
            return ()
        return build_conditionals(
            self.noise.problem,
            self.fitted.at(),
            self.sampled,
            self.constants,
            self._basis[0],
            self._tangent,
            self._known.freedom,
        )

    @cached_property
    def _plain(self) -> list[int]:
        """Positions of the sampled coefficients that no constant affects."""
        affected = {i for c in self._conditionals for i in c.affected.tolist()}
        return [i for i in range(len(self.sampled)) if i not in affected]

    # -- units of the walkers

    @cached_property
    def _units(self) -> tuple[Array, Array]:
        """Origin (d,) and matrix (d, d): walkers live in units of the closed form, in which the
        coefficients are uncorrelated; the lines of the snooker have no meaning across millimetres
        and radians."""
        known, plain = self._known, self._plain
        index = [self.sampled[i] for i in plain]
        origin = np.zeros(self.size)
        origin[plain] = known.theta[index]
        origin[self._scales] = np.log(known.scale)
        spread = np.ones(self.size)
        spread[self._scales] = 1 / np.sqrt(2 * known.freedom / self.noise.count)
        if self.tail:
            spread[self._tail] = TAIL_SPREAD
        for constant in self.constants:
            width = constant.high - constant.low
            spread[self._position(constant)] = CONSTANT_SPREAD * width
        matrix = np.diag(spread)
        if plain:
            root = np.linalg.qr(known.factor[index].T)[1].T
            matrix[np.ix_(plain, plain)] = root * known.scale
        return origin, matrix

    def natural(self, walkers: Array) -> Array:
        """Convert walkers (..., d) from their own units to coefficients, log scales, tail and
        constants.

        The tail is folded at zero, so that normal noise is no wall to run against."""
        origin, matrix = self._units
        points = np.asarray(origin + walkers @ matrix.T)
        if self.tail:
            points[..., self._tail] = np.abs(points[..., self._tail])
        flat = points.reshape(-1, self.size)
        for conditional in self._conditionals:
            value = self._values(flat, conditional.constant)
            conditional.place(flat, value, origin[self._plain], self._known.scale)
        return flat.reshape(points.shape)

    @cached_property
    def ranges(self) -> tuple[tuple[int, float, float], ...]:
        """(position, lowest, highest) of every constant, in the walkers' own units."""
        origin, matrix = self._units
        ranges = []
        for constant in self.constants:
            i = self._position(constant)
            low, high = (np.array([constant.low, constant.high]) - origin[i]) / matrix[i, i]
            ranges.append((i, low, high))
        return tuple(ranges)

    # -- the density

    def log_density(self, walkers: Array) -> Array:
        """Compute the log density (W,) up to a constant at walkers (W, d) in their own units; −inf
        outside the priors."""
        every = self.natural(walkers)
        inside = self._inside(every)
        count = len(every)
        density = np.full(count, -np.inf)
        if not inside.any():
            return density
        points = every[inside]
        if self.exact:
            density[inside] = self._exact(points)
        else:
            density[inside] = self._linear(points)
        log_scale = points[:, self._scales.start]
        for conditional in self._conditionals:
            value = self._values(points, conditional.constant)
            prior = conditional.log_prior(points, log_scale)
            volume = conditional.log_volume(value)
            density[inside] += prior + volume
        return density

    def _inside(self, points: Array) -> Mask:
        """Mask (W,) of natural points (W, d) within the priors' bounds."""
        departure = points[:, self._scales] - np.log(self._known.scale)
        inside = (np.abs(departure) < MAX_LOG_RATIO).all(1)
        if self.tail:
            tail = points[:, self._tail]
            inside &= (tail > MIN_TAIL) & (tail < MAX_TAIL)
        for constant in self.constants:
            value = self._values(points, constant)
            inside &= (value > constant.low) & (value < constant.high)
            for other in self.constants:
                if other.mechanism == constant.mechanism and other.held < constant.held:
                    inside &= self._values(points, other) < value
        return np.asarray(inside)

    def _step(self, points: Array) -> Array:
        """Compute the departure (W, ψ) of the sampled coefficients from the optimum."""
        sampled = list(self.sampled)
        count = len(sampled)
        coefficients = points[:, :count]
        optimum = self.fitted.theta[sampled]
        return np.asarray(coefficients - optimum)

    def _linear(self, points: Array) -> Array:
        """Compute the log density of normal noise of one scale, linear about the optimum, on the
        QR-reduced data."""
        step = self._step(points) @ self._reduced.T
        log_s = points[:, self._scales.start]
        power = self._known.freedom + len(self.sampled)
        cost = self._known.cost + np.square(step).sum(1)
        return np.asarray(-power * log_s - cost / 2 * np.exp(-2 * log_s))

    def _exact(self, points: Array) -> Array:
        """Compute the log density on the exact chain."""
        theta = self._theta(points)
        twist: dict[tuple[int, int], Array] = {}
        for constant in self.constants:
            constant.add_twist(theta, self._values(points, constant), twist)
        residual = self._ensemble.residuals(theta, twist)
        data = residual.reshape(len(points), -1)[:, self._rows]
        prior = -theta @ self.fitted.root.T
        nu = 1 / points[:, self._tail] if self.tail else None
        log_s = points[:, self._scales]
        return self._likelihood.log_density(np.hstack([data, prior]), log_s, nu)

    def _theta(self, points: Array) -> Array:
        """Compute the coefficients (W, p), with β at its linear answer to ψ."""
        count = len(points)
        sampled = list(self.sampled)
        integrated = self._integrated
        _, _, response = self._basis
        optimum = self.fitted.theta
        theta = np.tile(optimum, (count, 1))
        step = self._step(points)
        theta[:, sampled] += step
        theta[:, integrated] -= step @ response.T
        return theta

    # -- start and results

    def start(self, rng: np.random.Generator, walkers: int) -> Array:
        """Draw the first walkers (walkers, d), more widely spread than the posterior.

        Coefficients and log scales are normal with START_SPREAD times the closed form's spread;
        tails and constants are uniform over their range."""
        first = START_SPREAD * rng.standard_normal((walkers, self.size))
        if self.tail:
            unit = self._units[1][self._tail, self._tail]
            first[:, self._tail] = rng.uniform(MIN_TAIL, MAX_TAIL, walkers) / unit
        for i, low, high in self.ranges:
            first[:, i] = rng.uniform(low, high, walkers)
        for mechanism in {c.mechanism for c in self.constants}:
            alike = [c for c in self.constants if c.mechanism == mechanism]
            alike.sort(key=lambda c: c.held)
            index = [self._position(c) for c in alike]
            first[:, index] = np.sort(first[:, index], axis=1)
        return first

    def values(self, walkers: Array) -> Array:
        """Convert walkers (..., d) to the units of the report: scales not as logarithms."""
        positions = self._scales
        values = self.natural(walkers)
        log_scales = values[..., positions]
        scales = np.exp(log_scales)
        scales = scales * self.noise.factor
        values[..., positions] = scales
        return values

    def closed_form(self, probability: Sequence[float]) -> Array:
        """Compute quantiles (d, k) of the closed form; NaN where there is none."""
        p = np.array(probability)
        quantiles = np.full((self.size, len(p)), np.nan)
        quantiles[: len(self.sampled)] = self._known.quantile(p)[list(self.sampled)]
        if self.noise.count == 1:
            scale = self._known.scale_quantile(p)
            quantiles[self._scales.start] = scale * self.noise.factor[0]
        return quantiles
