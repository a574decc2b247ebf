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

from .._linalg import orthonormalise
from .._typing import Array, Mask
from ..fitting.design import Model
from ..fitting.least_squares import Fit
from ..fitting.prior import prior_root
from ..fitting.problem import Problem
from ..mechanisms.terms import Mechanism, Term, TermKey
from .candidate_columns import Columns, stack_design
from .candidates import Candidate
from .scan import Released, Response, Scan, assemble_scan, build_scan_without, compute_basis

# share of an added column beyond the columns before it from which its products keep their digits
OWN_SHARE = 1e-6
# numbers of added columns, and of their products with the candidates, that are kept
KEPT_NUMBERS = 5_000_000


@dataclass(frozen=True, eq=False)
class View:
    """A fitted model as projections, with every candidate beyond it.

    Orthonormal Q (N, r) and R (r, r) with A[:, kept] = Q R; all columns A (N, p); the fit's residual
    `raw` (N,), its coordinates `along` (r,) in Q, and its part `residual` (N,) off the model, which
    the candidates see as `response`. The prior's rows of shrunk terms stand below the rows of the
    data. `kept`: the columns that do not depend on others; geometry takes whatever it can, so the
    prior of its usual sizes has no say."""

    model: Model
    fitted: Fit
    kept: tuple[int, ...]
    A: Array
    Q: Array
    R: Array
    raw: Array
    along: Array
    residual: Array
    scan: Scan
    response: Response

    @cached_property
    def owners(self) -> dict[TermKey, list[Mechanism]]:
        """The mechanisms of the model that have each of its terms."""
        owners: dict[TermKey, list[Mechanism]] = {term.key: [] for term in self.model.terms}
        for mechanism in self.model.mechanisms:
            for term in mechanism.terms:
                owners[term.key].append(mechanism)
        return owners

    def mask_terms(self, *effects: Candidate) -> Mask:
        """Mask (p,) of the terms that these effects alone bring into the model."""
        brought = [effect.mechanism for effect in effects]
        own = {term.key for m in brought for term in m.terms}
        for key in own & self.owners.keys():
            if any(m not in brought for m in self.owners[key]):
                own.remove(key)
        return np.array([key in own for key in self.owners], dtype=bool)

    def release(self, *effects: Candidate) -> Released:
        """Take effects out of the model without a refit.

        The directions are those that only they bring, in the coordinates of Q: R⁻ᵀ E with E their
        columns of the identity. What the fit explained by them is put back."""
        from scipy.linalg import solve_triangular

        own = self.mask_terms(*effects)
        E = np.eye(len(self.kept))[:, own[list(self.kept)]]
        directions = compute_basis(solve_triangular(self.R, E, trans="T", check_finite=False))
        effect = self.A[:, own] @ self.fitted.theta[own]
        return Released(directions, directions.T @ (self.along + self.Q.T @ effect))

    def scan_without(self, candidate: Candidate) -> tuple[Scan, Response]:
        """Scan from the model without one effect: (scan, residual with that effect put back)."""
        released = self.release(candidate)
        scan = build_scan_without(self.scan, released.directions)
        return scan, released.see(self.response, scan.back)


class _Projection(NamedTuple):
    """A model's columns A (N + s, p), with s rows of a prior, and of those that are `kept` the basis
    Q (N + s, r), the triangle R (r, r), and the products (C, r) of all candidates with Q."""

    kept: tuple[int, ...]
    A: Array
    Q: Array
    R: Array
    inside: Array


def build_view(problem: Problem, columns: Columns, fitted: Fit) -> View:
    """Build the view of a fitted model by itself, linearised where it is."""
    root = prior_root(fitted.terms, fitted.precision)
    A = np.vstack([stack_design(problem, fitted.terms, fitted.at())[0], root])
    kept = fitted.representatives
    reduced = np.vstack([fitted.reduction.R[:-1, :-1], root])
    triangle = np.asarray(np.linalg.qr(reduced[:, list(kept)], mode="r"))
    Q, R = orthonormalise(A[:, list(kept)], triangle)
    return _see(problem, columns, fitted, _Projection(kept, A, Q, R, columns.dot(Q)))


def _see(problem: Problem, columns: Columns, fitted: Fit, projected: _Projection) -> View:
    """See what a fitted model leaves, and every candidate beyond it."""
    root = prior_root(fitted.terms, fitted.precision)
    left = stack_design(problem, (), fitted.at())[1]
    raw = np.concatenate([left, -root @ fitted.theta])
    along = projected.Q.T @ raw
    residual = raw - projected.Q @ along
    return View(
        model=fitted.model,
        fitted=fitted,
        kept=projected.kept,
        A=projected.A,
        Q=projected.Q,
        R=projected.R,
        raw=raw,
        along=along,
        residual=residual,
        scan=assemble_scan(columns, projected.Q, projected.inside),
        response=Response(columns.dot(residual), float(residual @ residual)),
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
        projected = self._extend(fitted)
        if projected is None:
            return build_view(self.problem, self.columns, fitted)
        return _see(self.problem, self.columns, fitted, projected)

    def _extend(self, fitted: Fit) -> _Projection | None:
        """Extend the base's projection; None where what is added depends on what is there."""
        first, before, rows = self.first, self.first.A.shape[1], self.columns.rows
        columns, products = self._expand(fitted.terms[before:])
        root = prior_root(fitted.terms, fitted.precision)
        A = np.vstack([np.column_stack([first.A, columns]), root])
        own = [k for k in fitted.representatives if k >= before]
        rest = A[:, own]
        along = np.zeros((first.Q.shape[1], len(own)))
        for _ in range(2):  # twice is enough (Kahan, Parlett)
            share = first.Q.T @ rest[:rows]
            rest[:rows] -= first.Q @ share
            along += share
        Q, R = np.linalg.qr(rest)
        size = np.linalg.norm(A[:, own], axis=0)
        if not (np.abs(np.diagonal(R)) > OWN_SHARE * size).all():
            return None
        beyond = products[:, [k - before for k in own]] - first.scan.inside @ along
        return _Projection(
            kept=(*first.kept, *own),
            A=A,
            Q=np.column_stack([np.pad(first.Q, ((0, len(root)), (0, 0))), Q]),
            R=_stack_triangles(first.R, along, R),
            inside=np.column_stack([first.scan.inside, _divide(beyond, R)]),
        )

    def _expand(self, terms: Sequence[Term]) -> tuple[Array, Array]:
        """Compute the columns (N, k) of some terms, and the products (C, k) of all candidates with
        them; those of the last models are known."""
        keys = [term.key for term in terms]
        new = [key for key in keys if key not in self._known]
        if new:
            added = self.columns.expand_terms(new)
            multiplied = np.ascontiguousarray(self.columns.dot(added.T).T)
            for key, column, product in zip(new, added, multiplied, strict=True):
                self._known[key] = column, product
        known = [self._known[key] for key in keys]
        self._forget(keys)
        columns = np.array([column for column, _ in known]).reshape(len(keys), -1)
        products = np.array([product for _, product in known]).reshape(len(keys), -1)
        return columns.T, products.T

    def _forget(self, used: Sequence[TermKey]) -> None:
        """Forget the oldest columns where they are many, but for those in use."""
        size = self.columns.rows + self.columns.screws.count
        most = KEPT_NUMBERS // size
        old = [key for key in self._known if key not in used]
        for key in old[: max(len(self._known) - most, 0)]:
            del self._known[key]


def _stack_triangles(first: Array, across: Array, last: Array) -> Array:
    """Stack the triangle (r + k, r + k) of two triangles and what is across them (r, k)."""
    below = np.zeros((len(last), len(first)))
    return np.block([[first, across], [below, last]])


def _divide(matrix: Array, triangle: Array) -> Array:
    """Compute a matrix (C, k) times the inverse of an upper triangle (k, k)."""
    from scipy.linalg import solve_triangular

    solved = solve_triangular(triangle, matrix.T, trans="T", check_finite=False)
    return np.asarray(solved.T)
