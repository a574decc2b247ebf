"""What rows that are no points read, as functions of the target's position, and their gradients.

    point, x, y, z   x, or one of its coordinates          wire, ball-bar   |x − c| − ℓ     (ℓ: what the reading leaves out)
    distance         |x − x₀|, x₀ at another configuration  same-point       x − c           plane   n · (x − c) − t

A row's gradient G (3, 3) turns the target's displacement, three rows of the design, into the row's
own; a feature's own numbers, place tx ty tz, tilt rx ry and length ℓ, are columns beside them
(small changes of c, n and ℓ; t shifts the plane along n). Everything is in the tracker's frame,
components first and rows last; before them there may be further axes, of draws."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .._typing import Array
from ..measurements.measurements import Gauges
from ..mechanisms.terms import FIXTURE_AXES

LENGTH = FIXTURE_AXES.index("length")


@dataclass(frozen=True, eq=False)
class Fixtures:
    """Where the F features stand before anything is fitted: `centre` (F, 3) mm, `axes` (F, 3, 3),
    of a plane its two directions and its normal, a row each; `length` (F,) mm."""

    centre: Array
    axes: Array
    length: Array

    @staticmethod
    def unknown(count: int) -> Fixtures:
        """At nought."""
        return Fixtures(np.zeros((count, 3)), np.tile(np.eye(3), (count, 1, 1)), np.zeros(count))


def readings(gauges: Gauges, position: Array) -> Array:
    """(3, m) measured values, in the coordinates that `Gauges.coordinates` marks; nought
    elsewhere."""
    out = np.where(gauges.coordinates & gauges.of("point", "x", "y", "z")[:, None], position, 0.0).T
    lengths = gauges.of("wire", "ball-bar", "distance")
    out[0, lengths] = np.nan_to_num(
        gauges.length[lengths]
    )  # a ball-bar without a length reads nought beyond its own
    return np.asarray(out)


def _normal(axes: Array, tilt: Array) -> Array:
    """(..., 3, m) Rx(rx) Ry(ry) on a plane's normal; axes (m, 3, 3), tilt (..., m, 2)."""
    a, b = tilt[..., 0], tilt[..., 1]
    local = np.stack([np.sin(b), -np.sin(a) * np.cos(b), np.cos(a) * np.cos(b)], axis=-1)
    return np.moveaxis(np.einsum("...mi,mij->...mj", local, axes), -1, -2)


def predicted(
    gauges: Gauges, fixtures: Fixtures, values: Array, x: Array, origin: Array | None
) -> Array:
    """(..., 3, m) what the rows read with the target at x (..., 3, m), the features changed by
    `values` (..., F, 7); `origin` (..., 3, m): where the distances begin."""
    out = np.where(gauges.coordinates.T, x, 0.0)
    if gauges.features:
        own = values[..., np.maximum(gauges.feature, 0), :]  # (..., m, 7)
        centre, axes = fixtures.centre[gauges.feature], fixtures.axes[gauges.feature]
        length = fixtures.length[gauges.feature] + own[..., LENGTH]
        d = x - np.moveaxis(centre + own[..., :3], -1, -2)
        bar, point, plane = (
            gauges.of("wire", "ball-bar"),
            gauges.of("same-point"),
            gauges.of("plane"),
        )
        out[..., point] = d[..., point]
        out[..., 0, bar] = np.linalg.norm(d, axis=-2)[..., bar] - length[..., bar]
        height = (_normal(axes, own[..., 3:5]) * (x - centre.T)).sum(-2) - own[..., 2]
        out[..., 0, plane] = height[..., plane]
    if origin is not None:
        apart = gauges.of("distance")
        out[..., 0, apart] = np.linalg.norm(x - origin, axis=-2)[..., apart]
    return np.asarray(out)


def gradients(
    gauges: Gauges, fixtures: Fixtures, values: Array, x: Array, origin: Array | None
) -> tuple[Array, Array]:
    """(G (3, 3, m) by the target's position, E (7, 3, m) by the numbers of the row's own feature)
    of `predicted`, at x (3, m) and values (F, 7). By the origin of a distance it is −G."""
    m = x.shape[1]
    G, E = np.zeros((3, 3, m)), np.zeros((7, 3, m))
    for k in range(3):
        G[k, k] = gauges.coordinates[:, k]
    single = gauges.of("wire", "ball-bar", "distance", "plane")
    G[:, :, single] = 0.0
    own = values[np.maximum(gauges.feature, 0)] if gauges.features else np.zeros((m, 7))
    centre = fixtures.centre[gauges.feature] if gauges.features else np.zeros((m, 3))
    axes = fixtures.axes[gauges.feature] if gauges.features else np.tile(np.eye(3), (m, 1, 1))

    bar, point, plane = gauges.of("wire", "ball-bar"), gauges.of("same-point"), gauges.of("plane")
    apart = gauges.of("distance")
    line = (
        x - (centre + own[:, :3]).T
        if origin is None
        else np.where(apart, x - origin, x - (centre + own[:, :3]).T)
    )
    along = line / np.maximum(np.linalg.norm(line, axis=0), 1e-9)
    G[0] = np.where(bar | apart, along, G[0])
    E[:3, 0] = np.where(bar, -along, 0.0)
    E[LENGTH, 0] = -1.0 * bar
    for k in range(3):
        E[k, k] = np.where(point, -1.0, E[k, k])
    if plane.any():
        a, b = own[:, 3], own[:, 4]
        G[0] = np.where(plane, _normal(axes, own[:, 3:5]), G[0])
        E[2, 0] = np.where(plane, -1.0, E[2, 0])
        by_a = np.stack([0 * a, -np.cos(a) * np.cos(b), -np.sin(a) * np.cos(b)], 1)
        by_b = np.stack([np.cos(b), np.sin(a) * np.sin(b), -np.cos(a) * np.sin(b)], 1)
        for k, local in ((3, by_a), (4, by_b)):
            E[k, 0] = plane * np.einsum("mi,mij,mj->m", local, axes, x.T - centre)
    return G, E
