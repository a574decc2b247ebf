"""How well the parameters are known, and outliers and notes, on the page to explore: the PDF's own
sentences."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape

from .document import Block, Source
from .html_parts import keep_units, write_paragraph
from .pages.appendix import write_outliers_page
from .pages.parameter_uncertainty import CERTAINTY_TITLE, write_certainty


def write_certainty_section(source: Source) -> str:
    """Write what the sampler says of itself, and which parameters the data know only together; nothing
    where there is neither."""
    blocks = write_certainty(source.record)
    return _write_section("certainty", CERTAINTY_TITLE, blocks) if blocks else ""


def write_notes_section(source: Source) -> str:
    """Write the rows left out, faults of the data, warnings of the set-up, notes."""
    title, *blocks = write_outliers_page(source)
    return _write_section("notes", title["text"], blocks)


def _write_section(name: str, title: str, blocks: Sequence[Block]) -> str:
    heading = f'<h2 id="{name}-title">{escape(title)}</h2>'
    inner = "\n".join([heading, *map(_write_block, blocks)])
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
