"""What emcee samples: the logarithm of a posterior density, vectorised over walkers.

Sampled: some coefficients ψ (those of the named effects, or all), the logarithm of every noise
scale, the tail 1/ν of a Student-t per measured point, the inner constants of scanned mechanisms.
Integrated out: all other coefficients β. At each point the exact chain is evaluated at (ψ, β*(ψ)),
β* the linear answer of β to ψ; what is left is minimised over β in the columns J_β at the optimum
(one projection, or expectation-maximisation under a Student-t: Lange, Little & Taylor 1989), and
the normal integral about that minimum is taken (Laplace; exact for normal noise up to the curvature
of the chain in β). Under a Student-t the information of a row, w (1 − 2 w d² / (ν + c) c) in units
of s⁻² with w = (ν + c) / (ν + d²), is averaged over the rows; with 12 coefficients integrated out
of 25 points, tails of ν < 4 come out up to 0.4 too unlikely in ln p, and the noise scale too sure
(89 % intervals for 95 %, benchmarks/calibration.py). With normal noise of one scale,
    ln p(ψ, s | y) = −(rows + k − r_β) ln s − |(I − QQᵀ) ρ(ψ, β*)|² / 2s²,   Q an orthonormal basis of J_β, k held by a prior,
and with several scales ½ ln |Σ_t s_t⁻² Q_tᵀQ_t| stands in place of −r_β ln s (restricted
likelihood; Patterson & Thompson 1971). Priors: flat on coefficients and constants, 1/s on every
scale (within a factor of 1,000), 1/ν uniform below ½. Shrunk coefficients keep their normal prior,
its variance held at the most probable one; those that a constant bears on have the scan's
(`conditional`). Constants of mechanisms of one name keep their order."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from .._typing import Array
from ..fitting.batch import Ensemble
from ..fitting.least_squares import Fit
from .conditional_priors import Conditional, conditionals
from .nuisance import Components, Constant
from .posterior import posterior

TAIL = "tail 1/ν"
HEAVIEST, LIGHTEST = 0.5, 1e-6
FARTHEST = np.log(1000)
# spread of the first walkers over the closed form's: walkers that start together cannot show that
# they differ
APART = 2.0
SCORING = 5  # steps of expectation-maximisation; each leaves about 2/(ν + 5) of the distance


@dataclass(frozen=True, eq=False)
class LogPosterior:
    """A density of d numbers: coefficients (term indices `sampled`), log scales, tail (if `tail`),
    constants; `exact` tells whether the chain is evaluated, or its QR-reduced linear form."""

    fitted: Fit
    noise: Components
    sampled: tuple[int, ...]
    names: tuple[str, ...]
    units: tuple[str, ...]
    tail: bool = False
    constants: tuple[Constant, ...] = ()
    exact: bool = True
    _split: tuple[int, int] = field(init=False, repr=False)

    def __post_init__(self) -> None:
        k = len(self.sampled)
        object.__setattr__(self, "_split", (k, k + self.noise.count))

    @property
    def size(self) -> int:
        """Number of sampled numbers."""
        return len(self.names)

    @cached_property
    def _integrated(self) -> list[int]:
        return [k for k in self.fitted.found.kept if k not in self.sampled]

    @cached_property
    def _ensemble(self) -> Ensemble:
        return Ensemble(self.noise.problem, self.fitted.terms)

    @cached_property
    def _tangent(self) -> tuple[Array, Array]:
        """(columns (N + k, p), what is left (N + k,)) at the optimum; the N data rows in the order
        (coordinate, configuration), then a row per shrunk coefficient."""
        from ..fitting.design import compute_design

        fitted = self.fitted
        X, left = compute_design(self.noise.problem, fitted.terms, fitted.at())
        return (
            np.vstack(
                [X.transpose(1, 0, 2).reshape(-1, len(fitted.theta))[self._rows], fitted.root]
            ),
            np.concatenate([left.T.reshape(-1)[self._rows], -fitted.root @ fitted.theta]),
        )

    @cached_property
    def _basis(self) -> tuple[Array, Array, Array]:
        """(Q (N + k, r_β) turned so that the data's part of QᵀQ is diagonal, that diagonal h
        (r_β,), response B (r_β, ψ) of β to ψ), with the rows of `_tangent`."""
        beta, psi = self._integrated, list(self.sampled)
        X, N = self._tangent[0], len(self._of)
        Q, R = np.linalg.qr(X[:, beta])
        B = np.linalg.solve(R, Q.T @ X[:, psi]) if beta else np.zeros((0, len(psi)))
        h = np.ones(len(beta))
        if len(X) > N and beta:
            h, V = np.linalg.eigh(Q[:N].T @ Q[:N])
            Q = Q @ V
        return Q, h.clip(0, 1), B

    @cached_property
    def _rows(self) -> NDArray[np.bool_] | slice:
        """Which of the rows (coordinate, configuration) are measured."""
        seen = self.noise.problem.measured
        return slice(None) if seen is None else seen.T.reshape(-1)

    @cached_property
    def _of(self) -> NDArray[np.intp]:
        """(N,) component of every measured row."""
        return np.repeat(self.noise.of, len(self.noise.problem))[self._rows]

    @cached_property
    def _grams(self) -> Array:
        """(T + 1, r_β, r_β) QᵀQ of each component's rows, and of the prior's."""
        Q, m = self._basis[0], len(self.noise.problem)
        N = len(self._of)
        if self.noise.problem.measured is not None:
            own = [Q[:N][self._of == t] for t in range(self.noise.count)]
            return np.stack([*(part.T @ part for part in own), Q[N:].T @ Q[N:]])
        part = Q[:N].reshape(len(self.noise.of), m, -1)
        return np.stack(
            [
                *(
                    np.einsum("cmi,cmj->ij", part[self.noise.of == t], part[self.noise.of == t])
                    for t in range(self.noise.count)
                ),
                Q[N:].T @ Q[N:],
            ]
        )

    @cached_property
    def _reduced(self) -> Array:
        """(ψ, ψ) triangle of the linear problem with β projected out; the prior's rows are in."""
        from ..fitting.reduction import Reduction

        reduction = self.fitted.reduction
        if self.fitted.prior is not None:
            reduction = Reduction(reduction.add(self.fitted.prior).R, reduction.rows)
        b = len(self._integrated)
        return reduction.select([*self._integrated, *self.sampled]).R[b:-1, b:-1]

    @cached_property
    def _conditionals(self) -> tuple[Conditional, ...]:
        """Of the constants that bear on a sampled coefficient."""
        return conditionals(
            self.noise.problem,
            self.fitted.at(),
            self.sampled,
            self.constants,
            self._basis[0],
            self._tangent,
            posterior(self.fitted).freedom,
        )

    @cached_property
    def _plain(self) -> list[int]:
        """Positions of the sampled coefficients that no constant bears on."""
        owned = {i for c in self._conditionals for i in c.own.tolist()}
        return [i for i in range(len(self.sampled)) if i not in owned]

    @cached_property
    def _units(self) -> tuple[Array, Array]:
        """(origin (d,), matrix (d, d)): walkers live in units of the closed form, in which the
        coefficients are uncorrelated; a snooker's lines have no meaning across millimetres and
        radians."""
        known, k = posterior(self.fitted), self._split[0]
        origin, matrix = np.zeros(self.size), np.eye(self.size)
        plain = self._plain
        index = [self.sampled[i] for i in plain]
        origin[plain] = known.theta[index]
        if plain:
            matrix[np.ix_(plain, plain)] = np.linalg.qr(known.factor[index].T)[1].T * known.scale
        scales = slice(*self._split)
        origin[scales] = np.log(known.scale)
        wide = [1 / np.sqrt(2 * known.freedom / self.noise.count)] * self.noise.count + [
            0.05
        ] * self.tail
        wide += [0.1 * (constant.high - constant.low) for constant in self.constants]
        matrix[range(k, self.size), range(k, self.size)] = wide
        return origin, matrix

    def natural(self, walkers: Array) -> Array:
        """(..., d) coefficients, log scales, tail, constants of walkers in their own units. The
        tail is folded at nought, so that normal noise is no wall to run against."""
        origin, matrix = self._units
        out = np.asarray(origin + walkers @ matrix.T)
        if self.tail:
            out[..., self._split[1]] = np.abs(out[..., self._split[1]])
        flat = out.reshape(-1, self.size)
        for c in self._conditionals:
            c.place(
                flat,
                self._values(flat, c.constant),
                origin[self._plain],
                posterior(self.fitted).scale,
            )
        return flat.reshape(out.shape)

    def _at(self, constant: Constant) -> int:
        """Position of a constant."""
        return self._split[1] + self.tail + [c is constant for c in self.constants].index(True)

    def _values(self, points: Array, constant: Constant) -> Array:
        return np.asarray(points[:, self._at(constant)])

    @cached_property
    def ranges(self) -> tuple[tuple[int, float, float], ...]:
        """(position, lowest, highest) of every constant, in the walkers' own units."""
        origin, matrix = self._units
        return tuple(
            (i, (c.low - origin[i]) / matrix[i, i], (c.high - origin[i]) / matrix[i, i])
            for c in self.constants
            for i in (self._at(c),)
        )

    def log_density(self, walkers: Array) -> Array:
        """(W,) up to a constant, at walkers (W, d) in their own units; −inf outside the priors."""
        points = self.natural(walkers)
        inside = (
            np.abs(points[:, slice(*self._split)] - np.log(posterior(self.fitted).scale)) < FARTHEST
        ).all(1)
        if self.tail:
            inside &= (points[:, self._split[1]] > LIGHTEST) & (
                points[:, self._split[1]] < HEAVIEST
            )
        for constant in self.constants:
            value = self._values(points, constant)
            inside &= (value > constant.low) & (value < constant.high)
            for other in self.constants:
                if other.mechanism == constant.mechanism and other.held < constant.held:
                    inside &= self._values(points, other) < value
        out = np.full(len(points), -np.inf)
        if inside.any():
            some = points[inside]
            out[inside] = self._exact(some) if self.exact else self._linear(some)
            for c in self._conditionals:
                out[inside] += c.log_prior(some, some[:, self._split[0]]) + c.log_volume(
                    self._values(some, c.constant)
                )
        return out

    def _linear(self, points: Array) -> Array:
        """Normal noise of one scale, linear about the optimum, on the QR-reduced data."""
        known = posterior(self.fitted)
        step = (
            points[:, : self._split[0]] - self.fitted.theta[list(self.sampled)]
        ) @ self._reduced.T
        log_s = points[:, self._split[0]]
        power = known.freedom + len(self.sampled)
        return np.asarray(
            -power * log_s - (known.cost + np.square(step).sum(1)) / 2 * np.exp(-2 * log_s)
        )

    def _theta(self, points: Array) -> Array:
        """(W, p) with β at its linear answer."""
        theta = np.tile(self.fitted.theta, (len(points), 1))
        step = points[:, : self._split[0]] - self.fitted.theta[list(self.sampled)]
        theta[:, list(self.sampled)] += step
        theta[:, self._integrated] -= step @ self._basis[2].T
        return theta

    def _exact(self, points: Array) -> Array:
        theta, W = self._theta(points), len(points)
        more: dict[tuple[int, int], Array] = {}
        for constant in self.constants:
            constant.twist(theta, self._values(points, constant), more)
        e = self._ensemble.residuals(theta, more).reshape(W, -1)[:, self._rows]
        e = np.hstack([e, -theta @ self.fitted.root.T])
        log_s = points[:, self._split[0] : self._split[1]]
        nu = 1 / points[:, self._split[1]] if self.tail else None
        return self._marginal(e, log_s, nu)

    def _marginal(self, e: Array, log_s: Array, nu: Array | None) -> Array:
        """β integrated out of residuals e (W, N + k) at log scales (W, T) and degrees of freedom
        (W,)."""
        noise, m, W = self.noise, len(self.noise.problem), len(e)
        c, N = len(noise.of), len(self._of)
        Q, h, _ = self._basis
        of = np.concatenate([self._of, np.zeros(e.shape[1] - N, dtype=np.intp)])
        inverse = np.exp(-log_s)[:, of] if noise.count > 1 else np.exp(-log_s)
        A = None
        if noise.count > 1:
            A = np.einsum(
                "wt,tij->wij", np.exp(-2 * log_s[:, [*range(noise.count), 0]]), self._grams
            )
        w: Array | float = 1.0
        for _ in range(1 if nu is None else 1 + SCORING):
            b = (w * e if A is None else w * e * inverse**2) @ Q
            e = e - (b if A is None else np.linalg.solve(A, b[:, :, None])[:, :, 0]) @ Q.T
            if nu is not None:
                distance = np.square((e * inverse)[:, :N]).reshape(W, c, m).sum(1)
                weight = (nu[:, None] + c) / (nu[:, None] + distance)
                w = np.ones_like(e)
                w[:, :N] = np.tile(weight, (1, c))
        rows = np.bincount(self._of, minlength=noise.count) + self.fitted.by_prior * (
            np.arange(noise.count) == 0
        )
        out = -log_s @ rows - 0.5 * np.square((e * inverse)[:, N:]).sum(1)
        curved = np.ones(W)
        if nu is None:
            out = out - 0.5 * np.square((e * inverse)[:, :N]).sum(1)
        else:
            from scipy.special import gammaln

            curved = (
                (weight * (1 - 2 / c * weight * distance / (nu[:, None] + c))).mean(1).clip(0.05)
            )
            out = (
                out
                + m * (gammaln((nu + c) / 2) - gammaln(nu / 2) - c / 2 * np.log(nu))
                - (nu + c) / 2 * np.log1p(distance / nu[:, None]).sum(1)
            )
        if A is None:
            return np.asarray(
                out + len(h) * log_s[:, 0] - 0.5 * np.log(h * curved[:, None] + 1 - h).sum(1)
            )
        share = np.concatenate([np.repeat(curved[:, None], noise.count, 1), np.ones((W, 1))], 1)
        A = np.einsum(
            "wt,tij->wij", share * np.exp(-2 * log_s[:, [*range(noise.count), 0]]), self._grams
        )
        return np.asarray(out - 0.5 * np.linalg.slogdet(A)[1])

    def start(self, rng: np.random.Generator, walkers: int) -> Array:
        """(walkers, d) more widely spread than the posterior: normal coefficients and log scales of
        APART times the closed form's spread, tails over all that are allowed, constants over their
        whole range."""
        out = APART * rng.standard_normal((walkers, self.size))
        if self.tail:
            out[:, self._split[1]] = (
                rng.uniform(LIGHTEST, HEAVIEST, walkers)
                / self._units[1][self._split[1], self._split[1]]
            )
        for i, low, high in self.ranges:
            out[:, i] = rng.uniform(low, high, walkers)
        for name in {c.mechanism for c in self.constants}:
            alike = sorted((c for c in self.constants if c.mechanism == name), key=lambda c: c.held)
            index = [self._at(c) for c in alike]
            out[:, index] = np.sort(out[:, index], axis=1)
        return out

    def values(self, walkers: Array) -> Array:
        """Walkers (..., d) in the units of the report: scales not as logarithms."""
        out = self.natural(walkers)
        scales = slice(*self._split)
        out[..., scales] = np.exp(out[..., scales]) * self.noise.factor
        return out

    def closed_form(self, probability: Sequence[float]) -> Array:
        """(d, k) quantiles of the closed form; NaN where there is none."""
        known = posterior(self.fitted)
        p = np.array(probability)
        out = np.full((self.size, len(p)), np.nan)
        out[: self._split[0]] = known.quantile(p)[list(self.sampled)]
        if self.noise.count == 1:
            out[self._split[0]] = known.scale_quantile(p) * self.noise.factor[0]
        return out
