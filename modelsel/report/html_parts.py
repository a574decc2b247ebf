"""Pieces of a page in HTML: paragraphs and tables; words of the data are escaped here."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape

Columns = Sequence[tuple[str, str]]


def write_paragraph(words: str, style: str = "") -> str:
    """Write a paragraph of plain words."""
    attribute = f' class="{style}"' if style else ""
    return f"<p{attribute}>{escape(words)}</p>"


def write_html_table(columns: Columns, rows: Sequence[Sequence[str]], of: str) -> str:
    """Write a table of cells that are HTML already, with (name, "left" or "right") of each column. On
    narrow screens each cell says what it is."""
    sides = [_write_side(side) for _, side in columns]
    head = "".join(
        f'<th scope="col"{side}>{escape(name)}</th>'
        for (name, _), side in zip(columns, sides, strict=True)
    )
    lines = []
    for row in rows:
        cells = zip(columns, sides, row, strict=True)
        lines.append(
            "".join(
                f'<td{side} data-head="{escape(name)}">{cell}</td>'
                for (name, _), side, cell in cells
            )
        )
    body = "\n".join(f"<tr>{line}</tr>" for line in lines)
    return (
        f'<table class="plain stack {of}"><thead><tr>{head}</tr></thead>\n'
        f"<tbody>{body}</tbody></table>"
    )


def _write_side(side: str) -> str:
    return ' class="number"' if side == "right" else ""
