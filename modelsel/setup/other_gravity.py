"""Whether drives that wind up under gravity ask for another direction of it than the one assumed.

A drive's torque under gravity is linear in its direction. The direction that leaves least beside the
base, while every joint is as soft as it asks for, is found by alternating least squares."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from .._linalg import TINY
from .._typing import Array
from ..fitting.design import compute_design, measure_rounding
from ..fitting.least_squares import Fit
from ..fitting.problem import Problem
from ..mechanisms.compliance import joint_compliance
from ..robot.gravity import find_gravity_joints

# rows that are looked at, at most
MOST_ROWS = 2000
# angle [rad] from which a direction is another one, and share of the rms that it leaves at most
LEAST_ANGLE = np.radians(20.0)
MOST_LEFT = 0.65
# how rarely chance may do as well
MAX_P = 1e-6
ROUNDS = 50
# share of the largest wind-up from which a joint is named
SMALL = 0.2
# share of a column that is none, and angle [rad] to an axis within which a direction is along it
ROUNDING, CLOSE = 1e-8, np.radians(5.0)


class OtherGravity(NamedTuple):
    """A direction (3,) of gravity in the base frame that the compliance of some joints asks for, the
    share of the rms that it leaves of what the assumed one does, and how well all of it fits."""

    direction: Array
    joints: tuple[int, ...]
    left: float
    criterion: float


class _Softness(NamedTuple):
    """How soft joints (J,) are, and the squares that they leave."""

    size: Array
    square: float


def find_other_gravity(problem: Problem, fitted: Fit) -> OtherGravity | None:
    """Find the direction of gravity that the drives ask for beside a fitted base; None where that is
    about the assumed one, where it explains little more, or where gravity is not known."""
    assumed = problem.robot.gravity
    if assumed is None:
        return None
    some = _take_rows(problem)
    joints = _list_joints(some)
    Q, left = _leave(some, fitted)
    coordinates, known = Q.shape
    numbers = known + len(joints) + 2
    freedom = coordinates - numbers
    if not joints or freedom < 1:
        return None
    if np.linalg.norm(left) <= measure_rounding(some):
        return None
    wound = np.stack([_take_out(Q, own) for own in _wind(some, joints, fitted)])
    direction = _snap(_seek(wound, left))
    before = _soften(wound, np.array(assumed), left)
    after = _soften(wound, direction, left)
    if not _is_better(before, after, freedom) or not _is_elsewhere(direction, assumed):
        return None
    share = np.sqrt(after.square / before.square)
    moved = np.linalg.norm(wound @ direction, axis=1) * after.size
    least = SMALL * moved.max()
    asking = tuple(j for j, own in zip(joints, moved, strict=True) if own > least)
    criterion = _compute_criterion(after.square, coordinates, numbers)
    return OtherGravity(direction, asking, float(share), criterion)


def fits_better(problem: Problem, fitted: Fit, other: OtherGravity) -> bool:
    """Whether a fitted model fits at least as well as another direction of gravity does, by Schwarz's
    criterion: it has its numbers, and the other direction those that it was found with."""
    some = _take_rows(problem)
    Q, left = _leave(some, fitted)
    coordinates, numbers = Q.shape
    own = _compute_criterion(float(left @ left), coordinates, numbers)
    return own <= other.criterion


def _take_rows(problem: Problem) -> Problem:
    """Take the rows that are looked at."""
    count = len(problem)
    spread = np.linspace(0, count - 1, min(count, MOST_ROWS))
    return problem.take(spread.astype(int))


def _leave(problem: Problem, fitted: Fit) -> tuple[Array, Array]:
    """Compute a basis (N, k) of what a fitted model moves, and what it leaves (N,)."""
    terms = [fitted.terms[k] for k in fitted.representatives]
    columns, residual = compute_design(problem, terms, fitted.at())
    flat = columns.reshape(residual.size, -1)
    Q, _ = np.linalg.qr(flat)
    response = residual.reshape(-1, 1)
    left = _take_out(Q, response)
    return Q, left[:, 0]


def _compute_criterion(square: float, coordinates: int, numbers: int) -> float:
    """Compute Schwarz's criterion of what so many numbers leave: smaller is better."""
    each = max(square, TINY) / coordinates
    return float(coordinates * np.log(each) + numbers * np.log(coordinates))


def _list_joints(problem: Problem) -> tuple[int, ...]:
    """List the joints that a weight may load, whatever the direction of gravity."""
    joints = set[int]()
    for axis in np.eye(3):
        gravity = tuple(axis)
        turned = replace(problem.robot, gravity=gravity)
        loaded = find_gravity_joints(turned)
        joints.update(loaded)
    return tuple(sorted(joints))


def _wind(problem: Problem, joints: tuple[int, ...], fitted: Fit) -> Array:
    """Compute (J, N, 3) what the drives of joints do, of unit softness, with gravity along each axis."""
    along = []
    for axis in np.eye(3):
        robot = replace(problem.robot, gravity=tuple(axis))
        turned = replace(problem, robot=robot)
        terms = [term for j in joints for term in joint_compliance(robot, j, 0).terms]
        columns, _ = compute_design(turned, terms, fitted.at())
        along.append(columns.reshape(-1, len(joints)))
    return np.stack(along).transpose(2, 1, 0)


def _take_out(Q: Array, columns: Array) -> Array:
    """Take a basis out of columns (N, k); what only rounding leaves of one is nothing."""
    left = columns - Q @ (Q.T @ columns)
    before = np.linalg.norm(columns, axis=0)
    after = np.linalg.norm(left, axis=0)
    is_left = after > ROUNDING * before
    return np.asarray(left * is_left)


def _seek(wound: Array, left: Array) -> Array:
    """Seek the direction (3,) that leaves least, by turns with how soft the joints are: no joint winds
    up against the weight."""
    found = []
    for direction in (*np.eye(3), *-np.eye(3)):
        turned = _turn(wound, direction, left)
        softness = _soften(wound, turned, left)
        found.append((softness.square, tuple(turned)))
    _, best = min(found)
    return np.array(best)


def _turn(wound: Array, direction: Array, left: Array) -> Array:
    """Turn a direction (3,) to where it leaves least."""
    for _ in range(ROUNDS):
        softness = _soften(wound, direction, left)
        together = np.tensordot(softness.size, wound, 1)
        solved, *_ = np.linalg.lstsq(together, left, rcond=None)
        length = np.linalg.norm(solved)
        if length <= TINY:
            break
        direction = solved / length
    return direction


def _snap(direction: Array) -> Array:
    """Snap a direction to an axis that it is close to."""
    size = np.abs(direction)
    nearest = size.argmax()
    axis = np.zeros(3)
    axis[nearest] = np.sign(direction[nearest])
    limit = np.cos(CLOSE)
    cosine = direction @ axis
    if cosine > limit:
        return axis
    return direction


def _soften(wound: Array, direction: Array, left: Array) -> _Softness:
    """Fit how soft each joint is, nought or more, with gravity in a direction."""
    from scipy.optimize import nnls

    moved = wound @ direction
    columns = moved.T
    norm = np.linalg.norm(columns, axis=0)
    scale = np.maximum(norm, TINY)
    scaled, rest = nnls(columns / scale, left)
    size = scaled / scale
    square = float(rest) ** 2
    return _Softness(size, square)


def _is_better(before: _Softness, after: _Softness, freedom: int) -> bool:
    """Whether a direction leaves clearly less: two numbers more explain it, and two joints ask for it."""
    from scipy.special import fdtrc

    less = before.square - after.square
    gain = max(less, 0.0)
    variance = max(after.square / freedom, TINY)
    F = gain / (2 * variance)
    p = fdtrc(2, freedom, F)
    most = MOST_LEFT**2 * before.square
    is_less = after.square < most
    joints = np.count_nonzero(after.size)
    several = joints > 1
    rarely = p < MAX_P
    return bool(is_less and several and rarely)


def _is_elsewhere(direction: Array, assumed: tuple[float, ...]) -> bool:
    """Whether a direction is another one than that assumed."""
    usual = np.array(assumed)
    cosine = direction @ usual
    limit = np.cos(LEAST_ANGLE)
    return bool(cosine < limit)
