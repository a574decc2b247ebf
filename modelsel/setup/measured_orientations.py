"""Whether the measured orientations are inverted, or their quaternions' columns are in another
order."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from .._typing import Array, Index, Mask
from ..exceptions import DataError, NotEstimable
from ..fitting.problem import Problem
from ..robot.rigid import from_quaternion, nearest_rotation, rotation_vector, to_quaternion
from .other_robots import select_most_frequent
from .registration import register
from .robust_weights import compute_cauchy_weights, compute_scale

# rows that are examined, spread over the file, and configurations that are needed
MAX_ROWS = 200
MIN_CONFIGURATIONS = 10
# median angle [rad] up to which the orientations are as the arm has them, give or take its errors
GOOD_ANGLE = 0.1
# a mistake explains the orientations where its correction reduces the median angle by this factor
MIN_IMPROVEMENT = 4.0
# factor within which mistakes fit as well as the best and are named with it
EQUAL_FACTOR = 1.5
# rotation angle [rad] beyond which its axis is not trusted
MAX_ANGLE = 2.8
# singular value per root of the rotations below which their axes are all alike
ONE_AXIS = 1e-3
REWEIGHTINGS = 12
MIN_SCALE = 1e-9
INVERTED = "inverted (the turn from target to tracker, not from tracker to target)"
NEGATE = "give qx, qy and qz the other sign"
# places of w x y z in the columns qw qx qy qz, what these hold, and what to call them
ORDERS = (((3, 0, 1, 2), "x, y, z, w", "qx qy qz qw"), ((1, 2, 3, 0), "z, w, x, y", "qz qw qx qy"))


class _Guess(NamedTuple):
    """A mistake in the quaternions: the median angle [rad] that its correction leaves, its words and
    its remedy."""

    angle: float
    words: str
    look: str


def describe_orientation_mistake(problem: Problem, use: Mask, registered: bool) -> str | None:
    """Describe which mistake in the quaternions explains what the orientations of the rows `use`
    (mask) leave, with the median angle before and after.

    None where they leave little, or no mistake explains it. The orientation of the target on the
    flange is free, and the tracker's where it is `registered`."""
    if problem.data.rotation is None:
        return None
    rows = _thin(select_most_frequent(problem, use))
    if len(np.unique(problem.data.block[rows])) < MIN_CONFIGURATIONS:
        return None
    sample = problem.take(rows)
    flange = sample.pose(slice(None)).axes[-1, :3].transpose(2, 1, 0)
    seen = np.asarray(sample.data.rotation)
    trackers: list[Array | None] = [sample.placement[0][sample.data.group[0]]]
    if registered:
        trackers = [_rotate_by_positions(sample), None]
    for tracker in trackers:
        sentence = _describe_best(seen, flange, tracker)
        if sentence is not None:
            return sentence
    return None


def _thin(rows: Index) -> Index:
    if not len(rows):
        return rows
    spread = np.linspace(0, len(rows) - 1, min(len(rows), MAX_ROWS)).astype(int)
    return np.asarray(rows[np.unique(spread)])


def _describe_best(seen: Array, flange: Array, tracker: Array | None) -> str | None:
    """Describe the mistakes that explain the orientations best; None where nothing needs or gives an
    explanation."""
    before = _compute_angle(seen, flange, tracker)
    if before is None or before < GOOD_ANGLE:
        return None
    limit = min(GOOD_ANGLE, before / MIN_IMPROVEMENT)
    guesses = []
    for corrected, words, look in _generate_corrections(seen):
        angle = _compute_angle(corrected, flange, tracker)
        if angle is not None and angle < limit:
            guesses.append(_Guess(angle, words, look))
    if not guesses:
        return None
    after = min(guesses).angle
    best = [guess for guess in sorted(guesses) if guess.angle <= EQUAL_FACTOR * after]
    words = ", or ".join(guess.words for guess in best)
    looks = ", or ".join(guess.look for guess in best)
    return (
        f"The orientations fit {before / after:.0f} times better ({np.degrees(after):.2g}° instead "
        f"of {np.degrees(before):.3g}°, median) if the quaternions are {words}: {looks}."
    )


def _rotate_by_positions(problem: Problem) -> Array | None:
    """Find the tracker's rotation (3, 3) from positions alone, which no mistaken quaternion affects.

    With a free rotation the inverse and the other orders are the same motion (a map of quaternions
    with determinant -1). None where positions do not determine it."""
    points = problem.plain_points()
    try:
        registered = register(points, np.ones(len(points), bool), per_group=False)
    except (DataError, NotEstimable):
        return None
    return np.asarray(registered.placement[0][problem.data.group[0]])


def _generate_corrections(seen: Array) -> Iterator[tuple[Array, str, str]]:
    """Generate (rotations (m, 3, 3) without a mistake, the mistake in words, its remedy)."""
    yield seen.transpose(0, 2, 1), INVERTED, NEGATE
    q = to_quaternion(seen)
    for order, held, names in ORDERS:
        R = from_quaternion(q[:, order])
        words = f"in another order (qw qx qy qz hold {held})"
        look = f"rename these columns to {names}"
        yield R, words, look
        yield R.transpose(0, 2, 1), f"{words}, and {INVERTED}", f"{look}, then {NEGATE}"


def _compute_angle(seen: Array, flange: Array, tracker: Array | None) -> float | None:
    """Compute the median angle [rad] between seen (m, 3, 3) and P · flange · T with the best
    constant T, and P the `tracker` or the best one; None where the rotations have one axis, so that
    P cannot be determined."""
    P = _fit_tracker(seen, flange) if tracker is None else tracker
    if P is None:
        return None
    each = np.einsum("mji,kj,mkl->mil", flange, P, seen)
    weight = np.ones(len(each))
    for _ in range(REWEIGHTINGS):
        T = nearest_rotation(np.einsum("m,mij->ij", weight, each))
        angle = np.linalg.norm(rotation_vector(np.einsum("ji,mjk->mik", T, each)), axis=1)
        weight = compute_cauchy_weights(angle, compute_scale(angle, MIN_SCALE))
    return float(np.median(angle))


def _fit_tracker(seen: Array, flange: Array) -> Array | None:
    """Fit the rotation P (3, 3) that maps the flange's rotations between rows to the seen ones; None
    where they have one axis."""
    shifts = sorted({1, max(len(seen) // 2, 1)})
    a = np.concatenate([_rotate_between(seen, k) for k in shifts])
    b = np.concatenate([_rotate_between(flange, k) for k in shifts])
    is_trusted = (np.linalg.norm(b, axis=1) < MAX_ANGLE) & (np.linalg.norm(a, axis=1) < MAX_ANGLE)
    least = ONE_AXIS * np.sqrt(is_trusted.sum())
    if not is_trusted.any() or np.linalg.matrix_rank(b[is_trusted], tol=least) < 2:
        return None
    weight = is_trusted.astype(float)
    for _ in range(REWEIGHTINGS):
        P = nearest_rotation(np.einsum("m,mi,mj->ij", weight, a, b))
        size = np.linalg.norm(a - b @ P.T, axis=1)
        weight = is_trusted * compute_cauchy_weights(size, compute_scale(size, MIN_SCALE))
    return P


def _rotate_between(rotations: Array, k: int) -> Array:
    """Compute (m, 3) rotation vectors from the row k further on to every row."""
    return rotation_vector(np.einsum("mij,mkj->mik", np.roll(rotations, -k, 0), rotations))
