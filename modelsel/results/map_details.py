"""The error map's cells as numbers small enough for a page: displacement per place, values per
cause, slopes per cell.

From them a reader's page computes the residual about any axis against any cause: with d (3,) the
target's displacement per unit screw, c the cause and r the residual, d·r / |d|² is the residual
seen as a twist of that screw, and c·slope + d·r / |d|² the partial residual beyond the base (Larsen
& McCleary 1972)."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from .._typing import Array
from ..diagnosis.scan import compute_basis
from ..fitting.design import PLACE, blocks, field_of
from ..fitting.problem import Problem
from ..mechanisms.causes import Applied, Cause, Combined, Named, Number
from ..selection.evaluation import Evaluation

if TYPE_CHECKING:
    from .result import Result

MOST = 800  # rows from which the slopes are taken
FAINT = (
    1e-5  # share of a column that must be left beyond the base for it to have a slope of its own
)


def wave(causes: tuple[Cause, ...]) -> tuple[Cause, float] | None:
    """(angle, waves per turn of it) where the causes are sine and cosine of one angle, else
    None."""
    if len(causes) != 2 or not all(
        isinstance(c, Applied) and c.function in ("sin", "cos") for c in causes
    ):
        return None
    first, second = (c for c in causes if isinstance(c, Applied))
    if {first.function, second.function} != {"sin", "cos"} or first.argument != second.argument:
        return None
    angle = first.argument
    if isinstance(angle, Combined) and angle.operator == "*" and isinstance(angle.left, Number):
        return angle.right, angle.left.number
    return angle, 1.0


def column_dict(causes: tuple[Cause, ...], problem: Problem) -> dict[str, Any]:
    """One column of the map: a wave by its angle and count (the joint's own readings are in the
    rows), else its values."""
    found = wave(causes)
    if found is not None:
        angle, count = found
        joint = next(
            (
                j
                for j in range(1, problem.robot.n + 1)
                if isinstance(angle, Named) and angle.name == f"q{j}"
            ),
            None,
        )
        return {
            "wave": count,
            "angle": str(angle),
            "joint": joint,
            "values": None if joint else [_values(angle, problem)],
        }
    return {
        "wave": None,
        "angle": None,
        "joint": None,
        "values": [_values(c, problem) for c in causes],
        "unit": causes[0].unit,
    }


def _values(cause: Cause, problem: Problem) -> list[Any]:
    values = np.broadcast_to(np.asarray(problem.cause(cause), float), (len(problem),))
    biggest = float(np.abs(values).max(initial=0))
    digits = int(np.clip(5 - np.ceil(np.log10(biggest)) if biggest > 0 else 0, 0, 9))
    out: list[Any] = (np.round(values, digits) + 0.0).tolist()
    return out


def cells_dict(
    result: Result, base_rung: Evaluation, problem: Problem, field: Array
) -> dict[str, Any]:
    """Places with their displacement (m, 3) at the drawn rows, causes, slopes by cell, the
    registered names of cells."""
    whole = result.error_map
    places = []
    for frame, axis in whole.where:
        d = field[frame - 1, PLACE[axis]]
        turning = (
            problem.components == 6 and float(np.abs(d[:3]).max()) < 1e-6
        )  # the target's own rotations turn, they do not move
        part = d[3:] if turning else d[:3]
        places.append(
            {
                "frame": frame,
                "axis": axis,
                "turns_only": turning,
                "d": (np.round(part.T, 1 if axis[0] == "r" and not turning else 4) + 0.0).tolist(),
            }
        )
    return {
        "places": places,
        "columns": [column_dict(causes, problem) for causes in whole.why],
        "slopes": _slopes(result, base_rung) if whole.where else [],
        "named": [
            [i, j, m.name] for (i, j), m in sorted(whole.named.items(), key=lambda item: item[0])
        ],
    }


def _slopes(result: Result, base_rung: Evaluation) -> list[Any]:
    """(P, C) nested: each cell's least-squares slopes alone beyond the base, six digits; None where
    no cell is."""
    data, whole = result.data, result.error_map
    used = np.flatnonzero(data.used)
    if len(used) > MOST:
        used = used[np.linspace(0, len(used) - 1, MOST).astype(int)]
    some, every = data.problem.take(used), slice(0, len(used))
    fitted, white = base_rung.fit, some.whiten
    _, columns, residual = next(blocks(some, fitted.terms, fitted.at()))  # MOST rows are one block
    Q, r = (
        compute_basis(columns[list(fitted.found.kept)].reshape(fitted.found.rank, residual.size).T),
        residual.reshape(-1),
    )
    field = field_of(some, some.pose(every), every)
    causes = [
        [np.broadcast_to(np.asarray(some.cause(c), float), (len(used),)) for c in why]
        for why in whole.why
    ]
    out: list[Any] = []
    for i, (frame, axis) in enumerate(whole.where):
        d = field[frame - 1, PLACE[axis]]
        d = d * white if isinstance(white, float) else np.einsum("mij,jm->im", white, d)
        line: list[Any] = [None] * len(causes)
        where = [j for j in range(len(causes)) if np.isfinite(whole.f[i, j])]
        for k in sorted({len(causes[j]) for j in where}):  # cells of as many causes together
            cells = [j for j in where if len(causes[j]) == k]
            flat = np.array([values for j in cells for values in causes[j]])
            X = (d[None] * flat[:, None]).reshape(len(flat), -1)
            Z = X - (X @ Q) @ Q.T
            for j, slopes in zip(
                cells,
                _slope(Z.reshape(len(cells), k, -1), X.reshape(len(cells), k, -1), r),
                strict=True,
            ):
                line[j] = [float(f"{v:.5g}") for v in slopes]
        out.append(line)
    return out


def _slope(Z: Array, X: Array, r: Array) -> list[Any]:
    """(n, k) least-squares slopes of r on the rows of every Z (n, k, N); nought for what the base
    has already."""
    size = np.linalg.norm(X, axis=2)
    moves = size.all(1)
    size = np.where(moves[:, None], size, 1.0)
    value, vector = np.linalg.eigh(
        np.matmul(Z, Z.swapaxes(1, 2)) / size[:, :, None] / size[:, None]
    )
    inverse = np.where(value > FAINT, 1 / np.where(value > FAINT, value, 1), 0)
    inner = inverse * np.matmul(vector.swapaxes(1, 2), (Z @ r / size)[:, :, None])[:, :, 0]
    slopes = np.matmul(vector, inner[:, :, None])[:, :, 0] / size
    found: list[Any] = np.where(moves[:, None], slopes, 0.0).tolist()
    return found
