"""A finding against the covariate that drives it, as a thermal effect against the temperature.

Let w (3,) be what a row's target moves between the lowest and the highest value of the covariate. An
effect m and a residual r are then m·w / |w|² and r·w / |w|² of that way, which depends on the
covariate alone where the effect is a product of it and the posture. Times the rms of |w| they are
millimetres at a typical posture."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ..._linalg import TINY
from ..._typing import Array
from ...fitting.design import compute_columns
from ...fitting.problem import Problem
from ...mechanisms.terms import Term
from .panel_points import CURVE_POINTS, PanelPoints, select_points

# share of the longest way: rows with less show noise, no effect
MIN_WAY = 0.2

Values = dict[str, Any]


def find_covariate(terms: Sequence[Term], problem: Problem) -> str | None:
    """Find the covariate of the data that drives some terms; None where there is none, or several."""
    names = {name for term in terms for screw in term.screws for name in screw.cause.names()}
    drivers = sorted(names & set(problem.data.covariates))
    return drivers[0] if len(drivers) == 1 else None


def draw_covariate(
    terms: Sequence[Term],
    estimate: Array,
    problem: Problem,
    field: Array,
    residual: Array,
    name: str,
) -> Values | None:
    """Return the panel of an effect against a covariate; None where the covariate moves nothing."""
    effect = _Effect(terms, estimate)
    values = np.asarray(problem.data.covariates[name], float)
    low, high = float(values.min()), float(values.max())
    way = effect.displace(_hold(problem, name, high), field)
    way = way - effect.displace(_hold(problem, name, low), field)
    length = np.linalg.norm(way, axis=1)
    rows = select_points(length > max(MIN_WAY * length.max(initial=0.0), TINY))
    if rows is None:
        return None
    lengths = length[rows, None]
    typical = float(np.sqrt(np.square(lengths).mean()))
    scale = way[rows] / lengths * (typical / lengths)
    moved = effect.displace(problem, field)
    fitted = (scale * moved[rows]).sum(1)
    left = (scale * residual[rows, :3]).sum(1)
    longest = int(length.argmax())
    most = length[longest]
    along_way = way[longest] / most * (typical / most)
    grid = np.linspace(low, high, CURVE_POINTS)
    one = np.full(CURVE_POINTS, longest)
    along_grid = effect.displace(_hold(problem.take(one), name, grid), field[..., one])
    weight = np.square(length[rows] / length.max())
    points = PanelPoints(values[rows], left + fitted, left, weight, grid, along_grid @ along_way)
    return {
        "frames": [],
        "axis": "",
        "against": name,
        "against_unit": problem.names().get(name, "1"),
        "unit": "mm",
        "kind": "line",
        **points.describe(),
    }


@dataclass(frozen=True, eq=False)
class _Effect:
    """Terms and their estimate (k,)."""

    terms: Sequence[Term]
    estimate: Array

    def displace(self, problem: Problem, field: Array) -> Array:
        """Compute the target's displacement (m, 3) [mm]."""
        columns = compute_columns(problem, field, self.terms, slice(0, len(problem)))
        moved: Array = np.tensordot(self.estimate, columns, 1)[:3].T
        return moved


def _hold(problem: Problem, name: str, value: Array | float) -> Problem:
    """Return a problem with other values of one covariate."""
    values = np.broadcast_to(value, (len(problem),)).astype(float)
    covariates = {**problem.data.covariates, name: values}
    return replace(problem, data=replace(problem.data, covariates=covariates))
