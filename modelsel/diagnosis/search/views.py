"""Views: fitted models seen as projections, with every candidate beyond them.

What lies beyond a model, and beyond it without one of its effects, follows without a refit. All
views of a search share the base's linearisation, that of the candidates' columns: an effect adds its
few columns to the base's basis, and their products with every candidate are worked out once."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import NamedTuple

import numpy as np

from ..._linalg import orthonormalise, orthonormalise_in_place
from ..._typing import Array, Index, Mask
from ...fitting.design import Model, measure_rounding
from ...fitting.least_squares import Fit
from ...fitting.prior import prior_root
from ...fitting.problem import Problem
from ...mechanisms.terms import Mechanism, TermKey
from ..candidates.candidate import Candidate
from ..columns.candidate_columns import Columns, stack_design
from ..columns.row_blocks import split_range
from ..inference.scan import Released, Response, Scan, assemble_scan, compute_basis

# share of an added column beyond the columns before it from which its products keep their digits
OWN_SHARE = 1e-6
# numbers of added columns, and of their products with the candidates, that are kept
KEPT_NUMBERS = 2_000_000
# candidates' columns, and rows, that are multiplied at a time
PIECE = 4096


@dataclass(frozen=True, eq=False)
class ModelColumns:
    """The columns A (N + s, p) of a model's terms, with s rows of a prior below those of the data.

    `base` (N, p₀): of the first terms; `added`: of every other one (N,), which the models that have
    it share; `root` (s, p): the prior's rows."""

    base: Array
    added: tuple[Array, ...]
    root: Array

    @property
    def rows(self) -> int:
        """The number of rows of the data."""
        return len(self.base)

    def fill(self, terms: Sequence[int], out: Array) -> None:
        """Fill in (N + s, k) the columns of some terms, with the rows of the prior."""
        for place, term in enumerate(terms):
            out[: self.rows, place] = self._take(term)
        out[self.rows :] = self.root[:, list(terms)]

    def move(self, terms: Sequence[int] | Index, theta: Array) -> Array:
        """Compute (N,) what some terms of these sizes (k,) do at the rows of the data."""
        moved = np.zeros(self.rows)
        for term, size in zip(terms, theta, strict=True):
            moved += size * self._take(term)
        return moved

    def _take(self, term: int) -> Array:
        first = self.base.shape[1]
        column = self.base[:, term] if term < first else self.added[term - first]
        return np.asarray(column)


@dataclass(frozen=True, eq=False)
class View:
    """A fitted model as projections, with every candidate beyond it.

    Orthonormal Q (N, r) and R (r, r) with A[:, kept] = Q R; all columns A (N, p); of the fit's
    residual, its coordinates `along` (r,) in Q, and its part `residual` (N,) off the model, which the
    candidates see as `response`; it is zero where no more than rounding is left. The prior's rows of shrunk terms stand below the rows of the
    data. `kept`: the columns that do not depend on others; geometry takes whatever it can, so the
    prior of its usual sizes has no say."""

    model: Model
    fitted: Fit
    kept: tuple[int, ...]
    A: ModelColumns
    Q: Array
    R: Array
    along: Array
    residual: Array
    scan: Scan
    response: Response

    @cached_property
    def owners(self) -> dict[TermKey, list[Mechanism]]:
        """The mechanisms of the model that have each of its terms."""
        model = self.model
        keys = [term.key for term in model.terms]
        owners: dict[TermKey, list[Mechanism]] = {key: [] for key in keys}
        for mechanism in model.mechanisms:
            for term in mechanism.terms:
                key = term.key
                own = owners[key]
                own.append(mechanism)
        return owners

    @cached_property
    def places(self) -> dict[TermKey, int]:
        """Where each of the model's terms stands among its columns."""
        return {key: place for place, key in enumerate(self.owners)}

    def mask_terms(self, *effects: Candidate) -> Mask:
        """Mask (p,) of the terms that these effects alone bring into the model."""
        brought = [effect.mechanism for effect in effects]
        mask = np.zeros(len(self.places), dtype=bool)
        for mechanism in brought:
            for term in mechanism.terms:
                place = self.places.get(term.key)
                if place is not None:
                    mask[place] = all(m in brought for m in self.owners[term.key])
        return mask

    def release(self, *effects: Candidate) -> Released:
        """Take effects out of the model without a refit.

        The directions are those that only they bring, in the coordinates of Q: R⁻ᵀ E with E their
        columns of the identity. What the fit explained by them is put back."""
        from scipy.linalg import solve_triangular

        own = self.mask_terms(*effects)
        E = np.eye(len(self.kept))[:, own[list(self.kept)]]
        directions = compute_basis(solve_triangular(self.R, E, trans="T", check_finite=False))
        A = self.A
        theta = self.fitted.theta[own]
        of_data = A.move(np.flatnonzero(own), theta)
        of_prior = A.root[:, own] @ theta
        effect = np.concatenate([of_data, of_prior])
        return Released(directions, directions.T @ (self.along + self.Q.T @ effect))


class _Projection(NamedTuple):
    """A model's columns A (N + s, p), with s rows of a prior, and of those that are `kept` the basis
    Q (N + s, r), the triangle R (r, r), and the products (C, r) of all candidates with Q."""

    kept: tuple[int, ...]
    A: ModelColumns
    Q: Array
    R: Array
    inside: Array


def build_view(problem: Problem, columns: Columns, fitted: Fit) -> View:
    """Build the view of a fitted model by itself, linearised where it is."""
    root = prior_root(fitted.terms, fitted.precision)
    of_data, _ = stack_design(problem, fitted.terms, fitted.at())
    A = ModelColumns(of_data, (), root)
    kept = fitted.representatives
    own = list(kept)
    reduced = np.vstack([fitted.reduction.R[:-1, :-1], root])
    triangle = np.asarray(np.linalg.qr(reduced[:, own], mode="r"))
    stacked = np.vstack([of_data, root])
    Q, R = orthonormalise(stacked[:, own], triangle)
    inside = columns.dot(Q)
    projected = _Projection(kept, A, Q, R, inside)
    return _see(problem, columns, fitted, projected)


def _see(problem: Problem, columns: Columns, fitted: Fit, projected: _Projection) -> View:
    """See what a fitted model leaves, and every candidate beyond it."""
    root = prior_root(fitted.terms, fitted.precision)
    Q = projected.Q
    _, of_data = stack_design(problem, (), fitted.at())
    of_prior = -root @ fitted.theta
    raw = np.concatenate([of_data, of_prior])
    along = Q.T @ raw
    residual = raw - Q @ along
    if np.linalg.norm(residual) <= measure_rounding(problem):
        residual = np.zeros_like(residual)
    scan = assemble_scan(columns, Q, projected.inside)
    return View(
        model=fitted.model,
        fitted=fitted,
        kept=projected.kept,
        A=projected.A,
        Q=Q,
        R=projected.R,
        along=along,
        residual=residual,
        scan=scan,
        response=scan.see(residual),
    )


@dataclass(frozen=True, eq=False)
class Views:
    """The views of one search: `first`, that of the base, and those of models that extend it.

    `columns`: every candidate's, linearised at the base, which nothing shrinks. So are all views:
    what the base's own terms determine does not change with what is added to them."""

    problem: Problem
    columns: Columns
    first: View
    _known: dict[TermKey, tuple[Array, Array]] = field(default_factory=dict, repr=False)

    def build(self, fitted: Fit) -> View:
        """Build the view of the base with more mechanisms, from the base's and what they add.

        Where the columns that are added can hardly be told from the others, the view is built by
        itself."""
        problem = self.problem
        columns = self.columns
        projected = self._extend(fitted)
        if projected is None:
            return build_view(problem, columns, fitted)
        return _see(problem, columns, fitted, projected)

    def _extend(self, fitted: Fit) -> _Projection | None:
        """Extend the base's projection; None where nothing is added, or depends on what is there."""
        first = self.first
        base = first.A.base
        before = base.shape[1]
        keys = [term.key for term in fitted.terms]
        more = keys[before:]
        if not more:
            return None
        root = prior_root(fitted.terms, fitted.precision)
        A = ModelColumns(base, self._expand(more), root)
        own = [k for k in fitted.representatives if k >= before]
        if not own:
            return None
        rank = first.Q.shape[1]
        # by columns: the new ones are made orthonormal where they stand
        shape = A.rows + len(root), rank + len(own)
        Q = np.zeros(shape, order="F")
        basis = Q[:, :rank]
        basis[: A.rows] = first.Q
        rest = Q[:, rank:]
        A.fill(own, rest)
        size = np.linalg.norm(rest, axis=0)
        along = _take_out(rest, basis)
        R = orthonormalise_in_place(rest)
        is_own = np.abs(np.diagonal(R)) > OWN_SHARE * size
        if not is_own.all():
            return None
        added = [keys[k] for k in own]
        inside = self._multiply(added, along, R)
        return _Projection(
            kept=(*first.kept, *own), A=A, Q=Q, R=_stack_triangles(first.R, along, R), inside=inside
        )

    def _expand(self, keys: Sequence[TermKey]) -> tuple[Array, ...]:
        """Compute the columns (N,) of some terms; those of the last models are known."""
        new = [key for key in keys if key not in self._known]
        if new:
            self._learn(new)
        self._forget(set(keys))
        return tuple(self._known[key][0] for key in keys)

    def _multiply(self, keys: Sequence[TermKey], along: Array, R: Array) -> Array:
        """Multiply all candidates by the base's basis and by what some terms add, which are
        Q along + Q_new R: (C, r + k), filled piece by piece."""
        from scipy.linalg.blas import dtrsm

        inside = self.first.scan.inside
        count, size = inside.shape
        products = np.empty((count, size + len(keys)))
        products[:, :size] = inside
        added = products[:, size:]
        of_keys = [self._known[key][1] for key in keys]
        for rows in split_range(count, PIECE):
            beyond = np.array([own[rows] for own in of_keys])
            beyond -= along.T @ inside[rows].T
            # by columns, as it stands: beyond R⁻¹ needs no copy
            added[rows] = dtrsm(1.0, R, beyond.T, side=1, overwrite_b=1)
        return products

    def _learn(self, new: Sequence[TermKey]) -> None:
        """Work out the columns of some terms, and the products of all candidates with them."""
        columns = self.columns.expand_terms(new)
        products = self.columns.dot(columns.T)
        by_term = np.ascontiguousarray(products.T)
        for key, column, product in zip(new, columns, by_term, strict=True):
            # copies: a row of either would keep all the others
            self._known[key] = column.copy(), product.copy()

    def _forget(self, used: set[TermKey]) -> None:
        """Forget the oldest columns where they are many, but for those in use."""
        numbers = self.columns.rows + self.columns.screws.count
        most = KEPT_NUMBERS // numbers
        surplus = max(len(self._known) - most, 0)
        old = [key for key in self._known if key not in used]
        for key in old[:surplus]:
            del self._known[key]


def _take_out(vectors: Array, basis: Array) -> Array:
    """Take a basis (N, r) out of vectors (N, k), both contiguous by columns, in place; returns the
    coordinates (r, k).

    Twice is enough (Kahan, Parlett)."""
    from scipy.linalg.blas import dgemm

    across = basis.T
    shape = len(across), vectors.shape[1]
    coordinates = np.zeros(shape)
    for _ in range(2):
        along = across @ vectors
        dgemm(-1.0, basis, along, 1.0, vectors, overwrite_c=1)
        coordinates += along
    return coordinates


def _stack_triangles(first: Array, across: Array, last: Array) -> Array:
    """Stack the triangle (r + k, r + k) of two triangles and what is across them (r, k)."""
    rows = len(last)
    size = len(first)
    shape = rows, size
    below = np.zeros(shape)
    top = [first, across]
    bottom = [below, last]
    both = [top, bottom]
    return np.block(both)
