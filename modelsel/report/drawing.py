"""Draws the report of a study: its records in, report.pdf and report.html out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from .._files import write_all
from .._progress import News, keep_silent
from .._second_process import Collect, SecondProcess
from .._typing import Say
from ..results.reading import read_records
from ..results.schemas.details_schema import DetailsRecord
from ..results.schemas.schema import StudyRecord
from ..results.storage import REPORTS, SOME_PAGES, SUMMARY_FILE
from .document import Block, Page, Source, collect_blocks
from .html import write_page
from .pages.appendix import write_outliers_page, write_provenance_page
from .pages.calibrated import (
    write_parameters_page,
    write_parameters_summary,
    write_significance_page,
)
from .pages.error_budget import write_repeatability_page
from .pages.findings import write_findings_pages
from .pages.front import write_data_page, write_error_map_page, write_first_page
from .pages.models import write_models_page
from .pages.parameter_uncertainty import (
    write_posterior_page,
    write_residuals_page,
    write_unidentifiable_page,
)
from .pdf import compile_pdf, fill_template, find_missing_letters
from .style import shorten

PAGES: dict[str, Page] = {
    "first": write_first_page,
    "parameters": write_parameters_page,
    "significance": write_significance_page,
    "findings": write_findings_pages,
    "residuals": write_residuals_page,
    "repeatability": write_repeatability_page,
    "outliers": write_outliers_page,
    "models": write_models_page,
    "data": write_data_page,
    "map": write_error_map_page,
    "unidentifiable": write_unidentifiable_page,
    "posterior": write_posterior_page,
    "provenance": write_provenance_page,
}
# of two pages: the verdict, and the table of the parameters
SUMMARY: dict[str, Page] = {"first": write_first_page, "parameters": write_parameters_summary}
# whose pictures show what sampling adds to a record, and those whose do not
SAMPLED_PAGES = ("posterior",)
UNSAMPLED_PAGES = tuple(name for name in PAGES if name not in SAMPLED_PAGES)
# about half of the work of drawing
HALF = ("data", "findings")
# letters that the PDF lacks and a note lists
MAX_MISSING = 20
DRAWING, SETTING = STEPS = ("drawing the pictures", "setting the report")


@dataclass(frozen=True, eq=False)
class DrawnAhead:
    """Pictures of some pages that a second process draws while this one does something else."""

    pages: tuple[str, ...]
    pending: Collect[dict[str, bytes]]

    @staticmethod
    def draw(
        second: SecondProcess, record: StudyRecord, details: DetailsRecord, pages: Sequence[str]
    ) -> DrawnAhead:
        """Have the pictures of some pages drawn."""
        pending = second.ask(partial(draw_pictures, record, details, pages))
        return DrawnAhead(tuple(pages), pending)

    def collect(self) -> dict[str, bytes]:
        """Wait for the pictures, by file name; those that failed are missing."""
        return self.pending() or {}


def draw_pictures(
    record: StudyRecord, details: DetailsRecord, pages: Sequence[str]
) -> dict[str, bytes]:
    """Draw the pictures of some pages, by file name."""
    source = Source(record, details)
    collect_blocks(source, PAGES, pages)
    return source.pictures


def draw(folder: Path, pages: Sequence[str] | None = None, say: Say = keep_silent) -> list[Path]:
    """Draw the report of a folder again, or a file of some of its pages. Files written. Raises StudyError or
    ReportError."""
    record, details = read_records(folder)
    return draw_records(record, details, folder, pages, say)


def draw_records(
    record: StudyRecord,
    details: DetailsRecord,
    folder: Path,
    pages: Sequence[str] | None = None,
    say: Say = keep_silent,
    ahead: DrawnAhead | None = None,
) -> list[Path]:
    """Draw report.pdf and report.html of a study's records into a folder; `ahead` has pictures of the same study.
    With `pages`, of some of the PDF's pages a file beside them, which stay as they are. Files written. Raises
    StudyError or ReportError."""
    source = Source(record, details)
    say(DRAWING)
    if ahead is not None:
        # the others first: the second process draws meanwhile
        others = [name for name in PAGES if name not in ahead.pages]
        source.pictures.update(draw_pictures(record, details, others))
        source.pictures.update(ahead.collect())
    chosen = collect_blocks(source, PAGES, pages, say)
    say(SETTING)
    if pages is not None:
        write_all(folder, {SOME_PAGES: _set_pages(source, chosen, say)})
        return [folder / SOME_PAGES]
    contents = (_set_pages(source, chosen, say), write_page(source))
    write_all(folder, dict(zip(REPORTS, contents, strict=True)))
    return [folder / name for name in REPORTS]


def draw_summary(
    record: StudyRecord, details: DetailsRecord, folder: Path, say: Say = keep_silent
) -> list[Path]:
    """Draw the summary of a study's records, two pages, beside the full report. Files written. Raises ReportError."""
    source = Source(record, details)
    say(DRAWING)
    blocks = collect_blocks(source, SUMMARY, say=say)
    say(SETTING)
    pages = _set_pages(source, blocks, say)
    write_all(folder, {SUMMARY_FILE: pages})
    return [folder / SUMMARY_FILE]


def _set_pages(source: Source, blocks: Sequence[Block], say: Say) -> bytes:
    content = fill_template(source, blocks)
    missing = find_missing_letters(content)
    if missing:
        shown = shorten(missing, MAX_MISSING)
        words = f"report.pdf has no letters for {shown} and shows boxes; report.html has them"
        say(News(words, kept=True))
    pdf, _ = compile_pdf(content, source.pictures)
    return pdf
