"""Orientations as robots' controllers write them: three angles or a rotation vector, by a named
convention, in place of the quaternion qw qx qy qz."""

from __future__ import annotations

import warnings
from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..._typing import Array
from ...robot.rigid import from_rotation_vector, rotation_matrix, rotation_vector, to_quaternion
from ..formats.table import Table
from .columns import UNITS, find_blank_cells, read_numbers

QUATERNION_COLUMNS = ("qw", "qx", "qy", "qz")
UNIT_WORDS = ("deg", "rad")
# rad: an angle beyond it is none in radians
MAX_ANGLE_RAD = 4 * np.pi


@dataclass(frozen=True)
class Convention:
    """How three numbers say an orientation: `axes` about which they turn, one after another about
    the turned frame's own axes, by the angles in the order of `sequence`; without axes they are a
    rotation vector. `formula` says so in words."""

    name: str
    maker: str
    columns: tuple[str, str, str]
    axes: tuple[int, int, int] | None
    sequence: tuple[int, int, int]
    formula: str

    def rotate(self, angles: Array) -> Array:
        """Convert angles (m, 3) [rad], in the order of `columns`, to rotations (m, 3, 3)."""
        if self.axes is None:
            return from_rotation_vector(angles)
        R = np.broadcast_to(np.eye(3), (len(angles), 3, 3))
        for axis, k in zip(self.axes, self.sequence, strict=True):
            R = R @ rotation_matrix(axis, angles[:, k])
        return np.asarray(R)

    def read_angles(self, R: Array) -> Array:
        """Convert rotations (m, 3, 3) to angles (m, 3) [rad], in the order of `columns`: what
        `rotate` takes. Where two axes fall together, one of their angles is 0."""
        from scipy.spatial.transform import Rotation

        if self.axes is None:
            return rotation_vector(R)
        turned = "".join("XYZ"[axis] for axis in self.axes)
        with warnings.catch_warnings():
            warnings.filterwarnings("ignore", message="Gimbal lock")
            angles = Rotation.from_matrix(R).as_euler(turned)
        return np.asarray(angles[:, np.argsort(self.sequence)])


FIRST_TO_LAST, LAST_TO_FIRST = (0, 1, 2), (2, 1, 0)
XYZ, ZYX, ZYZ = (0, 1, 2), (2, 1, 0), (2, 1, 2)
CONVENTIONS = (
    Convention(
        "kuka", "KUKA", ("kuka_a", "kuka_b", "kuka_c"), ZYX, FIRST_TO_LAST, "Rz(A) Ry(B) Rx(C)"
    ),
    Convention(
        "fanuc", "Fanuc", ("fanuc_w", "fanuc_p", "fanuc_r"), ZYX, LAST_TO_FIRST, "Rz(R) Ry(P) Rx(W)"
    ),
    Convention(
        "staubli",
        "Stäubli",
        ("staubli_rx", "staubli_ry", "staubli_rz"),
        XYZ,
        FIRST_TO_LAST,
        "Rx(rx) Ry(ry) Rz(rz)",
    ),
    Convention(
        "yaskawa",
        "Yaskawa",
        ("yaskawa_rx", "yaskawa_ry", "yaskawa_rz"),
        ZYX,
        LAST_TO_FIRST,
        "Rz(rz) Ry(ry) Rx(rx)",
    ),
    Convention(
        "kawasaki",
        "Kawasaki",
        ("kawasaki_o", "kawasaki_a", "kawasaki_t"),
        ZYZ,
        FIRST_TO_LAST,
        "Rz(O) Ry(A) Rz(T)",
    ),
    Convention(
        "rpy",
        "roll-pitch-yaw",
        ("roll", "pitch", "yaw"),
        ZYX,
        LAST_TO_FIRST,
        "Rz(yaw) Ry(pitch) Rx(roll)",
    ),
    Convention(
        "ur",
        "Universal Robots",
        ("ur_rx", "ur_ry", "ur_rz"),
        None,
        FIRST_TO_LAST,
        "rotation vector (rx, ry, rz)",
    ),
)
ORIENTATION_COLUMNS = tuple(
    f"{name}_{unit}" for each in CONVENTIONS for name in each.columns for unit in UNIT_WORDS
)


def convert_orientations(table: Table) -> Table:
    """Return a table with quaternions in place of the columns of another convention. Raises
    DataError for columns that do not come together, and for two conventions."""
    present = [name for name in ORIENTATION_COLUMNS if name in table]
    if not present:
        return table
    convention, unit = _parse_orientation_column(present[0])
    names = [f"{name}_{unit}" for name in convention.columns]
    _refuse_mixtures(table, names, present)
    rows = _find_oriented_rows(table, names)
    angles = np.stack([_read_angles(table, name, rows, unit) for name in names], 1)
    quaternion = np.full((len(table), 4), np.nan)
    quaternion[rows] = to_quaternion(convention.rotate(angles[rows]))
    columns = {name: cells for name, cells in table.columns.items() if name not in names}
    columns |= {name: quaternion[:, k] for k, name in enumerate(QUATERNION_COLUMNS)}
    return replace(table, columns=columns)


def _parse_orientation_column(name: str) -> tuple[Convention, str]:
    """Return the convention of a column, and its unit."""
    angle, _, unit = name.rpartition("_")
    return next(each for each in CONVENTIONS if angle in each.columns), unit


def choose_orientation_names(names: Collection[str]) -> tuple[str, ...]:
    """Find the columns that say orientations among names: those of the quaternion where no other
    convention's are there."""
    present = [name for name in ORIENTATION_COLUMNS if name in names]
    if not present:
        return QUATERNION_COLUMNS
    convention, unit = _parse_orientation_column(present[0])
    return tuple(f"{name}_{unit}" for name in convention.columns)


def write_orientations(R: Array, names: Sequence[str]) -> dict[str, Array]:
    """Write orientations (m, 3, 3) as columns of these names, of `choose_orientation_names`."""
    if names == QUATERNION_COLUMNS:
        return dict(zip(names, to_quaternion(R).T, strict=True))
    convention, unit = _parse_orientation_column(names[0])
    angles = convention.read_angles(R) / UNITS[unit]
    return dict(zip(names, angles.T, strict=True))


def _refuse_mixtures(table: Table, names: Sequence[str], present: Sequence[str]) -> None:
    missing = [name for name in names if name not in table]
    if missing:
        raise table.where.refuse(
            f"{', '.join(present)} without {', '.join(missing)}.",
            remedy=f"{' '.join(names)} come together.",
        )
    others = [name for name in (*present, *QUATERNION_COLUMNS) if name in table]
    others = [name for name in others if name not in names]
    if others:
        raise table.where.refuse(
            f"orientations stand there twice: {' '.join(names)}, and {' '.join(others)}.",
            remedy="Keep one of them.",
        )


def _find_oriented_rows(table: Table, names: Sequence[str]) -> Array:
    """Mask (m,) the rows with an orientation: all, or with kinds those with cells that are
    filled."""
    if "kind" not in table:
        return np.ones(len(table), bool)
    return np.asarray(~np.all([find_blank_cells(table.columns[name]) for name in names], axis=0))


def _read_angles(table: Table, name: str, rows: Array, unit: str) -> Array:
    """Read a column of angles as radians. Raises DataError for degrees under radians."""
    angles = read_numbers(table, name, -1e9, 1e9, np.asarray(rows, bool)) * UNITS[unit]
    with np.errstate(invalid="ignore"):
        beyond = np.abs(angles) > MAX_ANGLE_RAD
    if unit == "rad" and beyond.any():
        row = int(np.argmax(beyond))
        raise table.where.refuse(
            f"{angles[row]:g} rad is beyond two turns: it looks like degrees.",
            row=row,
            column=name,
            remedy=f"If the angles are degrees, name the column {name.removesuffix('rad')}deg.",
        )
    return angles
