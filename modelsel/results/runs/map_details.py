"""The error map's cells as numbers small enough for a page: displacement per place, values per
cause, slopes per cell.

From them a reader's page computes the residual about any axis against any cause: with d (3,) the
target's displacement per unit screw, c the cause and r the residual, d·r / |d|² is the residual
seen as a twist of that screw, and c·slope + d·r / |d|² the partial residual beyond the base (Larsen
& McCleary 1972)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..._typing import Array
from ...diagnosis.error_map import ErrorMap
from ...diagnosis.inference.scan import compute_basis
from ...fitting.design import PLACE, blocks, field_of
from ...fitting.problem import Problem
from ...mechanisms.causes import Cause, Named
from ...mechanisms.terms import Mechanism
from ...mechanisms.waves import find_common_wave
from ...selection.evaluation import Evaluation
from .mechanism_cards import find_card
from .study_run import StudyRun

# rows from which the slopes are taken: they are one block of the design
MAX_SLOPE_ROWS = 800
# share of a column that must be left beyond the base for it to have a slope
MIN_SHARE = 1e-5
# displacement [mm or mm per rad] below which a rotation of the target only turns it
MIN_DISPLACEMENT = 1e-6
SIGNIFICANT_DIGITS = 5

Values = dict[str, Any]


def describe_map(
    run: StudyRun, problem: Problem, field: Array, cards: dict[Mechanism, str]
) -> Values:
    """Return places with their displacement (m, 3) at the drawn rows, causes, slopes by cell, and the keys of the
    `cards` of cells that have a registered name."""
    whole = run.diagnosis.error_map
    names = sorted(whole.named.items(), key=lambda item: item[0])
    return {
        "places": [_describe_place(frame, axis, problem, field) for frame, axis in whole.where],
        "columns": [describe_column(causes, problem) for causes in whole.why],
        "slopes": _slopes(run) if whole.where else [],
        "named": [[row, column, find_card(cards, one)] for (row, column), one in names],
    }


def _describe_place(frame: int, axis: str, problem: Problem, field: Array) -> Values:
    """Return the displacement per unit screw of one place; of the target's own rotations, which turn it and do not
    move it, the rotation."""
    displacement = field[frame - 1, PLACE[axis]]
    is_still = float(np.abs(displacement[:3]).max()) < MIN_DISPLACEMENT
    turns_only = problem.components == 6 and is_still
    part = displacement[3:] if turns_only else displacement[:3]
    is_lever = axis[0] == "r" and not turns_only
    decimals = 4
    if is_lever:
        decimals = 1
    return {
        "frame": frame,
        "axis": axis,
        "turns_only": turns_only,
        "d": (np.round(part.T, decimals) + 0.0).tolist(),
    }


# -- causes
# ---------------------------------------------------------------------------------------------------------------------


def describe_column(causes: tuple[Cause, ...], problem: Problem) -> Values:
    """Return one column of the map: a wave by its angle and count (the joint's own readings are in the rows), else
    its values."""
    wave = find_common_wave(causes)
    if wave is None:
        values = [_cause_values(cause, problem) for cause in causes]
        unit = causes[0].unit
        return {"wave": None, "angle": None, "joint": None, "values": values, "unit": unit}
    angle, count = wave
    joint = _joint_of(angle, problem.robot.n)
    readings = None if joint else [_cause_values(angle, problem)]
    return {"wave": count, "angle": str(angle), "joint": joint, "values": readings}


def _joint_of(angle: Cause, joints: int) -> int | None:
    """Return the joint whose reading an angle is; None of any other."""
    if not isinstance(angle, Named):
        return None
    readings = {f"q{joint}": joint for joint in range(1, joints + 1)}
    return readings.get(angle.name)


def _cause_values(cause: Cause, problem: Problem) -> list[Any]:
    """Return a cause at the problem's rows, rounded by its largest value."""
    values = _broadcast(cause, problem)
    largest = float(np.abs(values).max(initial=0))
    magnitude = np.ceil(np.log10(largest)) if largest > 0 else SIGNIFICANT_DIGITS
    decimals = int(np.clip(SIGNIFICANT_DIGITS - magnitude, 0, 9))
    rounded: list[Any] = (np.round(values, decimals) + 0.0).tolist()
    return rounded


def _broadcast(cause: Cause, problem: Problem) -> Array:
    """Return (m,) a cause at every row."""
    return np.broadcast_to(np.asarray(problem.cause(cause), float), (len(problem),))


# -- slopes
# ---------------------------------------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class _Beyond:
    """What is left beyond the base at some rows: an orthonormal `basis` (N, p) of its columns, its `residual` (N,),
    both whitened, and the whitened displacement field of the places, (components, m) each."""

    problem: Problem
    basis: Array
    residual: Array
    field: Array

    def displacement(self, frame: int, axis: str) -> Array:
        """Return the whitened displacement per unit screw of one place."""
        displacement = self.field[frame - 1, PLACE[axis]]
        return self.problem.whitening.apply(displacement.copy())


def _slopes(run: StudyRun) -> list[list[list[float] | None]]:
    """Return (P, C) nested: each cell's least-squares slopes alone beyond the base, five digits; None where no cell
    is."""
    used = np.flatnonzero(run.split.used)
    if len(used) > MAX_SLOPE_ROWS:
        used = used[np.linspace(0, len(used) - 1, MAX_SLOPE_ROWS).astype(int)]
    beyond = _beyond_base(run.problem.take(used), run.base)
    whole = run.diagnosis.error_map
    causes = [
        np.array([_broadcast(cause, beyond.problem) for cause in column]) for column in whole.why
    ]
    return [
        _place_slopes(beyond, beyond.displacement(*place), causes, _scanned(whole, row))
        for row, place in enumerate(whole.where)
    ]


def _scanned(whole: ErrorMap, row: int) -> list[int]:
    """Return the columns that have a cell in a row of the map."""
    return np.flatnonzero(np.isfinite(whole.f[row])).tolist()


def _beyond_base(problem: Problem, base: Evaluation) -> _Beyond:
    """Return what the base leaves at the rows of a problem."""
    fitted = base.fit
    _, columns, residual = next(blocks(problem, fitted.terms, fitted.at()))
    kept = columns[list(fitted.found.kept)].reshape(fitted.found.rank, residual.size)
    whole = slice(0, len(problem))
    field = field_of(problem, problem.pose(whole), whole)
    return _Beyond(problem, compute_basis(kept.T), residual.reshape(-1), field)


def _place_slopes(
    beyond: _Beyond, displacement: Array, causes: Sequence[Array], scanned: Sequence[int]
) -> list[list[float] | None]:
    """Return the slopes of one place's cells; cells of as many causes are solved together."""
    line: list[list[float] | None] = [None] * len(causes)
    for count in sorted({len(causes[column]) for column in scanned}):
        cells = [column for column in scanned if len(causes[column]) == count]
        values = np.concatenate([causes[column] for column in cells])
        X = displacement[None] * values[:, None]
        X = X.reshape(len(values), -1)
        projection = X @ beyond.basis
        Z = X - projection @ beyond.basis.T
        shape = (len(cells), count, -1)
        solved = _solve_slopes(Z.reshape(shape), X.reshape(shape), beyond.residual)
        for column, slopes in zip(cells, solved, strict=True):
            line[column] = [float(f"{slope:.5g}") for slope in slopes]
    return line


def _solve_slopes(Z: Array, X: Array, residual: Array) -> list[list[float]]:
    """Return (n, k) least-squares slopes of the residual on the rows of every Z (n, k, N), what X (n, k, N) has
    beyond the base; zero for what the base has already."""
    size = np.linalg.norm(X, axis=2)
    moves = size.all(1)
    size = np.where(moves[:, None], size, 1.0)
    gram = np.matmul(Z, Z.swapaxes(1, 2))
    gram = gram / size[:, :, None] / size[:, None]
    value, vector = np.linalg.eigh(gram)
    is_left = value > MIN_SHARE
    inverse = np.where(is_left, 1 / np.where(is_left, value, 1), 0)
    projected = (Z @ residual / size)[:, :, None]
    rotated = np.matmul(vector.swapaxes(1, 2), projected)[:, :, 0]
    inner = inverse * rotated
    slopes = np.matmul(vector, inner[:, :, None])[:, :, 0]
    slopes = slopes / size
    solved: list[list[float]] = np.where(moves[:, None], slopes, 0.0).tolist()
    return solved
