"""Simple mistakes of a set-up, as changes of the joint readings and of the positions: directions,
right angles, units, columns."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from .._typing import Array
from ..exceptions import sentence_list
from ..robot.kinematics import Robot

DEGREE = np.pi / 180
RIGHT_ANGLES = (90, -90, 180)
# joints up to which every choice of reversed joints is tried
MAX_REVERSIBLE = 8


@dataclass(frozen=True)
class Unit:
    """A unit of positions: `scale` to millimetres; what all of a file's positions then are (`words`)
    and where to `look`; its name, where some rows alone have it (`unit`)."""

    scale: float
    words: str
    look: str
    unit: str


SCALES = (
    Unit(1000.0, "are metres", "name them x_m y_m z_m", "metres"),
    Unit(
        0.001,
        "are a thousandth of what they say",
        "check whether x_m y_m z_m hold millimetres, or the robot file metres",
        "micrometres",
    ),
    Unit(25.4, "are inches", "name them x_in y_in z_in", "inches"),
    Unit(10.0, "are centimetres", "convert them to mm", "centimetres"),
)
# units that are said to be larger than they are, of all positions: (scale, words, where to look)
LARGER_UNITS = (
    (
        1 / 25.4,
        "are millimetres and not inches",
        "correct the unit that the file says, or name them x_mm y_mm z_mm",
    ),
    (
        0.1,
        "are millimetres and not centimetres",
        "correct the unit that the file says, or name them x_mm y_mm z_mm",
    ),
)
MIRRORED = (
    "are in a left-handed frame (an axis mirrored)",
    "check the signs and the order of x, y and z",
)


@dataclass(frozen=True, eq=False)
class Mistake:
    """A mistake, by its correction: `words` after "if", and where to `look`; readings q (m, n)
    become q Aᵀ + c and positions x Bᵀ; `parts`: how many simple mistakes it consists of."""

    words: str
    look: str
    A: Array
    c: Array
    B: Array
    parts: int = 1

    def then(self, other: Mistake) -> Mistake:
        """Combine both corrections, this one first."""
        look = self.look
        if other.look != look:
            look = f"{look}, and {other.look}"
        shift = other.A @ self.c
        return Mistake(
            words=f"{self.words} and {other.words}",
            look=look,
            A=other.A @ self.A,
            c=shift + other.c,
            B=other.B @ self.B,
            parts=self.parts + other.parts,
        )


NOTHING = Mistake("", "", np.eye(0), np.zeros(0), np.eye(3))
REGISTER = replace(
    NOTHING,
    words="the instrument's frame and the target on the flange are found",
    look="[robot] register = true",
)


def _change_readings(words: str, look: str, A: Array, c: Array | None = None) -> Mistake:
    if c is None:
        c = np.zeros(len(A))
    return Mistake(words, look, A, c, B=np.eye(3))


def _change_positions(words: str, look: str, B: Array, joints: int) -> Mistake:
    return Mistake(words, look, A=np.eye(joints), c=np.zeros(joints), B=B)


def list_joint_mistakes(robot: Robot) -> Iterator[Mistake]:
    """List mistakes of the readings: one joint's direction, zero, unit, or what it is counted from;
    two joints' columns; all units, all columns."""
    n = robot.n
    turns = [not slides for slides in robot.prismatic]
    for j in range(n):
        yield _reverse_joint(j, n, turns[j])
        if turns[j]:
            yield from _generate_zeros(j, n)
        for k in range(j + 1, n):
            is_alike = turns[j] == turns[k]
            if is_alike:
                yield _exchange_columns(j, k, n)
        has_turn_before = j > 0 and turns[j - 1]
        if has_turn_before and turns[j]:
            yield from _generate_couplings(j, n)
    yield from _generate_angle_units(turns)
    all_alike = len(set(turns)) == 1
    if all_alike and n > 2:
        identity = np.eye(n)
        yield _change_readings(
            "the joints are counted from the flange",
            f"check the order of the columns q1 to q{n}",
            identity[::-1],
        )


def _reverse_joint(j: int, n: int, turns: bool) -> Mistake:
    A = np.eye(n)
    A[j, j] = -1.0
    verb = "turns" if turns else "moves"
    return _change_readings(
        f"joint {j + 1} {verb} the other way",
        f"check the sign of column q{j + 1}, or which way joint {j + 1} {verb} in the robot file",
        A,
    )


def _generate_zeros(j: int, n: int) -> Iterator[Mistake]:
    look = f"check where joint {j + 1} is zero in the controller and in the robot file"
    identity = np.eye(n)
    for degrees in RIGHT_ANGLES:
        change = "added to" if degrees > 0 else "subtracted from"
        zeros = identity[j] * degrees * DEGREE
        yield _change_readings(f"{abs(degrees)}° is {change} q{j + 1}", look, identity, zeros)


def _exchange_columns(j: int, k: int, n: int) -> Mistake:
    order = np.arange(n)
    order[j] = k
    order[k] = j
    identity = np.eye(n)
    return _change_readings(
        f"q{j + 1} and q{k + 1} are exchanged",
        "check the columns of the joint readings",
        identity[order],
    )


def _generate_couplings(j: int, n: int) -> Iterator[Mistake]:
    look = f"check whether the controller counts joint {j + 1} from the link before it or from the base"
    for sign in (1.0, -1.0):
        A = np.eye(n)
        A[j, j - 1] = sign
        change = "added to" if sign > 0 else "subtracted from"
        yield _change_readings(f"q{j} is {change} q{j + 1}", look, A)


def _generate_angle_units(turns: Sequence[bool]) -> Iterator[Mistake]:
    n = len(turns)
    for factor, suffix, words in (
        (1 / DEGREE, "_rad", "radians, not degrees"),
        (DEGREE, "_deg", "degrees, not radians"),
    ):
        for j in np.flatnonzero(turns):
            A = np.eye(n)
            A[j, j] = factor
            yield _change_readings(
                f"q{j + 1} is in {words}", f"name its column q{j + 1}{suffix}", A
            )
        A = np.diag(np.where(turns, factor, 1.0))
        look = f"name their columns q1{suffix} and so on"
        yield _change_readings(f"all readings are in {words}", look, A)


def list_reversed_joints(n: int) -> Iterator[Mistake]:
    """List all choices of three joints and more, of n, that turn the other way."""
    if n > MAX_REVERSIBLE:
        return
    look = "check the signs of the readings and the robot file's axes"
    for size in range(3, n + 1):
        for joints in combinations(range(n), size):
            sign = np.ones(n)
            sign[list(joints)] = -1.0
            numbers = [str(j + 1) for j in joints]
            names = sentence_list(numbers)
            words = f"joints {names} turn the other way"
            signs = np.diag(sign)
            reversal = _change_readings(words, look, signs)
            yield replace(reversal, parts=size)


def list_position_mistakes(n: int, framed: bool) -> Iterator[Mistake]:
    """List mistakes of the positions: units, of all or of one axis, and handedness; axis by axis where the positions are
    said to be in the robot's own frame (`framed`)."""
    units = [(unit.scale, unit.words, unit.look) for unit in SCALES]
    for scale, words, look in (*units, *LARGER_UNITS):
        scaling = np.eye(3) * scale
        yield _change_positions(f"the positions {words}", look, scaling, n)
    for a, axis in enumerate("xyz"):
        look = f"check the unit of the column of {axis}"
        for unit in SCALES:
            of_axes = np.ones(3)
            of_axes[a] = unit.scale
            B = np.diag(of_axes)
            yield _change_positions(f"the values of {axis} {unit.words}", look, B, n)
    if not framed:
        words, look = MIRRORED
        yield _change_positions(f"the positions {words}", look, -np.eye(3), n)
        return
    for axis, other, B in list_axis_changes():
        words = f"{axis} has the opposite sign"
        look = f"check the sign of {axis}"
        if other:
            words = f"{axis} and {other} are exchanged"
            look = "check the columns of the positions"
        yield _change_positions(words, look, B, n)


def list_axis_changes() -> Iterator[tuple[str, str, Array]]:
    """List (an axis, the one that it is exchanged with, the change of the positions B (3, 3)); ""
    where its sign changes."""
    axes = "xyz"
    identity = np.eye(3)
    for a, axis in enumerate(axes):
        sign = 1 - 2 * identity[a]
        reversal = np.diag(sign)
        yield axis, "", reversal
        for b in range(a + 1, 3):
            order = np.arange(3)
            order[a] = b
            order[b] = a
            other = axes[b]
            exchange = identity[order]
            yield axis, other, exchange
