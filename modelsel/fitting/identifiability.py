"""What the data determine: rank, a stable choice of representatives, alias groups and lost
combinations in words."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from .._typing import Array
from ..exceptions import sentence_list
from ..mechanisms.causes import ONE, Number
from ..mechanisms.terms import Term
from .problem import Problem
from .reduction import Reduction, Source, independent

SHARE = 1e-4  # a smaller part of a combination is not worth a word


@dataclass(frozen=True, eq=False)
class Identified:
    """`kept`: indices of the fitted terms, in the columns' order: of `identify` the
    representatives; `scale` (p,) norms of the columns; `triangle` (p, p); `exact`: the
    representatives, whatever else is fitted; `held`: the length that stays as drawn where the data
    measure none, `still`: the base's turns where they do not say which way it looks (see
    `size`)."""

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
        singular = (
            np.linalg.svd(self.triangle[:, kept] / self.scale[kept], compute_uv=False)
            if kept
            else np.ones(1)
        )
        return float(singular[0] / singular[-1])


def identify(reduction: Reduction) -> Identified:
    """Rank by sequential orthogonalisation of the unit columns, in their order: an earlier column
    represents a later one that depends on it, so the choice does not hang on the data. A column
    below 1e-13 of the largest is zero."""
    R = reduction.R[: reduction.p, : reduction.p]
    kept, scale = independent(R)
    return Identified(tuple(kept), scale, R, tuple(kept))


def without(found: Identified, lost: set[int]) -> Identified:
    """With some representatives fixed: a target 0.7 mm off the last axis makes combinations
    estimable on paper that need radians to move it by a micrometre, and least squares would put
    such radians in."""
    return replace(found, kept=tuple(k for k in found.kept if k not in lost))


def solve(reduction: Reduction, kept: Sequence[int]) -> tuple[Array, Array, float]:
    """(estimate of the kept columns, their unscaled covariance factor R⁻¹ with cov = R⁻¹R⁻ᵀ,
    residual sum of squares)."""
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


def unidentifiable(
    found: Identified, terms: Sequence[Term], leaning: Sequence[int] = ()
) -> tuple[Unidentifiable, ...]:
    """Parameters that move nothing, groups of which only combinations are determined, parameters
    that the data hardly tell; `leaning`: fitted terms that the prior of usual sizes holds as much
    as the data."""
    symbols = [t.symbol for t in terms]
    biggest = found.scale.max(initial=0)
    still = [symbols[j] for j in range(len(terms)) if found.scale[j] <= 1e-13 * biggest]
    out = []
    if still:
        verb = "moves" if len(still) == 1 else "move"
        out.append(
            Unidentifiable(
                f"{sentence_list(still)} {verb} no measured coordinate: the data say nothing of "
                f"{'it' if len(still) == 1 else 'them'}.",
                tuple(still),
            )
        )
    lost = [
        j for j in range(len(terms)) if j not in found.exact and found.scale[j] > 1e-13 * biggest
    ]
    partners = {
        j: [
            found.exact[k]
            for k in np.flatnonzero(
                np.abs(found.relation[j] * found.scale[list(found.exact)]) > SHARE * found.scale[j]
            )
        ]
        for j in lost
    }
    for group in _connected(partners):
        names = [symbols[j] for j in sorted(group)]
        dropped = [symbols[j] for j in sorted(group) if j in partners]
        free = len(group) - len(dropped)
        what = "only their sum effect is" if free == 1 else f"only {free} combinations of them are"
        zero = [symbols[j] for j in sorted(group) if j in partners and j not in found.kept]
        shared = (
            f"{_at_zero(zero)}" if zero else "the fit divides it among them by their usual sizes"
        )
        out.append(
            Unidentifiable(
                f"{sentence_list(names)} cannot be told apart: {what} determined; {shared}.",
                tuple(names),
            )
        )
    if found.still:
        turns = [symbols[j] for j in found.still]
        out.append(
            Unidentifiable(
                f"{_at_zero(turns)}: no row is measured in a frame of its own, and the whole may turn about "
                "points that nobody knows.",
                tuple(turns),
            )
        )
    if found.held is not None:
        held = symbols[found.held]
        out.append(
            Unidentifiable(
                f"{_at_zero([held])}: no row measures a length, and an arm of another size would meet "
                f"all of them as well; every length is in proportion to the drawing's at {held}.",
                (held,),
            )
        )
    said = {name for group in out for name in group.parameters}
    weak = [symbols[j] for j in leaning if symbols[j] not in said]
    if weak:
        out.append(
            Unidentifiable(
                f"{sentence_list(weak)} {'is' if len(weak) == 1 else 'are'} hardly determined by these data: "
                f"{'its estimate is' if len(weak) == 1 else 'their estimates are'} held near zero by the usual "
                "size of such errors, and the standard error says how far.",
                tuple(weak),
            )
        )
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


# How long is the arm? Planes, touched points and bars of unknown length do not say: an arm of half
# the size meets them all.

APART_MM = 1.0  # spread of readings that tells one size from another
KNOWN = {"same-point": 2, "plane": 4}  # known features that do


def sized(problem: Problem | Source) -> bool:
    """Whether some row measures a length: a coordinate, a wire, a distance, a bar of known length,
    features at known places."""
    if (
        isinstance(problem, Source)
        or (gauges := problem.data.gauges) is None
        or any(j.prismatic for j in problem.robot.joints)
    ):
        return True
    if gauges.of("distance").any() or any(
        f.kind in ("wire", "ball-bar") and "length" not in f.free for f in gauges.features
    ):
        return True
    readings = [
        gauges.length[gauges.feature == k]
        for k, f in enumerate(gauges.features)
        if f.kind == "wire"
    ]
    readings += [problem.data.position[gauges.of("point", "xyz"[a]), a] for a in range(3)]
    if any(len(r) and np.ptp(r) > APART_MM for r in readings):
        return True
    return any(
        sum(
            f.kind == kind and f.position is not None and "tz" not in f.free
            for f in gauges.features
        )
        >= count
        for kind, count in KNOWN.items()
    )


def turned(problem: Problem | Source) -> bool:
    """Whether touched points stand alone: no row is measured in a frame, no feature is known. Of
    wires and planes the columns say so themselves; touched points seem to tell, by as much as they
    miss each other on the nominal arm."""
    if isinstance(problem, Source) or (gauges := problem.data.gauges) is None:
        return False
    known = any(f.kind != "distance" and not {"tx", "tz"} & set(f.free) for f in gauges.features)
    return (
        bool(gauges.of("same-point").any())
        and not known
        and not gauges.of("point", "x", "y", "z").any()
    )


def as_drawn(found: Identified, problem: Problem | Source, terms: Sequence[Term]) -> Identified:
    """Without the representatives that these data leave as drawn: the way the base looks, and the
    largest length of the arm where they measure none and every length is open."""
    if turned(problem):
        base = [
            k
            for k in found.kept
            if [(s.frame, s.axis[0], s.cause) for s in terms[k].screws] == [(1, "r", ONE)]
        ]
        found = replace(
            found, kept=tuple(k for k in found.kept if k not in base), still=tuple(base)
        )
    if sized(problem) or isinstance(problem, Source):
        return found
    robot = problem.robot
    lengths = {
        (f + 1, "xyz"[i]): v for f, fixed in enumerate(robot.fixed[:-1]) for i, v in fixed.offset
    }
    last = np.zeros(3)
    for i, v in robot.fixed[-1].offset:
        last[i] = v
    lengths |= {
        (robot.n + 1, "xyz"[i]): float(v) for i, v in enumerate(last + problem.tools[0]) if v
    }
    place = {
        (t.screws[0].frame, t.screws[0].axis[1:]): k
        for k, t in enumerate(terms)
        if len(t.screws) == 1
        and t.screws[0].axis[0] == "t"
        and isinstance(t.screws[0].cause, Number)
    }
    if not lengths.keys() <= place.keys():
        return found
    direction = np.zeros(len(terms))
    for key, value in lengths.items():
        direction[place[key]] = value
    own = np.abs(direction @ found.relation)
    open_ = [i for i, k in enumerate(found.exact) if k in place.values() and k in found.kept]
    if not open_ or not own[open_].any():
        return found
    held = found.exact[max(open_, key=lambda i: float(own[i]))]
    return replace(found, kept=tuple(k for k in found.kept if k != held), held=held)
