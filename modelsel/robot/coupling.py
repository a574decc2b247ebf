"""Coupled joints: motors that turn more than one joint, as in a parallelogram or a wrist.

A reading is of a motor; the joints' angles are q = C · readings. Inside modelsel q are always the
joints' angles: readings become angles as a file is read, and commands become readings as they are
written. An error e of motor k moves every joint j by C[j, k] e."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np

from .._typing import Array

# above it a matrix is as good as singular: a reading would hardly tell the joints
MAX_CONDITION = 1e6


COUPLED = (
    "The readings are of motors: the robot file's coupling makes joint angles of them, and q1, q2, … "
    "are these angles. Directions of approach and moves are the motors'."
)


@dataclass(frozen=True, eq=False)
class Coupling:
    """How motors move the joints: `matrix` C (n, n) with joint angles = C · motor readings;
    `passive`: motors (from 1) that are none, but stand for what a linkage holds at a reading."""

    matrix: Array = field(repr=False)
    passive: tuple[int, ...] = ()

    @property
    def reversed(self) -> tuple[int, ...] | None:
        """The joints (from 1) that only count the other way than their motors; None where motors
        do more than that."""
        signs = np.diagonal(self.matrix)
        is_plain = np.array_equal(self.matrix, np.diag(signs)) and (np.abs(signs) == 1).all()
        if self.passive or not is_plain:
            return None
        return tuple(int(k) + 1 for k in np.flatnonzero(signs < 0))

    def describe_readings(self) -> str:
        """Say how joint angles are made of readings."""
        if not self.reversed:
            return COUPLED
        joints = ", ".join(f"q{joint}" for joint in self.reversed)
        return f"By the robot's file these joints count the other way than they are read: {joints}."

    @property
    def driven(self) -> Array:
        """The columns of the matrix that a controller can move, (n, k)."""
        count = len(self.matrix)
        motors = [motor for motor in range(count) if motor + 1 not in self.passive]
        return self.matrix[:, motors]

    @cached_property
    def inverse(self) -> Array:
        """Readings of the motors per joint angle, (n, n)."""
        return np.asarray(np.linalg.inv(self.matrix))

    def joint_angles(self, readings: Array) -> Array:
        """Convert readings of the motors (m, n) to joint angles, rad or mm."""
        return np.asarray(readings @ self.matrix.T)

    def motor_readings(self, q: Array) -> Array:
        """Convert joint angles (m, n) to readings of the motors, rad or mm."""
        return np.asarray(q @ self.inverse.T)

    def moved_joints(self, motor: int) -> dict[int, float]:
        """Return the joints (from 1) that a motor moves, each with its ratio."""
        column = self.matrix[:, motor - 1].tolist()
        return {joint: ratio for joint, ratio in enumerate(column, 1) if ratio}

    def read_joints(self, motor: int) -> dict[int, float]:
        """Return the joints (from 1) whose angles make up a motor's reading, each with its
        ratio."""
        row = self.inverse[motor - 1].round(12).tolist()
        return {joint: ratio for joint, ratio in enumerate(row, 1) if ratio}


def find_coupling_problem(matrix: Array, prismatic: tuple[bool, ...]) -> str | None:
    """Find what keeps a square matrix from being a coupling of these joints, in words; None where
    it is one."""
    slides = np.array(prismatic)
    mixed = (matrix != 0) & (slides[:, None] != slides)
    if mixed.any():
        joint, motor = (int(place) + 1 for place in np.argwhere(mixed)[0])
        return (
            f"row {joint}, column {motor} couples a joint that turns with one that slides; only "
            "joints of one kind can be coupled"
        )
    if np.linalg.cond(matrix) > MAX_CONDITION:
        return (
            "the matrix is singular: different readings would give the same joint angles; every "
            "joint needs a motor of its own"
        )
    return None


def find_passive_problem(passive: Any, count: int) -> str | None:
    """Find what keeps a value from being a list of some of `count` motors, in words; None where it
    is one."""
    motors = range(1, count + 1)
    is_list = isinstance(passive, (list, tuple))
    if is_list and all(type(motor) is int and motor in motors for motor in passive):
        distinct = set(passive)
        if len(distinct) == len(passive) < count:
            return None
    return f"expected some of the motors 1 to {count}, each once, found {passive}"


def readings_of(coupling: Coupling | None, q: Array) -> Array:
    """Return what the motors read at joint angles (m, n); the angles where nothing is coupled."""
    return q if coupling is None else coupling.motor_readings(q)


def angles_of(coupling: Coupling | None, readings: Array) -> Array:
    """Return the joint angles at readings (m, n) of the motors."""
    return readings if coupling is None else coupling.joint_angles(readings)
