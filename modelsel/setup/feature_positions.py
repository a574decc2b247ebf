"""Where the features of a set-up stand, before anything is fitted: anchors, spheres, points and
planes from the nominal arm.

A wire's and a ball-bar's lengths are linear in the anchor c and |c|² once squared (Smith & Abel
1987, spherical interpolation), a plane is the positions' least direction; the place is then refined
robustly. The fit goes on from here."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from .._typing import Array, Index
from ..exceptions import DataError
from ..fitting.design import residuals
from ..fitting.observation import Fixtures
from ..fitting.problem import Problem
from ..measurements.features import Feature
from ..measurements.measurements import Measurements
from ..robot.rigid import align_z

# least over largest spread of positions below which an anchor could stand on either side of them
FLAT = 1e-2
ARM_ERROR_MM = 5.0  # what a nominal arm is off by: residuals beyond count less
LEAST = {"wire": 4, "ball-bar": 4, "plane": 4, "same-point": 1, "distance": 1}


def place_features(problem: Problem, use: NDArray[np.bool_]) -> Problem:
    """The problem with its features placed from the rows `use` (mask), those that are known as they
    are known. Raises DataError where the rows do not say where one is."""
    gauges = problem.data.gauges
    if gauges is None:
        return problem
    x = -residuals(problem.bare)[:, :3]
    found = Fixtures.unknown(len(gauges.features))
    for k, feature in enumerate(gauges.features):
        if feature.kind == "distance":
            continue
        rows = np.flatnonzero((gauges.feature == k) & use)
        if not len(rows) and feature.free:
            continue  # its rows are left out (`unseen`)
        found.centre[k], found.axes[k], found.length[k] = _found(
            feature, x[rows], gauges.length[rows]
        )
    return replace(problem, fixtures=found)


def find_unmeasured_features(data: Measurements, use: NDArray[np.bool_]) -> Index:
    """Features that are not known and that no row of `use` (mask) measures."""
    gauges = data.gauges
    some = () if gauges is None else gauges.features
    return np.array(
        [
            k
            for k, f in enumerate(some)
            if gauges is not None and f.free and not ((gauges.feature == k) & use).any()
        ],
        dtype=np.intp,
    )


def _found(feature: Feature, x: Array, length: Array) -> tuple[Array, Array, float]:
    """(centre, axes, length) of one feature from the nominal positions x (k, 3) of its rows."""
    position = None if feature.position is None else np.array(feature.position)
    needed = LEAST[feature.kind] + ("length" in feature.free)
    if (
        len(x) < needed
        and feature.free
        and not (feature.kind == "same-point" or position is not None)
    ):
        raise DataError(
            f'feature "{feature.name}" ({feature.kind}) has {len(x)} estimation rows; to place it takes {needed}.',
            remedy="Measure more, or give its position_mm under [measurements.features].",
        )
    if feature.kind == "same-point":
        return np.median(x, axis=0) if position is None else position, np.eye(3), 0.0
    if feature.kind == "plane":
        centre = np.median(x, axis=0) if position is None else position
        normal = (
            np.linalg.svd(x - x.mean(0))[2][-1]
            if feature.normal is None
            else np.array(feature.normal)
        )
        return centre, align_z(normal).T, 0.0
    return _anchor(feature, x, np.nan_to_num(length), position)


def _anchor(
    feature: Feature, x: Array, reading: Array, position: Array | None
) -> tuple[Array, Array, float]:
    """A wire's anchor or a ball-bar's sphere: |x − c| − ℓ = reading, ℓ = 0 unless it is free or
    known (a ball-bar's own)."""
    from scipy.optimize import least_squares

    known, open_ = feature.length or 0.0, "length" in feature.free
    if not set(feature.free) - {"length"}:
        assert position is not None
        left_out = (
            float(np.median(np.linalg.norm(x - position, axis=1) - reading))
            if open_ and len(x)
            else known
        )
        return position, np.eye(3), left_out
    if position is None:
        middle = x.mean(0)
        spread = np.linalg.svd(x - middle, compute_uv=False)
        if spread[2] < FLAT * spread[0]:
            raise DataError(
                f'the positions that feature "{feature.name}" ({feature.kind}) is measured from lie in a plane: it '
                "could stand on either side of it.",
                remedy="Measure more widely, or give a first guess: "
                f"[measurements.features.{feature.name}] position_mm = [x, y, z], estimate = true.",
            )
        near, full = x - middle, reading + known  # |near|² − full² = 2 near·c + 2 full ℓ + constant
        matrix = np.column_stack(
            [2 * near, np.ones(len(x)), *([2 * reading] if open_ and np.ptp(reading) > 0 else [])]
        )
        solution = np.linalg.lstsq(matrix, np.square(near).sum(1) - np.square(full), rcond=None)[0]
        position = middle + solution[:3]
    start = float(np.median(np.linalg.norm(x - position, axis=1) - reading)) if open_ else known

    def gap(p: Array) -> Array:
        return np.asarray(np.linalg.norm(x - p[:3], axis=1) - (p[3] if open_ else known) - reading)

    found = least_squares(
        gap,
        np.append(position, [start] if open_ else []),
        loss="soft_l1",
        f_scale=ARM_ERROR_MM,
        x_scale="jac",
    ).x
    return found[:3], np.eye(3), float(found[3]) if open_ else known
