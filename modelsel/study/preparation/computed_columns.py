"""Columns that were computed from the measured positions, told by their values: they know the noise
of the measurement itself, which no cause of errors does."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ..._linalg import orthonormal_basis, project_out
from ..._typing import Array
from ...fitting.component_noise import POSITION
from ...fitting.design import residuals
from ...fitting.problem import Problem
from ...measurements.quantities.contract_columns import KNOWN_COVARIATES
from ...notices import Note

# what is left of a column's variance, by deviations beside what another frame and tool change in
# them, up to which it was computed from them: 1 % of its spread. A drift that moves the whole arm
# one way would need noise and all other errors so small
MAX_DEVIATION_SHARE = 1e-4
# the same of a combination of the coordinates themselves, which is exact but for digits cut off
MAX_POSITION_SHARE = 1e-8
# rows that are looked at, and the least number for one that is fitted
MAX_ROWS = 2000
MIN_ROWS_PER_NUMBER = 3


def drop_computed_columns(
    problem: Problem, estimation: NDArray[np.bool_], named: Collection[str]
) -> tuple[Problem, list[Note]]:
    """Leave out the columns that agree with the measured positions, or their deviations from the
    nominal arm, more closely than any cause could; not those that the study has `named`."""
    data = problem.data
    kept = {*KNOWN_COVARIATES, *named}
    open_names = [name for name in data.covariates if name not in kept]
    is_seen = estimation & data.points
    rows = np.flatnonzero(is_seen)
    if not open_names or not len(rows):
        return problem, []
    step = -(-len(rows) // MAX_ROWS)
    seen = rows[::step]
    sample = problem.take(seen)
    told = _list_regressors(sample)
    computed = dict[str, str]()
    for name in open_names:
        values = sample.data.covariates[name]
        why = _find_agreement(values, *told)
        if why:
            computed[name] = why
    if not computed:
        return problem, []
    left = {name: each for name, each in data.covariates.items() if name not in computed}
    lean = replace(data, covariates=left)
    notes = [_describe(name, why) for name, why in computed.items()]
    return replace(problem, data=lean), notes


def _list_regressors(sample: Problem) -> tuple[Array, Array, Array]:
    """List (constant and measured coordinates (m, 4); what another placing of the frame and target
    changes (m, 13); deviations and their size (m, 4))."""
    position = sample.data.position
    residual = residuals(sample)
    deviation = residual[:, POSITION]
    size = np.linalg.norm(deviation, axis=1)
    rows = len(position)
    constant = np.ones(rows)
    # from their mean: far from the tracker they would be all but constant
    coordinates = position - position.mean(axis=0)
    measured = np.column_stack([constant, coordinates])
    axes = sample.pose(slice(None)).axes[-1, :3]
    flange = axes.transpose(2, 1, 0)
    turns = flange.reshape(rows, 9)
    placed = np.column_stack([measured, turns])
    deviations = np.column_stack([deviation, size])
    return measured, placed, deviations


def _find_agreement(values: Array, measured: Array, placed: Array, deviations: Array) -> str:
    """Say what a column (m,) agrees with; empty where it may be a cause."""
    spread = np.ptp(values)
    fitted = placed.shape[1] + deviations.shape[1]
    if not spread or len(values) < MIN_ROWS_PER_NUMBER * fitted:
        return ""
    mean = values.mean()
    centred = values - mean
    total = float(centred @ centred)
    if _measure_rest(measured, centred) <= MAX_POSITION_SHARE * total:
        return "the measured coordinates"
    before = _measure_rest(placed, centred)
    if before <= MAX_POSITION_SHARE * total:
        return ""
    both = np.column_stack([placed, deviations])
    after = _measure_rest(both, centred)
    return "the deviations from the nominal arm" if after <= MAX_DEVIATION_SHARE * before else ""


def _measure_rest(columns: Array, values: Array) -> float:
    """Return the sum of squares that columns (m, k) leave of values (m,)."""
    rest = project_out(values, orthonormal_basis(columns))
    return float(rest @ rest)


def _describe(name: str, why: str) -> Note:
    sentence = (
        f'Column "{name}" follows {why} as closely as only what was computed from them can: it is '
        "not a cause, and is left out. [[covariate]] with its name keeps it."
    )
    return Note("computed-ignored", sentence)
