"""Where the features of a set-up stand before anything is fitted: anchors, spheres, points and
planes, from the nominal arm.

The lengths of a wire and of a ball-bar are linear in the anchor c and |c|² once squared (Smith &
Abel 1987, spherical interpolation); a plane's normal is the positions' least direction. The place is
then refined robustly, and the fit goes on from there."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from .._typing import Array, Index, Mask
from ..exceptions import NotEstimable, count_words
from ..fitting.design import residuals
from ..fitting.observation import Fixtures
from ..fitting.problem import Problem
from ..measurements.campaign.features import Feature
from ..measurements.measurements import Measurements
from ..robot.rigid import align_z

# least over largest extent of positions below which an anchor could stand on either side of them
FLAT = 1e-2
# error of a nominal arm: residuals beyond it count less
ARM_ERROR_MM = 5.0
# rows that it takes to place a feature
MIN_ROWS = {"wire": 4, "ball-bar": 4, "plane": 4, "same-point": 1, "distance": 1}


class _Place(NamedTuple):
    """Where a feature stands: centre (3,) [mm], axes (3, 3), length [mm]."""

    centre: Array
    axes: Array
    length: float


def place_features(problem: Problem, use: Mask) -> Problem:
    """Place the features from the rows `use` (mask), those that are known as they are known.

    Raises NotEstimable where the rows do not determine where one is."""
    gauges = problem.data.gauges
    if gauges is None:
        return problem
    residual = residuals(problem.bare)
    x = -residual[:, :3]
    features = gauges.features
    fixtures = Fixtures.unknown(len(features))
    for k, feature in enumerate(features):
        is_of_feature = gauges.feature == k
        rows = np.flatnonzero(is_of_feature & use)
        is_unmeasured = not len(rows) and feature.free
        if feature.kind == "distance" or is_unmeasured:
            continue
        place = _find_place(feature, x[rows], gauges.length[rows])
        fixtures.centre[k] = place.centre
        fixtures.axes[k] = place.axes
        fixtures.length[k] = place.length
    return replace(problem, fixtures=fixtures)


def find_unmeasured_features(data: Measurements, use: Mask) -> Index:
    """Find the features that are not known and that no row of `use` (mask) measures."""
    gauges = data.gauges
    if gauges is None:
        return np.zeros(0, np.intp)
    used = gauges.feature[use]
    measured = set(used.tolist())
    unmeasured = []
    for k, feature in enumerate(gauges.features):
        is_measured = k in measured
        if feature.free and not is_measured:
            unmeasured.append(k)
    return np.array(unmeasured, dtype=np.intp)


def _find_place(feature: Feature, x: Array, length: Array) -> _Place:
    """Find the place of one feature from the nominal positions x (k, 3) of its rows."""
    _require_rows(feature, len(x))
    if feature.kind not in ("same-point", "plane"):
        reading = np.nan_to_num(length)
        return _find_anchor(feature, x, reading)
    centre = np.median(x, axis=0)
    if feature.position is not None:
        centre = np.array(feature.position)
    if feature.kind == "same-point":
        unturned = np.eye(3)
        return _Place(centre, axes=unturned, length=0.0)
    if feature.normal is None:
        mean = x.mean(0)
        centred = x - mean
        _, _, directions = np.linalg.svd(centred)
        normal = directions[-1]
    else:
        normal = np.array(feature.normal)
    aligned = align_z(normal)
    return _Place(centre, axes=aligned.T, length=0.0)


def _require_rows(feature: Feature, count: int) -> None:
    """Raise NotEstimable where a feature that is not known has too few rows."""
    needed = MIN_ROWS[feature.kind]
    if "length" in feature.free:
        needed += 1
    is_same_point = feature.kind == "same-point"
    has_start = is_same_point or feature.position is not None
    if count < needed and feature.free and not has_start:
        raise NotEstimable(
            f'feature "{feature.name}" ({feature.kind}) has {count_words(count, "estimation row")}; '
            f"to place it takes {needed}. Measure more, or give its position_mm under "
            "[measurements.features]."
        )


def _find_anchor(feature: Feature, x: Array, reading: Array) -> _Place:
    """Find a wire's anchor or a ball-bar's sphere: |x − c| − ℓ = reading (k,), with ℓ = 0 unless it
    is free or known (a ball-bar's own)."""
    known = feature.length or 0.0
    is_open = "length" in feature.free
    if feature.position is None:
        position = _solve_anchor(feature, x, reading, known, is_open)
    else:
        position = np.array(feature.position)
    offset = known
    if is_open and len(x) > 0:
        offset = _compute_offset(position, x, reading)
    free_of_place = set(feature.free) - {"length"}
    if not free_of_place:
        return _Place(position, np.eye(3), offset)
    position, offset = _refine_anchor(position, offset, x, reading, is_open)
    return _Place(position, np.eye(3), offset)


def _compute_offset(position: Array, x: Array, reading: Array) -> float:
    """Compute the median of the distances from an anchor beyond the readings [mm]."""
    distance = np.linalg.norm(x - position, axis=1)
    beyond = distance - reading
    return float(np.median(beyond))


def _solve_anchor(feature: Feature, x: Array, reading: Array, known: float, is_open: bool) -> Array:
    """Solve |near|² − full² = 2 near · c + 2 full ℓ + constant for the anchor, near = x − middle and
    full = reading + known length. Raises NotEstimable where the positions lie in a plane."""
    middle = x.mean(0)
    near = x - middle
    full = reading + known
    extent = np.linalg.svd(near, compute_uv=False)
    is_flat = extent[2] < FLAT * extent[0]
    if is_flat:
        raise NotEstimable(
            f'the positions from which feature "{feature.name}" ({feature.kind}) is measured lie in '
            "a plane: it could stand on either side of it. Measure more widely, or give a first guess: "
            f"[measurements.features.{feature.name}] position_mm = [x, y, z], estimate = true."
        )
    constant = np.ones(len(x))
    columns = [2 * near, constant]
    if is_open and np.ptp(reading) > 0:
        columns.append(2 * reading)
    design = np.column_stack(columns)
    squares = np.square(near)
    squared_distance = squares.sum(1)
    squared_length = np.square(full)
    difference = squared_distance - squared_length
    solution, *_ = np.linalg.lstsq(design, difference, rcond=None)
    anchor = middle + solution[:3]
    return np.asarray(anchor)


def _refine_anchor(
    position: Array, offset: float, x: Array, reading: Array, is_open: bool
) -> tuple[Array, float]:
    """Refine an anchor, and its length where that is open, by robust least squares."""
    from scipy.optimize import least_squares

    def compute_gaps(p: Array) -> Array:
        length = p[3] if is_open else offset
        distance = np.linalg.norm(x - p[:3], axis=1)
        gap = distance - length - reading
        return np.asarray(gap)

    start = np.append(position, offset) if is_open else position
    solution = least_squares(
        compute_gaps, start, loss="soft_l1", f_scale=ARM_ERROR_MM, x_scale="jac"
    )
    fitted = solution.x
    if is_open:
        offset = float(fitted[3])
    return fitted[:3], offset
