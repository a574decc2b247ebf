"""A finished study: what `run` returns and what `load_result` reads back."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

from ..._arguments import check_path, check_type, collect_names
from ..._progress import follow
from ..._typing import Say
from ...calibration.calibration import Calibration, calibrate
from ...calibration.held_out_uncertainty import measure_held_out_uncertainty
from ...calibration.refitting import refit_forms
from ...config.study_file import Study
from ...exceptions import NotStored, StudyError, suggest
from ...fitting.problem import Problem
from ...measurements.formats.file_form import FileForm
from ...results.details import draw_details
from ...results.record import record_run
from ...results.residual_table import RESIDUALS, ResidualColumns
from ...results.runs.study_run import Explanation, ModelSearch, StudyRun
from ...results.schemas.details_schema import DetailsRecord
from ...results.schemas.finding_schema import FindingRecord
from ...results.schemas.schema import StudyRecord, WarningRecord
from ...results.sentences.tables import TABLES, write_notebook_page
from ...results.storage import StudyFiles, read_study_files, record_text, write_study_files
from ...robot.kinematics import Robot
from ...selection.evaluation import Split
from ...uncertainty.summary import Confidence
from .arm_or_instrument import find_other_sides

if TYPE_CHECKING:
    import pandas as pd


FOLDER_EXPECTED = "the folder that the result is written into"


@dataclass(frozen=True, eq=False, repr=False)
class Result:
    """A finished study, fresh from a run or read back from its folder.

    Of both: `record` (result.json as attributes), `findings`, `warnings`, `calibration`, `to_frame` for tables, `save`
    and `report`; in a notebook it shows itself. Only a fresh run has the `problem`, the fits and the draws behind
    these: `models`, `diagnosis`, `uncertainty`."""

    fresh: StudyRun | None = None
    files: StudyFiles | None = None

    # -- what every result has

    @cached_property
    def record(self) -> StudyRecord:
        """result.json's content."""
        return record_run(self.run) if self.files is None else self.files.record

    @cached_property
    def details(self) -> DetailsRecord:
        """details.json's content: what the pictures need beyond the record."""
        return draw_details(self.run) if self.files is None else self.files.details

    @cached_property
    def calibration(self) -> Calibration:
        """The chosen model, to predict, to store, to export and to compensate with."""
        return _calibrate(self.run) if self.files is None else self.files.calibration

    @property
    def findings(self) -> list[FindingRecord]:
        """What was named, faults of the data first."""
        return self.record.findings

    @property
    def warnings(self) -> list[WarningRecord]:
        """What the user should know."""
        return self.record.warnings

    def residuals(self) -> pd.DataFrame:
        """Return the residuals of the nominal, the base and the chosen model, indexed by the row of the file.

        Measured minus predicted, mm (and rad, where orientations were measured) in the tracker's frame; whether a
        row estimates, and whether errors leave it out, as an outlier (`outlier`) or as on an unknown side of a
        step (`side_open`; no column in files of version 0.1.0). Raises StudyError where the folder has none."""
        import pandas as pd

        columns = self._residual_columns()
        if columns is None:
            raise StudyError(
                f"there was no {RESIDUALS} in the folder: run the study again to write one."
            )
        values = {name: column for name, column in columns.items() if name != "row"}
        return pd.DataFrame(values, index=pd.Index(columns["row"], name="row"))

    def _residual_columns(self) -> ResidualColumns | None:
        return self.run.residual_columns() if self.files is None else self.files.residuals

    def to_frame(self, table: str = "ladder") -> pd.DataFrame:
        """Return one of the result's tables: "ladder", "candidates", "findings", "credible sets", "estimates",
        "repeatability", "parameters", "significance", "error map" (places by causes, F) or "residuals". Raises
        StudyError for another name."""
        check_type("table", table, str, "the name of a table")
        if table == "residuals":
            return self.residuals()
        if table not in TABLES:
            hint = suggest(table, (*TABLES, "residuals"))
            raise StudyError(f'a result has no table "{table}". {hint}')
        return TABLES[table](self.record)

    def to_json(self) -> str:
        """Return result.json's text."""
        return record_text(self.record)

    def save(self, folder: Path | str) -> list[Path]:
        """Write result.json, details.json, calibration.json and residuals.parquet into a folder, all whole before the
        first takes its place; `load_result` reads them back. Files written. Raises StudyError."""
        columns = self._residual_columns()
        files = StudyFiles(self.record, self.details, self.calibration, columns)
        return write_study_files(files, check_path(folder, FOLDER_EXPECTED))

    def report(
        self,
        folder: Path | str,
        pages: Sequence[str] | str | None = None,
        say: Say | None = None,
        progress: bool | None = None,
    ) -> list[Path]:
        """Draw report.pdf and report.html into a folder, or with `pages` (one, or several) those of the PDF into
        report-pages.pdf: "first", "parameters", "significance", "findings", "residuals", "repeatability",
        "outliers", "models", "data", "map", "unidentifiable", "posterior", "provenance".

        `progress` shows what is being done (by default on a terminal, unless `say` is given). Files written. Raises
        StudyError or ReportError."""
        from ...report.drawing import STEPS, draw_records

        path = check_path(folder, FOLDER_EXPECTED)
        chosen = None if pages is None else collect_names("pages", pages)
        with follow(say, progress, STEPS) as tell:
            return draw_records(self.record, self.details, path, chosen, tell)

    def __repr__(self) -> str:
        return f"Result of {self.record.study!r}. {' '.join(self.record.verdict)}"

    def _repr_html_(self) -> str:
        """Show verdict, ladder and findings in a notebook."""
        return write_notebook_page(self.record)

    # -- what only a fresh run has

    @property
    def run(self) -> StudyRun:
        """Everything the run computed. Raises StudyError for a result that was read back."""
        if self.fresh is None:
            raise NotStored(
                "this result was read back from its folder. The problem, the fits and the draws belong to the run "
                "and are not stored: run the study again to have them."
            )
        return self.fresh

    @property
    def study(self) -> Study:
        """The study's configuration. Raises StudyError for a result that was read back; so do all below."""
        return self.run.study

    @property
    def robot(self) -> Robot:
        """The nominal robot."""
        return self.run.robot

    @property
    def split(self) -> Split:
        """The problem with its estimation, held-out and outlying rows."""
        return self.run.split

    @property
    def problem(self) -> Problem:
        """The robot with its measurements, registered and weighed."""
        return self.run.problem

    @property
    def models(self) -> ModelSearch:
        """The models that were compared, and the chosen one."""
        return self.run.models

    @property
    def diagnosis(self) -> Explanation:
        """What is wrong with the arm, and what else was looked for."""
        return self.run.diagnosis

    @property
    def uncertainty(self) -> Confidence:
        """How sure the chosen model's parameters are: `parameters` with their intervals; `sampling`, the
        sampled posterior (None where nothing was sampled), whose `chain` (steps, walkers, numbers), `names`,
        `to_dataframe()` and `to_arviz()` have the draws."""
        return self.run.uncertainty

    def with_uncertainty(self, uncertainty: Confidence) -> Result:
        """Return the result with another answer to how sure it is, as after sampling."""
        result = Result(replace(self.run, uncertainty=uncertainty))
        if "details" in vars(self):
            # they show nothing of it
            vars(result)["details"] = self.details
        return result


def load_result(folder: Path | str) -> Result:
    """Read a result from the folder that `Result.save` or `modelsel study` wrote it into (or the result.json there).
    Raises StudyError."""
    path = check_path(folder, "the folder of a finished study")
    return Result(files=read_study_files(path.parent if path.name == "result.json" else path))


def find_file_form(study: Study) -> FileForm:
    """Find how a study reads its measurements file."""
    table = study.measurements
    headerless = not table.header
    return FileForm(
        columns=table.columns,
        sheet=table.sheet,
        decimal=table.decimal,
        headerless=headerless,
        joined=table.joined,
    )


def _calibrate(run: StudyRun) -> Calibration:
    """Return a run's chosen model as a calibration, with what its other forms take."""
    chosen = run.models.chosen
    fitted = chosen.fit
    calibration = calibrate(
        run.study.name,
        run.split,
        fitted,
        run.floor,
        chosen.held_out.rms_mm,
        bool(run.study.robot.register_),
        run.provenance,
    )
    form = find_file_form(run.study)
    refits = refit_forms(run.split, fitted, run.models.ladder)
    findings = run.diagnosis.findings
    doubtful = [one.effect.candidate for one in findings if one.doubtful]
    names = tuple(candidate.mechanism.name for candidate in doubtful)
    model_mm = measure_held_out_uncertainty(calibration, run.split)
    effects = [one.effect for one in findings]
    sides = find_other_sides(effects, run.split.training)
    return replace(
        calibration,
        refits=refits,
        form=form,
        doubtful=names,
        held_out_model_mm=model_mm,
        other_sides=sides,
    )
