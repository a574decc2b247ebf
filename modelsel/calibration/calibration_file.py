"""A calibration as the text of calibration.json."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from .._arguments import check_path
from .._files import write_atomically
from ..mechanisms.serialization import mechanism_record
from ..robot.alignment import have_same_chain
from ..robot.kinematics import Robot, UrdfSource
from ..robot.plain_values import robot_record
from ..robot.urdf import read_urdf_text
from .calibration_schema import SCHEMA_VERSION
from .other_sides import OtherSide
from .refitting import refits_record

if TYPE_CHECKING:
    from .calibration import Calibration

CALIBRATION_FILE = "calibration.json"


def save_calibration(c: Calibration, folder: Path | str) -> Path:
    """Write calibration.json into a folder, whole or not at all, and return its path. Raises
    StudyError."""
    path = check_path(folder, "the folder that calibration.json is written into")
    path = path / CALIBRATION_FILE
    write_atomically(path, calibration_text(c).encode())
    return path


def calibration_text(c: Calibration) -> str:
    """Return the text of calibration.json; numbers in full."""
    record = calibration_record(c)
    text = json.dumps(record, ensure_ascii=False, indent=1, allow_nan=False)
    return text + "\n"


def calibration_record(c: Calibration) -> dict[str, Any]:
    """Return a calibration as JSON values, in the order of the file."""
    record: dict[str, Any] = {
        "schema": SCHEMA_VERSION,
        "kind": "calibration",
        "study": c.study,
        "robot": robot_record(c.robot),
        "targets": [
            {
                "name": name,
                "tool_mm": c.tools[k].tolist(),
                "rotation": None if c.tool_rotations is None else c.tool_rotations[k].tolist(),
            }
            for k, name in enumerate(c.targets)
        ],
        "groups": [
            {
                "name": name,
                "rotation": c.placement[0][k].tolist(),
                "translation_mm": c.placement[1][k].tolist(),
            }
            for k, name in enumerate(c.groups)
        ],
        "registered": c.registered,
        "tracker_mm": list(c.tracker),
        "mechanisms": [mechanism_record(m) for m in c.model.mechanisms],
        "estimates": [
            {
                "symbol": t.symbol,
                "value": float(v),
                "standard_error": float(e),
                "unit": t.unit,
                "estimable": k in c.kept,
            }
            for k, (t, v, e) in enumerate(zip(c.terms, c.theta, c.standard_errors, strict=True))
        ],
        "covariance_factor": {
            "says": "row k of the fitted terms (estimable), from its own column on: covariance = F Fᵀ",
            "rows": [c.factor[k, i:].tolist() for i, k in enumerate(c.kept)],
        },
        "noise_floor": {
            "coordinate_mm": c.floor.coordinate_mm,
            "source": c.floor.source,
            "freedom": c.floor.freedom if np.isfinite(c.floor.freedom) else None,
        },
        "held_out_rms_mm": c.held_out_rms_mm,
        "ranges": {name: list(pair) for name, pair in c.ranges.items()},
        "provenance": dict(c.provenance),
    }
    if c.refits is not None:
        symbols = [term.symbol for term in c.terms]
        record["refits"] = refits_record(c.refits, symbols)
    if c.doubtful:
        record["doubtful"] = list(c.doubtful)
    if c.held_out_model_mm is not None:
        record["held_out_model_mm"] = c.held_out_model_mm
    if c.held_out_ranges:
        beyond = {name: list(pair) for name, pair in c.held_out_ranges.items()}
        record["held_out_ranges"] = beyond
    if c.estimation_rows.count:
        rows = c.estimation_rows
        record["estimation_rows"] = {"count": rows.count, "codes": rows.text}
    if c.other_sides:
        record["other_sides"] = {name: _record_side(one) for name, one in c.other_sides.items()}
    form = c.form
    if not form.is_plain:
        columns = dict(form.columns)
        record["file_form"] = {"columns": columns, "sheet": form.sheet, "decimal": form.decimal}
        if form.headerless:
            record["file_form"]["header"] = False
        if form.joined:
            record["file_form"]["joined"] = dict(form.joined)
    source = c.robot.urdf
    if source is not None and _is_of(source, c.robot):
        record["urdf"] = {"base": source.base, "tip": source.tip, "text": source.text}
    return record


def _record_side(one: OtherSide) -> dict[str, Any]:
    """Return what may be true in the place of a mechanism as JSON values."""
    values = one._asdict()
    instrument = mechanism_record(one.instrument)
    return values | {"instrument": instrument, "estimate": list(one.estimate)}


def _is_of(source: UrdfSource, robot: Robot) -> bool:
    """Whether a robot still has the chain of the URDF that it was read from: a script may have
    changed it."""
    read = read_urdf_text(source.text, "urdf", source.base, source.tip)
    return have_same_chain(robot, read)
