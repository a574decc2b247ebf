"""Coefficients that a sampled constant bears on: their prior, and what they are at every value of
the constant.

At some values such coefficients cannot be estimated at all: a step before the first configuration
moves nothing. Flat priors would make their posterior improper there, so they get the normal prior
of the scan (`why.evidence`): covariance v · S⁻¹, S the information about them beyond all other
coefficients, here averaged over the constant's range; v/s² as the data find it most probable, over
the same ratios. Given the constant, the coefficients are normal up to the chain's curvature;
walkers live in units of that distribution, so that a walker may change the constant alone and take
its coefficients with it."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from .._typing import Array, Index
from ..diagnosis.evidence import RATIOS
from ..fitting.design import compute_design
from ..fitting.linearisation import Linearisation
from ..fitting.problem import Problem
from ..mechanisms.terms import Screw, Term
from ..robot.rigid import AXES
from .nuisance import GRID, Constant

POINTS = 20_000  # walkers that are worked out together


@dataclass(frozen=True, eq=False)
class Conditional:
    """For one constant: `own` (k,) and `other` (o,) positions among the sampled coefficients. At
    GRID values over its range: `mean` (GRID, k) of the own where the others are at the optimum,
    minus `slope` (GRID, k, o) per unit of those; `root` (GRID, k, k) upper root of their covariance
    in units of the noise. `prior` (k, k): prior · own ~ N(0, 1) times the noise; `ratio`: the
    prior's variance over that of the estimate at a typical value."""

    constant: Constant
    own: Index
    other: Index
    mean: Array = field(repr=False)
    slope: Array = field(repr=False)
    root: Array = field(repr=False)
    prior: Array = field(repr=False)
    ratio: float

    def place(self, points: Array, value: Array, origin: Array, scale: float) -> None:
        """Turn the own coefficients of points (W, d), in place, from their own units into natural
        ones; the others (from `origin` (o,)) and the constant's values (W,) are natural already."""
        for start in range(0, len(points), POINTS):
            part = slice(start, start + POINTS)
            below, share = self.constant.between(value[part])
            mean, slope, root = (
                table[below] * (1 - w) + table[below + 1] * w
                for table, w in (
                    (self.mean, share[:, None]),
                    (self.slope, share[:, None, None]),
                    (self.root, share[:, None, None]),
                )
            )
            there = points[part]
            there[:, self.own] = (
                mean
                - np.einsum("wko,wo->wk", slope, there[:, self.other] - origin)
                + scale * np.einsum("wkl,wl->wk", root, there[:, self.own])
            )

    @cached_property
    def _diagonal(self) -> Array:
        return np.diagonal(self.root, 0, 1, 2)

    def log_volume(self, value: Array) -> Array:
        """(W,) logarithm of the determinant of that change of units, up to a constant."""
        below, share = self.constant.between(value)
        diagonal = (
            self._diagonal[below] * (1 - share[:, None])
            + self._diagonal[below + 1] * share[:, None]
        )
        return np.asarray(np.log(diagonal).sum(1))

    def log_prior(self, points: Array, log_scale: Array) -> Array:
        """(W,) of the own coefficients of natural points (W, d), up to a constant."""
        cost = np.square(points[:, self.own] @ self.prior.T).sum(1)
        return np.asarray(-len(self.own) * log_scale - 0.5 * cost * np.exp(-2 * log_scale))


def conditionals(
    problem: Problem,
    at: Linearisation,
    sampled: Sequence[int],
    constants: Sequence[Constant],
    Q: Array,
    tangent: tuple[Array, Array],
    freedom: float,
) -> tuple[Conditional, ...]:
    """What each constant makes of the sampled coefficients it bears on. `Q` (N, r): basis of the
    coefficients that are integrated out; `tangent`: all columns (N, p) and what the optimum `at`
    leaves (N,), with the rows of a prior below the data's; `freedom` of that fit."""

    def beyond(values: Array) -> Array:
        return np.asarray(values - Q @ (Q.T @ values))

    X, left = tangent
    place = {k: i for i, k in enumerate(sampled)}
    owns = [sorted({place[k] for _, k, _ in c.tables if k in place}) for c in constants]
    theirs = {i for own in owns for i in own}
    plain = [i for i in range(len(sampled)) if i not in theirs]
    out = []
    for constant, own in zip(constants, owns, strict=True):
        if not own:
            continue
        rest = [i for i in range(len(sampled)) if i not in own]
        index = [sampled[i] for i in own]
        before = beyond(X[:, index])
        response = beyond(left) + before @ at.theta[index]
        grid = np.stack(
            [
                before + beyond(change)
                for change in _changes(problem, at, constant, index, X.shape[0])
            ]
        )
        others = beyond(X[:, [sampled[i] for i in rest]])
        prior, ratio = _prior(
            np.concatenate([grid, before[None]]),
            response,
            np.linalg.qr(others)[0] if rest else others,
            freedom + len(own),
        )
        gram = np.einsum("gnk,gnl->gkl", grid, grid) + prior.T @ prior
        mean = np.linalg.solve(gram, (response @ grid)[:, :, None])[:, :, 0]
        known = beyond(X[:, [sampled[i] for i in plain]])
        slope = np.linalg.solve(gram, grid.transpose(0, 2, 1) @ known)
        root = np.linalg.inv(np.linalg.cholesky(gram)).transpose(0, 2, 1)
        out.append(
            Conditional(
                constant,
                np.array(own, dtype=np.intp),
                np.array(plain, dtype=np.intp),
                mean,
                slope,
                root,
                prior,
                ratio,
            )
        )
    return tuple(out)


def _changes(
    problem: Problem,
    at: Linearisation,
    constant: Constant,
    index: Sequence[int],
    rows: int,
) -> Iterator[Array]:
    """At every grid point, how the columns (rows, k) of the terms `index` depart from the
    model's."""
    places = sorted({place for place, k, _ in constant.tables if k in index})
    terms = [Term(AXES[axis], (Screw(frame + 1, AXES[axis]),)) for frame, axis in places]
    unit = compute_design(problem, terms, at)[0].transpose(2, 1, 0)  # (places, c, m)
    for n in range(GRID):
        out = np.zeros((rows, len(index)))
        for place, k, table in constant.tables:
            if k in index:
                product = (unit[places.index(place)] * table[n]).reshape(-1)
                column = problem.select_measured(product)
                out[: len(column), index.index(k)] += column
        yield out


def _prior(grid: Array, response: Array, others: Array, freedom: float) -> tuple[Array, float]:
    """(upper root (k, k) of the prior's precision in units of the noise, ratio v/s²) from the
    columns (G, N, k) at all values of the constant, beyond the basis of the other coefficients
    `others` (N, o): the ratio at which the evidence, summed over the values, is greatest."""
    alone = grid - others @ (others.T @ grid)
    rest = response - others @ (others.T @ response)
    gram = np.einsum("gnk,gnl->gkl", alone, alone)
    cross, total = rest @ alone, float(rest @ rest)
    typical, best = gram.mean(0), (-np.inf, 0.0)
    for ratio in map(float, RATIOS):
        precision = typical / ratio
        explained = np.einsum(
            "gk,gk->g", cross, np.linalg.solve(gram + precision, cross[:, :, None])[:, :, 0]
        )
        each = 0.5 * (np.linalg.slogdet(precision)[1] - np.linalg.slogdet(gram + precision)[1])
        each -= 0.5 * freedom * np.log1p(-np.minimum(explained / total, 1 - 1e-12))
        best = max(best, (float(np.logaddexp.reduce(each)), ratio))
    return np.linalg.cholesky(typical / best[1]).T, best[1]
