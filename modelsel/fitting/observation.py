"""What rows read of the target's position, one class for each kind of row.

    PointObservation       x, or some of its coordinates
    DistanceObservation    |x - x0|, x0 the target's position at another configuration
    AnchorObservation      |x - c| - l, of a wire or a ball-bar; l is what the reading leaves out
    SamePointObservation   x - c, of a touched point
    PlaneObservation       n · (x - c) - t

Everything is in the tracker's frame. Arrays have components first and rows last, x (..., 3, m);
before them there may be further axes, of draws. A row's gradient G (3, 3) turns the target's
displacement, three rows of the design, into the row's own. The numbers of a feature, its place
tx ty tz, tilt rx ry (and rz) and length, have columns beside them: small changes of c, n and l; tz
of a plane shifts it along n."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .._typing import Array, Index
from ..measurements.gauges import Gauges
from ..mechanisms.terms import FIXTURE_AXES

LENGTH = FIXTURE_AXES.index("length")
PLACE = slice(0, 3)  # of a feature's numbers
SHIFT, TILTS = 2, slice(3, 5)  # of a plane
SMALLEST_MM = 1e-9  # of a distance: its direction is not known below


@dataclass(frozen=True, eq=False)
class Fixtures:
    """Where the F features stand before anything is fitted: `centre` (F, 3) mm, `axes` (F, 3, 3),
    of a plane its two directions and its normal, a row each; `length` (F,) mm."""

    centre: Array
    axes: Array
    length: Array

    @staticmethod
    def unknown(count: int) -> Fixtures:
        """Return features at zero, their axes along the frame's."""
        return Fixtures(np.zeros((count, 3)), np.tile(np.eye(3), (count, 1, 1)), np.zeros(count))


@dataclass(frozen=True, eq=False)
class FeatureOfRows:
    """The feature of each of m rows: where it stands before the fit, `centre` (m, 3), `axes`
    (m, 3, 3) and `length` (m,), and how it has changed, `change` (..., m, 7)."""

    centre: Array
    axes: Array
    length: Array
    change: Array

    @staticmethod
    def of(fixtures: Fixtures, change: Array, feature: Index) -> FeatureOfRows:
        """Return the features of rows by their indices (m,); change (..., F, 7). Rows without one
        have any: nothing reads it."""
        if not len(fixtures.length):
            fixtures = Fixtures.unknown(1)
            change = np.zeros((*change.shape[:-2], 1, 7))
        number = np.maximum(feature, 0)
        return FeatureOfRows(
            fixtures.centre[number],
            fixtures.axes[number],
            fixtures.length[number],
            change[..., number, :],
        )

    @property
    def anchor(self) -> Array:
        """Places (..., 3, m) of the anchors, as changed."""
        return np.moveaxis(self.centre + self.change[..., PLACE], -1, -2)

    def take(self, rows: NDArray[np.bool_]) -> FeatureOfRows:
        """Return the features of some rows."""
        return FeatureOfRows(
            self.centre[rows], self.axes[rows], self.length[rows], self.change[..., rows, :]
        )


class Observation(ABC):
    """What rows of one kind read with the target at x."""

    @abstractmethod
    def predict(self, x: Array) -> Array:
        """Return the readings (..., 3, m) with the target at x (..., 3, m); a single number stands
        in the first component, zero where nothing is measured."""

    @abstractmethod
    def gradients(self, x: Array) -> tuple[Array, Array]:
        """Return the derivatives of `predict` at x (3, m): G (3, 3, m) by the target's position
        and E (7, 3, m) by the numbers of the row's own feature."""


@dataclass(frozen=True, eq=False)
class PointObservation(Observation):
    """The target's position, or those of its coordinates (m, 3) that are measured."""

    coordinates: NDArray[np.bool_]

    def predict(self, x: Array) -> Array:
        return np.where(self.coordinates.T, x, 0.0)

    def gradients(self, x: Array) -> tuple[Array, Array]:
        G, E = _zeros(x)
        coordinates = self.coordinates
        for k in range(3):
            is_measured = coordinates[:, k]
            G[k, k] = is_measured
        return G, E


@dataclass(frozen=True, eq=False)
class DistanceObservation(Observation):
    """The distance from where the target stood at another configuration, `origin` (..., 3, m). By
    the origin its gradient is -G."""

    origin: Array

    def predict(self, x: Array) -> Array:
        return _single(np.linalg.norm(x - self.origin, axis=-2))

    def gradients(self, x: Array) -> tuple[Array, Array]:
        G, E = _zeros(x)
        line = x - self.origin
        direction = _direction(line)
        G[0] = direction
        return G, E


@dataclass(frozen=True, eq=False)
class AnchorObservation(Observation):
    """The length of a wire from its anchor, or of a ball-bar from its sphere, less a constant."""

    feature: FeatureOfRows

    def predict(self, x: Array) -> Array:
        length = self.feature.length + self.feature.change[..., LENGTH]
        return _single(np.linalg.norm(x - self.feature.anchor, axis=-2) - length)

    def gradients(self, x: Array) -> tuple[Array, Array]:
        G, E = _zeros(x)
        anchor = self.feature.anchor
        line = x - anchor
        direction = _direction(line)
        G[0] = direction
        E[PLACE, 0] = -direction
        E[LENGTH, 0] = -1.0
        return G, E


@dataclass(frozen=True, eq=False)
class SamePointObservation(Observation):
    """How far the target is from a point that several rows touch."""

    feature: FeatureOfRows

    def predict(self, x: Array) -> Array:
        return np.asarray(x - self.feature.anchor)

    def gradients(self, x: Array) -> tuple[Array, Array]:
        G, E = _zeros(x)
        axes = range(3)
        for k in axes:
            G[k, k] = 1.0
            E[k, k] = -1.0
        return G, E


@dataclass(frozen=True, eq=False)
class PlaneObservation(Observation):
    """The height of the target over a plane."""

    feature: FeatureOfRows

    def predict(self, x: Array) -> Array:
        shift = self.feature.change[..., SHIFT]
        height = (self._normal() * (x - self.feature.centre.T)).sum(-2)
        return _single(height - shift)

    def gradients(self, x: Array) -> tuple[Array, Array]:
        G, E = _zeros(x)
        G[0] = self._normal()
        E[SHIFT, 0] = -1.0
        line = x.T - self.feature.centre
        for k, slope in enumerate(self._normal_slopes(), TILTS.start):
            E[k, 0] = np.einsum("mi,mij,mj->m", slope, self.feature.axes, line)
        return G, E

    def _tilts(self) -> tuple[Array, Array]:
        tilt = self.feature.change[..., TILTS]
        return tilt[..., 0], tilt[..., 1]

    def _normal(self) -> Array:
        """Tilt the plane's normal (..., 3, m) by Rx(rx) Ry(ry)."""
        a, b = self._tilts()
        local = np.stack([np.sin(b), -np.sin(a) * np.cos(b), np.cos(a) * np.cos(b)], axis=-1)
        turned = np.einsum("...mi,mij->...mj", local, self.feature.axes)
        return np.moveaxis(turned, -1, -2)

    def _normal_slopes(self) -> tuple[Array, Array]:
        """Derivatives (m, 3) of the normal by rx and by ry, in the plane's own axes."""
        a, b = self._tilts()
        by_a = np.stack([0 * a, -np.cos(a) * np.cos(b), -np.sin(a) * np.cos(b)], 1)
        by_b = np.stack([np.cos(b), np.sin(a) * np.sin(b), -np.cos(a) * np.sin(b)], 1)
        return by_a, by_b


def _zeros(x: Array) -> tuple[Array, Array]:
    """Return the gradients (G, E) of rows where nothing is measured."""
    m = x.shape[-1]
    return np.zeros((3, 3, m)), np.zeros((len(FIXTURE_AXES), 3, m))


def _single(number: Array) -> Array:
    """Put a number (..., m) into the first component of readings (..., 3, m)."""
    shape = number.shape
    *draws, rows = shape
    out = np.zeros((*draws, 3, rows))
    out[..., 0, :] = number
    return out


def _direction(line: Array) -> Array:
    """Return the unit vectors (3, m) along lines."""
    norms = np.linalg.norm(line, axis=0)
    length = np.maximum(norms, SMALLEST_MM)
    direction: Array = line / length
    return direction


# -- rows of several kinds
# ------------------------------------------------------------------------------------------------------


def split_by_kind(
    gauges: Gauges, fixtures: Fixtures, change: Array, origin: Array | None
) -> Iterator[tuple[NDArray[np.bool_], Observation]]:
    """Yield (rows (m,), their observation) for each kind that there is; change (..., F, 7) of the
    features' numbers, origin (..., 3, m) where distances begin (None: at the feature)."""
    features = FeatureOfRows.of(fixtures, change, gauges.feature)
    points = gauges.of("point", "x", "y", "z")
    if points.any():
        coordinates = gauges.coordinates[points]
        yield points, PointObservation(coordinates)
    distances = gauges.of("distance")
    if distances.any():
        start = features.anchor if origin is None else origin
        start_of_rows = start[..., distances]
        yield distances, DistanceObservation(start_of_rows)
    anchored = gauges.of("wire", "ball-bar")
    if anchored.any():
        anchors = features.take(anchored)
        yield anchored, AnchorObservation(anchors)
    touched = gauges.of("same-point")
    if touched.any():
        touched_points = features.take(touched)
        yield touched, SamePointObservation(touched_points)
    on_plane = gauges.of("plane")
    if on_plane.any():
        planes = features.take(on_plane)
        yield on_plane, PlaneObservation(planes)


def measured_readings(gauges: Gauges, position: Array) -> Array:
    """Return what was read (3, m), in the components that `Gauges.coordinates` marks, zero
    elsewhere; a ball-bar without a length reads zero beyond its own."""
    points = gauges.of("point", "x", "y", "z")
    of_point = points[:, None]
    coordinates = gauges.coordinates
    is_measured = coordinates & of_point
    measured = np.where(is_measured, position, 0.0)
    out = measured.T
    is_length = gauges.of("wire", "ball-bar", "distance")
    lengths = gauges.length
    read = lengths[is_length]
    # a ball-bar without a reading reads zero
    numbers = np.nan_to_num(read)
    out[0, is_length] = numbers
    return np.asarray(out)


def predict_readings(
    gauges: Gauges, fixtures: Fixtures, change: Array, x: Array, origin: Array | None
) -> Array:
    """Return the readings (..., 3, m) of rows of several kinds with the target at x (..., 3, m);
    arguments as in `split_by_kind`."""
    shape = x.shape
    out = np.zeros(shape)
    kinds = split_by_kind(gauges, fixtures, change, origin)
    for rows, observation in kinds:
        target = x[..., rows]
        reading = observation.predict(target)
        out[..., rows] = reading
    return out


def reading_gradients(
    gauges: Gauges, fixtures: Fixtures, change: Array, x: Array, origin: Array | None
) -> tuple[Array, Array]:
    """Return the derivatives (G (3, 3, m), E (7, 3, m)) of `predict_readings` at x (3, m) and
    change (F, 7)."""
    G, E = _zeros(x)
    for rows, observation in split_by_kind(gauges, fixtures, change, origin):
        G[..., rows], E[..., rows] = observation.gradients(x[:, rows])
    return G, E
