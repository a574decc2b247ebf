"""The workspace: measured and drawn configurations, and what an effect does to the target there.

The drawn ones lie within the joints' limits (within the measured range of a joint that has none);
what else a cause may look at, as temperature or the direction of approach, is that of a measured
row. Displacements are linear in the effect's numbers, on the nominal chain."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from ..._linalg import TINY
from ..._typing import Array, Index
from ...fitting.design import PLACE, compute_columns, field_of
from ...fitting.problem import Problem
from ...measurements.campaign.reference_temperature import TEMPERATURE
from ...mechanisms.causes import Cause
from ...mechanisms.terms import Term
from ...robot.kinematics import Pose

# measured rows that are looked at, and configurations that are drawn
MAX_MEASURED = 4000
DRAWN = 4000
# standard errors from an estimate to the ends of its 95 % interval
NORMAL_95 = 1.96
# share of the longest vector by which equal ones may differ
ROUNDING = 1e-9


@dataclass(frozen=True)
class Range:
    """A value with its 95 % interval, which is None where it has no error."""

    value: float
    low: float | None = None
    high: float | None = None

    def scale(self, factor: float) -> Range:
        """Return the range in another unit, by a positive factor."""
        low = None if self.low is None else self.low * factor
        high = None if self.high is None else self.high * factor
        return Range(self.value * factor, low, high)

    def invert(self, numerator: float) -> Range:
        """Return numerator over the range; the upper end is None where the range reaches zero."""
        low = None if not self.high else numerator / self.high
        high = None if not self.low else numerator / self.low
        return Range(numerator / max(self.value, TINY), low, high)


@dataclass(frozen=True, eq=False)
class Workspace:
    """Rows where effects are looked at: `problem` has them as points, the first `measured` of them
    measured, the others drawn; `oriented`: orientations were measured."""

    problem: Problem
    measured: int
    oriented: bool = False

    @property
    def q(self) -> Array:
        """Joint readings (m, n) of all rows."""
        return self.problem.data.q

    @cached_property
    def pose(self) -> Pose:
        """The nominal chain at all rows."""
        return self.problem.pose(slice(0, len(self.problem)))

    @cached_property
    def field(self) -> Array:
        """The screw field (n+1, 6, 3, m) of all rows."""
        return field_of(self.problem, self.pose, slice(0, len(self.problem)))

    @cached_property
    def turning(self) -> Array:
        """The target's turning (n+1, 6, 3, m) per unit screw at all rows, in frame 0 [rad]."""
        axes = self.pose.axes
        rotations = axes[:, 3:]
        turned = np.zeros_like(axes)
        turned[:, 3:] = rotations
        return turned

    @cached_property
    def measured_range(self) -> tuple[Array, Array]:
        """The measured range of every joint (n,): lowest and highest reading."""
        readings = self.q[: self.measured]
        return readings.min(0), readings.max(0)

    def find_unmeasured(self, row: int) -> tuple[int, ...]:
        """Find the joints that stand beyond their measured range at a row."""
        low, high = self.measured_range
        readings = self.q[row]
        is_beyond = (readings < low) | (readings > high)
        beyond = np.flatnonzero(is_beyond)
        joints = beyond + 1
        numbers = joints.tolist()
        return tuple(numbers)

    def displace(self, terms: Sequence[Term]) -> Array:
        """Compute the target's displacement (k, 3, m) per unit of every term [mm]."""
        return compute_columns(self.problem, self.field, terms, slice(0, len(self.problem)))

    def turn_target(self, terms: Sequence[Term]) -> Array:
        """Compute the target's turning (k, 3, m) per unit of every term, in frame 0 [rad]."""
        return compute_columns(self.problem, self.turning, terms, slice(0, len(self.problem)))

    def twist(self, term: Term, frame: int, axes: slice) -> Array:
        """Compute the twist (axes, m) of a frame per unit of a term [mm, rad]."""
        out = np.zeros((6, len(self.problem)))
        for screw in term.screws:
            if screw.frame == frame:
                out[PLACE[screw.axis]] += self.problem.cause(screw.cause)
        return out[axes]

    def has_both_sides(self, cause: Cause) -> bool:
        """Return whether a cause has either sign among the measured rows."""
        rows = len(self.q)
        count = self.measured
        values = self.problem.cause(cause)
        everywhere = np.broadcast_to(values, rows)
        measured = everywhere[:count]
        low = measured.min()
        high = measured.max()
        is_both = low < 0 < high
        return bool(is_both)

    def at_covariate(self, name: str, value: float) -> Workspace:
        """Return the workspace with one covariate held at a value; what follows it late has long
        followed."""
        data = self.problem.data
        covariates = {**data.covariates, name: np.full(len(data), value)}
        late = None if name == TEMPERATURE else data.late_temperature
        held = replace(data, covariates=covariates, late_temperature=late)
        problem = replace(self.problem, data=held)
        return replace(self, problem=problem)


def build_workspace(problem: Problem, rng: np.random.Generator) -> Workspace:
    """Build the workspace: the measured rows of a problem, and drawn ones."""
    plain = problem.plain_points()
    rows = np.flatnonzero(np.isfinite(plain.data.q).all(1))
    if len(rows) > MAX_MEASURED:
        steps = np.linspace(0, len(rows) - 1, MAX_MEASURED).astype(int)
        rows = rows[steps]
    picked: Index = rng.choice(rows, DRAWN)
    everything = plain.take(np.concatenate([rows, picked]))
    q = everything.data.q.copy()
    q[len(rows) :] = _draw_readings(problem, q[: len(rows)], rng)
    data = replace(everything.data, q=q)
    oriented = problem.components > 3
    return Workspace(replace(everything, data=data), len(rows), oriented)


def _draw_readings(problem: Problem, measured: Array, rng: np.random.Generator) -> Array:
    ends = []
    for joint, readings in zip(problem.robot.joints, measured.T, strict=True):
        ends.append(joint.limits or (readings.min(), readings.max()))
    low, high = np.array(ends).T
    return rng.uniform(low, high, (DRAWN, len(ends)))


@dataclass(frozen=True, eq=False)
class Fitted:
    """An effect in the workspace: its terms, their estimate (k,) and its covariance (k, k).

    `reaches`: whether it is told of what was not measured, too; a shape that the data alone drew is
    not."""

    terms: tuple[Term, ...]
    estimate: Array
    covariance: Array
    workspace: Workspace
    reaches: bool = True
    _columns: list[Array] = field(default_factory=list, repr=False)

    @property
    def columns(self) -> Array:
        """The target's displacement (k, 3, m) per unit of every term."""
        if not self._columns:
            columns = self.workspace.displace(self.terms)
            self._columns.append(columns)
        return self._columns[0]

    def moved(self) -> Array:
        """Compute the target's displacement (3, m) [mm]."""
        return np.asarray(np.tensordot(self.estimate, self.columns, 1))

    @cached_property
    def target_turns(self) -> Array:
        """The target's turning (k, 3, m) per unit of every term [rad]."""
        return self.workspace.turn_target(self.terms)

    def turned(self) -> Array:
        """Compute the target's turning (3, m) [rad]."""
        return np.asarray(np.tensordot(self.estimate, self.target_turns, 1))

    def turn(self, frame: int, axes: slice) -> tuple[Array, Array]:
        """Compute what the effect does at a frame, (axes, m), and (k, axes, m) of every term."""
        each = np.stack([self.workspace.twist(term, frame, axes) for term in self.terms])
        return np.asarray(np.tensordot(self.estimate, each, 1)), each

    def length_at(self, vector: Array, each: Array, row: int) -> Range:
        """Return the length of a vector (d, m) at a row, given every term's share (k, d, m)."""
        here = vector[:, row]
        length = float(np.linalg.norm(here))
        if length == 0:
            return Range(0.0, 0.0, 0.0)
        direction = here / length
        shares = each[:, :, row]
        along = shares @ direction
        return self.range_of(along)

    def range_of(self, gradient: Array) -> Range:
        """Return a positive number that is linear in the terms, with its interval from zero up."""
        value = abs(float(gradient @ self.estimate))
        variance = float(gradient @ self.covariance @ gradient)
        margin = NORMAL_95 * np.sqrt(max(variance, 0.0))
        return Range(value, max(value - margin, 0.0), value + margin)

    def moved_at(self, row: int) -> Range:
        """Return how far the target moves at a row [mm]."""
        return self.length_at(self.moved(), self.columns, row)

    def find_worst(self) -> int:
        """Find the row at which the target moves most."""
        return find_longest(self._leave_out_unreached(self.moved()))

    def turned_at(self, row: int) -> Range:
        """Return how far the target turns at a row [rad]."""
        return self.length_at(self.turned(), self.target_turns, row)

    def find_worst_turn(self) -> int:
        """Find the row at which the target turns most."""
        return find_longest(self._leave_out_unreached(self.turned()))

    def _leave_out_unreached(self, vectors: Array) -> Array:
        """Leave out of vectors (3, m) the rows that it is not told of."""
        if self.reaches:
            return vectors
        measured = self.workspace.measured
        return vectors[:, :measured]


def find_longest(vectors: Array) -> int:
    """Find the longest of vectors (3, m), the first of equal ones."""
    length = np.linalg.norm(vectors, axis=0)
    is_longest = length >= (1 - ROUNDING) * length.max()
    return int(is_longest.argmax())
