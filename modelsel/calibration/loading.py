"""calibration.json read back: whole, each value of its type, its parts in agreement, or refused in
one sentence with the place."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from .._arguments import check_path
from .._files import STUDY_FILE
from .._json import parse_json, read_json_text
from .._records import parse_record
from .._text import parse_toml, read_text
from .._typing import Array
from ..exceptions import StudyError
from ..fitting.design import Model
from ..fitting.noise import Floor
from ..measurements.formats.file_form import FileForm
from ..mechanisms.serialization import find_members, mechanism_from_record
from ..robot.alignment import have_same_chain
from ..robot.kinematics import Robot
from ..robot.plain_values import bounded_array, check_rotation, robot_from_record
from ..robot.urdf import read_urdf_text
from .calibration import Calibration
from .calibration_file import CALIBRATION_FILE
from .calibration_schema import SCHEMA_VERSION, CalibrationRecord, NoiseFloorRecord
from .estimation_rows import EstimationRows
from .known_names import LABEL_NAMES
from .other_sides import OtherSide
from .refitting import Refits, refits_of

RESULT_FILE = "result.json"
RUN = ("data_sha256", "study_sha256")  # what files of one run have in common
REPORTS = "reports"  # where `modelsel study` writes by default
RELATIVE_TOLERANCE = 1e-6  # two numbers of a file that say the same
REMEDY = "Run the study again."
STORED_LABELS = LABEL_NAMES - {"feature"}  # features of a set-up are no part of a calibration


def load_calibration(path: Path | str) -> Calibration:
    """Load a stored calibration: its file, the result.json beside it, or the folder of both, whose
    result.json is of the same run. Raises StudyError."""
    given = check_path(path, "the path of a calibration or of its folder")
    file = _find_file(given)
    try:
        text = read_json_text(file)
    except FileNotFoundError:
        raise StudyError(
            f"{file}: no such calibration; `modelsel study STUDY.toml` writes one beside its result.json."
        ) from None
    except ValueError as error:
        raise StudyError(f"{file.name}: cannot be read: {error}. {REMEDY}") from None
    calibration = parse_calibration(text, file.name)
    is_alone = given == file
    if not is_alone:
        _check_result_beside(file.with_name(RESULT_FILE), calibration)
    return calibration


def _check_result_beside(result: Path, calibration: Calibration) -> None:
    """Raise StudyError where a result.json is not of the run that a calibration beside it is of; where
    there is none, the calibration stands for itself."""
    folder = result.parent
    remedy = f"{REMEDY} For the calibration alone, give {folder / CALIBRATION_FILE}."
    try:
        value = parse_json(read_json_text(result))
    except FileNotFoundError:
        return
    except ValueError as error:
        raise StudyError(f"{result}: cannot be read: {error}. {remedy}") from None
    provenance = value.get("provenance") if isinstance(value, dict) else None
    if not isinstance(provenance, dict):
        raise StudyError(f"{result}: not the result of a study. {remedy}")
    own = calibration.provenance
    is_same = all(provenance.get(key) == own.get(key) for key in RUN)
    if not is_same:
        raise StudyError(
            f"{folder}: {CALIBRATION_FILE} belongs to another run than {RESULT_FILE}. {remedy}"
        )


def _find_file(path: Path) -> Path:
    if path.is_dir():
        return find_report_folder(path) / CALIBRATION_FILE
    if path.name == RESULT_FILE:
        return path.with_name(CALIBRATION_FILE)
    return path


def find_report_folder(folder: Path) -> Path:
    """Find the folder of a study's results: the one given or, of a study's own folder, where
    `modelsel study` writes them by default; the one given where there are none. Raises StudyError
    for a study's folder without results, or whose study file cannot be read."""
    study = folder / STUDY_FILE
    if (folder / CALIBRATION_FILE).exists() or not study.exists():
        return folder
    whole = folder.resolve()
    name = whole.name
    above = whole.parent
    tried = [Path(REPORTS) / name, above / REPORTS / name, above.parent / REPORTS / name]
    text = read_text(study, "the study file")
    table = parse_toml(text, study.name)
    for report in tried:
        if _is_report_of(report, table.get("name")):
            return report
    raise StudyError(
        f"{folder}: the folder of a study; its report's folder was expected, and {tried[0]} does not "
        f"have its results. Give the folder that `modelsel study {folder}` wrote."
    )


def _is_report_of(report: Path, study: object) -> bool:
    """Whether a folder has the calibration of a study, by its name."""
    try:
        value = parse_json(read_json_text(report / CALIBRATION_FILE))
    except (OSError, ValueError):
        return False
    return isinstance(value, dict) and value.get("study") == study


def parse_calibration(text: str, where: str = CALIBRATION_FILE) -> Calibration:
    """Return the calibration of a file's text. Raises StudyError."""
    no_calibration = StudyError(
        f"{where}: not a calibration; `modelsel study` writes one beside its result.json."
    )
    is_json = text.lstrip().startswith(("{", "["))
    if not is_json:
        raise no_calibration
    try:
        value = parse_json(text)
    except ValueError as error:
        raise StudyError(f"{where}: cannot be read: {error}. {REMEDY}") from None
    if not isinstance(value, dict) or value.get("kind") != "calibration":
        raise no_calibration
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
    values = [estimate.value for estimate in record.estimates]
    tools = [target.tool_mm for target in record.targets]
    target_names = tuple(target.name for target in record.targets)
    group_names = tuple(group.name for group in record.groups)
    calibration = Calibration(
        study=record.study,
        robot=_restore_robot(record),
        targets=target_names,
        groups=group_names,
        tools=bounded_array(tools),
        tool_rotations=_restore_tool_rotations(record),
        placement=_restore_placement(record),
        registered=record.registered,
        tracker=(x, y, z),
        model=model,
        theta=np.array(values),
        factor=_restore_factor(record),
        kept=tuple(term for term, kept in estimable if kept),
        floor=_restore_floor(record.noise_floor),
        held_out_rms_mm=record.held_out_rms_mm,
        ranges={name: (low, high) for name, (low, high) in record.ranges.items()},
        provenance=dict(record.provenance),
        refits=_restore_refits(record, model),
        form=_restore_form(record),
        doubtful=tuple(record.doubtful),
        held_out_ranges={name: (low, high) for name, (low, high) in record.held_out_ranges.items()},
        estimation_rows=_restore_estimation_rows(record),
        held_out_model_mm=record.held_out_model_mm,
        other_sides=_restore_other_sides(record),
    )
    _check_standard_errors(record, calibration.standard_errors)
    _check_screws(record, model)
    return calibration


def _restore_other_sides(record: CalibrationRecord) -> dict[str, OtherSide]:
    """Return what may be an error of the other side, by mechanism."""
    sides = {}
    for name, one in record.other_sides.items():
        instrument = mechanism_from_record(one.instrument)
        _check_places(record, Model((instrument,)))
        estimate = tuple(one.estimate)
        sides[name] = OtherSide(one.label, one.share, one.rms_mm, instrument, estimate)
    return sides


def _restore_estimation_rows(record: CalibrationRecord) -> EstimationRows:
    """Return the rows that were fitted. Raises ValueError where their codes are no codes."""
    stored = record.estimation_rows
    if stored is None:
        return EstimationRows()
    try:
        return EstimationRows.from_text(stored.count, stored.codes)
    except ValueError:
        raise ValueError("its estimation_rows.codes: expected numbers in base64") from None


def _restore_robot(record: CalibrationRecord) -> Robot:
    """Return the nominal robot, with the URDF that it was read from. Raises ValueError where that
    is another robot's."""
    robot = robot_from_record(record.robot.to_dict())
    stored = record.urdf
    if stored is None:
        return robot
    try:
        read = read_urdf_text(stored.text, "urdf", stored.base, stored.tip)
    except StudyError as error:
        raise ValueError(f"its urdf cannot be read: {error}") from None
    if not have_same_chain(robot, read):
        raise ValueError("its urdf is not that of its robot: its transforms are others")
    return replace(robot, urdf=read.urdf)


def _restore_tool_rotations(record: CalibrationRecord) -> Array | None:
    """Return the targets' orientations (T, 3, 3); None where they have none."""
    rotations = []
    for target in record.targets:
        rows = target.rotation
        if rows is not None:
            rotations.append(check_rotation(rows))
    if not rotations:
        return None
    return np.array(rotations)


def _restore_placement(record: CalibrationRecord) -> tuple[Array, Array]:
    """Return rotations (G, 3, 3) and translations (G, 3) of frame 0 in the tracker's frame."""
    rotations = []
    translations = []
    for group in record.groups:
        rotations.append(check_rotation(group.rotation))
        translations.append(group.translation_mm)
    return np.array(rotations), bounded_array(translations)


def _restore_factor(record: CalibrationRecord) -> Array:
    """Return the factor (p, r) of the covariance from its rows, each from its own column on."""
    estimates = record.estimates
    estimable = [k for k, estimate in enumerate(estimates) if estimate.estimable]
    shape = (len(estimates), len(estimable))
    factor = np.zeros(shape)
    rows = record.covariance_factor.rows
    placed = zip(estimable, rows, strict=True)
    for column, (term, row) in enumerate(placed):
        factor[term, column:] = row
    return factor


def _restore_floor(record: NoiseFloorRecord) -> Floor:
    freedom = np.inf
    if record.freedom is not None:
        freedom = record.freedom
    return Floor(record.coordinate_mm, record.source, freedom)


def _restore_form(record: CalibrationRecord) -> FileForm:
    stored = record.file_form
    if stored is None:
        return FileForm()
    joined = dict(stored.joined)
    return FileForm(dict(stored.columns), stored.sheet, stored.decimal, not stored.header, joined)


def _restore_refits(record: CalibrationRecord, model: Model) -> Refits | None:
    refits = record.refits
    if refits is None:
        return None
    return refits_of(refits, model)


# -- parts of the file that say the same, or hang together
# ------------------------------------------------------------------------------------------------


def _check_estimates(record: CalibrationRecord, model: Model) -> None:
    """Raise ValueError where the estimates are not those of the model's terms."""
    stored = [(estimate.symbol, estimate.unit) for estimate in record.estimates]
    fitted = [(term.symbol, term.unit) for term in model.terms]
    if stored != fitted:
        raise ValueError("its estimates are not those of its terms")


def _check_standard_errors(record: CalibrationRecord, standard_errors: Array) -> None:
    """Raise ValueError where the standard errors are not those of the covariance factor."""
    estimates = record.estimates
    stored = [estimate.standard_error for estimate in estimates]
    agree = np.allclose(stored, standard_errors, rtol=RELATIVE_TOLERANCE, atol=0)
    if not agree:
        raise ValueError("its standard errors are not those of its covariance_factor")


def _check_screws(record: CalibrationRecord, model: Model) -> None:
    """Raise ValueError where a screw is at a frame, or of a target, group or value, that the file
    does not have."""
    _check_places(record, model)
    needs = set[str]().union(*(one.names() for one in model.mechanisms))
    missing = sorted(needs - STORED_LABELS - record.ranges.keys())
    if missing:
        names = ", ".join(missing)
        raise ValueError(f"its ranges lack {names}")


def _check_places(record: CalibrationRecord, model: Model) -> None:
    """Raise ValueError where a screw is at a frame, or of a target or group, that the file does not
    have."""
    frames = len(record.robot.joints) + 1
    counts = {"target": len(record.targets), "group": len(record.groups)}
    screws = [screw for term in model.terms for screw in term.screws]
    if any(screw.frame > frames for screw in screws):
        raise ValueError("a screw is at a frame that its robot does not have")
    members = [member for screw in screws for member in find_members(screw.cause)]
    for member in members:
        count = counts[member.kind]
        if not 0 <= member.index < count:
            raise ValueError("a cause names a target or group that it does not have")
