"""Whether the measured orientations are inverted, or their quaternions' columns are in another
order."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from .._typing import Array, Index, Mask
from ..exceptions import DataError, NotEstimable, write_rounded
from ..fitting.problem import Problem
from ..robot.rigid import from_quaternion, nearest_rotation, rotation_vector, to_quaternion
from .improvement import EQUAL_FACTOR, MIN_IMPROVEMENT
from .other_robots import select_most_frequent
from .registration import register
from .robust_weights import (
    MIN_ROTATION_SCALE,
    compute_cauchy_weights,
    compute_scale,
    fit_rotation_robustly,
)

# rows that are examined, spread over the file, and configurations that are needed
MAX_ROWS = 200
MIN_CONFIGURATIONS = 10
# median angle [rad] up to which the orientations are as the arm has them, give or take its errors
GOOD_ANGLE = 0.1
# share of the rows below which some alone are inverted
MAX_INVERTED_SHARE = 0.5
# rotation angle [rad] beyond which its axis is not trusted
MAX_ANGLE = 2.8
# singular value per root of the rotations below which their axes are all alike
ONE_AXIS = 1e-3
REWEIGHTINGS = 12
INVERTED = "inverted (the turn from target to instrument, not from instrument to target)"
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
    frequent = select_most_frequent(problem, use)
    rows = _thin(frequent)
    configurations = np.unique(problem.data.block[rows])
    if len(configurations) < MIN_CONFIGURATIONS:
        return None
    sample = problem.take(rows)
    at = sample.pose(slice(None))
    axes = at.axes[-1, :3]
    flange = axes.transpose(2, 1, 0)
    seen = np.asarray(sample.data.rotation)
    trackers: list[Array | None]
    if registered:
        trackers = [_rotate_by_positions(sample), None]
    else:
        R, _ = sample.placement
        group = sample.data.group[0]
        trackers = [R[group]]
    for tracker in trackers:
        sentence = _describe_best(seen, flange, tracker)
        if sentence is not None:
            return sentence
    every_row = np.ones(len(problem), bool)
    every = problem.take(select_most_frequent(problem, every_row))
    for tracker in trackers:
        sentence = _describe_inverted_rows(every, tracker)
        if sentence is not None:
            return sentence
    return None


def _describe_inverted_rows(problem: Problem, tracker: Array | None) -> str | None:
    """Describe the rows whose orientations alone are inverted, where those of most rows fit; None
    where there are none."""
    at = problem.pose(slice(None))
    flange = at.axes[-1, :3].transpose(2, 1, 0)
    seen = np.asarray(problem.data.rotation)
    P = _fit_tracker(seen, flange) if tracker is None else tracker
    if P is None:
        return None
    T, angle = _fit_target(seen, flange, P)
    is_off = angle > GOOD_ANGLE
    if is_off.mean() >= MAX_INVERTED_SHARE:
        return None
    after = _measure_angles(seen.transpose(0, 2, 1), flange, P, T)
    is_inverted = is_off & (after < GOOD_ANGLE)
    count = int(is_inverted.sum())
    if not count:
        return None
    place = problem.data.where.spans(problem.data.row[is_inverted])
    subject, them = "1 row has an inverted quaternion", "it"
    if count > 1:
        subject, them = f"{count} rows have inverted quaternions", "them"
    degrees_before = np.degrees(np.median(angle[is_inverted]))
    degrees_after = np.degrees(np.median(after[is_inverted]))
    return (
        f"{subject} ({place}): {degrees_after:.2g}° instead of {degrees_before:.3g}° are left of "
        f"{them} (median) if corrected; {NEGATE} there, or leave {them} out."
    )


def _thin(rows: Index) -> Index:
    count = len(rows)
    if not count:
        return rows
    chosen = min(count, MAX_ROWS)
    spread = np.linspace(0, count - 1, chosen)
    places = np.unique(spread.astype(int))
    return np.asarray(rows[places])


def _describe_best(seen: Array, flange: Array, tracker: Array | None) -> str | None:
    """Describe the mistakes that explain the orientations best; None where nothing needs or gives an
    explanation."""
    before = _compute_angle(seen, flange, tracker)
    if before is None or before < GOOD_ANGLE:
        return None
    improved = before / MIN_IMPROVEMENT
    limit = min(GOOD_ANGLE, improved)
    guesses = []
    for corrected, words, look in _generate_corrections(seen):
        angle = _compute_angle(corrected, flange, tracker)
        if angle is not None and angle < limit:
            guess = _Guess(angle, words, look)
            guesses.append(guess)
    if not guesses:
        return None
    guesses.sort()
    after = guesses[0].angle
    most = EQUAL_FACTOR * after
    best = [guess for guess in guesses if guess.angle <= most]
    words = ", or ".join(guess.words for guess in best)
    looks = ", or ".join(guess.look for guess in best)
    factor = before / after
    degrees_before = np.degrees(before)
    degrees_after = np.degrees(after)
    return (
        f"The orientations fit {factor:,.0f} times better ({write_rounded(degrees_after, 2)}° instead "
        f"of {write_rounded(degrees_before)}°, median) if the quaternions are {words}: {looks}."
    )


def _rotate_by_positions(problem: Problem) -> Array | None:
    """Find the tracker's rotation (3, 3) from positions alone, which no mistaken quaternion affects.

    With a free rotation the inverse and the other orders are the same motion (a map of quaternions
    with determinant -1). None where positions do not determine it."""
    points = problem.plain_points()
    every_row = np.ones(len(points), bool)
    try:
        registered = register(points, every_row, per_group=False)
    except (DataError, NotEstimable):
        return None
    R, _ = registered.placement
    group = problem.data.group[0]
    return np.asarray(R[group])


def _generate_corrections(seen: Array) -> Iterator[tuple[Array, str, str]]:
    """Generate (rotations (m, 3, 3) without a mistake, the mistake in words, its remedy)."""
    inverted = seen.transpose(0, 2, 1)
    yield inverted, INVERTED, NEGATE
    q = to_quaternion(seen)
    for order, held, names in ORDERS:
        reordered = q[:, order]
        R = from_quaternion(reordered)
        words = f"in another order (qw qx qy qz hold {held})"
        look = f"rename these columns to {names}"
        yield R, words, look
        inverted = R.transpose(0, 2, 1)
        words += f", and {INVERTED}"
        look += f", then {NEGATE}"
        yield inverted, words, look


def _compute_angle(seen: Array, flange: Array, tracker: Array | None) -> float | None:
    """Compute the median angle [rad] between seen (m, 3, 3) and P · flange · T with the best
    constant T, and P the `tracker` or the best one; None where the rotations have one axis, so that
    P cannot be determined."""
    P = _fit_tracker(seen, flange) if tracker is None else tracker
    if P is None:
        return None
    _, angle = _fit_target(seen, flange, P)
    return float(np.median(angle))


def _fit_target(seen: Array, flange: Array, P: Array) -> tuple[Array, Array]:
    """Fit the constant T (3, 3) of P · flange · T robustly; also return the angles (m,) [rad] that it
    leaves."""
    each = np.einsum("mji,kj,mkl->mil", flange, P, seen)
    weight = np.ones(len(each))
    for _ in range(REWEIGHTINGS):
        mean = np.einsum("m,mij->ij", weight, each)
        T = nearest_rotation(mean)
        angle = _measure_angles(seen, flange, P, T)
        scale = compute_scale(angle, MIN_ROTATION_SCALE)
        weight = compute_cauchy_weights(angle, scale)
    return T, angle


def _measure_angles(seen: Array, flange: Array, P: Array, T: Array) -> Array:
    """Measure the angles (m,) [rad] between seen (m, 3, 3) and P · flange · T."""
    each = np.einsum("mji,kj,mkl->mil", flange, P, seen)
    off_mean = np.einsum("ji,mjk->mik", T, each)
    return np.asarray(np.linalg.norm(rotation_vector(off_mean), axis=1))


def _fit_tracker(seen: Array, flange: Array) -> Array | None:
    """Fit the rotation P (3, 3) that maps the flange's rotations between rows to the seen ones; None
    where they have one axis."""
    half = len(seen) // 2
    shifts = sorted({1, max(half, 1)})
    a = np.concatenate([_rotate_between(seen, k) for k in shifts])
    b = np.concatenate([_rotate_between(flange, k) for k in shifts])
    angle_a = np.linalg.norm(a, axis=1)
    angle_b = np.linalg.norm(b, axis=1)
    is_trusted = (angle_b < MAX_ANGLE) & (angle_a < MAX_ANGLE)
    count = is_trusted.sum()
    if not count:
        return None
    rank = np.linalg.matrix_rank(b[is_trusted], tol=ONE_AXIS * np.sqrt(count))
    if rank < 2:
        return None
    return fit_rotation_robustly(a, b, is_trusted)


def _rotate_between(rotations: Array, k: int) -> Array:
    """Compute (m, 3) rotation vectors from the row k further on to every row."""
    earlier = np.roll(rotations, -k, axis=0)
    turned = np.einsum("mij,mkj->mik", earlier, rotations)
    return rotation_vector(turned)
