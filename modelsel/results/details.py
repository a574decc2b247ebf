"""details.json: what the pictures need beyond result.json, so that a report can be drawn again from
files alone.

Rows are thinned evenly to at most ROWS (outlying ones stay). Lengths in mm to 0.1 µm, angles in rad
to 10 µrad; residuals and displacements in the tracker's frame."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from .._typing import Array, Index
from ..fitting.design import directions, field_of, residuals
from ..fitting.problem import Problem
from ..mechanisms.serialization import describe_mechanism
from .map_details import cells_dict
from .panels import finding_panels

if TYPE_CHECKING:
    from .result import Result

ROWS = 480  # drawn; more say nothing more to the eye and make the page heavy
OUTLIERS = 60


def rounded(values: Array, digits: int) -> list[Any]:
    """Nested lists, a fixed number of decimals, no negative nought."""
    out: list[Any] = (np.round(np.asarray(values, float), digits) + 0.0).tolist()
    return out


def thinned(estimation: NDArray[np.bool_], outlying: NDArray[np.bool_], most: int = ROWS) -> Index:
    """Indices of the rows to draw: outlying ones first, then half for the held-out rows at most,
    evenly in file order."""

    def some(mask: NDArray[np.bool_], count: int) -> Index:
        at = np.flatnonzero(mask)
        return (
            at if len(at) <= count else at[np.linspace(0, len(at) - 1, max(count, 1)).astype(int)]
        )

    out = some(outlying, OUTLIERS)
    held = some(
        ~estimation & ~outlying,
        max(most // 2, most - len(out) - int((estimation & ~outlying).sum())),
    )
    return np.sort(
        np.concatenate([out, held, some(estimation & ~outlying, most - len(out) - len(held))])
    )


def arm(problem: Problem) -> list[Any]:
    """(n+2, 3) origins of the nominal chain, joint 1 to target, in the tracker's frame, at the
    configuration nearest to all."""
    q = problem.data.q
    middle = int(
        np.argmin(
            np.square((q - np.median(q, axis=0)) / np.maximum(np.std(q, axis=0), 1e-9)).sum(1)
        )
    )
    one = problem.take(np.array([middle]))
    at, R, t = (
        one.pose(slice(None)),
        one.placement[0][one.data.group[0]],
        one.placement[1][one.data.group[0]],
    )
    return rounded(at.origins[:, :, 0] @ R.T + t, 1)


def details(result: Result) -> dict[str, Any]:
    """The file's content as plain values."""
    data, base = result.data, tuple(result.study.model.base)
    rows = thinned(data.estimation, data.outlying)
    problem = data.problem.take(rows)
    every = slice(0, len(problem))
    measured, at = problem.data, problem.pose(every)
    field = field_of(problem, at, every)
    placed, seen = measured.position, field
    if (
        measured.gauges is not None
    ):  # drawn where the nominal arm has the target, a single number along its direction
        G = directions(problem, at, every)
        placed = np.where(np.isfinite(placed), placed, -residuals(problem.bare)[:, :3])
        seen = field.copy()
        seen[:, :, :3] = np.einsum("jim,fajm->faim", G, field[:, :, :3])

    def drawn(residual: Array) -> Array:
        return (
            residual
            if measured.gauges is None
            else np.asarray(np.einsum("jim,mj->mi", G, residual))
        )

    turned = problem.components == 6
    base_rung = next(r for r in result.ladder if r.names == base)
    return {
        "schema": 1,
        "data_sha256": result.provenance["data_sha256"],
        "study_sha256": result.provenance["study_sha256"],
        "rows": {
            "of": len(data.problem),
            "row": measured.row.tolist(),
            "estimation": data.estimation[rows].astype(int).tolist(),
            "outlying": data.outlying[rows].astype(int).tolist(),
            "q": rounded(measured.q, 5),
            "measured_mm": rounded(placed, 2),
        },
        "places": data.problem.data.where.record(data.problem.data.row),
        "joints": [
            {
                "unit": "mm" if j.prismatic else "rad",
                "limits": None if j.limits is None else rounded(np.array(j.limits), 5),
            }
            for j in result.robot.joints
        ],
        "arm_mm": arm(data.problem),
        "base": result.ladder.index(base_rung),
        "rungs": [
            {
                "residual_mm": rounded(drawn(r.residual[rows][:, :3]), 4),
                "rotation_rad": rounded(r.residual[rows][:, 3:], 6) if turned else None,
            }
            for r in result.ladder
        ],
        "map": cells_dict(result, base_rung, problem, seen),
        "cards": {m.name: describe_mechanism(m) for m in _mentioned(result)},
        "findings": finding_panels(result, problem, field, rows),
    }


def _mentioned(result: Result) -> list[Any]:
    """Every registered mechanism that a cell or a credible set names, once by name."""
    found = [
        *result.error_map.named.values(),
        *(
            e.candidate.mechanism
            for f in result.findings
            for e in f.effect.named.entries
            if e.candidate.registered
        ),
    ]
    first = {m.name: m for m in reversed(found)}
    return [first[name] for name in sorted(first)]


def dumps(content: dict[str, Any]) -> str:
    """The file's text: compact, the same bytes for the same values."""
    return json.dumps(content, ensure_ascii=False, separators=(",", ":"), allow_nan=False) + "\n"
