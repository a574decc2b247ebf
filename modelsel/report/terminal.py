"""A study's records as words and tables for a terminal or a log (rich)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from .._typing import Array
from ..exceptions import sentence_list
from ..measurements.row_places import where_from_record
from ..notices import ALARMS
from ..results.details_schema import DetailsRecord
from ..results.model_schema import SignificanceRecord
from ..results.placements import describe_placements
from ..results.repeatability import write_repeatability_lines
from ..results.schema import ErrorMapRecord, StudyRecord
from ..results.study_sentences import (
    NOMINAL_CAVEAT,
    TABLE_PURPOSE,
    alarm_sentences,
    common_mechanisms,
    describe_feature,
    describe_noise_floor,
    describe_outliers,
    describe_predictable,
    describe_split,
    format_mm,
    format_p,
    format_share,
    format_weight,
    gain_sentence,
    hopeless_sentences,
    list_errors,
    write_finding_lines,
    write_sampling_sentences,
)
from ..results.tables import label_ladder

if TYPE_CHECKING:
    from rich.console import Console
    from rich.table import Table

MAX_MAP_COLUMNS = 14
MAX_PAIRS = 6
MAX_FEATURES = 12
MAX_OUTLIERS = 20
# F up to which a cell of the error map has a shade
SHADES = ((3.0, "·"), (10.0, "░"), (30.0, "▒"), (100.0, "▓"), (np.inf, "█"))
STANDS_OUT_P = 0.05
# an F below it is not told from zero
SMALLEST_F = 1e-99


def show_study(record: StudyRecord, details: DetailsRecord, console: Console) -> None:
    """Show the whole study on a terminal: the ladder, the table of subsets, the error map, significance, then all in
    words."""
    show_analysis(record, details, console)
    show_sampling(record, console)


def show_analysis(record: StudyRecord, details: DetailsRecord, console: Console) -> None:
    """Show what is known before the posterior is sampled."""
    console.print(_title(record))
    console.print(_ladder_table(record))
    if record.candidates.best:
        console.print(_subset_table(record))
    if record.error_map.causes:
        console.print(_map_table(record.error_map))
    if record.significance:
        console.print(_significance_table(record.significance))
    _print_sentences(_analysis_sentences(record, details), console)


def show_sampling(record: StudyRecord, console: Console) -> None:
    """Show the rest of a study: what sampling says, and the notes, to which it adds."""
    _print_sentences(_last_sentences(record), console)


def _print_sentences(sentences: Sequence[str], console: Console) -> None:
    for sentence in sentences:
        console.print(sentence, highlight=False, markup=False, emoji=False)


def _title(record: StudyRecord) -> Any:
    from rich.text import Text

    # Text: no name is markup
    return Text.assemble(
        "\n", (record.study, "bold"), f": {record.robot}, ", describe_split(record)
    )


def _new_table(title: str, first: str, columns: Sequence[str], last: str = "") -> Table:
    """Return an empty table: words in the first and the last column, figures between."""
    from rich.table import Table

    table = Table(title=title, title_justify="left", title_style="bold")
    table.add_column(first, overflow="fold")
    for column in columns:
        table.add_column(column, justify="right")
    if last:
        table.add_column(last, overflow="fold")
    return table


LADDER_COLUMNS = ("parameters", "rank", "mean", "worst", "held-out mean", "worst", "CV rms", "AICc")


def _ladder_table(record: StudyRecord) -> Table:
    from rich.text import Text

    title = "Ladder: errors in mm, lengths of the residual vectors"
    table = _new_table(title, "model", LADDER_COLUMNS)
    for label, rung in zip(label_ladder(record), record.ladder, strict=True):
        table.add_row(
            Text(label),
            str(rung.parameters),
            str(rung.rank),
            *list_errors(rung),
            format_mm(rung.cv_rms_mm),
            "–" if rung.aicc is None else f"{rung.aicc:.0f}",
        )
    return table


def _subset_table(record: StudyRecord) -> Table:
    from rich.text import Text

    candidates = record.candidates
    common = common_mechanisms(candidates.best)
    first = f"{' + '.join(common)} and" if common else "mechanisms"
    table = _new_table(
        f"Best of {candidates.compared:,} candidate models, by cross-validation: errors in mm; weight: probability "
        "among them",
        first,
        ("rank", "CV rms", "held-out mean", "weight"),
        "note",
    )
    for subset in candidates.best:
        table.add_row(
            Text(" + ".join(subset.mechanisms[len(common) :]) or "nothing more"),
            str(subset.rank),
            format_mm(subset.cv_rms_mm),
            format_mm(subset.held_out.mean_mm),
            format_weight(subset.weight),
            Text(subset.note),
        )
    table.caption = TABLE_PURPOSE
    return table


# -- error map
# --------------------------------------------------------------------------------------------------------------------


def _map_table(whole: ErrorMapRecord) -> Table:
    """Return the error map seen from the base: darker explains more alone; what stands out beyond chance is in
    colour."""
    from rich.table import Table
    from rich.text import Text

    table = Table(
        title="Error map: F of each place and cause alone, beyond the base (· < 3, ░ < 10, ▒ < 30, ▓ < 100, █; "
        "bold: p < 0.05 over the whole map)",
        title_justify="left",
        title_style="bold",
        box=None,
        padding=(0, 1),
    )
    f, p = np.array(whole.f, dtype=float), np.array(whole.p_family_wise, dtype=float)
    columns = _strongest_columns(f)
    table.add_column("place")
    for column in columns:
        name = Text(whole.causes[column].replace(" & ", "\n"))
        table.add_column(name, justify="center", overflow="fold")
    for row, place in enumerate(whole.places):
        cells = [_map_cell(f[row, column], p[row, column]) for column in columns]
        table.add_row(f"frame {place}", *cells)
    return table


def _strongest_columns(f: Array) -> list[int]:
    """Return the causes whose best cell stands out most, in the map's order."""
    best = np.where(np.isnan(f), 0.0, f).max(axis=0)
    order = np.argsort(-best, kind="stable")
    strongest: list[int] = order[:MAX_MAP_COLUMNS].tolist()
    return sorted(strongest)


def _map_cell(f: float, p: float) -> Any:
    from rich.text import Text

    shade = " " if np.isnan(f) else next(mark for bound, mark in SHADES if f < bound)
    return Text(shade * 2, style="bold red" if p < STANDS_OUT_P else "dim")


# -- significance
# -----------------------------------------------------------------------------------------------------------------

SIGNIFICANCE_COLUMNS = (
    "mean",
    "worst",
    "F",
    "nominal p",
    "log10 evidence",
    "CV rms without",
    "held-out rms without",
    "stays in halves",
)


def _significance_table(mechanisms: Sequence[SignificanceRecord]) -> Table:
    """Return how much each mechanism of the chosen model matters, and what is lost without it."""
    from rich.text import Text

    title = "How much each mechanism matters: displacement it causes, and errors without it, in mm"
    table = _new_table(title, "mechanism", SIGNIFICANCE_COLUMNS, "catalogue")
    for one in mechanisms:
        table.add_row(
            Text(one.mechanism),
            format_mm(one.mean_mm),
            format_mm(one.max_mm),
            _figure(one.f),
            format_p(one.p),
            _figure(one.log10_evidence),
            format_mm(one.cv_rms_without_mm),
            format_mm(one.held_out_rms_without_mm),
            format_share(one.stability),
            Text(one.catalogue),
        )
    first = mechanisms[0]
    table.caption = (
        f"with all of them: CV rms {format_mm(first.cv_rms_mm)}, held-out rms {format_mm(first.held_out_rms_mm)}. "
        f"Nominal p and halves {NOMINAL_CAVEAT}"
    )
    return table


def _figure(value: float | None) -> str:
    if value is None:
        return "–"
    return "< 1e-99" if 0 <= value < SMALLEST_F else f"{value:.3g}"


# -- words
# ----------------------------------------------------------------------------------------------------------------------


def write_sentences(record: StudyRecord, details: DetailsRecord) -> list[str]:
    """Write the study in words."""
    return [*_analysis_sentences(record, details), *_last_sentences(record)]


def _last_sentences(record: StudyRecord) -> list[str]:
    return [*_sampling_sentences(record), *_note_sentences(record)]


def _analysis_sentences(record: StudyRecord, details: DetailsRecord) -> list[str]:
    """Return what is known before sampling."""
    where = where_from_record(None if details.places is None else details.places.to_dict())
    sentences = [
        *alarm_sentences(record),
        *hopeless_sentences(record),
        _describe_models(record),
        *write_finding_lines(record),
        *write_repeatability_lines(record.repeatability),
        record.nothing_else.sentence,
        describe_predictable(record),
        describe_outliers(record, where, MAX_OUTLIERS),
        gain_sentence(record),
        *_placement_sentences(record),
        *_feature_sentences(record),
        *(f"Not identifiable: {one.sentence}" for one in record.unidentifiable),
        *_correlation_sentences(record),
    ]
    return [sentence for sentence in sentences if sentence]


def _describe_models(record: StudyRecord) -> str:
    """Return the errors of the nominal and the chosen model against the noise floor."""
    nominal, chosen = record.ladder[0].estimation, record.ladder[-1]
    names = sentence_list(chosen.mechanisms) if chosen.mechanisms else "nominal"
    return (
        f"Nominal model: {format_mm(nominal.mean_mm)} mm mean, {format_mm(nominal.max_mm)} mm worst. "
        f"Chosen model ({names}): {format_mm(chosen.estimation.mean_mm)} mm mean; noise floor "
        f"{describe_noise_floor(record)}."
    )


def _placement_sentences(record: StudyRecord) -> list[str]:
    if record.registration is None:
        return []
    sentences = describe_placements(record.registration)
    return [f"Registered: {sentence[0].lower()}{sentence[1:]}" for sentence in sentences]


def _feature_sentences(record: StudyRecord) -> list[str]:
    """Return where the chosen model has what rows share and nobody knew."""
    fitted = [feature for feature in record.features or [] if feature.fitted]
    sentences = [describe_feature(feature) for feature in fitted[:MAX_FEATURES]]
    if len(fitted) > MAX_FEATURES:
        sentences.append(f"{len(fitted) - MAX_FEATURES} more features are in result.json.")
    return sentences


def _correlation_sentences(record: StudyRecord) -> list[str]:
    """Return which parameters the data tell only together."""
    pairs = record.correlation.pairs
    sentences = [f"Only together: {pair.sentence}" for pair in pairs[:MAX_PAIRS]]
    if len(pairs) > MAX_PAIRS:
        more = len(pairs) - MAX_PAIRS
        sentences.append(f"Only together: {more} further pairs correlate above 0.9.")
    return sentences


def _sampling_sentences(record: StudyRecord) -> list[str]:
    sentences = write_sampling_sentences(record)
    return [f"Sampling: {' '.join(sentences)}"] if sentences else []


def _note_sentences(record: StudyRecord) -> list[str]:
    notes = [warning for warning in record.warnings if warning.code not in ALARMS]
    return [f"Note: {note.sentence}" for note in notes]
