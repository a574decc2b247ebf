"""A study in its folder: result.json, details.json, calibration.json and residuals.parquet, written and read
back."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from .._files import write_all
from .._json import plain_text
from ..calibration.calibration import Calibration
from ..calibration.calibration_file import CALIBRATION_FILE, calibration_text
from ..calibration.loading import load_calibration
from ..exceptions import StudyError
from .reading import read_records
from .residual_table import RESIDUALS, ResidualColumns, pack_residuals, read_residuals
from .schemas.details_schema import DetailsRecord
from .schemas.schema import StudyRecord

WRITES = (
    RESIDUALS,
    "details.json",
    CALIBRATION_FILE,
    "result.json",
)  # the last says that all are there
# what is drawn of a result: the report, some of its pages, its summary
REPORTS = ("report.pdf", "report.html")
SOME_PAGES, SUMMARY_FILE = "report-pages.pdf", "report-summary.pdf"
DRAWN_FROM = ("result.json", "details.json")


@dataclass(frozen=True, eq=False)
class StudyFiles:
    """What a study's folder holds: the two records, the calibration, and the residuals (None: an earlier version did
    not write them)."""

    record: StudyRecord
    details: DetailsRecord
    calibration: Calibration
    residuals: ResidualColumns | None


def write_study_files(files: StudyFiles, folder: Path) -> list[Path]:
    """Write a study's files into a folder, all whole before the first takes its place; reports of another result,
    which was there before, are removed. Files written. Raises StudyError."""
    run = files.record.provenance.run
    contents = {
        "details.json": details_text(files.details).encode(),
        CALIBRATION_FILE: calibration_text(files.calibration).encode(),
        "result.json": record_text(files.record).encode(),
    }
    if files.residuals is not None:
        contents[RESIDUALS] = pack_residuals(files.residuals, run)
    names = [name for name in WRITES if name in contents]
    outdated = find_outdated_reports(contents, folder)
    write_all(folder, {name: contents[name] for name in names}, outdated)
    return [folder / name for name in names]


def find_reports(folder: Path) -> list[str]:
    """Find the reports that a folder has, by name."""
    names = (*REPORTS, SOME_PAGES, SUMMARY_FILE)
    return [name for name in names if (folder / name).is_file()]


def find_outdated_reports(contents: Mapping[str, bytes], folder: Path) -> list[str]:
    """Find the reports of a folder's result that some new contents replace by another: none where there was no
    result, or the same."""
    if not (folder / "result.json").is_file():
        return []
    paths = [folder / name for name in DRAWN_FROM]
    unchanged = [path.is_file() and path.read_bytes() == contents[path.name] for path in paths]
    return [] if all(unchanged) else find_reports(folder)


def read_study_files(folder: Path) -> StudyFiles:
    """Read what `write_study_files` wrote, whole and of one run. Raises StudyError."""
    record, details = read_records(folder)
    calibration = load_calibration(folder)
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
