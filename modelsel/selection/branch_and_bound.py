"""The best subset of many groups by BIC, with a certificate, by branch and bound; for more groups
than all subsets can be walked.

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

from .._linalg import TINY
from .._typing import Array, Index, Mask
from ..fitting.reduction import Reduction, independent
from .criteria import bic

# relative size of what counts as rounding
ROUNDING = 1e-9
# length of a unit column below which it lies in the span of the base
MIN_COLUMN = 1e-8
# first step of the bound's ascent, as a share of the way to the next point
FIRST_STEP = 0.7


@dataclass(frozen=True)
class SearchOptions:
    """Effort of the search.

    max_nodes: nodes of the tree, each a fraction of a millisecond to a few.
    tangents: points u that are tried for the bound of each node.
    """

    max_nodes: int = 2000
    tangents: int = 80


DEFAULT_SEARCH = SearchOptions()


@dataclass(frozen=True, eq=False)
class Certified:
    """The best subset found, with its certificate.

    members: mask (G,) of its groups.
    bic: its BIC.
    gap: how much lower the BIC of another subset could be; zero where it is proven the best.
    nodes: number of nodes that were searched.
    """

    members: Mask
    bic: float
    gap: float
    nodes: int

    @property
    def proven(self) -> bool:
        """Whether no subset has a lower BIC."""
        return self.gap == 0.0


@dataclass(frozen=True, eq=False)
class _Regression:
    """Least squares beyond the base, with orthonormal columns in every group.

    gram, products: Gram (p, p) of the columns and their products (p,) with the response.
    square: squared length of the response.
    group: group (p,) of every column; `groups` their number.
    rank: number of base columns.
    rows, sigma: of the data, as for `bic`.
    bic_of: BIC of the subsets evaluated so far.
    """

    gram: Array
    products: Array
    square: float
    group: Index
    groups: int
    rank: int
    rows: int
    sigma: float | None
    bic_of: dict[bytes, float] = field(default_factory=dict)

    @property
    def real(self) -> Mask:
        """Mask (G,) of groups that have columns of their own."""
        return np.asarray(np.bincount(self.group, minlength=self.groups) > 0)

    def columns(self, members: Mask) -> Index:
        """Return the columns of a subset."""
        inside = members[self.group]
        return np.flatnonzero(inside)

    def rss(self, members: Mask) -> float:
        """Compute the residual sum of squares of a subset."""
        columns = self.columns(members)
        left = self.square - float(self.products[columns] @ self.solve(columns))
        return max(left, np.finfo(float).eps * self.square)

    def solve(self, columns: Index) -> Array:
        """Solve least squares for columns that may depend on one another: minimum norm."""
        value, vector = np.linalg.eigh(self.gram[np.ix_(columns, columns)])
        kept = value > ROUNDING
        vector = vector[:, kept]
        return np.asarray(vector @ ((vector.T @ self.products[columns]) / value[kept]))

    def price(self, members: Mask) -> float:
        """Compute what BIC charges for a subset's columns beyond the base."""
        columns = self.columns(members)
        count = len(columns)
        per_column = np.log(self.rows)
        price = count * per_column
        return float(price)

    def bic(self, members: Mask) -> float:
        """Compute BIC of a subset, all its columns counted; remembered."""
        key = members.tobytes()
        if key not in self.bic_of:
            rank = self.rank + len(self.columns(members))
            self.bic_of[key] = float(bic(self.rss(members), self.rows, rank, self.sigma))
        return self.bic_of[key]


def find_best_subset(
    total: Reduction,
    base: Sequence[int],
    groups: Sequence[Sequence[int]],
    options: SearchOptions = DEFAULT_SEARCH,
    *,
    sigma: float | None = None,
) -> Certified:
    """Find the subset of `groups` (lists of column indices) with the lowest BIC on top of the
    independent base columns.

    `total`: triangle of all rows; `sigma`: their standard deviation, where it is known. After
    `options.max_nodes` nodes the search stops, and says by how much its best may be beaten."""
    problem = _project(total, base, groups, sigma)
    search = _Search(problem, options)
    search.visit(_Node(np.zeros(problem.groups, bool), problem.real))
    while search.promising() and search.visited < options.max_nodes:
        _, _, node, g = heapq.heappop(search.waiting)
        rest = _flip(node.open, [g])
        search.visit(_Node(_flip(node.inside, [g]), rest))
        search.visit(_Node(node.inside, rest))
    value = problem.bic(search.best)
    gap = max(0.0, value - search.waiting[0][0]) if search.waiting else 0.0
    if gap <= ROUNDING * abs(value):
        gap = 0.0
    return Certified(search.best, value, gap, search.visited)


@dataclass(frozen=True, eq=False)
class _Node:
    """Groups that are in, and those that are still open."""

    inside: Mask
    open: Mask


class _Search:
    """State of a search: the best subset so far, and the nodes that may hold a better one, lowest
    bound first, each with the group to branch on."""

    def __init__(self, problem: _Regression, options: SearchOptions):
        self.problem = problem
        self.options = options
        self.visited = 0
        self.waiting: list[tuple[float, int, _Node, int]] = []
        starts = (np.zeros(problem.groups, bool), problem.real)
        self.best = min((_improve(problem, start) for start in starts), key=problem.bic)

    def beats(self, bound: float) -> bool:
        """Whether a subset of that BIC would be better than the best, beyond rounding."""
        value = self.problem.bic(self.best)
        size = abs(value)
        rounding = ROUNDING * size
        limit = value - rounding
        return bound < limit

    def promising(self) -> bool:
        """Whether a waiting node may hold a better subset."""
        if not self.waiting:
            return False
        lowest_bound = self.waiting[0][0]
        return self.beats(lowest_bound)

    def visit(self, node: _Node) -> None:
        """Bound a node; keep it where it may hold a better subset."""
        self.visited += 1
        bound, trial, branch = _bound_node(self.problem, node, self.best, self.options.tangents)
        if self.problem.bic(trial) < self.problem.bic(self.best):
            self.best = _improve(self.problem, trial)
        if branch >= 0 and self.beats(bound):
            heapq.heappush(self.waiting, (bound, self.visited, node, branch))


def _project(
    total: Reduction, base: Sequence[int], groups: Sequence[Sequence[int]], sigma: float | None
) -> _Regression:
    """Project the base out and make every group's columns orthonormal.

    Columns that the base or the group's other columns span are left out, and so is a group that
    spans the same space as an earlier one."""
    count = len(base)
    rest = [c for g in groups for c in g]
    R = total.select([*base, *rest]).R
    size = np.linalg.norm(R, axis=0)
    size = size[count:]
    beyond = R[count:, count:]
    bases: list[Array] = []
    group: list[int] = []
    start = 0
    for g, columns in enumerate(groups):
        stop = start + len(columns)
        place = slice(start, stop)
        start = stop
        length = np.maximum(size[place], TINY)
        unit = beyond[:, place] / length
        basis = _orthonormalise(unit)
        if any(_spans_same(other, basis) for other in bases):
            basis = basis[:, :0]
        bases.append(basis)
        rank = basis.shape[1]
        group += [g] * rank
    rows = len(beyond)
    none = np.zeros((rows, 0))
    Q = np.concatenate([*bases, none], axis=1)
    y = beyond[:, -1]
    square = float(y @ y)
    return _Regression(
        Q.T @ Q,
        Q.T @ y,
        square,
        np.array(group, dtype=np.intp),
        len(groups),
        count,
        total.rows,
        sigma,
    )


def _orthonormalise(columns: Array) -> Array:
    """Orthonormalise columns that had unit length before the base was projected out."""
    columns = columns[:, np.linalg.norm(columns, axis=0) > MIN_COLUMN]
    kept, norm = independent(columns)
    if not kept:
        return columns[:, :0]
    return np.linalg.qr(columns[:, kept] / norm[kept])[0]


def _spans_same(basis: Array, other: Array) -> bool:
    """Whether two orthonormal bases span the same space."""
    same_shape = basis.shape == other.shape
    if not same_shape or not other.size:
        return False
    products = basis.T @ other
    cosines = np.linalg.svd(products, compute_uv=False)
    smallest = cosines.min()
    least = 1 - ROUNDING
    return bool(smallest > least)


def _improve(problem: _Regression, members: Mask) -> Mask:
    """Add, drop or exchange groups as long as BIC falls (splicing; Zhu et al. 2020)."""
    real = np.flatnonzero(problem.real).tolist()
    while True:
        trials = [_flip(members, [g]) for g in real]
        best = min(trials, key=problem.bic, default=members)
        if problem.bic(best) >= problem.bic(members):
            inside = [g for g in real if members[g]]
            outside = [g for g in real if not members[g]]
            trials = [_flip(members, [g, h]) for g in inside for h in outside]
            best = min(trials, key=problem.bic, default=members)
        if problem.bic(best) >= problem.bic(members) - ROUNDING:
            return members
        members = best


def _flip(members: Mask, which: Sequence[int]) -> Mask:
    changed = members.copy()
    changed[which] = ~changed[which]
    return changed


def _bound_node(
    problem: _Regression, node: _Node, best: Mask, tangents: int
) -> tuple[float, Mask, int]:
    """Bound the BIC of every subset of a node: (bound, a subset worth trying, the group to branch on
    or −1).

    The floor is BIC with the residual of all open groups and the price of those inside alone."""
    rss = problem.rss(node.inside | node.open)
    bare = float(bic(rss, problem.rows, problem.rank, problem.sigma))
    floor = bare + problem.price(node.inside)
    excess = problem.bic(best) - floor
    if excess <= 0 or not node.open.any():
        return floor, node.inside, -1
    slope = _chord_slope(problem, rss, excess)
    columns = problem.columns(node.open)
    A, b = _eliminate(problem, problem.columns(node.inside), columns)
    group = problem.group[columns]
    count = np.bincount(problem.group, minlength=problem.groups)
    weight = count * np.log(problem.rows) / slope
    start = _solve_members(A, b, np.flatnonzero((best & node.open)[group]))
    relaxed, chosen, clear = _relax(A, b, group, weight, start, tangents)
    bound = floor + slope * (problem.rss(node.inside) + relaxed - rss)
    trial = node.inside.copy()
    trial[chosen] = True
    doubt = np.abs(np.log(np.maximum(clear, TINY)))
    return max(floor, bound), trial, int(group[np.argmin(doubt)])


def _chord_slope(problem: _Regression, rss: float, excess: float) -> float:
    """Compute the slope of BIC over RSS: 1/σ², or that of the chord of n ln RSS from `rss` to the
    RSS at which BIC has risen by `excess`."""
    if problem.sigma is not None:
        return 1 / problem.sigma**2
    largest = rss * np.exp(excess / problem.rows)
    return float(problem.rows * np.log(largest / rss) / (largest - rss))


def _eliminate(problem: _Regression, inside: Index, columns: Index) -> tuple[Array, Array]:
    """Compute Gram and products of `columns` with the columns `inside` projected out."""
    value, vector = np.linalg.eigh(problem.gram[np.ix_(inside, inside)])
    half = (vector / np.sqrt(np.maximum(value, ROUNDING))).T
    cross = half @ problem.gram[np.ix_(inside, columns)]
    A = problem.gram[np.ix_(columns, columns)] - cross.T @ cross
    b = problem.products[columns] - cross.T @ (half @ problem.products[inside])
    return A, b


def _solve_members(A: Array, b: Array, members: Index) -> Array:
    """Compute the least squares (p,) of some columns, zero elsewhere."""
    coefficients = np.zeros(len(b))
    if not len(members):
        return coefficients
    pairs = np.ix_(members, members)
    gram = A[pairs]
    products = b[members]
    solution = np.linalg.lstsq(gram, products, rcond=ROUNDING)
    coefficients[members] = solution[0]
    return coefficients


def _relax(
    A: Array, b: Array, group: Index, weight: Array, start: Array, tangents: int
) -> tuple[float, Index, Array]:
    """Bound βᵀAβ − 2bᵀβ + Σ weight of the groups that are in from below.

    Returns the bound, the groups that are in there, and (p,) how far each column's group is in;
    the best of some tangents from u = `start`."""
    if not len(A):
        return 0.0, np.unique(group), np.ones(0)
    D = _diagonalise(A, group)
    if D.min() <= ROUNDING:
        least = -float(b @ np.linalg.lstsq(A, b, rcond=ROUNDING)[0])
        return least, np.unique(group), np.ones(len(A))
    M = A - np.diag(D)
    groups, column_group = np.unique(group, return_inverse=True)
    best, best_gain = -np.inf, np.zeros(len(groups))
    point, direction, step = start, np.zeros(len(A)), FIRST_STEP
    u = start
    for _ in range(tangents):
        c = b - M @ u
        gain = np.bincount(column_group, np.square(c) / D) - weight[groups]
        bound = -float(u @ M @ u) - float(np.maximum(gain, 0).sum())
        if bound > best:
            best, best_gain, point = bound, gain, u
            direction = np.where((gain > 0)[column_group], c / D, 0.0) - u
        else:  # too far: where columns are nearly alike D is small and c / D huge
            step /= 2
        u = point + step * direction
    share = np.abs(best_gain / weight[groups])
    return best, groups[best_gain > 0], share[column_group]


def _diagonalise(A: Array, group: Index) -> Array:
    """Compute a diagonal D (p,), alike within a group, with A − diag(D) positive: each as large as
    it could be alone, all scaled to fit."""
    value, vector = np.linalg.eigh(A)
    inverse = (vector / np.maximum(value, ROUNDING)) @ vector.T
    D = np.empty(len(A))
    for g in np.unique(group):
        columns = np.flatnonzero(group == g)
        D[columns] = 1 / np.linalg.eigvalsh(inverse[np.ix_(columns, columns)])[-1]
    root = np.sqrt(D)
    smallest = float(np.linalg.eigvalsh(A / root[:, None] / root)[0])
    return np.asarray(D * max(smallest, 0.0) * (1 - 1e-10))
