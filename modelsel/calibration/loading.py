"""calibration.json read back: whole, each value of its type, its parts in agreement, or refused in
one sentence with the place."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from .._json import parse_json, read_json_text
from .._records import parse_record
from .._typing import Array
from ..exceptions import StudyError
from ..fitting.design import Model
from ..fitting.noise import Floor
from ..mechanisms.serialization import find_members, mechanism_from_record
from ..robot.plain_values import bounded_array, check_rotation, robot_from_record
from .calibration import Calibration
from .refitting import Refits, refits_of
from .schema import SCHEMA_VERSION, CalibrationRecord, NoiseFloorRecord
from .storage import CALIBRATION_FILE

RELATIVE_TOLERANCE = 1e-6  # two numbers of a file that say the same
REMEDY = "Run the study again."
PLACED_NAMES = {"target", "group"}  # names of a cause that are no values with a range


def load_calibration(path: Path | str) -> Calibration:
    """Load a stored calibration: its file, the result.json beside it, or the folder of both. Raises
    StudyError."""
    file = _find_file(Path(path))
    try:
        text = read_json_text(file)
    except FileNotFoundError:
        raise StudyError(
            f"{file}: no such calibration; `modelsel study STUDY.toml` writes one beside its result.json."
        ) from None
    except ValueError as error:
        raise StudyError(f"{file.name}: cannot be read: {error}. {REMEDY}") from None
    return parse_calibration(text, file.name)


def _find_file(path: Path) -> Path:
    if path.is_dir():
        return path / CALIBRATION_FILE
    if path.name == "result.json":
        return path.with_name(CALIBRATION_FILE)
    return path


def parse_calibration(text: str, where: str = CALIBRATION_FILE) -> Calibration:
    """Return the calibration of a file's text. Raises StudyError."""
    try:
        value = parse_json(text)
    except ValueError as error:
        raise StudyError(f"{where}: cannot be read: {error}. {REMEDY}") from None
    if not isinstance(value, dict) or value.get("kind") != "calibration":
        raise StudyError(
            f"{where}: not a calibration; `modelsel study` writes one beside its result.json."
        )
    version = value.get("schema")
    if version is True or version != SCHEMA_VERSION:
        raise StudyError(
            f"{where}: schema {str(version)[:40]}, but this modelsel reads schema {SCHEMA_VERSION}. {REMEDY}"
        )
    try:
        return _restore(parse_record(value, CalibrationRecord))
    except ValueError as error:
        raise StudyError(f"{where}: damaged: {error}. {REMEDY}") from None


def _restore(record: CalibrationRecord) -> Calibration:
    """Return the calibration of a record. Raises ValueError where its parts do not agree."""
    model = Model(tuple(map(mechanism_from_record, record.mechanisms)))
    _check_estimates(record, model)
    x, y, z = bounded_array(record.tracker_mm).tolist()
    estimable = enumerate(estimate.estimable for estimate in record.estimates)
    calibration = Calibration(
        study=record.study,
        robot=robot_from_record(record.robot.to_dict()),
        targets=tuple(target.name for target in record.targets),
        groups=tuple(group.name for group in record.groups),
        tools=bounded_array([target.tool_mm for target in record.targets]),
        tool_rotations=_restore_tool_rotations(record),
        placement=_restore_placement(record),
        registered=record.registered,
        tracker=(x, y, z),
        model=model,
        theta=np.array([estimate.value for estimate in record.estimates]),
        factor=_restore_factor(record),
        kept=tuple(term for term, kept in estimable if kept),
        floor=_restore_floor(record.noise_floor),
        held_out_rms_mm=record.held_out_rms_mm,
        ranges={name: (low, high) for name, (low, high) in record.ranges.items()},
        provenance=dict(record.provenance),
        refits=_restore_refits(record, model),
    )
    _check_standard_errors(record, calibration.standard_errors)
    _check_screws(record, model)
    return calibration


def _restore_tool_rotations(record: CalibrationRecord) -> Array | None:
    """Return the targets' orientations (T, 3, 3); None where they have none."""
    given = [target.rotation for target in record.targets]
    rotations = [check_rotation(rows) for rows in given if rows is not None]
    return np.array(rotations) if rotations else None


def _restore_placement(record: CalibrationRecord) -> tuple[Array, Array]:
    """Return rotations (G, 3, 3) and translations (G, 3) of frame 0 in the tracker's frame."""
    rotations = np.array([check_rotation(group.rotation) for group in record.groups])
    return rotations, bounded_array([group.translation_mm for group in record.groups])


def _restore_factor(record: CalibrationRecord) -> Array:
    """Return the factor (p, r) of the covariance from its rows, each from its own column on."""
    estimable = [k for k, estimate in enumerate(record.estimates) if estimate.estimable]
    factor = np.zeros((len(record.estimates), len(estimable)))
    for column, (term, row) in enumerate(
        zip(estimable, record.covariance_factor.rows, strict=True)
    ):
        factor[term, column:] = row
    return factor


def _restore_floor(record: NoiseFloorRecord) -> Floor:
    freedom = np.inf if record.freedom is None else record.freedom
    return Floor(record.coordinate_mm, record.source, freedom)


def _restore_refits(record: CalibrationRecord, model: Model) -> Refits | None:
    return None if record.refits is None else refits_of(record.refits, model)


# -- parts of the file that say the same, or hang together
# ------------------------------------------------------------------------------------------------


def _check_estimates(record: CalibrationRecord, model: Model) -> None:
    """Raise ValueError where the estimates are not those of the model's terms."""
    stored = [(estimate.symbol, estimate.unit) for estimate in record.estimates]
    if stored != [(term.symbol, term.unit) for term in model.terms]:
        raise ValueError("its estimates are not those of its terms")


def _check_standard_errors(record: CalibrationRecord, standard_errors: Array) -> None:
    """Raise ValueError where the standard errors are not those of the covariance factor."""
    stored = [estimate.standard_error for estimate in record.estimates]
    if not np.allclose(stored, standard_errors, rtol=RELATIVE_TOLERANCE, atol=0):
        raise ValueError("its standard errors are not those of its covariance_factor")


def _check_screws(record: CalibrationRecord, model: Model) -> None:
    """Raise ValueError where a screw is at a frame, or of a target, group or value, that the file
    does not have."""
    screws = [screw for term in model.terms for screw in term.screws]
    frames = len(record.robot.joints) + 1
    if any(screw.frame > frames for screw in screws):
        raise ValueError("a screw is at a frame that its robot does not have")
    counts = {"target": len(record.targets), "group": len(record.groups)}
    members = [member for screw in screws for member in find_members(screw.cause)]
    if any(not 0 <= member.index < counts[member.kind] for member in members):
        raise ValueError("a cause names a target or group that it does not have")
    needs = frozenset[str]().union(*(screw.cause.names() for screw in screws)) - PLACED_NAMES
    missing = sorted(needs - record.ranges.keys())
    if missing:
        raise ValueError(f"its ranges lack {', '.join(missing)}")
