"""Draws the report of a folder: result.json and details.json in, report.pdf and report.html out."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

from .._files import write_all
from ..results.result import Result
from ..results.storage import Source, StoredResult, _details, read
from .document import Page, book
from .html import page
from .pages.appendix import outliers, provenance, unidentifiable
from .pages.findings import findings
from .pages.front import data, error_map, first
from .pages.models import models
from .pages.parameter_uncertainty import correlation, held_out, posterior, residuals, significance
from .pdf import compiled, content

if TYPE_CHECKING:
    pass

PAGES: dict[str, Page] = {
    "first": first,
    "data": data,
    "models": models,
    "map": error_map,
    "findings": findings,
    "residuals": residuals,
    "significance": significance,
    "correlation": correlation,
    "posterior": posterior,
    "held-out": held_out,
    "unidentifiable": unidentifiable,
    "outliers": outliers,
    "provenance": provenance,
}


def draw(
    folder: Path, pages: tuple[str, ...] | None = None, say: Callable[[str], None] = lambda _: None
) -> list[Path]:
    """Draw the report of a folder again; `pages` chooses (all without). Files written. Raises
    StudyError or ReportError."""
    return draw_source(read(folder), folder, pages, say)


def draw_source(
    source: Source, folder: Path, pages: tuple[str, ...] | None, say: Callable[[str], None]
) -> list[Path]:
    """Draw the report of a result's contents into a folder."""
    say("drawing the pictures")
    blocks = book(source, PAGES, pages)
    say("setting the report")
    pdf, _ = compiled(content(source, blocks), source.pictures)
    write_all(folder, {"report.pdf": pdf, "report.html": page(source)})
    return [folder / "report.pdf", folder / "report.html"]


def report(
    result: Result | StoredResult,
    folder: Path | str,
    pages: tuple[str, ...] | None = None,
    say: Callable[[str], None] = lambda _: None,
) -> list[Path]:
    """Draw report.pdf and report.html of a result into a folder; `pages` chooses from the PDF's.
    Files written. Raises StudyError or ReportError."""
    return draw_source(
        Source(dict(result.record), json.loads(_details(result))), Path(folder), pages, say
    )
