"""The exact chain at many parameter values at once: a row is one draw at one configuration, and no
loop runs over draws.

Where only positions are measured, the target's position alone is carried along
(`batch_positions`)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from .._typing import Array, Index
from ..mechanisms.terms import Term
from ..robot.kinematics import pose
from ..robot.rigid import rotation_vector
from .batch_positions import BatchPositions, Place, Twist
from .design import PLACE
from .linearisation import add_feature_changes
from .observation import predict_readings
from .problem import Problem

ROWS = 8192  # draws x configurations in one block: its arrays stay in cache


@dataclass(frozen=True, eq=False)
class Ensemble:
    """A problem and the terms of a model, made ready for many parameter values."""

    problem: Problem
    terms: Sequence[Term]
    _places: dict[Place, tuple[Index, Array]] = field(init=False, repr=False)

    def __post_init__(self) -> None:
        terms_at: dict[Place, list[int]] = {}
        causes_at: dict[Place, list[Array]] = {}
        for k, term in enumerate(self.terms):
            for s in term.screws:
                place = s.frame - 1, PLACE[s.axis]
                cause = np.asarray(self.problem.cause(s.cause), float)
                terms_at.setdefault(place, []).append(k)
                causes_at.setdefault(place, []).append(cause)
        places = {}
        for place in sorted(terms_at):
            index = np.array(terms_at[place], dtype=np.intp)
            places[place] = index, self._stacked(causes_at[place])
        object.__setattr__(self, "_places", places)

    def _stacked(self, causes: Sequence[Array]) -> Array:
        """Stack causes as (k, m), or (k, 1) where all are constant."""
        are_constant = all(cause.ndim == 0 for cause in causes)
        if are_constant:
            numbers = [cause.reshape(1) for cause in causes]
            return np.stack(numbers)
        rows = len(self.problem)
        shape = (rows,)
        columns = [np.broadcast_to(cause, shape) for cause in causes]
        return np.stack(columns)

    @cached_property
    def _positions(self) -> BatchPositions:
        """The chain, where only positions are measured."""
        return BatchPositions.prepare(self.problem)

    @cached_property
    def _constant(self) -> tuple[dict[Place, int], Array]:
        """Columns of the entries that are alike at every configuration, and the matrix (p, k) that
        makes them of the parameters."""
        places = [place for place, (_, causes) in self._places.items() if causes.shape[1] == 1]
        matrix = np.zeros((len(self.terms), len(places)))
        for column, place in enumerate(places):
            index, causes = self._places[place]
            np.add.at(matrix[:, column], index, causes[:, 0])
        return {place: column for column, place in enumerate(places)}, matrix

    def twist(self, theta: Array) -> dict[Place, Array]:
        """(frame, axis) -> entries (D, m), or (D, 1) where they are alike at every configuration,
        at theta (D, p)."""
        columns, matrix = self._constant
        constant = theta @ matrix
        entries = {}
        for place, (index, causes) in self._places.items():
            if place in columns:
                column = columns[place]
                end = column + 1
                entries[place] = constant[:, column:end]
            else:
                entries[place] = theta[:, index] @ causes
        return entries

    def residuals(self, theta: Array, more: Twist | None = None) -> Array:
        """Compute the whitened exact residuals (D, c, m) at parameters theta (D, p); `more`: further entries
        (D, m) of some places."""
        problem, D, m = self.problem, len(theta), len(self.problem)
        out = np.empty((D, problem.components, m))
        step = max(1, ROWS // m)
        for start in range(0, D, step):
            draws = slice(start, min(start + step, D))
            twist = self.twist(theta[draws])
            for place, values in (more or {}).items():
                twist[place] = twist.get(place, np.zeros((1, 1))) + values[draws]
            left = self._subtract_predicted(twist, draws.stop - start)
            if self._bare is not None:
                left = self._read(left, theta[draws])
            out[draws] = problem.whitening.apply(left)
        return out

    def _subtract_predicted(self, twist: Twist, D: int) -> Array:
        """Subtract predicted from measured (D, c, m), of the rows as points."""
        bare = self._bare
        if bare is not None:
            return bare._subtract_predicted(twist, D)
        if self.problem.components == 3:
            return self._positions.residuals(twist, D)
        return self._poses(twist, D)

    @cached_property
    def _bare(self) -> Ensemble | None:
        """The same rows as points measured at nought, where not every row is a point."""
        if self.problem.only_points:
            return None
        bare = self.problem.bare
        return Ensemble(bare, ())

    @cached_property
    def _origin(self) -> Ensemble | None:
        origin = self.problem.origin
        if origin is None:
            return None
        return Ensemble(origin, self.terms)

    def _read(self, left: Array, theta: Array) -> Array:
        """Subtract predicted from measured (D, c, m), of what the rows read, from the target's position with
        its sign turned."""
        problem = self.problem
        gauges = problem.observed()
        x = -left[:, :3]
        origin_x = None
        if self._origin is not None:
            origin = self._origin
            twist = origin.twist(theta)
            origin_left = origin._subtract_predicted(twist, len(theta))
            origin_x = -origin_left[:, :3]
        count = len(gauges.features)
        change = add_feature_changes(count, self.terms, theta)
        predicted = predict_readings(gauges, problem.fixtures, change, x, origin_x)
        left[:, :3] = problem.readings - predicted
        return left * problem.components_measured.T

    def _poses(self, twist: Twist, D: int) -> Array:
        """Subtract predicted from measured poses, (D, 6, m) [mm, rad]."""
        problem = self.problem
        data = problem.data
        m = len(problem)
        frames = problem.robot.n + 1
        whole = np.zeros((frames, 6, D, m))
        for place, values in twist.items():
            whole[place] = values
        configurations = np.arange(m)
        rows = np.tile(configurations, D)
        tool_rotation = problem.tool_rotations
        if tool_rotation is not None:
            target_of_rows = data.target[rows]
            tool_rotation = tool_rotation[target_of_rows]
        entries = whole.reshape(frames, 6, D * m)
        at = pose(problem.robot, data.q[rows], problem.tool[rows], entries, tool_rotation)
        target = at.target.reshape(3, D, m)
        rotation = at.rotation.reshape(3, 3, D, m)
        rotations, origins = problem.placement
        R = rotations[data.group]
        t = origins[data.group]
        out = np.empty((D, 6, m))
        predicted = np.einsum("mij,jdm->dim", R, target)
        from_origin = data.position - t
        measured = from_origin.T
        out[:, :3] = measured - predicted
        assert data.rotation is not None
        # the measured orientation, in frame 0's axes
        seen = np.einsum("mji,mjk->mik", R, data.rotation)
        turned = np.einsum("mij,kjdm->dmik", seen, rotation)
        vectors = _vector(turned)
        turn = vectors.transpose(0, 2, 1)
        out[:, 3:] = np.einsum("mij,djm->dim", R, turn)
        return out


def _vector(R: Array) -> Array:
    """(..., 3) rotation vectors; scipy's only where a rotation is so large that its skew part does
    not tell the angle."""
    skew = 0.5 * np.stack(
        [R[..., 2, 1] - R[..., 1, 2], R[..., 0, 2] - R[..., 2, 0], R[..., 1, 0] - R[..., 0, 1]], -1
    )
    trace = np.einsum("...ii->...", R)
    if trace.min() < 0.5:
        return rotation_vector(R.reshape(-1, 3, 3)).reshape(skew.shape)
    size = np.linalg.norm(skew, axis=-1)
    angle = np.arctan2(size, (trace - 1) / 2)
    return np.asarray(skew * np.where(size > 0, angle / np.maximum(size, 1e-300), 1.0)[..., None])
