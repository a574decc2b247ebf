"""Reduction: any number of rows folded into one triangle, block by block; associative, constant
memory.

R holds the columns and, last, the response: X'X = R'R of the stacked rows. LAPACK's dtpqrt puts a
block onto R."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.linalg.lapack import dtpqrt

from .._typing import Array, Index
from ..mechanisms.terms import Term
from ..robot._kernels import Workspace
from .design import assemble, whiten
from .linearisation import Linearisation
from .problem import BLOCK, Problem
from .whitening import UNIT, Whitening

TOLERANCE = 1e-11  # of a unit column: structural dependence leaves 1e-14, NIST's Filip 1e-9 or more
# times what rounding leaves of a combination: structural dependence leaves a hundred, Filip a million
ROUNDING = 1e4
MIN_COLUMN = 1e-13  # of the largest column's norm: a smaller column is zero
DEPENDENT = 1e-9  # of a column, in any row: what is left of a dependent one beyond its combination
TOGETHER = 32  # columns orthogonalised at once where none of them depends on another
# configurations that tell which terms depend, in data of more than so many
PROBE = (256, 8192)
# configurations whose design a core's cache about holds; no power of two, whose strides collide in
# it
STREAM = 2000
# dtpqrt's inner block up to and beyond WIDE columns: a tenth faster on either side than the other
PANEL = (8, 16)
WIDE = 100


@dataclass(frozen=True, eq=False)
class Reduction:
    """Upper triangle R (p+1, p+1) of [columns | response] and the number of rows that went into
    it; `parts`: those of the folds that it is made of, where they were asked for."""

    R: Array
    rows: int
    parts: tuple[Reduction, ...] = field(default=(), repr=False)

    @staticmethod
    def empty(p: int) -> Reduction:
        """Return the reduction of no rows, for p columns and the response."""
        size = p + 1
        triangle = np.zeros((size, size))
        return Reduction(triangle, 0)

    @property
    def p(self) -> int:
        """Number of columns."""
        return len(self.R) - 1

    def add(self, matrix: Array) -> Reduction:
        """Stack the rows of a matrix (k, p+1) on the triangle, the response last."""
        if not len(matrix):
            return self
        triangle = np.array(self.R, order="F")
        below = np.array(matrix, order="F")
        _stack(triangle, below)
        rows = self.rows + len(matrix)
        return Reduction(triangle, rows)

    def merge(self, other: Reduction) -> Reduction:
        """Return the reduction of both sets of rows."""
        triangle = other.R
        stacked = self.add(triangle)
        rows = self.rows + other.rows
        return Reduction(stacked.R, rows)

    def select(self, columns: Sequence[int]) -> Reduction:
        """Return the reduction of some columns, in the given order; the response stays last."""
        p = self.p
        triangle = self.R
        if list(columns) == list(range(p)):
            return self
        kept = [*columns, p]
        picked = triangle[:, kept]
        count = len(columns)
        nothing = Reduction.empty(count)
        out = nothing.add(picked)
        parts = tuple(part.select(columns) for part in self.parts)
        return Reduction(out.R, self.rows, parts)

    def shift(self, change: Array) -> Reduction:
        """Return the reduction with the parameters changed by (p,), linear: the response is less by
        what the columns make of it."""
        R = self.R.copy()
        R[:, -1] -= R[:, :-1] @ change
        parts = tuple(part.shift(change) for part in self.parts)
        return Reduction(R, self.rows, parts)


def merged(parts: Iterable[Reduction]) -> Reduction:
    """Merge several reductions into one."""
    first, *others = parts
    for other in others:
        first = first.merge(other)
    return first


def independent(R: Array) -> tuple[list[int], Array]:
    """(columns of a triangle (p, p) that do not depend on earlier ones, norms (p,)): sequential
    orthogonalisation of the unit columns, in their order. A column below 1e-13 of the largest is
    zero; one of which no more is left than rounding leaves of its combination of earlier ones
    depends on them."""
    scale = np.linalg.norm(R, axis=0)
    moves = np.flatnonzero(scale > MIN_COLUMN * scale.max(initial=0))
    unit = R / np.where(scale > 0, scale, 1.0)
    basis = np.zeros(R.shape, order="F")
    kept: list[int] = []
    while True:
        kept = _orthogonalise(unit, moves, basis, kept)
        lost = _find_rounding(unit[:, kept])
        if lost is None:
            return kept, scale
        # what stands before it stays; a later column may be told from the others without it
        moves = moves[moves > kept[lost]]
        kept = kept[:lost]


def _find_rounding(unit: Array) -> int | None:
    """Find the first column, of unit columns (p, k), that rounding alone tells from the earlier
    ones: of a combination with coefficients c it leaves some 1e-16 times their sum, and the inverse
    of the triangle holds every column's, over what is left of it."""
    from scipy.linalg import solve_triangular

    k = unit.shape[1]
    triangle = np.linalg.qr(unit, mode="r")
    inverse = solve_triangular(triangle, np.eye(k), check_finite=False)
    left = np.abs(np.diagonal(triangle))
    coefficients = np.abs(inverse).sum(0) * left
    rounding = np.flatnonzero(left < ROUNDING * np.finfo(float).eps * coefficients)
    return int(rounding[0]) if len(rounding) else None


def _orthogonalise(unit: Array, moves: Index, basis: Array, kept: list[int]) -> list[int]:
    """Orthogonalise the columns `moves` of unit columns (p, n) beyond those kept already, whose basis
    stands in the first columns of `basis` (p, n), which is filled: all those kept."""
    for start in range(0, len(moves), TOGETHER):
        columns = moves[start : start + TOGETHER]
        rest = _beyond(unit[:, columns], basis[:, : len(kept)])
        Q, T = np.linalg.qr(rest)
        if (np.abs(np.diagonal(T)) > TOLERANCE).all() and len(T) == len(columns):
            basis[:, len(kept) : len(kept) + len(columns)] = _beyond(Q, basis[:, : len(kept)])
            kept = kept + columns.tolist()
            continue
        for j, v in zip(columns.tolist(), rest.T, strict=True):
            own = _beyond(v, basis[:, : len(kept)])
            size = np.sqrt(own @ own)
            if size > TOLERANCE:
                basis[:, len(kept)] = own / size
                kept = [*kept, j]
    return kept


def _beyond(vectors: Array, basis: Array) -> Array:
    """Vectors without their part in an orthonormal basis; twice is enough (Kahan, Parlett)."""
    for _ in range(2):
        vectors = vectors - basis @ (basis.T @ vectors)
    return vectors


def reduce(matrix: Array, response: Array) -> Reduction:
    """Reduce a plain matrix (N, p) and response (N,)."""
    columns = [matrix, response]
    rows = np.column_stack(columns)
    _, p = matrix.shape
    nothing = Reduction.empty(p)
    return nothing.add(rows)


def _stack(triangle: Array, matrix: Array) -> None:
    """The rows of matrix (k, p+1) onto the triangle (p+1, p+1), both Fortran-ordered and
    overwritten."""
    width = len(triangle)
    panel = min(PANEL[width > WIDE], width)
    _, _, _, info = dtpqrt(0, panel, triangle, matrix, overwrite_a=True, overwrite_b=True)
    if info:
        raise ArithmeticError(f"dtpqrt: argument {-info} is wrong")


class Source(ABC):
    """Data too large for memory; provides its reduction instead of rows."""

    whitening: Whitening = UNIT

    @abstractmethod
    def __len__(self) -> int:
        """Return the number of rows."""

    @abstractmethod
    def reduced(
        self,
        terms: Sequence[Term],
        at: Linearisation | None = None,
        only: Sequence[int] | None = None,
    ) -> Reduction:
        """Reduce all rows; arguments as in `reduce_problem`."""


def reduce_problem(
    problem: Problem | Source,
    terms: Sequence[Term],
    at: Linearisation | None = None,
    only: Sequence[int] | None = None,
) -> Reduction:
    """Reduce a problem's whitened design and residual, block by block; the whole matrix is never
    held, nothing allocated a block.

    Where there are many blocks, terms that depend exactly on earlier ones are left out of the
    factorisation and put back as the combinations they are; every block checks that they are, else
    all terms are factorised. `only`: the terms that are asked for; the other columns are zero.
    """
    if isinstance(problem, Source):
        return problem.reduced(terms, at, only)
    whitening = problem.whitening
    weight = whitening.weight
    unweighted = whitening.without_weight()
    plain = replace(problem, whitening=unweighted)
    triangle = _triangle(plain, terms, at, only)
    scaled = triangle * weight
    return Reduction(scaled, problem.coordinates)


def _triangle(
    problem: Problem, terms: Sequence[Term], at: Linearisation | None, only: Sequence[int] | None
) -> Array:
    """Reduce a problem by whichever way is the least work."""
    p = len(terms)
    if only is not None:
        picked = [*only, p]
        rows = _stream(problem, terms, at, picked)
        scattered = scatter_columns(rows, picked, p + 1)
        return Reduction.empty(p).add(scattered).R
    if len(problem) > PROBE[1] and p:
        try:
            return _without_dependent(problem, terms, at)
        except _Disagrees:
            pass
    every = range(p + 1)
    return _stream(problem, terms, at, every)


def reduce_folds(
    problem: Problem,
    terms: Sequence[Term],
    fold_of: Index,
    at: Linearisation | None = None,
    only: Sequence[int] | None = None,
) -> list[Reduction]:
    """Reduce a problem's whitened design and residual fold by fold, block by block.

    `fold_of` (m,): the rows' folds; `only`: the terms that are asked for, other columns are left
    out."""
    width = len(terms)
    wanted = [*(range(width) if only is None else only), width]
    triangles = [
        np.zeros((len(wanted), len(wanted)), order="F") for _ in range(int(fold_of.max()) + 1)
    ]
    problem, fold_of = sort_by_fold(problem, fold_of)
    space = Workspace()
    for rows, part in problem.parts(STREAM):
        design = whiten(part, assemble(part, terms, at, space=space))
        if len(wanted) < len(design):
            design = design[wanted]
        folds = fold_of[rows]
        for k in np.unique(folds).tolist():
            own = folds == k
            block = design if own.all() else design[:, :, own]
            _stack(triangles[k], block.reshape(len(wanted), -1).T)
    counts = problem.counted(fold_of, len(triangles)).tolist()
    return [Reduction(R, rows) for R, rows in zip(triangles, counts, strict=True)]


def sort_by_fold(problem: Problem, fold_of: Index) -> tuple[Problem, Index]:
    """Return many rows and their folds (m,), one fold after the other: most blocks are of one fold,
    and nothing is picked from them. Rows that share errors stay in their order."""
    if len(problem) <= BLOCK or problem.whitening.shared is not None:
        return problem, fold_of
    order = np.argsort(fold_of, kind="stable")
    return problem.take(order), fold_of[order]


def multiply_problem(
    problem: Problem,
    terms: Sequence[Term],
    at: Linearisation | None = None,
    only: Sequence[int] = (),
) -> tuple[Array, Reduction]:
    """Compute the products (p+1, p+1) of [columns | residual], whitened: at a third of the cost of
    a reduction, and with half of its digits where columns nearly depend on one another. Beside
    them, the reduction of the few terms `only`."""
    p, space = len(terms), Workspace()
    products = np.zeros((p + 1, p + 1))
    picked = [*only, p]
    triangle = np.zeros((len(picked), len(picked)), order="F")
    for _, part in problem.parts(STREAM):
        block = whiten(part, assemble(part, terms, at, space=space)).reshape(p + 1, -1)
        products += block @ block.T
        if only:
            _stack(triangle, block[picked].T)
    return products, Reduction(triangle, problem.coordinates)


class _Disagrees(ArithmeticError):
    """A block where terms that seemed to depend on others do not."""


def scatter_columns(rows: Array, columns: Sequence[int], width: int) -> Array:
    """Put rows (k, len(columns)) at their columns of `width`, zeros elsewhere."""
    shape = len(rows), width
    out = np.zeros(shape)
    out[:, columns] = rows
    return out


def _stream(
    problem: Problem,
    terms: Sequence[Term],
    at: Linearisation | None,
    picked: Sequence[int],
    check: Array | None = None,
    bound: float = 0.0,
) -> Array:
    """The triangle of the picked columns, the response among them. Raises _Disagrees where a
    mixture `check` (p,) of the terms exceeds `bound` in any row."""
    p, space = len(terms), Workspace()
    triangle = np.zeros((len(picked), len(picked)), order="F")
    for _, part in problem.parts(STREAM):
        block = whiten(part, assemble(part, terms, at, space=space)).reshape(p + 1, -1)
        if check is not None and np.abs(check @ block[:p]).max() > bound:
            raise _Disagrees
        if len(picked) <= p:
            buffer = space.array("picked", len(picked), block.shape[1])
            # any mode but "clip" goes through a buffer of numpy's
            block = np.take(block, picked, axis=0, out=buffer, mode="clip")
        _stack(triangle, block.T)
    return triangle


def _without_dependent(problem: Problem, terms: Sequence[Term], at: Linearisation | None) -> Array:
    """The triangle of all terms from the independent ones' alone. Raises _Disagrees where a block
    does not agree.

    Which terms depend is seen on configurations spread over all the data. A random mixture of what
    the dependent terms lack of their combinations must stay at rounding in every row of every
    block."""
    p = len(terms)
    probed = np.linspace(0, len(problem) - 1, PROBE[0]).astype(np.intp)
    probe = reduce_problem(problem.take(probed), terms, at).R[:p, :p]
    kept, scale = independent(probe)
    lost = [k for k in range(p) if k not in kept]
    unit = probe[:, kept] / scale[kept]
    relation = np.linalg.lstsq(unit, probe[:, lost], rcond=None)[0] / scale[kept][:, None]
    mixture, bound = mix_dependent(scale, kept, lost, relation, len(probed))
    picked = [*kept, p]
    triangle = _stream(problem, terms, at, picked, mixture, bound)
    restored = np.pad(triangle[:-1, :-1] @ relation, ((0, 1), (0, 0)))
    columns = np.concatenate([triangle, restored], axis=1)
    return Reduction.empty(p).add(columns[:, np.argsort([*picked, *lost])]).R


def mix_dependent(
    scale: Array, kept: Sequence[int], lost: Sequence[int], relation: Array, rows: int
) -> tuple[Array, float]:
    """(random mixture (p,) of what the dependent terms lack of their combinations, the most that
    rounding makes of it in any row); `scale` (p,): norms of the columns over so many `rows`."""
    biggest = scale.max()
    moves = scale[lost] > MIN_COLUMN * biggest
    size = np.where(moves, scale[lost], biggest)  # a term that moves nothing is no unit
    sign = np.random.default_rng(len(lost)).choice((-1.0, 1.0), len(lost))
    mixture = np.zeros(len(scale))
    mixture[lost] = sign / size
    mixture[kept] = -relation @ mixture[lost]
    reach = np.abs(relation) @ np.abs(mixture[lost]) * scale[kept]
    largest = max(float(reach.max(initial=0.0)), 1.0)
    return mixture, DEPENDENT * largest / np.sqrt(rows)
