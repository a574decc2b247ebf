"""The tables of a study on a terminal: the ladder, the subsets, the error map, the mechanisms."""

from __future__ import annotations

from collections.abc import Sequence
from string import ascii_lowercase
from typing import TYPE_CHECKING

import numpy as np

from .._short_numbers import round_numbers
from .._typing import Array
from ..exceptions import write_rounded
from ..results.schemas.model_schema import SignificanceRecord
from ..results.schemas.schema import ErrorMapRecord, StudyRecord
from ..results.sentences.study_sentences import (
    NOMINAL_CAVEAT,
    SETS_PURPOSE,
    SETS_TITLE,
    TABLE_PURPOSE,
    common_mechanisms,
    describe_sets,
    format_mm,
    format_motion,
    format_p,
    format_share,
    format_weight,
    list_errors,
)
from ..results.sentences.tables import label_ladder
from .text_tables import Row, Span, fold_text, write_table

if TYPE_CHECKING:
    from rich.console import Console
    from rich.text import Text

# F up to which a cell of the error map has a shade
SHADES = ((3.0, "·"), (10.0, "░"), (30.0, "▒"), (100.0, "▓"), (np.inf, "█"))
STANDS_OUT_P = 0.05
MAX_MAP_COLUMNS = 14
# an F below it is not told from zero
SMALLEST_F = 1e-99
# from it on, figures are written with a power of ten
LARGEST_SHORT = 1e7
# what the record says of signs and sizes that are not odd
AS_EXPECTED = "as expected"
# columns between the causes of the map, and of a place's name
CELL_WIDTH = 4
PLACE_WIDTH = 6

LADDER_HEADS = ("params", "rank", "mean", "worst", "mean", "worst", "CV rms", "AICc")
LADDER_SPANS = (Span("estimation", 2, 3), Span("held-out", 4, 5))
SUBSET_HEADS = ("rank", "CV rms", "held-out mean", "weight")
SET_HEADS = ("probability",)
SIGNIFICANCE_HEADS = (
    *("mean", "worst", "F", "p", "log10 evid.", "CV rms", "held-out rms", "in halves"),
)


def show_tables(record: StudyRecord, console: Console) -> None:
    """Show all tables of a study, none wider than the console."""
    width = console.width
    rungs = _ladder_table(record, width)
    _show_table(console, *rungs)
    if record.candidates.best:
        _show_table(console, *_subset_table(record, width))
    if record.weighed_models:
        _show_table(console, *_set_table(record, width))
    if record.error_map.causes:
        _show_map(record.error_map, console)
    if record.significance:
        _show_table(console, *_significance_table(record.significance, width))


def _show_table(console: Console, title: str, lines: Sequence[str], caption: str = "") -> None:
    """Show a title, a table below it, and what is said of it."""
    from rich.text import Text

    console.print()
    for line in fold_text(title, console.width):
        console.print(Text(line, style="bold"))
    for line in [*lines, *fold_text(caption, console.width)]:
        console.print(Text(line), soft_wrap=True)


def _ladder_table(record: StudyRecord, width: int) -> tuple[str, list[str]]:
    rows = []
    for label, rung in zip(label_ladder(record), record.ladder, strict=True):
        counts = [str(rung.parameters), str(rung.rank)]
        aicc = "–" if rung.aicc is None else f"{rung.aicc:.0f}"
        figures = [*counts, *list_errors(rung), format_mm(rung.cv_rms_mm), aicc]
        rows.append(Row(label, figures))
    title = "Ladder: errors in mm, lengths of the residual vectors; params: parameters"
    return title, write_table("model", LADDER_HEADS, "", rows, width, LADDER_SPANS)


def _subset_table(record: StudyRecord, width: int) -> tuple[str, list[str], str]:
    candidates = record.candidates
    common = common_mechanisms(candidates.best)
    rows = []
    for subset in candidates.best:
        errors = [format_mm(subset.cv_rms_mm), format_mm(subset.held_out.mean_mm)]
        weight = format_weight(subset.weight)
        figures = [str(subset.rank), *errors, weight]
        own = subset.mechanisms[len(common) :]
        words = " + ".join(own) or "nothing more"
        row = Row(words, figures, subset.note)
        rows.append(row)
    title = (
        f"Best of {candidates.compared:,} candidate models, by weighted CV: errors in mm; weight: "
        "probability among them"
    )
    if common:
        title += f"; all have {' + '.join(common)}"
    lines = write_table("mechanisms", SUBSET_HEADS, "note", rows, width)
    return title, lines, TABLE_PURPOSE


def _set_table(record: StudyRecord, width: int) -> tuple[str, list[str], str]:
    rows = []
    models = record.weighed_models
    descriptions = describe_sets(models)
    for words, model in zip(descriptions, models, strict=True):
        probability = format_weight(model.probability)
        row = Row(words, [probability])
        rows.append(row)
    lines = write_table("effects", SET_HEADS, "", rows, width)
    return SETS_TITLE, lines, SETS_PURPOSE


# -- error map
# --------------------------------------------------------------------------------------------------


def _show_map(whole: ErrorMapRecord, console: Console) -> None:
    """Show the error map seen from the base: darker explains more alone; what stands out beyond
    chance is in colour. Causes have letters, which are explained below."""
    from rich.text import Text

    f, p = np.array(whole.f, dtype=float), np.array(whole.p_family_wise, dtype=float)
    fitting = (console.width - PLACE_WIDTH) // CELL_WIDTH
    columns = _strongest_columns(f, max(min(MAX_MAP_COLUMNS, fitting), 1))
    title = (
        f"Error map: F of each place and cause alone, beyond the base, for the {len(columns)} strongest causes "
        "(· < 3, ░ < 10, ▒ < 30, ▓ < 100, █; blank: not scanned; bold: p < 0.05 over the whole map)"
    )
    letters = ascii_lowercase[: len(columns)]
    heads = "".join(letter.rjust(CELL_WIDTH) for letter in letters)
    _show_table(console, title, ["frame".ljust(PLACE_WIDTH) + heads])
    for row, place in enumerate(whole.places):
        line = Text(place.ljust(PLACE_WIDTH))
        for column in columns:
            line.append(" " * (CELL_WIDTH - 2))
            line.append_text(_map_cell(f[row, column], p[row, column]))
        console.print(line, soft_wrap=True)
    causes = [round_numbers(whole.causes[column]) for column in columns]
    for explained in _explain_letters(causes, console.width):
        console.print(Text(explained), soft_wrap=True)


def _explain_letters(causes: Sequence[str], width: int) -> list[str]:
    """Write what the letters above the map's columns stand for, in as few lines as the longest
    cause allows."""
    entries = [f"{letter}  {cause}" for letter, cause in zip(ascii_lowercase, causes, strict=False)]
    size = max(len(entry) for entry in entries) + 3
    count = max(width // size, 1)
    groups = [entries[start : start + count] for start in range(0, len(entries), count)]
    return [
        line for group in groups for line in fold_text("".join(e.ljust(size) for e in group), width)
    ]


def _strongest_columns(f: Array, most: int) -> list[int]:
    """Return at most so many causes whose best cell stands out most, in the map's order."""
    best = np.where(np.isnan(f), 0.0, f).max(axis=0)
    order = np.argsort(-best, kind="stable")
    strongest: list[int] = order[:most].tolist()
    return sorted(strongest)


def _map_cell(f: float, p: float) -> Text:
    from rich.text import Text

    shade = " " if np.isnan(f) else next(mark for bound, mark in SHADES if f < bound)
    return Text(shade * 2, style="bold red" if p < STANDS_OUT_P else "dim")


# -- significance
# --------------------------------------------------------------------------------------------------


def _significance_table(
    mechanisms: Sequence[SignificanceRecord], width: int
) -> tuple[str, list[str], str]:
    """Return how much each mechanism of the chosen model matters, and what is lost without it."""
    rows = []
    for one in mechanisms:
        figures = (
            format_motion(one.mean_mm, one.mean_mrad),
            format_motion(one.max_mm, one.max_mrad),
            _format_figure(one.f),
            format_p(one.p),
            _format_figure(one.log10_evidence),
            format_mm(one.cv_rms_without_mm),
            format_mm(one.held_out_rms_without_mm),
            format_share(one.stability),
        )
        rows.append(Row(one.label, figures, remark=_remark(one)))
    title = (
        "How much each mechanism matters: displacement that it causes, F, nominal p, evidence (log10), errors "
        "without it, in mm; in halves: share of the halves of the data in which it stays; below a mechanism: signs and sizes that the catalogue "
        "does not expect"
    )
    first = mechanisms[0]
    caption = (
        f"With all of them: CV rms {format_mm(first.cv_rms_mm)}, held-out rms {format_mm(first.held_out_rms_mm)}. "
        f"Nominal p and halves {NOMINAL_CAVEAT}"
    )
    return title, write_table("mechanism", SIGNIFICANCE_HEADS, "", rows, width), caption


def _remark(one: SignificanceRecord) -> str:
    """Return how a mechanism departs from the catalogue's signs and sizes; nothing if it does not."""
    return "" if one.catalogue == AS_EXPECTED else one.catalogue


def _format_figure(value: float | None) -> str:
    """Return a figure with three digits; a dash where undefined."""
    if value is None:
        return "–"
    if 0 <= value < SMALLEST_F:
        return "< 1e-99"
    is_long = abs(value) >= LARGEST_SHORT
    return f"{value:.3g}" if is_long else write_rounded(value)
