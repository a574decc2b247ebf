"""details.json: what the pictures need beyond result.json, so that a report can be drawn again from
files alone.

Rows are thinned evenly to at most MAX_DRAWN_ROWS (outlying ones stay). Lengths in mm to 0.1 µm, angles in rad
to 10 µrad; residuals and displacements in the tracker's frame."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .._records import parse_record
from .._typing import Array, Index
from ..fitting.design import directions, field_of, residuals
from ..fitting.problem import Problem
from ..measurements.campaign.reference_temperature import TEMPERATURE
from ..measurements.measurements import Measurements
from .pictures.arm_details import describe_arm, describe_meanings, find_middling_row
from .pictures.finding_postures import describe_postures
from .pictures.panels import describe_panels
from .reading import SCHEMA
from .runs.map_details import describe_map
from .runs.mechanism_cards import describe_cards, key_cards, list_finding_cards
from .runs.study_run import StudyRun
from .schemas.details_schema import DetailsRecord

# rows drawn: more say nothing more to the eye and make the page heavy
MAX_DRAWN_ROWS = 480
MAX_DRAWN_OUTLIERS = 60

Mask = NDArray[np.bool_]
Values = dict[str, Any]


@dataclass(frozen=True, eq=False)
class _Drawing:
    """The rows that are drawn: their problem, their indices, the displacement field of every place, and for rows that
    are no points the directions (1, 3, m) along which they measure."""

    problem: Problem
    rows: Index
    field: Array
    directions: Array | None

    def in_space(self, residual: Array) -> Array:
        """Return residuals (m, 3) as vectors in the tracker's frame."""
        if self.directions is None:
            return residual
        return np.asarray(np.einsum("jim,mj->mi", self.directions, residual))

    @property
    def displacement(self) -> Array:
        """The displacement field as vectors in the tracker's frame."""
        if self.directions is None:
            return self.field
        field = self.field.copy()
        field[:, :, :3] = np.einsum("jim,fajm->faim", self.directions, self.field[:, :, :3])
        return field

    @property
    def positions(self) -> Array:
        """(m, 3) where the targets are drawn: as measured, else where the nominal arm has them."""
        measured = self.problem.data.position
        if self.directions is None:
            return measured
        return np.where(np.isfinite(measured), measured, -residuals(self.problem.bare)[:, :3])


def draw_details(run: StudyRun) -> DetailsRecord:
    """Return details.json's content of a finished run."""
    rows = select_rows(run.split.estimation, run.split.outlying)
    drawing = _prepare(run.problem.take(rows), rows)
    return parse_record(_values(run, drawing), DetailsRecord)


def _prepare(problem: Problem, rows: Index) -> _Drawing:
    whole = slice(0, len(problem))
    pose = problem.pose(whole)
    is_gauged = problem.data.gauges is not None
    along = directions(problem, pose, whole) if is_gauged else None
    return _Drawing(problem, rows, field_of(problem, pose, whole), along)


def _values(run: StudyRun, drawing: _Drawing) -> Values:
    """Return the file's keys, in their order."""
    everything = run.problem.data
    keys = key_cards(run)
    return {
        "schema": SCHEMA,
        "data_sha256": run.provenance["data_sha256"],
        "study_sha256": run.provenance["study_sha256"],
        "campaign": run.study.campaign.given or None,
        "rows": _describe_rows(run, drawing),
        "places": everything.where.record(
            everything.row, everything.row[run.split.outlying].tolist()
        ),
        "joints": _describe_joints(run),
        "arm_mm": round_nested(nominal_arm(run.problem), 1),
        "arm": describe_arm(run.problem),
        "parameters": describe_meanings(run.problem, run.models.chosen.fit),
        "base": run.models.ladder.index(run.base),
        "rungs": _describe_residuals(run, drawing),
        "map": describe_map(run, drawing.problem, drawing.displacement, keys),
        "cards": describe_cards(keys),
        "findings": _describe_findings(run, drawing, list_finding_cards(run, keys)),
    }


def _describe_rows(run: StudyRun, drawing: _Drawing) -> Values:
    data = drawing.problem.data
    rows = drawing.rows
    return {
        "of": len(run.problem),
        "row": data.row.tolist(),
        "estimation": run.split.estimation[rows].astype(int).tolist(),
        "outlying": run.split.outlying[rows].astype(int).tolist(),
        "q": round_nested(data.q, 5),
        "measured_mm": round_nested(drawing.positions, 2),
        "progress": round_nested(data.progress, 5),
        "move": round_nested(_largest_moves(data), 5),
        **_describe_temperature(data),
    }


def _largest_moves(data: Measurements) -> Array:
    """Return the largest last move (m,) of a joint that turns [rad], of an arm that has none of one that slides
    [mm]."""
    slides = np.array(data.prismatic or [False] * data.q.shape[1])
    moved = data.move if slides.all() else data.move[:, ~slides]
    return np.asarray(moved.max(1, initial=0.0))


def _describe_temperature(data: Measurements) -> Values:
    """Return the temperature of every row, where it was measured."""
    celsius = data.covariates.get(TEMPERATURE)
    if celsius is None or not np.isfinite(celsius).all():
        return {}
    return {"temperature_C": round_nested(celsius, 2)}


def _describe_joints(run: StudyRun) -> list[Values]:
    return [
        {
            "unit": "mm" if joint.prismatic else "rad",
            "limits": None if joint.limits is None else round_nested(np.array(joint.limits), 5),
        }
        for joint in run.robot.joints
    ]


def _describe_findings(run: StudyRun, drawing: _Drawing, cards: list[Values]) -> list[Values]:
    """Return of every finding its panels, the arm where it errs most, and which card is its own."""
    panels = describe_panels(run, drawing.problem, drawing.field, drawing.rows)
    postures = describe_postures(run)
    parts = zip(panels, postures, cards, strict=True)
    return [one | {"posture": posture} | card for one, posture, card in parts]


def _describe_residuals(run: StudyRun, drawing: _Drawing) -> list[Values]:
    """Return the residuals of every rung at the drawn rows."""
    has_rotation = drawing.problem.components == 6
    rungs = []
    for rung in run.models.ladder:
        residual = rung.residual[drawing.rows]
        position = drawing.in_space(residual[:, :3])
        rotation = round_nested(residual[:, 3:], 6) if has_rotation else None
        rungs.append({"residual_mm": round_nested(position, 4), "rotation_rad": rotation})
    return rungs


def round_nested(values: Array, digits: int) -> list[Any]:
    """Return nested lists, a fixed number of decimals, no negative zero."""
    rounded: list[Any] = (np.round(np.asarray(values, float), digits) + 0.0).tolist()
    return rounded


def select_rows(estimation: Mask, outlying: Mask, most: int = MAX_DRAWN_ROWS) -> Index:
    """Return the indices of the rows to draw: outlying ones first, then half for the held-out rows at most, evenly in
    file order."""
    used, held_out = estimation & ~outlying, ~estimation & ~outlying
    outliers = _spread(outlying, MAX_DRAWN_OUTLIERS)
    room = most - len(outliers)
    held_out_room = max(most // 2, room - int(used.sum()))
    shown_held_out = _spread(held_out, held_out_room)
    shown_used = _spread(used, room - len(shown_held_out))
    shown = np.concatenate([outliers, shown_held_out, shown_used])
    return np.sort(shown)


def _spread(mask: Mask, count: int) -> Index:
    """Return at most `count` indices of a mask, evenly spread."""
    indices = np.flatnonzero(mask)
    if len(indices) <= count:
        return indices
    last = len(indices) - 1
    steps = np.linspace(0, last, max(count, 1)).astype(int)
    spread: Index = indices[steps]
    return spread


def nominal_arm(problem: Problem) -> Array:
    """Return (n+2, 3) origins of the nominal chain, joint 1 to target, in the tracker's frame, at the configuration
    nearest to all."""
    nearest = find_middling_row(problem)
    middle = problem.take(np.array([nearest]))
    rotation, translation = middle.placement
    group = middle.data.group[0]
    origins = middle.pose(slice(None)).origins[:, :, 0]
    return np.asarray(origins @ rotation[group].T + translation[group])
