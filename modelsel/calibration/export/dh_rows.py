"""DH rows as a person reads them: rounded, the last transform in the last row where one can hold it,
and beside the nominal ones."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from ..._typing import Array

# decimals in a file: less than 1e-9 mm of an arm, unless a row is longer than FAR_MM
DECIMALS_MM, DECIMALS_DEG, DECIMALS_DIRECTION = 10, 12, 12
FAR_MM = 1e5
# of a transform that a row can hold
TOLERANCE = 1e-12
SHOWN = (("theta_deg", 4), ("d_mm", 3), ("a_mm", 3), ("alpha_deg", 4), ("beta_deg", 4))
NONE = "–"


def fold_last(table: Mapping[str, Any]) -> dict[str, Any]:
    """Return the table of a robot file with the transform after the last joint in the last row,
    as drawings have it; as it is where no row can hold it."""
    folded = dict(table)
    last = np.array(table["last"]["transform_mm"])
    row = _read_row(last)
    if table["convention"] != "standard" or row is None:
        return folded
    *others, joint = table["joint"]
    own = joint["dh"]
    if own["a_mm"] or own["alpha_deg"] or own.get("beta_deg"):
        return folded
    theta, d, a, alpha = row
    both = {
        "theta_deg": wrap_degrees(own["theta_deg"] + theta),
        "d_mm": own["d_mm"] + d,
        "a_mm": a,
        "alpha_deg": alpha,
    }
    folded["joint"] = [*others, {**joint, "dh": both}]
    del folded["last"]
    return folded


def _read_row(last: Array) -> tuple[float, float, float, float] | None:
    """Read a transform (3, 4) as Rz(θ) Tz(d) Tx(a) Rx(α): degrees and mm; None where it is none."""
    x_axis, position = last[:, 0], last[:, 3]
    across = float(x_axis[0] * position[1] - x_axis[1] * position[0])
    size = max(float(np.linalg.norm(position)), 1.0)
    if abs(x_axis[2]) > TOLERANCE or abs(across) > TOLERANCE * size:
        return None
    theta = np.degrees(np.arctan2(x_axis[1], x_axis[0]))
    alpha = np.degrees(np.arctan2(last[2, 1], last[2, 2]))
    a = float(x_axis[:2] @ position[:2])
    return float(theta), float(position[2]), a, float(alpha)


def wrap_degrees(degrees: float) -> float:
    """Return an angle beyond -180 up to 180 degrees."""
    return degrees - 360 * float(np.ceil((degrees - 180) / 360))


def round_rows(table: Mapping[str, Any]) -> dict[str, Any]:
    """Return the table of a robot file with the decimals that an arm has use for; all of them where
    a row is so long that it holds with all its digits alone."""
    rows = [joint["dh"] for joint in table["joint"]]
    if max(abs(row[key]) for row in rows for key in ("d_mm", "a_mm")) > FAR_MM:
        return dict(table)
    joints = [
        {**joint, "dh": {key: _round(value, key) for key, value in joint["dh"].items()}}
        for joint in table["joint"]
    ]
    base = np.array(table["base_mm"])
    directions = np.round(base[:, :3], DECIMALS_DIRECTION)
    position = np.round(base[:, 3:], DECIMALS_MM)
    rounded = np.hstack([directions, position]) + 0.0
    return {**table, "base_mm": rounded.tolist(), "joint": joints}


def _round(value: float, key: str) -> float:
    return round(value, DECIMALS_MM if key.endswith("_mm") else DECIMALS_DEG) + 0.0


def compare_rows(nominal: Mapping[str, Any], calibrated: Mapping[str, Any]) -> tuple[str, ...]:
    """Write the rows of two tables, each calibrated one below its nominal one, for people to read on
    a terminal of 80 columns."""
    pairs = [
        (before["dh"], after["dh"])
        for before, after in zip(nominal["joint"], calibrated["joint"], strict=True)
    ]
    keys = [(key, digits) for key, digits in SHOWN if any(key in after for _, after in pairs)]
    lines = [["joint", "", *(key for key, _ in keys)]]
    for number, (before, after) in enumerate(pairs, 1):
        old = [_write_value(before.get(key), digits) for key, digits in keys]
        new = [_write_value(_near(before, after, key), digits) for key, digits in keys]
        lines += [[str(number), "nominal", *old], ["", "calibrated", *new]]
    return tuple(_align(lines))


def _near(before: Mapping[str, float], after: Mapping[str, float], key: str) -> float | None:
    """Return a calibrated number, an angle on the turn of the nominal one."""
    old, new = before.get(key), after.get(key)
    if old is not None and new is not None and key.endswith("_deg"):
        return old + wrap_degrees(new - old)
    return new


def _write_value(value: float | None, digits: int) -> str:
    return NONE if value is None else f"{round(value, digits) + 0.0:,.{digits}f}"


def _align(lines: Sequence[Sequence[str]]) -> list[str]:
    """Write lines of cells, every column as wide as its widest cell: figures at its right, the words
    of the second column at its left."""
    widths = [max(map(len, column)) for column in zip(*lines, strict=True)]
    aligned = []
    for line in lines:
        cells = [cell.rjust(width) for cell, width in zip(line, widths, strict=True)]
        cells[1] = line[1].ljust(widths[1])
        aligned.append("  ".join(cells))
    return aligned
