"""Whether the measured orientations are inverted, or their quaternions' columns stand in another
order."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from .._typing import Array
from ..exceptions import DataError, NotEstimable
from ..fitting.problem import Problem
from ..robot.rigid import from_quaternion, nearest_rotation, rotation_vector, to_quaternion
from .registration import register

ROWS = 200  # that are looked at, spread over the file
LEAST = 10  # configurations
BAD = 0.1  # rad, median: below it the orientations are as the arm has them, give or take its errors
FACTOR = 4.0  # a mistake explains the orientations if without it they fit so much better
ALIKE = 1.5  # mistakes that fit as well as the best, within this factor, are told with it
FAR = 2.8  # rad of a turn, beyond which its axis is not trusted
ROUNDS = 12
INVERTED = "inverted (the turn from target to tracker, not from tracker to target)"
# places of w x y z in the columns qw qx qy qz, what these hold, and what to call them
ORDERS = (((3, 0, 1, 2), "x, y, z, w", "qx qy qz qw"), ((1, 2, 3, 0), "z, w, x, y", "qz qw qx qy"))


def describe_orientation_mistake(
    problem: Problem, use: NDArray[np.bool_], registered: bool
) -> str | None:
    """A sentence that says which mistake in the quaternions explains what the orientations of the
    rows `use` (mask) leave, with the median angle before and after; None where they leave little,
    or no mistake explains it. The orientation of the target on the flange is free, and the
    tracker's where it is `registered`."""
    data = problem.data
    if data.rotation is None:
        return None
    rows = np.flatnonzero(use if data.gauges is None else use & data.gauges.of("point"))
    for index in (data.target, data.group):
        rows = rows[index[rows] == np.bincount(index[rows]).argmax()] if len(rows) else rows
    rows = (
        rows[np.unique(np.linspace(0, len(rows) - 1, min(len(rows), ROWS)).astype(int))]
        if len(rows)
        else rows
    )
    if len(np.unique(data.block[rows])) < LEAST:
        return None
    some = problem.take(rows)
    flange = some.pose(slice(None)).axes[-1, :3].transpose(2, 1, 0)
    seen = np.asarray(some.data.rotation)
    for placed in (
        (_by_positions(some), None) if registered else (some.placement[0][some.data.group[0]],)
    ):
        before = _left(seen, flange, placed)
        if before is None or before < BAD:
            continue
        tried = [
            (left, words, look)
            for other, words, look in _others(seen)
            if (left := _left(other, flange, placed)) is not None
            and left < min(BAD, before / FACTOR)
        ]
        if tried:
            after = min(tried)[0]
            best = [(words, look) for left, words, look in sorted(tried) if left <= ALIKE * after]
            return (
                f"The orientations fit {before / after:.0f} times better ({np.degrees(after):.2g}° in place of "
                f"{np.degrees(before):.3g}°, median) if the quaternions are {', or '.join(words for words, _ in best)}: "
                f"{', or '.join(look for _, look in best)}."
            )
    return None


def _by_positions(problem: Problem) -> Array | None:
    """The tracker's rotation (3, 3) from positions alone, which no mistaken quaternion has touched:
    with a free one the inverse and the other orders are the same motion (a map of quaternions with
    determinant -1); None where positions do not tell it."""
    bare = problem.plain_points()
    try:
        return np.asarray(
            register(bare, np.ones(len(bare), bool), per_group=False).placement[0][
                problem.data.group[0]
            ]
        )
    except (DataError, NotEstimable):
        return None


def _others(seen: Array) -> Iterator[tuple[Array, str, str]]:
    """(rotations (m, 3, 3) as a mistake has them, the mistake in words, the remedy)."""
    negate = "give qx, qy and qz the other sign"
    yield seen.transpose(0, 2, 1), INVERTED, negate
    q = to_quaternion(seen)
    for order, held, names in ORDERS:
        R = from_quaternion(q[:, order])
        words, look = (
            f"in another order (qw qx qy qz hold {held})",
            f"rename these columns to {names}",
        )
        yield R, words, look
        yield R.transpose(0, 2, 1), f"{words}, and {INVERTED}", f"{look}, then {negate}"


def _left(seen: Array, flange: Array, placed: Array | None) -> float | None:
    """Median angle [rad] between seen (m, 3, 3) and P · flange · T with the best constant T, and
    the best P where it is not `placed`; None where the turns have one axis and P cannot be told."""
    P = placed
    if P is None:
        shift = max(len(seen) // 2, 1)
        pairs = [(np.roll(seen, -k, 0), np.roll(flange, -k, 0)) for k in sorted({1, shift})]
        a = np.concatenate([rotation_vector(np.einsum("mij,mkj->mik", s, seen)) for s, _ in pairs])
        b = np.concatenate(
            [rotation_vector(np.einsum("mij,mkj->mik", f, flange)) for _, f in pairs]
        )
        trusted = (np.linalg.norm(b, axis=1) < FAR) & (np.linalg.norm(a, axis=1) < FAR)
        if (
            not trusted.any()
            or np.linalg.matrix_rank(b[trusted], tol=1e-3 * np.sqrt(trusted.sum())) < 2
        ):
            return None
        weight = trusted.astype(float)
        for _ in range(ROUNDS):
            P = nearest_rotation(np.einsum("m,mi,mj->ij", weight, a, b))
            size = np.linalg.norm(a - b @ P.T, axis=1)
            weight = trusted / (1 + (size / max(3 * float(np.median(size)), 1e-9)) ** 2)
    assert P is not None
    each = np.einsum("mji,kj,mkl->mil", flange, P, seen)  # flangeᵀ Pᵀ seen: T, were there no error
    weight = np.ones(len(each))
    for _ in range(ROUNDS):
        T = nearest_rotation(np.einsum("m,mij->ij", weight, each))
        angle = np.linalg.norm(rotation_vector(np.einsum("ji,mjk->mik", T, each)), axis=1)
        weight = 1 / (1 + (angle / max(3 * float(np.median(angle)), 1e-9)) ** 2)
    return float(np.median(angle))
