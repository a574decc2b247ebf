"""Simple mistakes of a set-up, as changes of the joint readings and of the positions: directions,
right angles, units, columns."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from .._typing import Array
from ..exceptions import sentence_list
from ..fitting.problem import Problem
from ..robot.kinematics import Robot, pose
from .robust_weights import MEDIANS, compute_redescending_weights

REWEIGHTINGS = 8
# mistakes that are scored in one block of the linear solution
BLOCK = 64
DEGREE = np.pi / 180
RIGHT_ANGLES = (90, -90, 180)
# joints up to which every choice of reversed joints is tried
MAX_REVERSIBLE = 8
MIN_SPAN_MM = 1e-6
MIN_SCALE_MM = 1e-6


@dataclass(frozen=True)
class Unit:
    """A unit of positions: `scale` to millimetres; what all of a file's positions then are (`words`)
    and where to `look`; its name, where some rows alone have it (`unit`), and their `remedy`."""

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
    words="the tracker's frame and the target on the flange are found",
    look="[robot] register = true",
)


def _change_readings(words: str, look: str, A: Array, c: Array | None = None) -> Mistake:
    if c is None:
        c = np.zeros(len(A))
    return Mistake(
        words,
        look,
        A,
        c,
        B=np.eye(3),
    )


def _change_positions(words: str, look: str, B: Array, joints: int) -> Mistake:
    return Mistake(
        words,
        look,
        A=np.eye(joints),
        c=np.zeros(joints),
        B=B,
    )


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
        f"check the sign of q{j + 1} and the robot file's axis",
        A,
    )


def _generate_zeros(j: int, n: int) -> Iterator[Mistake]:
    look = f"check where joint {j + 1} is zero in the controller and in the robot file"
    identity = np.eye(n)
    for degrees in RIGHT_ANGLES:
        change = "added to" if degrees > 0 else "subtracted from"
        zeros = identity[j] * degrees * DEGREE
        yield _change_readings(
            f"{abs(degrees)}° is {change} q{j + 1}",
            look,
            identity,
            zeros,
        )


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
        yield _change_readings(
            f"q{j} is {change} q{j + 1}",
            look,
            A,
        )


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
            reversal = _change_readings(
                f"joints {names} turn the other way",
                look,
                np.diag(sign),
            )
            yield replace(reversal, parts=size)


def list_position_mistakes(n: int, framed: bool) -> Iterator[Mistake]:
    """List mistakes of the positions: units and handedness; axis by axis where the positions are
    said to be in the robot's own frame (`framed`)."""
    for unit in SCALES:
        yield _change_positions(
            f"the positions {unit.words}",
            unit.look,
            np.eye(3) * unit.scale,
            n,
        )
    if not framed:
        words, look = MIRRORED
        yield _change_positions(
            f"the positions {words}",
            look,
            -np.eye(3),
            n,
        )
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


def score_linearly(problem: Problem, joints: Sequence[Mistake]) -> tuple[Array, Array]:
    """Score mistakes of the readings by what an affine map and a target can explain: (misfits (H,),
    scales (H,)).

    For the readings as each of H mistakes has them, the best affine map from the tracker to frame 0
    and the best target are found with redescending weights. The misfit is the median distance left,
    over the mapped positions' own (a map may shrink the world); the scale is the map's, negative
    where it mirrors."""
    position = problem.data.position
    middle = np.median(position, axis=0)
    x = position - middle
    size = np.abs(x)
    largest = float(size.max())
    span = max(largest, MIN_SPAN_MM)
    ones = np.ones((len(x), 1))
    row = np.concatenate(
        [x / span, ones],
        axis=1,
    )
    misfits = []
    scales = []
    for start in range(0, len(joints), BLOCK):
        block = joints[start : start + BLOCK]
        o, F = _compute_flanges(problem, block)
        misfit, scale = _fit_affine_maps(
            row,
            o,
            F,
        )
        misfits.append(misfit)
        scales.append(scale / span)
    return np.concatenate(misfits), np.concatenate(scales)


def _compute_flanges(problem: Problem, joints: Sequence[Mistake]) -> tuple[Array, Array]:
    """Compute the flange's positions o (H, m, 3) and rotations F (H, m, 3, 3) for the readings as
    each of H mistakes has them."""
    count = len(joints)
    m = len(problem)
    readings = []
    for joint in joints:
        turned = problem.data.q @ joint.A.T
        readings.append(turned + joint.c)
    flange = pose(
        problem.robot,
        np.concatenate(readings),
        np.zeros(3),
    )
    axes = flange.axes[-1, :3]
    rotation = axes.transpose(2, 1, 0)
    position = flange.target.T
    o = position.reshape(count, m, 3)
    F = rotation.reshape(count, m, 3, 3)
    return o, F


def _fit_affine_maps(row: Array, o: Array, F: Array) -> tuple[Array, Array]:
    """Fit affine maps (H, 4, 3) and targets t (H, 3) with row · map = o + F t, for rows (m, 4):
    (misfits (H,), cube roots of the maps' determinants (H,))."""
    count, m = o.shape[:2]
    origin = o[..., None]
    y = np.concatenate([origin, F], axis=3)
    y = y.reshape(count, m, 12)
    weight = np.ones((count, m))
    for _ in range(REWEIGHTINGS):
        # the map for the flange's position, and for every axis of the flange
        weighted = weight[:, None] * row.T
        inverse = np.linalg.pinv(
            weighted @ row,
            rcond=1e-12,
            hermitian=True,
        )
        response = weighted @ y
        maps = inverse @ response
        rest = y - row @ maps
        rest = rest.reshape(count, m, 3, 4)
        o_rest = rest[..., :1].reshape(count, 3 * m, 1)
        F_rest = rest[..., 1:].reshape(count, 3 * m, 3)
        # the target that leaves least beyond the maps
        of_coordinates = np.repeat(
            weight,
            3,
            axis=1,
        )
        heavy = of_coordinates[:, None] * F_rest.transpose(0, 2, 1)
        inverse = np.linalg.pinv(
            heavy @ F_rest,
            rcond=1e-9,
            hermitian=True,
        )
        response = heavy @ o_rest
        t = -inverse @ response
        left = o_rest + F_rest @ t
        distance = np.linalg.norm(
            left.reshape(count, m, 3),
            axis=2,
        )
        median = np.median(distance, axis=1)
        scale = np.maximum(
            MEDIANS * median,
            MIN_SCALE_MM,
        )
        weight = compute_redescending_weights(
            distance,
            scale[:, None],
        )
    ones = np.ones((count, 1, 1))
    with_target = np.concatenate([ones, t], axis=1)
    of_axes = maps.reshape(count, 4, 3, 4)
    linear = of_axes[:, :3] @ with_target[:, None]
    linear = linear[..., 0]
    mapped = np.linalg.norm(
        row[:, :3] @ linear,
        axis=2,
    )
    spread = np.median(mapped, axis=1)
    misfit = median / np.maximum(spread, 1e-9)
    determinant = np.linalg.det(linear)
    return misfit, np.cbrt(determinant)
