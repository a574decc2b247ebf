"""The calibrated parameters on the page to explore: the drawing of the arm, the table that the PDF has,
and what the data cannot tell."""

from __future__ import annotations

from base64 import b64encode
from html import escape

from ..fitting.undetermined import write_unidentifiable
from ..results.schemas.schema import StudyRecord
from ..results.sentences.parameter_table import PARAMETER_COLUMNS, tabulate_calibrated
from .document import Source
from .html_parts import write_html_table, write_paragraph
from .pages.calibrated import TITLE, caption_parameters, write_frames_figure
from .pages.parameter_uncertainty import UNIDENTIFIABLE


def write_parameters(source: Source) -> str:
    """Write the section; nothing where nothing was fitted."""
    rows = tabulate_calibrated(source.record, source.details)
    if not rows:
        return ""
    cells = [[escape(cell) for cell in row.cells] for row in rows]
    table = write_html_table(PARAMETER_COLUMNS, cells, "calibrated")
    words = caption_parameters(source, rows)
    caption = write_paragraph(words, "quiet")
    drawing = _write_drawing(source)
    unknown = _write_unidentifiable(source.record)
    title = f'<h2 id="parameters-title">{TITLE}</h2>'
    inner = "\n".join(filter(None, (title, drawing, table, caption, unknown)))
    return f'<section id="parameters" aria-labelledby="parameters-title">\n{inner}\n</section>\n'


def _write_drawing(source: Source) -> str:
    """Write the drawing that gives the symbols their meaning; nothing where an earlier version left no
    arm."""
    figures = write_frames_figure(source)
    if not figures:
        return ""
    (figure,) = figures
    file = figure["file"]
    picture = source.pictures[file]
    coded = b64encode(picture).decode("ascii")
    words = escape(figure["alt"])
    image = f'<img src="data:image/svg+xml;base64,{coded}" alt="{words}">'
    caption = write_paragraph(figure["caption"], "quiet")
    return f'<div class="drawing">{image}</div>\n{caption}'


def _write_unidentifiable(record: StudyRecord) -> str:
    """Write the combinations that the data do not determine, behind a click; nothing where they
    determine all."""
    groups = record.unidentifiable
    if not groups:
        return ""
    lines = []
    for sentence in write_unidentifiable(groups):
        escaped = escape(sentence)
        line = f"<li>{escaped}</li>"
        lines.append(line)
    items = "\n".join(lines)
    words = write_paragraph(UNIDENTIFIABLE)
    summary = "<summary>What the data cannot tell</summary>"
    return f"<details>{summary}\n{words}\n<ul>{items}</ul></details>"
