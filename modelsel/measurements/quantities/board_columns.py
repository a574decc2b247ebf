"""An eye in the hand: rows of the kind "board", poses of a fixed board seen by a camera on the
flange.

Seen from the board, the camera moves: x = -Rᵀ p and Rᵀ are its place and orientation in the board's
frame, where p and R are the board's in the camera's. So the rows become points, the target the
camera and the board's frame the instrument's. A turn of what was seen moves the camera around the
board, which the uncertainties of x contain."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..._typing import Array
from ...notices import Note
from ...robot.rigid import from_quaternion, to_quaternion
from ..formats.table import Table
from .columns import POSITION_UNITS, read_column_set, read_coordinates
from .contract_columns import ROTATION_UNCERTAINTY_COLUMNS, UNCERTAINTY_COLUMNS
from .orientation_columns import QUATERNION_COLUMNS

BOARD = "board"
POSITION_COLUMNS = tuple(f"{axis}_{unit}" for axis in "xyz" for unit in POSITION_UNITS)
SINGLE = "s_mm"
SAID = (
    "The rows are of a board seen from the hand: they are turned into poses of the camera, the "
    "target, in the board's frame."
)


def convert_board_poses(table: Table) -> Table:
    """Return a table with the camera's poses in the board's frame where its rows are of kind
    "board", else the table itself. Raises DataError for rows of other kinds among them, and for
    rows without an orientation."""
    if "kind" not in table:
        return table
    words = np.array([str(cell).strip() for cell in table.columns["kind"]])
    is_board = words == BOARD
    if not is_board.any():
        return table
    if not is_board.all():
        raise table.where.refuse(
            f'a row of kind "{words[~is_board][0]}" among rows of a board seen from the hand, which '
            "are in another frame.",
            row=int(np.argmin(is_board)),
            column="kind",
            remedy="Make a study of each kind.",
        )
    position = read_coordinates(table)
    quaternion = read_column_set(table, QUATERNION_COLUMNS, "not unit")
    if quaternion is None:
        raise table.where.refuse(
            "rows of a board seen from the hand need the board's orientation, too.",
            remedy="Add qw qx qy qz, or the columns of another convention; a board's position alone "
            "does not say where the camera is.",
        )
    R = from_quaternion(quaternion)
    camera = -np.einsum("mji,mj->mi", R, position)
    columns: dict[str, NDArray[Any]] = dict(zip(("x_mm", "y_mm", "z_mm"), camera.T, strict=True))
    turned = to_quaternion(R.transpose(0, 2, 1))
    columns |= dict(zip(QUATERNION_COLUMNS, turned.T, strict=True))
    columns |= _convert_uncertainties(table, position, R)
    return replace(
        table,
        columns=_keep_others(table.columns) | columns,
        notes=(*table.notes, Note("board-seen", SAID)),
    )


def _keep_others(columns: Mapping[str, NDArray[Any]]) -> dict[str, NDArray[Any]]:
    """Keep the columns that do not hold the pose; of several boards, each is a group of its own."""
    used = {"kind", "length_mm", SINGLE, *POSITION_COLUMNS, *QUATERNION_COLUMNS}
    used |= {*UNCERTAINTY_COLUMNS, *ROTATION_UNCERTAINTY_COLUMNS}
    kept = {name: cells for name, cells in columns.items() if name not in used}
    boards = kept.pop("feature", None)
    if boards is not None and "group" not in kept and len(set(map(str, boards))) > 1:
        kept["group"] = boards
    return kept


def _convert_uncertainties(table: Table, position: Array, R: Array) -> dict[str, NDArray[Any]]:
    """Return the standard uncertainties of the camera's pose; none where the table states none."""
    sigma = read_column_set(table, UNCERTAINTY_COLUMNS, "not positive")
    if sigma is None and SINGLE in table:
        single = read_column_set(table, (SINGLE,), "not positive")
        assert single is not None
        sigma = np.repeat(single, 3, axis=1)
    sigma_rotation = read_column_set(table, ROTATION_UNCERTAINTY_COLUMNS, "not positive")
    if sigma is None and sigma_rotation is None:
        return {}
    if sigma is None or sigma_rotation is None:
        raise table.where.refuse(
            "a board's uncertainties of position and of orientation come together, since a turn of "
            "the board moves the camera around it.",
            remedy=f"Give {' '.join(UNCERTAINTY_COLUMNS)} and "
            f"{' '.join(ROTATION_UNCERTAINTY_COLUMNS)}, or leave both out.",
        )
    # a turn e of the board about the camera's axes moves the camera by Rᵀ (e x p)
    cross = np.cross(np.eye(3), position[:, None, :]).transpose(0, 2, 1)
    shift = np.einsum("mji,mjk->mik", R, cross)
    moved = np.einsum("mij,mj->mi", R.transpose(0, 2, 1) ** 2, sigma**2)
    around = np.einsum("mij,mj->mi", shift**2, sigma_rotation**2)
    turned = np.einsum("mij,mj->mi", R.transpose(0, 2, 1) ** 2, sigma_rotation**2)
    return dict(
        zip(
            (*UNCERTAINTY_COLUMNS, *ROTATION_UNCERTAINTY_COLUMNS),
            np.sqrt(np.concatenate([moved + around, turned], axis=1)).T,
            strict=True,
        )
    )
