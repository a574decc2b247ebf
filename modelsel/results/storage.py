"""A study in its folder: result.json, details.json, calibration.json and residuals.parquet, written and read
back."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path

from .._files import write_all
from .._json import plain_text
from ..calibration.calibration import Calibration
from ..calibration.calibration_file import CALIBRATION_FILE, calibration_text
from ..calibration.loading import load_calibration
from ..exceptions import StudyError
from .details_schema import DetailsRecord
from .reading import read_records
from .residual_table import RESIDUALS, ResidualColumns, pack_residuals, read_residuals
from .schema import StudyRecord

WRITES = (
    RESIDUALS,
    "details.json",
    CALIBRATION_FILE,
    "result.json",
)  # the last says that all are there


@dataclass(frozen=True, eq=False)
class StudyFiles:
    """What a study's folder holds: the two records, the calibration, and the residuals (None: an earlier version did
    not write them)."""

    record: StudyRecord
    details: DetailsRecord
    calibration: Calibration
    residuals: ResidualColumns | None


def write_study_files(files: StudyFiles, folder: Path) -> list[Path]:
    """Write a study's files into a folder, all whole before the first takes its place. Files written. Raises
    StudyError."""
    run = files.record.provenance.run
    contents = {
        "details.json": details_text(files.details).encode(),
        CALIBRATION_FILE: calibration_text(files.calibration).encode(),
        "result.json": record_text(files.record).encode(),
    }
    if files.residuals is not None:
        contents[RESIDUALS] = pack_residuals(files.residuals, run)
    names = [name for name in WRITES if name in contents]
    write_all(folder, {name: contents[name] for name in names})
    return [folder / name for name in names]


def read_study_files(folder: Path) -> StudyFiles:
    """Read what `write_study_files` wrote, whole and of one run. Raises StudyError."""
    record, details = read_records(folder)
    calibration = load_calibration(folder)
    hashes = (calibration.provenance.get(key) for key in ("data_sha256", "study_sha256"))
    _check_run(tuple(hashes), record, folder, CALIBRATION_FILE)
    residuals = None
    if (folder / RESIDUALS).exists():
        counts = record.configurations
        residuals, run = read_residuals(folder / RESIDUALS, counts.estimation + counts.held_out)
        _check_run(run, record, folder, RESIDUALS)
    return StudyFiles(record, details, calibration, residuals)


def _check_run(run: tuple[object, ...], record: StudyRecord, folder: Path, name: str) -> None:
    """Raise StudyError where a file of the folder belongs to another run."""
    if run != record.provenance.run:
        raise StudyError(
            f"{folder}: {name} belongs to another run than result.json; modelsel study STUDY.toml --out DIR makes "
            "it anew."
        )


def record_text(record: StudyRecord) -> str:
    """Return result.json's text: the same bytes for the same values."""
    return plain_text(record.to_dict())


def details_text(details: DetailsRecord) -> str:
    """Return details.json's text: compact, the same bytes for the same values."""
    content = details.to_dict()
    return json.dumps(content, ensure_ascii=False, separators=(",", ":"), allow_nan=False) + "\n"
