"""What the data determine: the rank, a stable choice of representatives, the relations among
dependent columns."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from .._typing import Array
from ..measurements.campaign.features import Feature
from ..measurements.gauges import Gauges
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
    """Which terms are fitted, and which represent others that depend on them.

    `kept`: indices of the fitted terms, in the columns' order; `identify` gives the representatives;
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

    def confine(self, theta: Array) -> Array:
        """Return parameters (p,) with those that are not fitted at zero."""
        return np.where(np.isin(np.arange(len(theta)), self.kept), theta, 0.0)

    @cached_property
    def relation(self) -> Array:
        """Coefficients (p, len(exact)) of every column in the exact representatives."""
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
        scale = self.scale[kept]
        columns = self.triangle[:, kept]
        unit = columns / scale
        singular = np.linalg.svd(unit, compute_uv=False)
        largest = singular[0]
        return float(largest / singular[-1])

    @property
    def zero(self) -> tuple[int, ...]:
        """Columns that are zero: they move nothing."""
        scale = self.scale
        largest = scale.max(initial=0)
        limit = MIN_COLUMN * largest
        is_zero = scale <= limit
        columns = np.flatnonzero(is_zero)
        return tuple(columns.tolist())


def identify(reduction: Reduction) -> Identified:
    """Determine the rank by sequential orthogonalisation of the unit columns, in their order: an
    earlier column represents a later one that depends on it, so the choice does not depend on the
    data. A column below 1e-13 of the largest is zero."""
    p = reduction.p
    triangle = reduction.R[:p, :p]
    columns, scale = independent(triangle)
    representatives = tuple(columns)
    return Identified(kept=representatives, scale=scale, triangle=triangle, exact=representatives)


def without(identified: Identified, lost: set[int]) -> Identified:
    """Return what is identified with some representatives fixed.

    A target 0.7 mm off the last axis makes combinations estimable on paper that need radians to move
    it by a micrometre, and least squares would fit such radians."""
    return replace(identified, kept=tuple(k for k in identified.kept if k not in lost))


def solve(reduction: Reduction, kept: Sequence[int]) -> tuple[Array, Array, float]:
    """Solve for the kept columns: (their estimate (k,), their unscaled covariance factor R⁻¹
    (k, k) with cov = R⁻¹R⁻ᵀ, the residual sum of squares)."""
    from scipy.linalg import solve_triangular

    inner = reduction.select(kept)
    k = len(kept)
    R = inner.R
    rss = float(R[k, k] ** 2)
    if not k:
        nothing = np.zeros(0)
        return nothing, np.zeros((0, 0)), rss
    columns = R[:k, :k]
    response = R[:k, k]
    scale = np.linalg.norm(columns, axis=0)
    T = columns / scale
    identity = np.eye(k)
    unit_estimate = solve_triangular(T, response)
    unit_factor = solve_triangular(T, identity)
    estimate = unit_estimate / scale
    row_scale = scale[:, None]
    factor = unit_factor / row_scale
    return estimate, factor, rss


# -- what stays as drawn: how long is the arm, and which way does it look?
# ------------------------------------------------------------------------------------------------------

# Planes, touched points and bars of unknown length do not say how long the arm is: an arm of half
# the size meets them all.


def measures_a_length(problem: Problem | Source) -> bool:
    """Return whether some row measures a length: a coordinate, a wire, a distance, a bar of known
    length, features at known places. An arm with a slide has one of its own."""
    if isinstance(problem, Source) or problem.only_points:
        return True
    has_slide = any(joint.prismatic for joint in problem.robot.joints)
    if has_slide:
        return True
    gauges = problem.observed()
    has_distance = bool(gauges.of("distance").any())
    has_known_length = any(map(_has_known_length, gauges.features))
    if has_distance or has_known_length:
        return True
    readings = _length_readings(problem, gauges)
    spread = max(map(_spread, readings), default=0.0)
    if spread > MIN_READING_SPREAD_MM:
        return True
    return _known_features_tell_size(gauges.features)


def _has_known_length(feature: Feature) -> bool:
    return feature.kind in ("wire", "ball-bar") and "length" not in feature.free


def _length_readings(problem: Problem, gauges: Gauges) -> Iterator[Array]:
    """Yield the readings of each wire, and of each coordinate measured alone [mm]."""
    lengths = gauges.length
    data = problem.data
    positions = data.position
    for number, feature in enumerate(gauges.features):
        if feature.kind == "wire":
            rows = gauges.feature == number
            yield lengths[rows]
    for a, axis in enumerate("xyz"):
        rows = gauges.of("point", axis)
        yield positions[rows, a]


def _spread(readings: Array) -> float:
    if not len(readings):
        return 0.0
    return float(np.ptp(readings))


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
        fitted = identified.kept
        turns = tuple(k for k in fitted if _turns_base(terms[k]))
        others = tuple(k for k in fitted if k not in turns)
        identified = replace(identified, kept=others, still=turns)
    if isinstance(problem, Source):
        return identified
    has_length = measures_a_length(problem)
    if has_length:
        return identified
    lengths = _drawn_lengths(problem)
    held = _length_to_hold(identified, terms, lengths)
    if held is None:
        return identified
    kept = tuple(k for k in identified.kept if k != held)
    return replace(identified, kept=kept, held=held)


def _turns_base(term: Term) -> bool:
    """Whether a term is a constant rotation of the base."""
    return [(s.frame, s.axis[0], s.cause) for s in term.screws] == [(1, "r", ONE)]


def _drawn_lengths(problem: Problem) -> dict[tuple[int, str], float]:
    """Map (frame, "x", "y" or "z") to the nominal lengths [mm] that are not zero, to the target."""
    robot = problem.robot
    lengths = {}
    fixed_transforms = robot.fixed
    *links, flange = fixed_transforms
    for frame, fixed in enumerate(links, 1):
        for number, value in fixed.offset:
            axis = "xyz"[number]
            lengths[frame, axis] = value
    tool = problem.tools[0]
    last = tool.copy()
    for number, value in flange.offset:
        last[number] = value + tool[number]
    target_frame = robot.n + 1
    for axis, value in zip("xyz", last, strict=True):
        if value:
            lengths[target_frame, axis] = float(value)
    return lengths


def _length_to_hold(
    identified: Identified, terms: Sequence[Term], lengths: dict[tuple[int, str], float]
) -> int | None:
    """The fitted length that has most of a change of the arm's size; None where not every length
    is a term, or none of them is open."""
    term_of = {}
    for k, term in enumerate(terms):
        if _is_constant_shift(term):
            screw = term.screws[0]
            axis = screw.axis[1:]
            term_of[screw.frame, axis] = k
    all_open = lengths.keys() <= term_of.keys()
    if not all_open:
        return None
    count = len(terms)
    direction = np.zeros(count)
    for place, value in lengths.items():
        number = term_of[place]
        direction[number] = value
    part = direction @ identified.relation
    share = np.abs(part)
    shifts = set(term_of.values())
    fitted = shifts & set(identified.kept)
    exact = identified.exact
    is_open = [i for i, k in enumerate(exact) if k in fitted]
    if not is_open:
        return None
    open_share = share[is_open]
    if not open_share.any():
        return None
    most = int(np.argmax(open_share))
    return exact[is_open[most]]


def _is_constant_shift(term: Term) -> bool:
    if len(term.screws) != 1:
        return False
    screw = term.screws[0]
    is_shift = screw.axis[0] == "t"
    return is_shift and isinstance(screw.cause, Number)
