"""What does not repeat, on the page to explore: sentences, and a table with a bar and an interval in
every row."""

from __future__ import annotations

from collections.abc import Iterator
from html import escape

from ..results.repeatability.repeatability import round_digits
from ..results.schemas.schema import ErrorPartRecord
from .figures.error_parts import measure_axis, scale_intervals
from .pages.error_budget import COLUMNS, EXPLANATION, SHARES, TITLE, tabulate_parts
from .style import choose_unit


def write_error_parts(parts: list[ErrorPartRecord]) -> str:
    """Write the section; nothing where no parts were looked for, one sentence where the instrument
    stands alone."""
    if not parts:
        return ""
    sentences = "\n".join(f"<p>{escape(part.sentence)}</p>" for part in parts)
    title = f'<h2 id="repeatability-title">{TITLE}</h2>'
    inner = sentences if len(parts) == 1 else f"{_note(EXPLANATION)}\n{sentences}\n{_table(parts)}"
    return f'<section id="repeatability" aria-labelledby="repeatability-title">\n{title}\n{inner}\n</section>\n'


def _note(words: str) -> str:
    return f'<p class="quiet">{escape(words)}</p>'


def _table(parts: list[ErrorPartRecord]) -> str:
    rms, _, high = scale_intervals(parts)
    end = measure_axis(rms, high)
    largest = float(rms.max())
    factor, unit = choose_unit("mm", largest)
    scale = f"at the target, 0 to {round_digits(factor * end)} {unit}"
    tracks = ("share of what is left, 0 to 100 %", scale)
    columns = [*COLUMNS, *tracks]
    heads = [_head(name, is_number=0 < k < len(COLUMNS)) for k, name in enumerate(columns)]
    head = "".join(heads)
    pictures = _draw_rows(parts, end, tracks)
    rows = zip(tabulate_parts(parts), pictures, strict=True)
    lines = [f"<tr>{_cells(row)}{picture}</tr>" for row, picture in rows]
    body = "\n".join(lines)
    table = f"<thead><tr>{head}</tr></thead>\n<tbody>\n{body}\n</tbody>"
    return f'<table class="plain stack">\n{table}\n</table>\n{_note(SHARES)}'


def _head(name: str, is_number: bool) -> str:
    style = ' class="number"' if is_number else ""
    return f'<th scope="col"{style}>{escape(name)}</th>'


def _cells(row: list[str]) -> str:
    part, *figures = row
    cells = [f"<td>{escape(part)}</td>"]
    for name, figure in zip(COLUMNS[1:], figures, strict=True):
        label = escape(name)
        cells.append(f'<td class="number" data-head="{label}">{escape(figure)}</td>')
    return "".join(cells)


def _draw_rows(parts: list[ErrorPartRecord], end: float, names: tuple[str, str]) -> Iterator[str]:
    """Draw share and interval of every part, in percent of their columns, each with its name and scale; the
    table has them in words."""
    for part, *interval in zip(parts, *scale_intervals(parts), strict=True):
        rms, low, high = (100 * min(float(value) / end, 1.0) for value in interval)
        bar = f'<div class="bar" style="width:{part.share:.1%}"></div>'
        share = f'<div class="scale">{bar}</div>'
        line = f'<i style="left:{low:.1f}%;width:{high - low:.1f}%"></i><b style="left:{rms:.1f}%"></b>'
        cells = (share, f'<div class="scale range">{line}</div>')
        yield "".join(map(_write_track, names, cells))


def _write_track(name: str, cell: str) -> str:
    return f'<td class="track" aria-hidden="true" data-head="{escape(name)}">{cell}</td>'
