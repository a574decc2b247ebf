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
FACTORS = 2.0 ** np.arange(
    -2, 4
)  # that this arm's errors may be larger than usual, a factor of two being likely
SURPRISING = (
    3.0  # usual sizes: an estimate beyond is no usual one, and its own size is taken for it
)


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
        """Whether another changes nothing."""
        if self.rows is None or other.rows is None:
            return self.rows is other.rows
        a, b = self.rows.T @ self.rows, other.rows.T @ other.rows
        unit = np.sqrt(np.maximum(np.diagonal(b), np.finfo(float).tiny))
        return bool(np.abs((a - b) / unit / unit[:, None]).max() <= ALIKE)

    def placed(self, index: Sequence[int]) -> WeakPrior:
        """Of other terms: number k of these is number index[k] of those, -1 for none."""
        if self.rows is None:
            return self
        own = np.array(index)
        return replace(
            self,
            rows=np.where(own < 0, 0.0, self.rows[:, own]),
            sizes=None if self.sizes is None else np.where(own < 0, np.inf, self.sizes[own]),
        )


def constant(model: Model) -> NDArray[np.bool_]:
    """(p,) mask of the constant parameters of the arm and its set-up."""
    return np.array([t.usual is not None for t in model.terms], dtype=bool)


def usual_sizes(model: Model, catalogue: bool = False) -> Array:
    """(p,) usual size of every term, in its unit: of the arm's and the set-up's constant
    parameters, and, by the `catalogue`, of a mechanism's terms the upper end of the usual range;
    infinite where none is known, for free functions, which have a variance of their own, and for
    what changes as the campaign goes on, whose moment is sampled with a prior of its own."""
    return np.array(
        [
            t.usual
            if t.usual is not None
            else t.size[1]
            if catalogue and t.size is not None and _lasts(t)
            else np.inf
            for t in model.terms
        ],
        dtype=float,
    )


def _lasts(term: Term) -> bool:
    return spline(term) is None and not any("progress" in s.cause.names() for s in term.screws)


def _of_the_arm(model: Model) -> list[Index]:
    """Indices of the arm's constant lengths and of its angles, without what the set-up leaves
    open."""
    return [
        np.array(
            [
                k
                for k, t in enumerate(model.terms)
                if t.usual is not None and t.usual < size and t.screws[0].axis[0] == kind
            ],
            dtype=np.intp,
        )
        for kind, size in OPEN.items()
    ]


def fitted_terms(found: Identified, model: Model) -> Identified:
    """With every constant parameter that moves a measured coordinate, whether others could
    represent it or not; as it is where some are left as drawn, for want of a length or a direction
    (see `size`)."""
    if found.held is not None or found.still:
        return found
    moves = found.scale > STILL * found.scale.max(initial=0.0)
    return replace(
        found, kept=tuple(sorted({*found.kept, *np.flatnonzero(moves & constant(model)).tolist()}))
    )


def faint(R: Array, kept: Sequence[int], sizes: Array, least: float) -> set[int]:
    """Kept columns of the triangle R (p, p) to leave at zero on the way: while some combination of
    them at their usual `sizes` (p,) stays below `least`, the last of the terms that dominate it."""
    judged = [k for k in kept if np.isfinite(sizes[k])]
    lost: set[int] = set()
    while judged:
        _, singular, Vt = np.linalg.svd(R[:, judged] * sizes[judged], full_matrices=False)
        if singular[-1] > least:
            break
        share = np.abs(Vt[-1])
        lost.add(judged.pop(int(np.flatnonzero(share > 0.5 * share.max())[-1])))
    return lost


def weak_prior(
    reduction: Reduction,
    fitted: Sequence[int],
    model: Model,
    theta: Array,
    sigma: float,
    catalogue: bool = False,
) -> WeakPrior:
    """The prior on what a reduction at theta (p,) says little of, by usual sizes (see there for the
    `catalogue`); those of the arm's constant parameters are scaled to this arm's own."""
    kept, sizes = list(fitted), usual_sizes(model, catalogue)
    if not sigma > 0 or not np.isfinite(sizes[kept]).any():
        return WeakPrior(sizes=sizes)
    sizes = sizes * _scales(reduction, kept, sizes, _of_the_arm(model), theta, sigma)
    sizes = np.maximum(sizes, np.abs(theta) / SURPRISING)
    sized = [k for k in kept if np.isfinite(sizes[k])]
    inner, _ = _beyond(reduction, sized, [k for k in kept if k not in sized], theta)
    _, singular, Vt = np.linalg.svd(inner * sizes[sized])
    known = singular / sigma
    weight = np.square(np.clip(1 - np.square(known / PLENTY), 0.0, None))
    some = weight > 0
    if not some.any():
        return WeakPrior(sizes=sizes)
    rows = np.zeros((int(some.sum()), reduction.p))
    rows[:, sized] = sigma * np.sqrt(weight[some])[:, None] * Vt[some] / sizes[sized]
    return WeakPrior(rows, len(rows), int((np.square(known) < weight).sum()), sizes)


def _beyond(
    reduction: Reduction, some: Sequence[int], others: Sequence[int], theta: Array
) -> tuple[Array, Array]:
    """(triangle (k, k) of some columns, what they and theta make of the response (k,)), beyond the
    others."""
    columns = [*others, *some]
    response = reduction.R[:, -1] + reduction.R[:, columns] @ theta[columns]
    R: Array = np.asarray(
        np.linalg.qr(np.column_stack([reduction.R[:, columns], response]), mode="r")
    )
    return R[len(others) : -1, len(others) : -1], R[len(others) : -1, -1]


def _scales(
    reduction: Reduction,
    kept: Sequence[int],
    sizes: Array,
    usual: Sequence[Index],
    theta: Array,
    sigma: float,
) -> Array:
    """(p,) factor of every usual size, alike for the arm's lengths and for its angles (`usual`):
    the roots of their posterior mean squares by the marginal likelihood of what the data say of
    these parameters; those that are mistaken say nothing."""
    sane = [
        np.intersect1d(k, [j for j in kept if abs(theta[j]) < SURPRISING**2 * sizes[j]]).astype(int)
        for k in usual
    ]
    some = [*sane[0].tolist(), *sane[1].tolist()]
    out = np.ones(len(sizes))
    if not some:
        return out
    inner, y = _beyond(reduction, some, [k for k in kept if k not in some], theta)
    B = inner * sizes[some]
    noise = max(sigma, PRECISE * float(np.linalg.norm(B)))
    B = B / noise
    parts = B[:, : len(sane[0])], B[:, len(sane[0]) :]
    covariance = (
        np.eye(len(some))
        + np.square(FACTORS)[:, None, None, None] * (parts[0] @ parts[0].T)
        + np.square(FACTORS)[:, None, None] * (parts[1] @ parts[1].T)
    )
    root = np.linalg.cholesky(covariance)
    z = np.linalg.solve(root, np.broadcast_to((y / noise)[:, None], (*root.shape[:3], 1)))
    exponents = np.log2(FACTORS)
    log_p = (
        -np.log(np.diagonal(root, 0, 2, 3)).sum(2)
        - 0.5 * np.square(z).sum((2, 3))
        - 0.5 * np.square(exponents)[:, None]
        - 0.5 * np.square(exponents)
    )
    p = np.exp(log_p - log_p.max())
    for k, share in zip(usual, (p.sum(1), p.sum(0)), strict=True):
        out[k] = np.sqrt(np.square(FACTORS) @ share / share.sum())
    return out
