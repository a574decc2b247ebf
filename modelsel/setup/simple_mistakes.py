"""Simple mistakes of a set-up, as changes of the joints' readings and of the positions: senses,
right angles, units, columns."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from .._typing import Array
from ..fitting.problem import Problem
from ..robot.kinematics import Robot, pose

REWEIGHT = 8
BLOCK = 64  # in one block of the linear solution
DEGREE = np.pi / 180


@dataclass(frozen=True)
class Unit:
    """Positions times `scale` are millimetres: what all of a file's then are (`words`) and where to
    `look`; the `unit` of some rows alone, and their `remedy`."""

    scale: float
    words: str
    look: str
    unit: str
    remedy: str


SCALES = (
    Unit(1000.0, "are metres", "name them x_m y_m z_m", "metres", "multiply x, y and z by 1000"),
    Unit(
        0.001,
        "are a thousandth of what they say",
        "check whether x_m y_m z_m hold millimetres, or the robot file metres",
        "micrometres",
        "divide x, y and z by 1000",
    ),
    Unit(25.4, "are inches", "convert them to mm", "inches", "multiply x, y and z by 25.4"),
    Unit(10.0, "are centimetres", "convert them to mm", "centimetres", "multiply x, y and z by 10"),
)
MIRRORED = (
    "stand in a left-handed frame (an axis mirrored)",
    "check the signs and the order of x, y and z",
)


@dataclass(frozen=True, eq=False)
class Mistake:
    """What would mend it, as `words` after "if", and where to `look`; readings q (m, n) become q Aᵀ
    + c, positions x Bᵀ; of how many simple mistakes it consists."""

    words: str
    look: str
    A: Array
    c: Array
    B: Array
    parts: int = 1

    def then(self, other: Mistake) -> Mistake:
        """Both, this one first."""
        look = self.look if other.look == self.look else f"{self.look}, and {other.look}"
        return Mistake(
            f"{self.words} and {other.words}",
            look,
            other.A @ self.A,
            other.A @ self.c + other.c,
            other.B @ self.B,
            self.parts + other.parts,
        )


NOTHING = Mistake("", "", np.eye(0), np.zeros(0), np.eye(3))
REGISTER = replace(
    NOTHING,
    words="the tracker's frame and the target on the flange are found",
    look="[robot] register = true",
)


def list_position_mistakes(robot: Robot) -> Iterator[Mistake]:
    """One joint's sense, zero, unit, or what it counts from; two joints' columns; all units, all
    columns."""
    n, eye, turns = robot.n, np.eye(robot.n), [not slides for slides in robot.prismatic]

    def one(words: str, look: str, A: Array = eye, c: Array | None = None) -> Mistake:
        return Mistake(words, look, A, np.zeros(n) if c is None else c, np.eye(3))

    for j in range(n):
        name, scaled = f"joint {j + 1}", eye.copy()
        scaled[j, j] = -1.0
        yield one(
            f"{name} {'turns' if turns[j] else 'moves'} the other way",
            f"check the sign of q{j + 1} and the robot file's axis",
            scaled,
        )
        if turns[j]:
            for degrees in (90, -90, 180):
                yield one(
                    f"{abs(degrees)}° is {'added to' if degrees > 0 else 'taken from'} q{j + 1}",
                    f"check where {name} is zero in the controller and in the robot file",
                    c=eye[j] * degrees * DEGREE,
                )
        for k in range(j + 1, n):
            if turns[j] == turns[k]:
                order = np.arange(n)
                order[[j, k]] = k, j
                yield one(
                    f"q{j + 1} and q{k + 1} change places",
                    "check the columns of the joint readings",
                    eye[order],
                )
        if j and turns[j] and turns[j - 1]:
            for sign in (1.0, -1.0):
                coupled = eye.copy()
                coupled[j, j - 1] = sign
                yield one(
                    f"q{j} is {'added to' if sign > 0 else 'taken from'} q{j + 1}",
                    f"check whether the controller counts joint {j + 1} from the link before it or from the base",
                    coupled,
                )
    for factor, words in ((1 / DEGREE, "radians, not degrees"), (DEGREE, "degrees, not radians")):
        unit = "_deg" if factor < 1 else "_rad"
        for j in (j for j in range(n) if turns[j]):
            scaled = eye.copy()
            scaled[j, j] = factor
            yield one(f"q{j + 1} is in {words}", f"name its column q{j + 1}{unit}", scaled)
        yield one(
            f"all readings are in {words}",
            f"name their columns q1{unit} and so on",
            np.diag(np.where(turns, factor, 1.0)),
        )
    if len(set(turns)) == 1 and n > 2:
        yield one(
            "the joints are counted from the flange",
            f"check the order of the columns q1 to q{n}",
            eye[::-1],
        )


def list_reversed_joints(n: int, framed: bool) -> Iterator[Mistake]:
    """Units and handedness; axis by axis where the positions are said to stand in the robot's own
    frame."""

    def one(words: str, look: str, B: Array) -> Mistake:
        return Mistake(words, look, np.eye(n), np.zeros(n), B)

    for unit in SCALES:
        yield one(f"the positions {unit.words}", unit.look, np.eye(3) * unit.scale)
    if not framed:
        yield one(f"the positions {MIRRORED[0]}", MIRRORED[1], -np.eye(3))
        return
    for axis, other, B in list_axis_changes():
        yield (
            one(f"{axis} and {other} change places", "check the columns of the positions", B)
            if other
            else one(f"{axis} counts the other way", f"check the sign of {axis}", B)
        )


def list_axis_changes() -> Iterator[tuple[str, str, Array]]:
    """(an axis, the one that it changes places with, the positions' change B (3, 3)); "" where its
    sign changes."""
    for a, axis in enumerate("xyz"):
        yield axis, "", np.diag(1 - 2 * np.eye(3)[a])
        for b in range(a + 1, 3):
            order = np.arange(3)
            order[[a, b]] = b, a
            yield axis, "xyz"[b], np.eye(3)[order]


def score_linearly(n: int) -> Iterator[Mistake]:
    """Three joints and more that turn the other way."""
    for size in range(3, n + 1 if n <= 8 else 0):
        for some in combinations(range(n), size):
            sign = np.ones(n)
            sign[list(some)] = -1.0
            names = ", ".join(str(j + 1) for j in some[:-1]) + f" and {some[-1] + 1}"
            yield Mistake(
                f"joints {names} turn the other way",
                "check the signs of the readings and the robot file's axes",
                np.diag(sign),
                np.zeros(n),
                np.eye(3),
                size,
            )


def list_joint_mistakes(problem: Problem, joints: Sequence[Mistake]) -> tuple[Array, Array]:
    """((H,) median distance that the best affine map from the tracker to frame 0 and the best
    target leave of the readings as each of H mistakes has them, over the mapped positions' own: a
    map may shrink the world; (H,) the map's scale, negative where it mirrors). Cauchy weights."""
    x = problem.data.position - np.median(problem.data.position, axis=0)
    span, m = max(float(np.abs(x).max()), 1e-6), len(problem)
    row = np.concatenate([x / span, np.ones((m, 1))], 1)
    left, scale = np.empty(len(joints)), np.empty(len(joints))
    for start in range(0, len(joints), BLOCK):
        part = joints[start : start + BLOCK]
        at = pose(
            problem.robot, np.concatenate([problem.data.q @ k.A.T + k.c for k in part]), np.zeros(3)
        )
        flange = np.concatenate(
            [at.target[:, None], at.axes[-1, :3].transpose(1, 0, 2)], 1
        )  # (3, 1 + 3, H m)
        y = flange.transpose(2, 0, 1).reshape(len(part), m, 12)
        weight = np.ones((len(part), m))
        for _ in range(REWEIGHT):
            wide = weight[:, None] * row.T  # (H, 4, m)
            map_ = np.linalg.pinv(wide @ row, rcond=1e-12, hermitian=True) @ (wide @ y)
            rest = (y - row @ map_).reshape(len(part), m, 3, 4)
            o, F = rest[..., :1].reshape(len(part), -1, 1), rest[..., 1:].reshape(len(part), -1, 3)
            heavy = np.repeat(weight, 3, axis=1)[:, None] * F.transpose(0, 2, 1)
            t = -np.linalg.pinv(heavy @ F, rcond=1e-9, hermitian=True) @ (heavy @ o)
            size = np.linalg.norm((o + F @ t).reshape(len(part), m, 3), axis=2)
            middle = np.median(size, axis=1)
            weight = 1 / (1 + (size / np.maximum(3 * middle, 1e-6)[:, None]) ** 2) ** 2
        A = (
            map_.reshape(-1, 4, 3, 4)[:, :3]
            @ np.concatenate([np.ones((len(part), 1, 1)), t], 1)[:, None]
        )
        mapped = np.median(np.linalg.norm(row[:, :3] @ A[..., 0], axis=2), axis=1)
        block = slice(start, start + len(part))
        left[block], scale[block] = (
            middle / np.maximum(mapped, 1e-9),
            np.cbrt(np.linalg.det(A[..., 0])) / span,
        )
    return left, scale
