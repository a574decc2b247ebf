"""A report as values: blocks in order and the pictures they show; `book` gathers the chosen
pages."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from ..exceptions import StudyError, suggest
from ..results.storage import Source

Block = dict[str, Any]


def heading(text: str, level: int = 1, opens: bool = True) -> Block:
    """A heading; a first-level one opens a page unless told otherwise."""
    return {"kind": "heading", "text": text, "level": level, "opens": opens and level == 1}


def text(words: str, style: str = "body") -> Block:
    """A paragraph; style body, quiet or lead."""
    return {"kind": "text", "text": words, "style": style}


def table(
    columns: list[tuple[str, str]],
    rows: list[list[str]],
    caption: str = "",
    widths: list[float] | None = None,
) -> Block:
    """A table: (name, "left" or "right") of each column, rows of text, relative widths (0: as
    narrow as the text)."""
    return {
        "kind": "table",
        "columns": [{"name": n, "align": a} for n, a in columns],
        "rows": rows,
        "caption": caption,
        "widths": widths or [0.0] * len(columns),
    }


def points(items: list[str]) -> Block:
    """A list."""
    return {"kind": "points", "items": items}


Page = Callable[[Source], list[Block]]


def book(
    source: Source, pages: Mapping[str, Page], chosen: tuple[str, ...] | None = None
) -> list[Block]:
    """The blocks of the chosen pages (all without), in the report's own order. Raises StudyError
    for an unknown page."""
    unknown = [name for name in chosen or () if name not in pages]
    if unknown:
        raise StudyError(
            *(
                f'--pages: no page "{name}". {suggest(name, pages)} Pages: {", ".join(pages)}.'
                for name in unknown
            )
        )
    return [
        block
        for name, page in pages.items()
        if chosen is None or name in chosen
        for block in page(source)
    ]
