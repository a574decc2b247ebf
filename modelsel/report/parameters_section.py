"""The calibrated parameters on the page to explore: the drawing of the arm, the table that the PDF has,
and what the data cannot tell."""

from __future__ import annotations

from base64 import b64encode
from html import escape

from ..results.parameter_table import PARAMETER_COLUMNS, tabulate_calibrated
from ..results.schema import StudyRecord
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
    caption = write_paragraph(caption_parameters(source, rows), "quiet")
    parts = [_write_drawing(source), table, caption, _write_unidentifiable(source.record)]
    inner = "\n".join(part for part in parts if part)
    title = f'<h2 id="parameters-title">{TITLE}</h2>'
    return f'<section id="parameters" aria-labelledby="parameters-title">\n{title}\n{inner}\n</section>\n'


def _write_drawing(source: Source) -> str:
    """Write the drawing that gives the symbols their meaning; nothing where an earlier version left no
    arm."""
    figures = write_frames_figure(source)
    if not figures:
        return ""
    (figure,) = figures
    picture = b64encode(source.pictures[figure["file"]]).decode("ascii")
    image = f'<img src="data:image/svg+xml;base64,{picture}" alt="{escape(figure["alt"])}">'
    return f'<div class="drawing">{image}</div>\n{write_paragraph(figure["caption"], "quiet")}'


def _write_unidentifiable(record: StudyRecord) -> str:
    """Write the combinations that the data do not determine, behind a click; nothing where they
    determine all."""
    sentences = [group.sentence for group in record.unidentifiable]
    if not sentences:
        return ""
    items = "\n".join(f"<li>{escape(sentence)}</li>" for sentence in sentences)
    words = write_paragraph(UNIDENTIFIABLE)
    return f"<details><summary>What the data cannot tell</summary>\n{words}\n<ul>{items}</ul></details>"
