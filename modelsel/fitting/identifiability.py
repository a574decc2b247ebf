"""What the data determine: the rank, a stable choice of representatives, the relations among
dependent columns."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from .._typing import Array
from ..measurements.features import Feature
from ..measurements.measurements import Gauges
from ..mechanisms.causes import ONE, Number
from ..mechanisms.terms import Term
from .problem import Problem
from .reduction import Reduction, Source, independent

MIN_COLUMN = 1e-13  # of the largest column's norm: a smaller column is zero
# spread [mm] of readings from which the size of the arm is known
MIN_READING_SPREAD_MM = 1.0
# how many features of a kind, at known places, tell the size of the arm
FEATURES_THAT_TELL_SIZE = {"same-point": 2, "plane": 4}


@dataclass(frozen=True, eq=False)
class Identified:
    """Which terms are fitted and which represent others.

    `kept`: indices of the fitted terms, in the columns' order: of `identify` the representatives;
    `scale` (p,) norms of the columns; `triangle` (p, p); `exact`: the representatives, whatever
    else is fitted; `held`: the length that stays as drawn where the data measure none, `still`:
    the base's rotations where they do not say which way it looks (see `as_drawn`)."""

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
        if not self.kept:
            return 1.0
        kept = list(self.kept)
        unit = self.triangle[:, kept] / self.scale[kept]
        singular = np.linalg.svd(unit, compute_uv=False)
        return float(singular[0] / singular[-1])

    @property
    def zero(self) -> tuple[int, ...]:
        """Columns that move nothing."""
        limit = MIN_COLUMN * self.scale.max(initial=0)
        return tuple(np.flatnonzero(self.scale <= limit).tolist())


def identify(reduction: Reduction) -> Identified:
    """Determine the rank by sequential orthogonalisation of the unit columns, in their order: an
    earlier column represents a later one that depends on it, so the choice does not hang on the
    data. A column below 1e-13 of the largest is zero."""
    R = reduction.R[: reduction.p, : reduction.p]
    kept, scale = independent(R)
    return Identified(tuple(kept), scale, R, tuple(kept))


def without(identified: Identified, lost: set[int]) -> Identified:
    """Return what is identified with some representatives fixed: a target 0.7 mm off the last axis
    makes combinations estimable on paper that need radians to move it by a micrometre, and least
    squares would put such radians in."""
    return replace(identified, kept=tuple(k for k in identified.kept if k not in lost))


def solve(reduction: Reduction, kept: Sequence[int]) -> tuple[Array, Array, float]:
    """Solve for the kept columns: (their estimate (k,), their unscaled covariance factor R⁻¹
    (k, k) with cov = R⁻¹R⁻ᵀ, the residual sum of squares)."""
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


# -- what stays as drawn: how long is the arm, and which way does it look?
# ------------------------------------------------------------------------------------------------------

# Planes, touched points and bars of unknown length do not say how long the arm is: an arm of half
# the size meets them all.


def measures_a_length(problem: Problem | Source) -> bool:
    """Return whether some row measures a length: a coordinate, a wire, a distance, a bar of known
    length, features at known places. An arm with a slide has one of its own."""
    if isinstance(problem, Source) or problem.only_points:
        return True
    if any(joint.prismatic for joint in problem.robot.joints):
        return True
    gauges = problem.observed()
    if gauges.of("distance").any() or any(map(_has_known_length, gauges.features)):
        return True
    spread = max(map(_spread, _length_readings(problem, gauges)), default=0.0)
    return spread > MIN_READING_SPREAD_MM or _known_features_tell_size(gauges.features)


def _has_known_length(feature: Feature) -> bool:
    return feature.kind in ("wire", "ball-bar") and "length" not in feature.free


def _length_readings(problem: Problem, gauges: Gauges) -> Iterator[Array]:
    """Readings of each wire, and of each coordinate measured alone [mm]."""
    for number, feature in enumerate(gauges.features):
        if feature.kind == "wire":
            yield gauges.length[gauges.feature == number]
    for a, axis in enumerate("xyz"):
        yield problem.data.position[gauges.of("point", axis), a]


def _spread(readings: Array) -> float:
    return float(np.ptp(readings)) if len(readings) else 0.0


def _known_features_tell_size(features: Sequence[Feature]) -> bool:
    """Whether so many features of a kind stand at known places."""
    known = [f.kind for f in features if f.position is not None and "tz" not in f.free]
    return any(known.count(kind) >= count for kind, count in FEATURES_THAT_TELL_SIZE.items())


def measures_no_direction(problem: Problem | Source) -> bool:
    """Return whether touched points stand alone: no row is measured in a frame, no feature is
    known. Of wires and planes the columns say so themselves; touched points seem to tell the
    direction, by as much as they miss each other on the nominal arm."""
    if isinstance(problem, Source) or problem.only_points:
        return False
    gauges = problem.observed()
    touched = bool(gauges.of("same-point").any())
    framed = bool(gauges.of("point", "x", "y", "z").any())
    known = any(f.kind != "distance" and not {"tx", "tz"} & set(f.free) for f in gauges.features)
    return touched and not framed and not known


def as_drawn(
    identified: Identified, problem: Problem | Source, terms: Sequence[Term]
) -> Identified:
    """Return what is identified without the representatives that these data leave as drawn: the
    way the base looks, and the largest length of the arm where the data measure none and every
    length is open."""
    if measures_no_direction(problem):
        turns = tuple(k for k in identified.kept if _turns_base(terms[k]))
        kept = tuple(k for k in identified.kept if k not in turns)
        identified = replace(identified, kept=kept, still=turns)
    if isinstance(problem, Source) or measures_a_length(problem):
        return identified
    held = _length_to_hold(identified, terms, _drawn_lengths(problem))
    if held is None:
        return identified
    return replace(identified, kept=tuple(k for k in identified.kept if k != held), held=held)


def _turns_base(term: Term) -> bool:
    """Whether a term is a constant rotation of the base."""
    return [(s.frame, s.axis[0], s.cause) for s in term.screws] == [(1, "r", ONE)]


def _drawn_lengths(problem: Problem) -> dict[tuple[int, str], float]:
    """(frame, "x", "y" or "z") -> the drawing's lengths [mm] that are not zero, to the target."""
    robot = problem.robot
    lengths = {}
    for frame, fixed in enumerate(robot.fixed[:-1], 1):
        for axis, value in fixed.offset:
            lengths[frame, "xyz"[axis]] = value
    last = problem.tools[0].copy()
    for axis, value in robot.fixed[-1].offset:
        last[axis] = value + problem.tools[0, axis]
    for axis, value in enumerate(last):
        if value:
            lengths[robot.n + 1, "xyz"[axis]] = float(value)
    return lengths


def _length_to_hold(
    identified: Identified, terms: Sequence[Term], lengths: dict[tuple[int, str], float]
) -> int | None:
    """The fitted length that has most of a change of the arm's size; None where not every length
    is a term, or none of them is open."""
    term_of = {}
    for k, term in enumerate(terms):
        if _is_constant_shift(term):
            term_of[term.screws[0].frame, term.screws[0].axis[1:]] = k
    if not lengths.keys() <= term_of.keys():
        return None
    direction = np.zeros(len(terms))
    for place, value in lengths.items():
        direction[term_of[place]] = value
    share = np.abs(direction @ identified.relation)
    shifts = term_of.values()
    is_open = [i for i, k in enumerate(identified.exact) if k in shifts and k in identified.kept]
    if not is_open or not share[is_open].any():
        return None
    return identified.exact[max(is_open, key=lambda i: float(share[i]))]


def _is_constant_shift(term: Term) -> bool:
    if len(term.screws) != 1:
        return False
    screw = term.screws[0]
    return screw.axis[0] == "t" and isinstance(screw.cause, Number)
