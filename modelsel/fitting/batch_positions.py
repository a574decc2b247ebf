"""The target's position at many parameter values at once, carried from the flange back to the base.

x = N_1 H_1 T_1 (… (Last (tool + t_{n+1}))), a third of the work of the whole pose (`robot.pose`, its
referee in the tests). Points are homogeneous rows, so that all that is alike at every configuration
of a draw is one product of matrices; x and y together are a complex number, so that a turn about z
is one multiplication.
"""

from __future__ import annotations

from collections.abc import Container, Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from .._typing import Array
from ..robot.rigid import transform
from .problem import Problem

Place = tuple[int, int]
Twist = Mapping[Place, Array]
Turns = NDArray[np.complex128]

# the first axis of the angles among a frame's six entries, and that of z
ANGLES, ABOUT_Z = 3, 5
# the two axes that a turn mixes, in right-handed order
MIXED = {3: (1, 2), 4: (2, 0)}
# [rad] up to which four terms of the sine's series are exact to rounding
SMALL_ANGLE = 0.04
SINE = (-1 / 5040, 1 / 120, -1 / 6)


@dataclass(frozen=True, eq=False)
class BatchPositions:
    """The chain of a problem's m configurations, made ready for many parameter values.

    turns: (n, m) cos q + i sin q of every joint reading; one where the joint slides.
    """

    problem: Problem
    turns: Turns

    @classmethod
    def prepare(cls, problem: Problem) -> BatchPositions:
        """Prepare the chain of a problem's configurations."""
        turns = np.exp(1j * problem.data.q.T)
        for k, joint in enumerate(problem.robot.joints):
            if joint.prismatic:
                turns[k] = 1
        return cls(problem, turns)

    def residuals(self, twist: Twist, draws: int) -> Array:
        """Subtract predicted from measured positions, (D, 3, m) [mm].

        twist: entries (D, m), or (D, 1) where they are alike, of places (frame, axis)."""
        data = self.problem.data
        points = self._carry(twist, draws)
        predicted = points.transpose(1, 0, 2) @ self._placements
        left = np.empty((draws, 3, len(self.problem)))
        for axis in range(3):
            left[:, axis] = data.position[:, axis] - predicted[..., axis].T
        return left

    @cached_property
    def _before(self) -> Array:
        """(n, 1, 4, 4), transposed: the fixed transform before every joint."""
        before = [joint.before.T for joint in self.problem.robot.joints]
        return np.stack(before)[:, None]

    @cached_property
    def _placements(self) -> Array:
        """(m, 4, 4), transposed: from frame 0 to the tracker of every configuration."""
        rotations, origins = self.problem.placement
        group = self.problem.data.group
        pairs = zip(rotations, origins, strict=True)
        placed = np.stack([transform(R, t).T for R, t in pairs])
        return np.asarray(placed[group])

    def _carry(self, twist: Twist, draws: int) -> Array:
        """Compute the target's position in frame 0, (D, m, 4) [mm], the last coordinate one."""
        problem = self.problem
        robot = problem.robot
        turns = self._turn_joints(twist, draws)
        points = np.ones((draws, len(problem), 4))
        points[..., :3] = problem.tool
        for axis in range(3):
            if (robot.n, axis) in twist:
                points[..., axis] += twist[robot.n, axis]
        points = points @ robot.last.T
        varying = {
            k for (k, axis), values in twist.items() if axis < ABOUT_Z and values.shape[1] > 1
        }
        moves = self._constant_moves(twist, draws, varying)
        for k in range(robot.n - 1, -1, -1):
            if robot.joints[k].prismatic:
                points[..., 2] += problem.data.q[:, k]
            # x and y as a complex number
            points.view(complex)[..., 0] *= turns[k]
            if k in varying:
                _move_rows(points, twist, k)
            points = points @ moves[k]
        return points

    def _turn_joints(self, twist: Twist, draws: int) -> Turns:
        """Compute the turn (n, D, m) about z of every joint, its reading and its entry together."""
        joints, rows = self.turns.shape
        angle = np.zeros((joints, draws, rows))
        for k in range(joints):
            if (k, ABOUT_Z) in twist:
                angle[k] = twist[k, ABOUT_Z]
        turn = np.empty(angle.shape, complex)
        turn.real, turn.imag = cos_sin(angle)
        turn *= self.turns[:, None]
        return turn

    def _constant_moves(self, twist: Twist, draws: int, varying: Container[int]) -> Array:
        """Compute (n, D, 4, 4), transposed: of every joint, what follows the turn about z; of those
        whose frame's entries vary from row to row, without these."""
        joints = self.problem.robot.n
        entries = np.zeros((ABOUT_Z, joints, draws))
        for (k, axis), values in twist.items():
            if k < joints and axis < ABOUT_Z and k not in varying:
                entries[axis, k] = values[:, 0]
        cosine, sine = cos_sin(entries[ANGLES:])
        moves = np.zeros((joints, draws, 4, 4))
        # Rx Ry, transposed
        moves[..., 0, 0] = cosine[1]
        moves[..., 2, 0] = sine[1]
        moves[..., 0, 1] = sine[0] * sine[1]
        moves[..., 1, 1] = cosine[0]
        moves[..., 2, 1] = -sine[0] * cosine[1]
        moves[..., 0, 2] = -cosine[0] * sine[1]
        moves[..., 1, 2] = sine[0]
        moves[..., 2, 2] = cosine[0] * cosine[1]
        moves[..., 3, :3] = entries[:ANGLES].transpose(1, 2, 0)
        moves[..., 3, 3] = 1
        return np.asarray(moves @ self._before)


def _move_rows(points: Array, twist: Twist, k: int) -> None:
    """Move points (D, m, 4), in place, by the entries of frame k + 1, that about z apart."""
    # Trans Rx Ry, from the right
    for axis in (4, 3, 2, 1, 0):
        values = twist.get((k, axis))
        if values is None:
            continue
        if axis < ANGLES:
            points[..., axis] += values
            continue
        i, j = MIXED[axis]
        cosine, sine = cos_sin(values)
        first, second = points[..., i].copy(), points[..., j]
        points[..., i] = cosine * first - sine * second
        points[..., j] = sine * first + cosine * second


def cos_sin(angle: Array) -> tuple[Array, Array]:
    """Compute cosine and sine; where all angles are small by the series, several times as fast."""
    if not np.abs(angle).max(initial=0.0) < SMALL_ANGLE:
        return np.cos(angle), np.sin(angle)
    square = angle * angle
    sine = square * SINE[0]
    for coefficient in SINE[1:]:
        sine += coefficient
        sine *= square
    sine *= angle
    sine += angle
    np.multiply(sine, sine, out=square)
    np.subtract(1, square, out=square)
    return np.sqrt(square, out=square), sine
