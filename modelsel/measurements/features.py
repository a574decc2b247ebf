"""What rows measure that are no points, and the features they share: anchors, spheres, points,
planes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from .._typing import Array

if TYPE_CHECKING:
    import pandas as pd

KINDS = ("point", "x", "y", "z", "wire", "ball-bar", "distance", "same-point", "plane")
PLACE = ("tx", "ty", "tz")
FREE_NUMBERS = {
    "wire": PLACE,
    "ball-bar": PLACE,
    "same-point": PLACE,
    "plane": ("tz", "rx", "ry"),
    "distance": (),
}
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


def collect_features(
    kind: Sequence[str], feature: Sequence[str], length: Array
) -> tuple[NDArray[np.intp], tuple[Feature, ...]]:
    """((m,) every row's feature, -1 for none, the features numbered by their first rows); a
    ball-bar without lengths has one that is not known."""
    first: dict[str, int] = {}
    for k, name in enumerate(feature):
        if name:
            first.setdefault(name, k)
    number = {name: k for k, name in enumerate(first)}
    unknown = {
        name: FREE_NUMBERS[kind[k]]
        + (("length",) if kind[k] == "ball-bar" and np.isnan(length[k]) else ())
        for name, k in first.items()
    }
    return (
        np.array([number.get(name, -1) for name in feature], dtype=np.intp),
        tuple(Feature(name, kind[k], free=unknown[name]) for name, k in first.items()),
    )


def add_kind_columns(
    frame: pd.DataFrame, kind: Sequence[str], feature: Sequence[str], length: Array
) -> pd.DataFrame:
    """The contract's columns of rows that are no points, from those that points would have: cells
    that a kind does not use are empty."""
    out = frame.assign(
        kind=np.array(kind, dtype=object), feature=np.array(feature, dtype=object), length_mm=length
    )
    what = out["kind"].to_numpy()
    turned = [
        name for name in ("qw", "qx", "qy", "qz", "srx_rad", "sry_rad", "srz_rad") if name in out
    ]
    out.loc[what != "point", turned] = np.nan
    if "sx_mm" in out:
        own = out["sx_mm"].mask(what == "y", out["sy_mm"]).mask(what == "z", out["sz_mm"])
        out["s_mm"] = own.where(what != "point")
        out.loc[what != "point", ["sx_mm", "sy_mm", "sz_mm"]] = np.nan
    return out
