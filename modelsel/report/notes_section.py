"""How well the parameters are known, and outliers and notes, on the page to explore: the PDF's own
sentences."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape

from ..results.schemas.schema import StudyRecord
from .document import Block, Source
from .html_parts import keep_units, write_html_table, write_paragraph
from .pages.appendix import write_outliers_page
from .pages.parameter_uncertainty import (
    CERTAINTY_TITLE,
    QUANTILE_COLUMNS,
    caption_quantiles,
    name_units,
    tabulate_quantiles,
    write_certainty,
)


def write_certainty_section(source: Source) -> str:
    """Write what the sampler says of itself, which parameters the data know only together, and the
    quantiles; nothing where there is none of it."""
    record = source.record
    blocks = write_certainty(record)
    quantiles = _write_quantiles(record)
    if not blocks and not quantiles:
        return ""
    return _write_section("certainty", CERTAINTY_TITLE, blocks, quantiles)


def _write_quantiles(record: StudyRecord) -> str:
    """Write the table of the sampled quantiles; nothing where there are none."""
    sampling = record.sampling
    rows = [] if sampling is None else tabulate_quantiles(name_units(sampling.quantiles, record))
    if sampling is None or not rows:
        return ""
    cells = [[escape(cell) for cell in row] for row in rows]
    caption = caption_quantiles(sampling.quantiles, record)
    return write_html_table(QUANTILE_COLUMNS, cells, "quantiles", caption)


def write_notes_section(source: Source) -> str:
    """Write the rows left out, faults of the data, warnings of the set-up, notes."""
    title, *blocks = write_outliers_page(source)
    return _write_section("notes", title["text"], blocks)


def _write_section(name: str, title: str, blocks: Sequence[Block], table: str = "") -> str:
    heading = f'<h2 id="{name}-title">{escape(title)}</h2>'
    written = map(_write_block, blocks)
    inner = "\n".join(filter(None, (heading, *written, table)))
    return f'<section id="{name}" aria-labelledby="{name}-title">\n{inner}\n</section>\n'


def _write_block(block: Block) -> str:
    """Write a heading below the section's own, a list, or a paragraph."""
    if block["kind"] == "heading":
        return f"<h3>{escape(block['text'])}</h3>"
    if block["kind"] == "points":
        lines = [f"<li>{escape(keep_units(item))}</li>" for item in block["items"]]
        items = "\n".join(lines)
        return f"<ul>{items}</ul>"
    return write_paragraph(block["text"])
