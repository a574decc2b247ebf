"""The best subset of many groups by BIC, with a certificate: branch and bound, for more groups than
all subsets can be walked.

Beyond the base, with every group's columns made orthonormal, A their Gram, b their products with
the response and D ≤ A a part of it that is diagonal by groups, every subset S of coefficients β
obeys, for any u (the convex part lies above its tangent),
    βᵀAβ − 2bᵀβ + Σ_{g in S} w_g  ≥  −uᵀ(A − D)u − Σ_g max(0, |c_g|²/D_g − w_g),    c = b − (A − D)u,
the perspective relaxation of l0 regression (Xie & Deng 2020; Hazimeh, Mazumder & Saab 2022). At u
the least squares of a subset whose effects are clear, both sides are equal: mostly the first node
is the proof. ln RSS is concave, so it lies above its chord over the values that could still beat
the best known, and w_g is what BIC charges for the group in units of that chord. With a known σ BIC
is linear in RSS, and its slope 1/σ² takes the chord's place."""

from __future__ import annotations

import heapq
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from .._typing import Array
from ..fitting.reduction import Reduction, independent
from .criteria import bic

MAX_NODES = 2000  # of the tree, each a fraction of a millisecond to a few
TANGENTS = 80  # points u that are tried at each
ROUNDING = 1e-9
Mask = NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class Certified:
    """The best subset found: members (G,), its BIC, how much less any other could have (`gap`:
    nought where it is proven the best), how many nodes that took."""

    members: Mask
    bic: float
    gap: float
    nodes: int

    @property
    def proven(self) -> bool:
        """Whether no subset has a lower BIC."""
        return self.gap == 0.0


@dataclass(frozen=True, eq=False)
class _Bounding:
    """Orthonormal columns of the groups beyond the base: Gram A (p, p), products b (p,), |y|²
    there, the group of a column."""

    A: Array
    b: Array
    square: float
    of: NDArray[np.intp]
    groups: int
    rank: int
    rows: int
    sigma: float | None
    known: dict[bytes, float] = field(default_factory=dict)

    def columns(self, members: Mask) -> NDArray[np.intp]:
        """Columns of some groups."""
        return np.flatnonzero(members[self.of])

    def rss(self, members: Mask) -> float:
        """Residual sum of squares of a subset."""
        at = self.columns(members)
        return max(
            self.square - float(self.b[at] @ self.solve(at)), np.finfo(float).eps * self.square
        )

    def solve(self, at: NDArray[np.intp]) -> Array:
        """Least squares of some columns; what depends on others is left to these."""
        value, vector = np.linalg.eigh(self.A[np.ix_(at, at)])
        good = value > ROUNDING
        return np.asarray(vector[:, good] @ ((vector[:, good].T @ self.b[at]) / value[good]))

    def price(self, members: Mask) -> float:
        """What BIC charges for a subset's columns beyond the base."""
        return float(len(self.columns(members)) * np.log(self.rows))

    def value(self, members: Mask) -> float:
        """BIC of a subset, its columns counted; remembered."""
        key = members.tobytes()
        if key not in self.known:
            self.known[key] = float(
                bic(
                    self.rss(members), self.rows, self.rank + len(self.columns(members)), self.sigma
                )
            )
        return self.known[key]


def _problem(
    total: Reduction, base: Sequence[int], groups: Sequence[Sequence[int]], sigma: float | None
) -> _Bounding:
    """Beyond the base; a group's columns that its other columns or the base span are left out, and
    a group that moves the target as an earlier one does is left to that."""
    b = len(base)
    rest = [c for g in groups for c in g]
    R = total.select([*base, *rest]).R
    size = np.linalg.norm(R, axis=0)
    inner = R[b:, b:]
    bases: list[Array] = []
    of: list[int] = []
    start = 0
    for g, columns in enumerate(groups):
        X = inner[:, start : start + len(columns)] / np.maximum(
            size[b + start : b + start + len(columns)], 1e-300
        )
        start += len(columns)
        X = X[:, np.linalg.norm(X, axis=0) > 1e-8]
        kept, norm = independent(X)
        Q = np.linalg.qr(X[:, kept] / norm[kept])[0] if kept else X[:, :0]
        alike = [own for own in bases if own.shape == Q.shape and Q.size]
        twin = any(np.linalg.svd(own.T @ Q, compute_uv=False).min() > 1 - ROUNDING for own in alike)
        bases.append(Q[:, :0] if twin else Q)
        of += [g] * bases[-1].shape[1]
    Q, y = np.concatenate([*bases, np.zeros((len(inner), 0))], axis=1), inner[:, -1]
    return _Bounding(
        Q.T @ Q,
        Q.T @ y,
        float(y @ y),
        np.array(of, dtype=np.intp),
        len(groups),
        b,
        total.rows,
        sigma,
    )


def _stepwise(problem: _Bounding, members: Mask) -> Mask:
    """A subset that no group added, dropped or exchanged makes better, from a given one (splicing;
    Zhu et al. 2020)."""
    real = np.flatnonzero(np.bincount(problem.of, minlength=problem.groups)).tolist()
    while True:
        trials = [_flipped(members, [g]) for g in real]
        best = min(trials, key=problem.value, default=members)
        if problem.value(best) >= problem.value(members):
            inside, outside = [g for g in real if members[g]], [g for g in real if not members[g]]
            best = min(
                (_flipped(members, [g, h]) for g in inside for h in outside),
                key=problem.value,
                default=members,
            )
        if problem.value(best) >= problem.value(members) - ROUNDING:
            return members
        members = best


def _flipped(members: Mask, which: Sequence[int]) -> Mask:
    out = members.copy()
    out[which] = ~out[which]
    return out


def _diagonal(A: Array, of: NDArray[np.intp]) -> Array:
    """(p,) D with A − diag(D) positive, alike within a group: each as large as it could be alone,
    all scaled to fit."""
    value, vector = np.linalg.eigh(A)
    inverse = (vector / np.maximum(value, ROUNDING)) @ vector.T
    D = np.empty(len(A))
    for g in np.unique(of):
        at = np.flatnonzero(of == g)
        D[at] = 1 / np.linalg.eigvalsh(inverse[np.ix_(at, at)])[-1]
    root = np.sqrt(D)
    return np.asarray(
        D * max(float(np.linalg.eigvalsh(A / root[:, None] / root)[0]), 0.0) * (1 - 1e-10)
    )


def _relaxed(
    A: Array, b: Array, of: NDArray[np.intp], weight: Array, first: Array
) -> tuple[float, NDArray[np.intp], Array]:
    """(a bound from below on βᵀAβ − 2bᵀβ + Σ weight of the groups that are in, the groups that are
    in there, (p,) how far each column's group is in): the best of some tangents from u =
    `first`."""
    D = _diagonal(A, of)
    if not len(A) or D.min() <= ROUNDING:
        value = 0.0 if not len(A) else -float(b @ np.linalg.lstsq(A, b, rcond=ROUNDING)[0])
        return value, np.unique(of), np.ones(len(A))
    M, best, u, found = A - np.diag(D), -np.inf, first, (of[:0], np.ones(len(A)))
    at, toward, step = first, np.zeros(len(A)), 0.7  # the best point so far, and the way up from it
    groups, inverse = np.unique(of, return_inverse=True)
    for _ in range(TANGENTS):
        c = b - M @ u
        gain = np.bincount(inverse, np.square(c) / D) - weight[groups]
        bound = -float(u @ M @ u) - float(np.maximum(gain, 0).sum())
        if bound > best:
            best, found = bound, (groups[gain > 0], np.abs(gain / weight[groups])[inverse])
            at, toward = u, np.where((gain > 0)[inverse], c / D, 0.0) - u
        else:  # too far: where columns are nearly alike D is small and c / D huge
            step /= 2
        u = at + step * toward
    return best, *found


@dataclass(frozen=True, eq=False)
class _Node:
    """Groups that are in, and those still open."""

    inside: Mask
    open: Mask


def _bounded(problem: _Bounding, node: _Node, best: Mask) -> tuple[float, Mask, int]:
    """(a bound from below on the BIC of every subset of a node, a subset worth trying, the group to
    branch on or −1)."""
    n, everything = problem.rows, node.inside | node.open
    least, c_best, paid = problem.rss(everything), problem.value(best), problem.price(node.inside)
    floor = float(bic(least, n, problem.rank, problem.sigma)) + paid
    if floor >= c_best or not node.open.any():
        return floor, node.inside, -1
    if problem.sigma is None:
        most = least * np.exp((c_best - floor) / n)  # RSS with which a subset would be as good
        slope = n * np.log(most / least) / (most - least)
    else:
        slope = 1 / problem.sigma**2
    inner, outer = problem.columns(node.inside), problem.columns(node.open)
    cross = problem.A[np.ix_(inner, outer)]
    value, vector = np.linalg.eigh(problem.A[np.ix_(inner, inner)])
    half = (vector / np.sqrt(np.maximum(value, ROUNDING))).T
    A = problem.A[np.ix_(outer, outer)] - (half @ cross).T @ (half @ cross)
    b = problem.b[outer] - (half @ cross).T @ (half @ problem.b[inner])
    of = problem.of[outer]
    weight = np.bincount(problem.of, minlength=problem.groups) * np.log(n) / slope
    own = np.flatnonzero((best & node.open)[of])
    first = np.zeros(len(outer))
    first[own] = (
        np.linalg.lstsq(A[np.ix_(own, own)], b[own], rcond=ROUNDING)[0] if len(own) else 0.0
    )
    bound, taken, clear = _relaxed(A, b, of, weight, first)
    low = floor + slope * (problem.rss(node.inside) + bound - least)
    trial = node.inside.copy()
    trial[taken] = True
    return max(floor, low), trial, int(of[np.argmin(np.abs(np.log(np.maximum(clear, 1e-300))))])


def find_best_subset(
    total: Reduction,
    base: Sequence[int],
    groups: Sequence[Sequence[int]],
    nodes: int = MAX_NODES,
    *,
    sigma: float | None = None,
) -> Certified:
    """The subset of `groups` (lists of column indices) with the lowest BIC on top of the
    independent base columns, from the triangle of all rows; `sigma`: the standard deviation of
    these, where it is known. After `nodes` nodes the search stops, and says by how much its best
    may be beaten."""
    problem = _problem(total, base, groups, sigma)
    real = np.bincount(problem.of, minlength=problem.groups) > 0
    best = min(
        (_stepwise(problem, start) for start in (np.zeros(problem.groups, bool), real.copy())),
        key=problem.value,
    )
    root = _Node(np.zeros(problem.groups, bool), real)
    waiting: list[tuple[float, int, _Node, int]] = []
    done = 0

    def look(node: _Node) -> None:
        nonlocal best, done
        done += 1
        low, trial, branch = _bounded(problem, node, best)
        if problem.value(trial) < problem.value(best):
            best = _stepwise(problem, trial)
        if low < problem.value(best) - ROUNDING * abs(problem.value(best)) and branch >= 0:
            heapq.heappush(waiting, (low, done, node, branch))

    look(root)
    while (
        waiting
        and waiting[0][0] < problem.value(best) - ROUNDING * abs(problem.value(best))
        and done < nodes
    ):
        _, _, node, g = heapq.heappop(waiting)
        left = _flipped(node.open, [g])
        look(_Node(_flipped(node.inside, [g]), left))
        look(_Node(node.inside, left))
    value = problem.value(best)
    gap = max(0.0, value - waiting[0][0]) if waiting else 0.0
    return Certified(best, value, gap if gap > ROUNDING * abs(value) else 0.0, done)
