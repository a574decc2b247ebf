"""Draws the report of a folder: result.json and details.json in, report.pdf and report.html out."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

from ..._files import write_all
from ..._json import misfit, strict
from ..._json import read as text
from ...exceptions import StudyError
from ..shapes import DETAILS, RESULT, disagreement
from .document import Page, Source, book
from .end import outliers, provenance, unidentifiable
from .evidence import correlation, held_out, posterior, residuals, significance
from .findings import findings
from .front import data, error_map, first
from .html import page
from .models import models
from .pdf import compiled, content

SCHEMA = 1
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


def read(folder: Path) -> Source:
    """result.json and details.json of a folder, whole and of one run. Raises StudyError with how to make them."""
    again = "modelsel study STUDY.toml --out DIR makes it"
    found = list[dict[str, Any]]()
    for name, shape in (("result.json", RESULT), ("details.json", DETAILS)):
        try:
            table = strict(text(folder / name))
            if not isinstance(table, dict) or table.get("schema") != SCHEMA or table.get("schema") is True:
                version = table.get("schema") if isinstance(table, dict) else None
                raise StudyError(f"{folder / name}: schema {str(version)[:40]}, this modelsel draws schema {SCHEMA}; {again} "
                                 "anew.")
            if found and any(found[0]["provenance"][key] != table.get(key) for key in ("data_sha256", "study_sha256")):
                raise StudyError(f"{folder}: details.json belongs to another run than result.json; {again} anew.")
            if (why := misfit(table, shape)) is not None:
                raise ValueError(f"damaged: {why}")
        except FileNotFoundError:
            raise StudyError(f"{folder}: there is no {name}; {again}.") from None
        except ValueError as error:
            raise StudyError(f"{folder / name}: cannot be read: {error}; {again} anew.") from None
        found.append(table)
    result, more = found
    if (why := disagreement(result, more)) is not None:
        raise StudyError(f"{folder}: {why}; {again} anew.")
    return Source(result, more)


def draw(folder: Path, pages: tuple[str, ...] | None = None, say: Callable[[str], None] = lambda _: None) -> list[Path]:
    """Draw the report of a folder again; `pages` chooses (all without). Files written. Raises StudyError or ReportError."""
    return draw_source(read(folder), folder, pages, say)


def draw_source(source: Source, folder: Path, pages: tuple[str, ...] | None, say: Callable[[str], None]) -> list[Path]:
    """Draw the report of a result's contents into a folder."""
    say("drawing the pictures")
    blocks = book(source, PAGES, pages)
    say("setting the report")
    pdf, _ = compiled(content(source, blocks), source.pictures)
    write_all(folder, {"report.pdf": pdf, "report.html": page(source)})
    return [folder / "report.pdf", folder / "report.html"]
