"""Usual sizes of the geometric parameters, and the prior that they put on what the data hardly
determine.

A combination of parameters that the data determine to better than a quarter of its usual size is
fitted by least squares alone. Below that a normal prior of the usual size comes in, smoothly, and
in full where the data say nothing; so no estimate goes beyond what the data and the usual size
allow, and adding a parameter frees no other one."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from .._typing import Array, Index
from ..mechanisms.geometry import OPEN
from ..mechanisms.terms import Term
from .design import Model
from .identifiability import Identified
from .reduction import Reduction
from .splines import spline

PLENTY = 4.0  # usual sizes over their standard error, beyond which least squares stands alone
PRECISE = 1e-5  # of the parameters' own effect: less noise would only lose digits
STILL = 1e-13  # of the largest column: a smaller one moves nothing
ALIKE = 1e-5  # relative change of the prior that changes nothing
# that this arm's errors may be larger than usual, a factor of two being likely
EXPONENTS = np.arange(-2.0, 4.0)
FACTORS = 2.0**EXPONENTS
# usual sizes: an estimate beyond is no usual one, and its own size is taken for it
SURPRISING = 3.0


@dataclass(frozen=True, eq=False)
class WeakPrior:
    """`rows` (k, p): their product with theta is normal about zero, in units of the noise (None:
    the data determine all well); `count`: directions that the prior has a say in; `held`: those of
    which it says more than the data; `sizes` (p,): usual sizes of this arm's parameters [mm, rad],
    infinite where there is none."""

    rows: Array | None = field(default=None, repr=False)
    count: int = 0
    held: int = 0
    sizes: Array | None = field(default=None, repr=False)

    def like(self, other: WeakPrior) -> bool:
        """Return whether another changes nothing."""
        own, others = self.rows, other.rows
        if own is None or others is None:
            return own is others
        gram = own.T @ own
        other_gram = others.T @ others
        diagonal = np.diagonal(other_gram)
        precision = np.finfo(float)
        tiny = precision.tiny
        positive = np.maximum(diagonal, tiny)
        unit = np.sqrt(positive)
        difference = gram - other_gram
        by_columns = difference / unit
        row_unit = unit[:, None]
        relative = by_columns / row_unit
        change = np.abs(relative)
        largest = change.max()
        is_alike = largest <= ALIKE
        return bool(is_alike)

    def placed(self, index: Sequence[int]) -> WeakPrior:
        """Return the prior of other terms: number k of these is number index[k] of those, -1 for
        none."""
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
    """Choose the kept columns of the triangle R (p, p) to leave at zero on the way: while some combination of
    them at their usual `sizes` (p,) stays below `least`, the last of the terms that dominate it."""
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


def weak_prior(
    reduction: Reduction,
    fitted: Sequence[int],
    model: Model,
    theta: Array,
    sigma: float,
    catalogue: bool = False,
) -> WeakPrior:
    """Compute the prior on what a reduction at theta (p,) says little of, by usual sizes (see there for the
    `catalogue`); those of the arm's constant parameters are scaled to this arm's own."""
    kept, sizes = list(fitted), usual_sizes(model, catalogue)
    if not sigma > 0 or not np.isfinite(sizes[kept]).any():
        return WeakPrior(sizes=sizes)
    sizes = sizes * _scales(reduction, kept, sizes, _of_the_arm(model), theta, sigma)
    sizes = np.maximum(sizes, np.abs(theta) / SURPRISING)
    sized = [k for k in kept if np.isfinite(sizes[k])]
    others = [k for k in kept if k not in sized]
    triangle, _ = _beyond(reduction, sized, others, theta)
    _, singular, Vt = np.linalg.svd(triangle * sizes[sized])
    known = singular / sigma  # usual sizes over the standard error, direction by direction
    weight = np.square(np.clip(1 - np.square(known / PLENTY), 0.0, None))
    weak = weight > 0
    if not weak.any():
        return WeakPrior(sizes=sizes)
    rows = np.zeros((int(weak.sum()), reduction.p))
    rows[:, sized] = sigma * np.sqrt(weight[weak])[:, None] * Vt[weak] / sizes[sized]
    held = int((np.square(known) < weight).sum())
    return WeakPrior(rows, len(rows), held, sizes)


def _beyond(
    reduction: Reduction, judged: Sequence[int], others: Sequence[int], theta: Array
) -> tuple[Array, Array]:
    """(triangle (k, k) of the judged columns, what they and theta make of the response (k,)),
    beyond the others."""
    columns = [*others, *judged]
    response = reduction.R[:, -1] + reduction.R[:, columns] @ theta[columns]
    matrix = np.column_stack([reduction.R[:, columns], response])
    R: Array = np.asarray(np.linalg.qr(matrix, mode="r"))
    first = len(others)
    return R[first:-1, first:-1], R[first:-1, -1]


def _scales(
    reduction: Reduction,
    kept: Sequence[int],
    sizes: Array,
    usual: Sequence[Index],
    theta: Array,
    sigma: float,
) -> Array:
    """Compute a factor (p,) of every usual size, alike for the arm's lengths and for its angles (`usual`):
    the roots of their posterior mean squares by the marginal likelihood of what the data say of
    these parameters; those that are mistaken say nothing."""
    sane = [k for k in kept if abs(theta[k]) < SURPRISING**2 * sizes[k]]
    lengths, angles = (np.intersect1d(kind, sane).astype(int).tolist() for kind in usual)
    judged = [*lengths, *angles]
    out = np.ones(len(sizes))
    if not judged:
        return out
    others = [k for k in kept if k not in judged]
    triangle, response = _beyond(reduction, judged, others, theta)
    effect = triangle * sizes[judged]
    noise = max(sigma, PRECISE * float(np.linalg.norm(effect)))
    p = _factor_posterior(effect / noise, response / noise, len(lengths))
    for kind, share in zip(usual, (p.sum(1), p.sum(0)), strict=True):
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
