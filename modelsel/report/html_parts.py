"""Pieces of a page in HTML: paragraphs and tables; words of the data are escaped here."""

from __future__ import annotations

import re
from collections.abc import Sequence
from html import escape

# between a number and its unit, where a line does not end
UNIT = re.compile(r"(?<=\d) (?=(?:%|mm|µm|mrad|µrad|°C)(?!\w))")
NO_BREAK = "\N{NO-BREAK SPACE}"
Columns = Sequence[tuple[str, str]]


def write_paragraph(words: str, style: str = "") -> str:
    """Write a paragraph of plain words."""
    attribute = f' class="{style}"' if style else ""
    return f"<p{attribute}>{escape(keep_units(words))}</p>"


def keep_units(words: str) -> str:
    """Keep every number on one line with its unit."""
    return UNIT.sub(NO_BREAK, words)


def write_html_table(
    columns: Columns, rows: Sequence[Sequence[str]], of: str, caption: str = ""
) -> str:
    """Write a table of cells that are HTML already, with (name, "left" or "right") of each column, and
    a caption in plain words. One that is wider than the page scrolls within itself; on narrow screens
    each cell says what it is."""
    heads = []
    for name, side in columns:
        style = _write_side(side)
        heads.append(f'<th scope="col"{style}>{escape(keep_units(name))}</th>')
    head = "".join(heads)
    lines = [_write_row(columns, row) for row in rows]
    body = "\n".join(lines)
    table = (
        f'<div class="wide"><table class="plain stack {of}"><thead><tr>{head}</tr></thead>\n'
        f"<tbody>{body}</tbody></table></div>"
    )
    if not caption:
        return table
    words = escape(keep_units(caption))
    return f"<figure>{table}<figcaption>{words}</figcaption></figure>"


def _write_row(columns: Columns, row: Sequence[str]) -> str:
    line = ""
    for column, cell in zip(columns, row, strict=True):
        name, side = column
        style = _write_side(side)
        label = escape(name)
        line += f'<td{style} data-head="{label}">{cell}</td>'
    return f"<tr>{line}</tr>"


def _write_side(side: str) -> str:
    return ' class="number"' if side == "right" else ""
