"""The sets of effects that were weighed, on the page to explore: the table that the PDF has."""

from __future__ import annotations

from html import escape

from ..results.schemas.schema import StudyRecord
from ..results.sentences.study_sentences import (
    SETS_PURPOSE,
    SETS_TITLE,
    describe_sets,
    format_weight,
)
from .html_parts import write_html_table, write_paragraph

COLUMNS = (("effects", "left"), ("probability", "right"))


def write_effect_sets(record: StudyRecord) -> str:
    """Write the section; nothing where no sets were weighed."""
    models = record.weighed_models
    if not models:
        return ""
    rows = []
    for words, model in zip(describe_sets(models), models, strict=True):
        probability = format_weight(model.probability)
        rows.append([escape(words), probability])
    title = f'<h2 id="sets-title">{SETS_TITLE}</h2>'
    table = write_html_table(COLUMNS, rows, "sets")
    purpose = write_paragraph(SETS_PURPOSE, "quiet")
    inner = f"{title}\n{table}\n{purpose}"
    return f'<section aria-labelledby="sets-title">\n{inner}\n</section>\n'
