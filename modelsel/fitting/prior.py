"""Usual sizes of the geometric parameters, and the prior that they put on what the data hardly
determine.

A combination of parameters that the data determine to better than a quarter of its usual size is
fitted by least squares alone. Below that a normal prior of the usual size enters smoothly, in full
where the data say nothing. So no estimate exceeds what the data and the usual size allow, and adding a
parameter sets no other one free."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from .._typing import Array, Index
from ..mechanisms.geometry import OPEN
from ..mechanisms.terms import Term
from .design import Model
from .identifiability import Identified
from .reduction import Reduction
from .splines import penalty, spline

PLENTY = 4.0  # usual sizes over their standard error, beyond which least squares stands alone
PRECISE = 1e-5  # of the parameters' own effect: less noise would only lose digits
STILL = 1e-13  # of the largest column: a smaller one moves nothing
ALIKE = 1e-8  # of the largest precision, by usual sizes: a change of the prior that changes nothing
# that this arm's errors may be larger than usual, a factor of two being likely
EXPONENTS = np.arange(-2.0, 4.0)
FACTORS = 2.0**EXPONENTS
# usual sizes beyond which an estimate is not usual; its own size then takes the usual one's place
SURPRISING = 3.0


@dataclass(frozen=True, eq=False)
class WeakPrior:
    """The prior on combinations of parameters that the data hardly determine.

    `rows` (k, p): rows · theta ~ N(0, 1) in units of the noise (None: the data determine everything
    well); `count`: number of directions that the prior affects; `held`: of these, directions that it
    determines more than the data; `sizes` (p,): usual sizes of this arm's parameters [mm, rad],
    infinite where there is none."""

    rows: Array | None = field(default=None, repr=False)
    count: int = 0
    held: int = 0
    sizes: Array | None = field(default=None, repr=False)

    def like(self, other: WeakPrior) -> bool:
        """Return whether another prior would change nothing."""
        if self.rows is None or other.rows is None or other.sizes is None:
            return self.rows is other.rows
        sized = np.isfinite(other.sizes)
        own, others = (w[:, sized] * other.sizes[sized] for w in (self.rows, other.rows))
        gram = others.T @ others
        change = np.abs(own.T @ own - gram).max()
        return bool(change <= ALIKE * np.diagonal(gram).max())

    def placed(self, index: Sequence[int]) -> WeakPrior:
        """Return the prior for other terms, of which number k is number index[k] of these; -1 where it
        is new."""
        if self.rows is None:
            return self
        source = np.array(index)
        is_new = source < 0
        columns = self.rows[:, source]
        rows = np.where(is_new, 0.0, columns)
        sizes = self.sizes
        if sizes is not None:
            sizes = sizes[source]
            sizes = np.where(is_new, np.inf, sizes)
        return replace(self, rows=rows, sizes=sizes)


@dataclass(frozen=True, eq=False)
class Shrinkage:
    """The prior of a model's shrunk terms: its `precision` (p,), zero for other terms (None: no term
    is shrunk), and its root `rows` (s, p)."""

    precision: Array | None
    rows: Array = field(repr=False)

    @staticmethod
    def of(terms: Sequence[Term], precision: Array | None) -> Shrinkage:
        """Compute the prior of a precision (p,)."""
        rows = np.zeros((0, len(terms))) if precision is None else penalty(terms, precision)
        return Shrinkage(precision, rows)

    @cached_property
    def gram(self) -> Array:
        """Products (p, p) of the rows."""
        return np.asarray(self.rows.T @ self.rows)

    def root(self, weak: WeakPrior | None) -> Array:
        """Return the root (k, p) of the precision of both this prior and the weak one."""
        if weak is None or weak.rows is None:
            return self.rows
        return np.vstack([self.rows, weak.rows])


def prior_root(
    terms: Sequence[Term], precision: Array | None, weak: WeakPrior | None = None
) -> Array:
    """Compute the root (k, p) of the prior's precision, of shrunk terms and of what the data hardly
    determine."""
    return Shrinkage.of(terms, precision).root(weak)


def with_prior(reduction: Reduction, root: Array, theta: Array) -> Reduction:
    """Return the reduction with the prior's rows, root · (theta + delta) = 0, stacked on; its count stays
    that of the data."""
    if not len(root):
        return reduction
    stacked = reduction.add(prior_rows(root, theta))
    return Reduction(stacked.R, reduction.rows)


def prior_rows(root: Array, theta: Array) -> Array:
    """Return the prior's rows (k, p+1) [columns | response] at theta."""
    return np.column_stack([root, -root @ theta])


def constant_mask(model: Model) -> NDArray[np.bool_]:
    """Return the mask (p,) of the constant parameters of the arm and its set-up."""
    return np.array([t.usual is not None for t in model.terms], dtype=bool)


def usual_sizes(model: Model, catalogue: bool = False) -> Array:
    """Return the usual size (p,) of every term, in its unit: of the arm's and the set-up's constant
    parameters, and, by the `catalogue`, of a mechanism's terms the upper end of the usual range.
    It is infinite where none is known, for free functions, which have a variance of their own, and
    for what changes as the campaign goes on, whose moment is sampled with a prior of its own."""
    return np.array([_usual_size(term, catalogue) for term in model.terms], dtype=float)


def _usual_size(term: Term, catalogue: bool) -> float:
    if term.usual is not None:
        return term.usual
    if catalogue and term.size is not None and _lasts(term):
        return term.size[1]
    return np.inf


def _lasts(term: Term) -> bool:
    """Whether a term is no free function and does not change during the campaign."""
    changes = any("progress" in screw.cause.names() for screw in term.screws)
    return spline(term) is None and not changes


def _of_the_arm(model: Model) -> list[Index]:
    """Return indices of the arm's constant lengths and of its angles, without what the set-up leaves
    open."""
    indices = []
    for kind, size in OPEN.items():
        is_usual = [_is_usual(term, kind, size) for term in model.terms]
        of_kind = np.flatnonzero(is_usual)
        indices.append(of_kind)
    return indices


def _is_usual(term: Term, kind: str, open_size: float) -> bool:
    """Whether a term is a constant of a `kind` of the arm, of a smaller size than what is open."""
    if term.usual is None:
        return False
    is_open = term.usual >= open_size
    screw = term.screws[0]
    return not is_open and screw.axis[0] == kind


def fitted_terms(found: Identified, model: Model) -> Identified:
    """Return what is identified with every constant parameter that moves a measured coordinate, whether others could
    represent it or not; as it is where some are left as drawn, for want of a length or a direction
    (see `size`)."""
    if found.held is not None or found.still:
        return found
    scale = found.scale
    largest = scale.max(initial=0.0)
    limit = STILL * largest
    moves = scale > limit
    is_constant = constant_mask(model)
    constants = np.flatnonzero(moves & is_constant)
    represented = set(constants.tolist())
    fitted = represented | set(found.kept)
    in_order = sorted(fitted)
    return replace(found, kept=tuple(in_order))


def faint(R: Array, kept: Sequence[int], sizes: Array, least: float) -> set[int]:
    """Choose the kept columns of the triangle R (p, p) to leave at zero during the iteration: while some
    combination of them at their usual `sizes` (p,) stays below `least`, the last of the terms that dominate it."""
    judged = [k for k in kept if np.isfinite(sizes[k])]
    lost: set[int] = set()
    while judged:
        columns = R[:, judged]
        effect = columns * sizes[judged]
        _, singular, Vt = np.linalg.svd(effect, full_matrices=False)
        smallest = singular[-1]
        if smallest > least:
            break
        combination = Vt[-1]
        share = np.abs(combination)
        largest = share.max()
        half = 0.5 * largest
        dominates = share > half
        dominant = np.flatnonzero(dominates)
        last = int(dominant[-1])
        term = judged.pop(last)
        lost.add(term)
    return lost


@dataclass(frozen=True, eq=False)
class Usual:
    """Usual `sizes` (p,) of a model's terms, infinite where there is none, and the indices of the
    arm's constant lengths and angles among them."""

    sizes: Array
    lengths: Index
    angles: Index

    @staticmethod
    def of(model: Model, catalogue: bool = False) -> Usual:
        """Look up the sizes by `usual_sizes`, which explains `catalogue`."""
        by_kind = _of_the_arm(model)
        return Usual(usual_sizes(model, catalogue), *by_kind)

    def sized(self, fitted: Sequence[int]) -> list[int]:
        """Choose the fitted terms that have a usual size."""
        is_sized = np.isfinite(self.sizes)
        return [k for k in fitted if is_sized[k]]


@dataclass(frozen=True, eq=False)
class Seen:
    """The information of the rows on some terms (indices `index`), beyond all others.

    `root` (r, k): a root of it; `response` (r,): least squares solve root · terms = response."""

    index: Sequence[int]
    root: Array
    response: Array

    def beyond(self, judged: Sequence[int]) -> Seen:
        """Return the information on some of the terms, beyond the rest of them, too."""
        place = {k: i for i, k in enumerate(self.index)}
        last = [place[k] for k in judged]
        first = [i for i in range(len(place)) if i not in set(last)]
        columns = [*first, *last]
        matrix = np.column_stack([self.root[:, columns], self.response])
        R: Array = np.asarray(np.linalg.qr(matrix, mode="r"))
        begin, end = len(first), len(columns)
        return Seen(judged, R[begin:end, begin:end], R[begin:end, end])


def weak_prior(
    reduction: Reduction,
    fitted: Sequence[int],
    model: Model,
    theta: Array,
    sigma: float,
    catalogue: bool = False,
) -> WeakPrior:
    """Compute the prior on what a reduction at theta (p,) hardly determines.

    It is of the usual sizes (`usual_sizes` explains `catalogue`), those of the arm's constant
    parameters scaled to this arm. `sigma`: the noise, in whitened units."""
    kept, usual = list(fitted), Usual.of(model, catalogue)
    response = reduction.R[:, -1] + reduction.R[:, kept] @ theta[kept]
    seen = Seen(kept, reduction.R[:, kept], response).beyond(usual.sized(kept))
    return weigh_usual(seen, usual, theta, sigma)


def weigh_usual(seen: Seen, usual: Usual, theta: Array, sigma: float) -> WeakPrior:
    """Compute the prior on what the rows hardly determine.

    `seen`: the information on all fitted terms of a usual size, beyond those without."""
    sized, sizes = list(seen.index), usual.sizes
    if not sigma > 0 or not sized:
        return WeakPrior(sizes=sizes)
    sizes = sizes * _scales(seen, usual, theta, sigma)
    sizes = np.maximum(sizes, np.abs(theta) / SURPRISING)
    _, singular, Vt = np.linalg.svd(seen.root * sizes[sized])
    known = singular / sigma  # usual sizes over the standard error, direction by direction
    weight = np.square(np.clip(1 - np.square(known / PLENTY), 0.0, None))
    weak = weight > 0
    if not weak.any():
        return WeakPrior(sizes=sizes)
    rows = np.zeros((int(weak.sum()), len(sizes)))
    rows[:, sized] = sigma * np.sqrt(weight[weak])[:, None] * Vt[weak] / sizes[sized]
    held = int((np.square(known) < weight).sum())
    return WeakPrior(rows, len(rows), held, sizes)


def _scales(seen: Seen, usual: Usual, theta: Array, sigma: float) -> Array:
    """Compute the factors (p,) that scale the usual sizes to this arm: one for all of its lengths and
    one for all of its angles.

    Each is the root of its posterior mean square, by the marginal likelihood of the data on these
    parameters. Parameters that are far beyond their usual size are left out as mistaken."""
    sizes, kinds = usual.sizes, (usual.lengths, usual.angles)
    sane = [k for k in seen.index if abs(theta[k]) < SURPRISING**2 * sizes[k]]
    lengths, angles = (np.intersect1d(kind, sane).astype(int).tolist() for kind in kinds)
    judged = [*lengths, *angles]
    out = np.ones(len(sizes))
    if not judged:
        return out
    of_arm = seen.beyond(judged)
    effect = of_arm.root * sizes[judged]
    noise = max(sigma, PRECISE * float(np.linalg.norm(effect)))
    p = _factor_posterior(effect / noise, of_arm.response / noise, len(lengths))
    for kind, share in zip(kinds, (p.sum(1), p.sum(0)), strict=True):
        out[kind] = np.sqrt(np.square(FACTORS) @ share / share.sum())
    return out


def _factor_posterior(effect: Array, response: Array, lengths: int) -> Array:
    """Compute posterior weights (F, F) of the FACTORS of the lengths' and the angles' sizes, up to a
    constant; `effect` (k, k) of usual sizes, the first `lengths` columns of lengths, and the
    response (k,), both in units of the noise."""
    of_lengths, of_angles = effect[:, :lengths], effect[:, lengths:]
    squares = np.square(FACTORS)
    covariance = (
        np.eye(len(effect))
        + squares[:, None, None, None] * (of_lengths @ of_lengths.T)
        + squares[:, None, None] * (of_angles @ of_angles.T)
    )
    root = np.linalg.cholesky(covariance)
    y = np.broadcast_to(response[:, None], (*root.shape[:3], 1))
    z = np.linalg.solve(root, y)
    log_p = (
        -np.log(np.diagonal(root, 0, 2, 3)).sum(2)
        - 0.5 * np.square(z).sum((2, 3))
        - 0.5 * np.square(EXPONENTS)[:, None]
        - 0.5 * np.square(EXPONENTS)
    )
    return np.asarray(np.exp(log_p - log_p.max()))
