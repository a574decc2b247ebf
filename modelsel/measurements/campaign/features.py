"""Rows that measure something other than a point, and the features they share: anchors, spheres,
points, planes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ..._typing import Array

if TYPE_CHECKING:
    import pandas as pd

KINDS = ("point", "x", "y", "z", "wire", "ball-bar", "distance", "same-point", "plane")
PLACE_AXES = ("tx", "ty", "tz")
# of a feature about which nothing is known, the numbers that are fitted
FREE_NUMBERS = {
    "wire": PLACE_AXES,
    "ball-bar": PLACE_AXES,
    "same-point": PLACE_AXES,
    "plane": ("tz", "rx", "ry"),
    "distance": (),
}
# which coordinates of its residual a row of each of KINDS measures; a single number is the first
COORDINATES = np.array(
    [
        (1, 1, 1),
        (1, 0, 0),
        (0, 1, 0),
        (0, 0, 1),
        (1, 0, 0),
        (1, 0, 0),
        (1, 0, 0),
        (1, 1, 1),
        (1, 0, 0),
    ],
    bool,
)
ORIENTATION_COLUMNS = ("qw", "qx", "qy", "qz", "srx_rad", "sry_rad", "srz_rad")


@dataclass(frozen=True)
class Feature:
    """What rows of one `kind` share: a wire's anchor, a ball-bar's sphere, a point, a plane. What
    is known of it, in the tracker's frame [mm]; `free` are its numbers that are fitted, of tx ty tz
    (place), rx ry (tilt), length."""

    name: str
    kind: str
    position: tuple[float, float, float] | None = None
    normal: tuple[float, float, float] | None = None
    length: float | None = None
    free: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False)
class KindColumns:
    """What m rows measure where not every row is a point: a word of KINDS a row, the feature's name
    ("" for none), the length [mm] (nan for none)."""

    kind: Sequence[str] | NDArray[np.object_]
    feature: Sequence[str] | NDArray[np.object_]
    length: Array

    def of(self, *kinds: str) -> NDArray[np.bool_]:
        """Mask (m,) the rows of some kinds."""
        return np.isin(self.kind, kinds)

    def take(self, rows: NDArray[np.bool_]) -> KindColumns:
        """Select some rows."""
        kinds = np.asarray(self.kind)
        kind = kinds[rows].tolist()
        features = np.asarray(self.feature)
        feature = features[rows].tolist()
        length = self.length[rows]
        return KindColumns(kind, feature, length)


def collect_features(columns: KindColumns) -> tuple[NDArray[np.intp], tuple[Feature, ...]]:
    """Collect ((m,) every row's feature, -1 for none, the features numbered by their first rows); a
    ball-bar without lengths has one that is not known."""
    first_rows: dict[str, int] = {}
    for row, name in enumerate(columns.feature):
        if name:
            first_rows.setdefault(name, row)
    features = list[Feature]()
    numbers = {"": -1}
    for name, row in first_rows.items():
        numbers[name] = len(features)
        kind = columns.kind[row]
        length = columns.length[row]
        has_no_length = np.isnan(length)
        free = FREE_NUMBERS[kind]
        if kind == "ball-bar" and has_no_length:
            free = (*free, "length")
        feature = Feature(name, kind, free=free)
        features.append(feature)
    row_numbers = [numbers[name] for name in columns.feature]
    index = np.array(row_numbers, dtype=np.intp)
    return index, tuple(features)


def add_kind_columns(frame: pd.DataFrame, columns: KindColumns) -> pd.DataFrame:
    """Add the contract's columns of rows that are no points to those that points would have: cells
    that a kind does not use are empty."""
    out = frame.assign(
        kind=np.array(columns.kind, dtype=object),
        feature=np.array(columns.feature, dtype=object),
        length_mm=columns.length,
    )
    kind = out["kind"].to_numpy()
    no_point = kind != "point"
    orientation = [name for name in ORIENTATION_COLUMNS if name in out]
    out.loc[no_point, orientation] = np.nan
    if "sx_mm" not in out:
        return out
    is_y = kind == "y"
    is_z = kind == "z"
    sigma = out["sx_mm"]
    sigma = sigma.mask(is_y, out["sy_mm"])
    sigma = sigma.mask(is_z, out["sz_mm"])
    out["s_mm"] = sigma.where(no_point)
    coordinates = ["sx_mm", "sy_mm", "sz_mm"]
    out.loc[no_point, coordinates] = np.nan
    return out
