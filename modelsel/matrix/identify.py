"""What the data determine: rank, a stable choice of representatives, alias groups and lost combinations in words."""
from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from .._typing import Array
from ..exceptions import sentence_list
from ..mechanisms.terms import Term
from .reduce import Reduction, independent

SHARE = 1e-4        # a smaller part of a combination is not worth a word


@dataclass(frozen=True, eq=False)
class Identified:
    """`kept`: indices of the fitted terms, in the columns' order: of `identify` the representatives; `scale` (p,) norms of the
    columns; `triangle` (p, p); `exact`: the representatives, whatever else is fitted; `held`: the length that stays as drawn
    where the data measure none, `still`: the base's turns where they do not say which way it looks (see `size`)."""

    kept: tuple[int, ...]
    scale: Array
    triangle: Array
    exact: tuple[int, ...] = ()
    held: int | None = None
    still: tuple[int, ...] = ()

    @property
    def rank(self) -> int:
        """Number of independent columns."""
        return len(self.kept)

    @cached_property
    def relation(self) -> Array:
        """(p, len(exact)): every column is these coefficients times the exact representatives."""
        kept = list(self.exact)
        if not kept:
            return np.zeros((len(self.scale), 0))
        unit = self.triangle[:, kept] / self.scale[kept]
        return np.asarray(np.linalg.lstsq(unit, self.triangle, rcond=None)[0].T / self.scale[kept])

    @cached_property
    def condition(self) -> float:
        """Condition number of the kept columns, scaled to unit norm."""
        kept = list(self.kept)
        singular = np.linalg.svd(self.triangle[:, kept] / self.scale[kept], compute_uv=False) if kept else np.ones(1)
        return float(singular[0] / singular[-1])


def identify(reduction: Reduction) -> Identified:
    """Rank by sequential orthogonalisation of the unit columns, in their order: an earlier column represents a later one
    that depends on it, so the choice does not hang on the data. A column below 1e-13 of the largest is zero."""
    R = reduction.R[:reduction.p, :reduction.p]
    kept, scale = independent(R)
    return Identified(tuple(kept), scale, R, tuple(kept))


def without(found: Identified, lost: set[int]) -> Identified:
    """With some representatives fixed: a target 0.7 mm off the last axis makes combinations estimable on paper that need radians
    to move it by a micrometre, and least squares would put such radians in."""
    return replace(found, kept=tuple(k for k in found.kept if k not in lost))


def solve(reduction: Reduction, kept: Sequence[int]) -> tuple[Array, Array, float]:
    """(estimate of the kept columns, their unscaled covariance factor R⁻¹ with cov = R⁻¹R⁻ᵀ, residual sum of squares)."""
    from scipy.linalg import solve_triangular
    inner = reduction.select(kept)
    k = len(kept)
    if not k:
        return np.zeros(0), np.zeros((0, 0)), float(inner.R[0, 0] ** 2)
    scale = np.linalg.norm(inner.R[:k, :k], axis=0)
    T = inner.R[:k, :k] / scale
    estimate = solve_triangular(T, inner.R[:k, k]) / scale
    factor = solve_triangular(T, np.eye(k)) / scale[:, None]
    return estimate, factor, float(inner.R[k, k] ** 2)


@dataclass(frozen=True)
class Unidentifiable:
    """A combination of parameters that the data cannot tell, in words."""

    sentence: str
    parameters: tuple[str, ...]


def unidentifiable(found: Identified, terms: Sequence[Term], leaning: Sequence[int] = ()) -> tuple[Unidentifiable, ...]:
    """Parameters that move nothing, groups of which only combinations are determined, parameters that the data hardly tell;
    `leaning`: fitted terms that the prior of usual sizes holds as much as the data."""
    symbols = [t.symbol for t in terms]
    biggest = found.scale.max(initial=0)
    still = [symbols[j] for j in range(len(terms)) if found.scale[j] <= 1e-13 * biggest]
    out = []
    if still:
        verb = "moves" if len(still) == 1 else "move"
        out.append(Unidentifiable(f"{sentence_list(still)} {verb} no measured coordinate: the data say nothing of "
                                  f"{'it' if len(still) == 1 else 'them'}.", tuple(still)))
    lost = [j for j in range(len(terms)) if j not in found.exact and found.scale[j] > 1e-13 * biggest]
    partners = {j: [found.exact[k] for k in np.flatnonzero(
        np.abs(found.relation[j] * found.scale[list(found.exact)]) > SHARE * found.scale[j])] for j in lost}
    for group in _connected(partners):
        names = [symbols[j] for j in sorted(group)]
        dropped = [symbols[j] for j in sorted(group) if j in partners]
        free = len(group) - len(dropped)
        what = "only their sum effect is" if free == 1 else f"only {free} combinations of them are"
        zero = [symbols[j] for j in sorted(group) if j in partners and j not in found.kept]
        shared = f"{_at_zero(zero)}" if zero else "the fit divides it among them by their usual sizes"
        out.append(Unidentifiable(f"{sentence_list(names)} cannot be told apart: {what} determined; {shared}.", tuple(names)))
    if found.still:
        turns = [symbols[j] for j in found.still]
        out.append(Unidentifiable(f"{_at_zero(turns)}: no row is measured in a frame of its own, and the whole may turn about "
                                  "points that nobody knows.", tuple(turns)))
    if found.held is not None:
        held = symbols[found.held]
        out.append(Unidentifiable(f"{_at_zero([held])}: no row measures a length, and an arm of another size would meet "
                                  f"all of them as well; every length is in proportion to the drawing's at {held}.", (held,)))
    said = {name for group in out for name in group.parameters}
    weak = [symbols[j] for j in leaning if symbols[j] not in said]
    if weak:
        out.append(Unidentifiable(f"{sentence_list(weak)} {'is' if len(weak) == 1 else 'are'} hardly determined by these data: "
                                  f"{'its estimate is' if len(weak) == 1 else 'their estimates are'} held near zero by the usual "
                                  "size of such errors, and the standard error says how far.", tuple(weak)))
    return tuple(out)


def _at_zero(names: Sequence[str]) -> str:
    return f"{sentence_list(names)} {'is' if len(names) == 1 else 'are'} kept at zero"


def _connected(partners: dict[int, list[int]]) -> list[set[int]]:
    groups: list[set[int]] = []
    for j, others in partners.items():
        together = {j, *others}
        touching = [g for g in groups if g & together]
        groups = [g for g in groups if g not in touching] + [together.union(*touching)]
    return sorted(groups, key=min)
