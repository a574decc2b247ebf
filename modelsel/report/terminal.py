"""A study's records as words for a terminal or a log: the verdict, a summary, or everything."""

from __future__ import annotations

from collections.abc import Sequence
from enum import Enum
from typing import TYPE_CHECKING

from ..diagnosis.findings.name_legend import explain_names
from ..exceptions import count_words, number_repeated, sentence_list, write_numbered
from ..fitting.undetermined import write_unidentifiable
from ..measurements.formats.row_places import where_from_record
from ..notices import ALARMS
from ..results.conclusions.placements import describe_placements
from ..results.repeatability.repeatability import write_repeatability_lines
from ..results.repeatability.unsure_joints import describe_noise_floor
from ..results.schemas.details_schema import DetailsRecord
from ..results.schemas.schema import StudyRecord
from ..results.sentences.study_sentences import (
    describe_feature,
    describe_outliers,
    describe_predictable,
    describe_split,
    format_mm,
    gain_sentence,
    opening_sentences,
    write_finding_lines,
    write_sampling_sentences,
)
from .terminal_summary import summarise_study, write_closing
from .terminal_tables import show_tables
from .text_tables import fold_text

if TYPE_CHECKING:
    from rich.console import Console

# columns of a terminal that everyone has
WIDTH = 80
MAX_PAIRS = 6
MAX_FEATURES = 12
MAX_OUTLIERS = 20


class Amount(Enum):
    """How much of a study is shown: the verdict alone, a summary of one screen, or everything."""

    VERDICT = "verdict"
    SUMMARY = "summary"
    EVERYTHING = "everything"


def show_study(
    record: StudyRecord, details: DetailsRecord, console: Console, amount: Amount = Amount.SUMMARY
) -> None:
    """Show a study on a terminal, the verdict first."""
    show_analysis(record, details, console, amount)
    show_sampling(record, console, amount)


def show_analysis(
    record: StudyRecord, details: DetailsRecord, console: Console, amount: Amount
) -> None:
    """Show what is known before the posterior is sampled."""
    if amount is Amount.VERDICT:
        _print_sentences(opening_sentences(record), console)
        return
    _print_title(record, console)
    _print_sentences(opening_sentences(record), console)
    if amount is Amount.SUMMARY:
        _print_lines(["", *summarise_study(record, details, console.width)], console)
        return
    show_tables(record, console)
    _print_lines([""], console)
    _print_sentences(_detail_sentences(record, details), console)


def show_sampling(record: StudyRecord, console: Console, amount: Amount) -> None:
    """Show the rest of a study: what sampling says, and the notes, to which it adds."""
    if amount is Amount.SUMMARY:
        lines = write_closing(record, console.width)
        _print_lines(lines, console)
    elif amount is Amount.EVERYTHING:
        _print_sentences(_last_sentences(record), console)


def _print_sentences(sentences: Sequence[str], console: Console) -> None:
    """Print sentences, each folded at its blanks below its own indent."""
    for sentence in sentences:
        for line in sentence.splitlines():
            indent = " " * (len(line) - len(line.lstrip()))
            _print_lines(fold_text(line.strip(), console.width, indent), console)


def _print_lines(lines: Sequence[str], console: Console) -> None:
    """Print lines as they are: no name is markup."""
    for line in lines:
        console.print(line, highlight=False, markup=False, emoji=False, soft_wrap=True)


def _print_title(record: StudyRecord, console: Console) -> None:
    from rich.text import Text

    console.print()
    for line in fold_text(record.study, console.width):
        console.print(Text(line, style="bold"), soft_wrap=True)
    _print_sentences([f"Robot {record.robot}: {describe_split(record)}.", ""], console)
    _print_lines([""], console)


# -- words
# ----------------------------------------------------------------------------------------------------------------------


def _last_sentences(record: StudyRecord) -> list[str]:
    return [*_sampling_sentences(record), *_note_sentences(record)]


def _detail_sentences(record: StudyRecord, details: DetailsRecord) -> list[str]:
    """Return what is known before sampling, without what looks wrong."""
    where = where_from_record(None if details.places is None else details.places.to_dict())
    sentences = [
        _describe_models(record),
        *write_finding_lines(record),
        *_legend_sentences(details),
        *write_repeatability_lines(record.repeatability),
        record.nothing_else.sentence,
        describe_predictable(record),
        describe_outliers(record, where, MAX_OUTLIERS),
        gain_sentence(record),
        *_placement_sentences(record),
        *_feature_sentences(record),
        *(
            f"Not identifiable: {sentence}"
            for sentence in write_unidentifiable(record.unidentifiable)
        ),
        *_correlation_sentences(record),
    ]
    return [sentence for sentence in sentences if sentence]


def _legend_sentences(details: DetailsRecord) -> list[str]:
    """Return what the findings' names mean that no registry lists, a line each."""
    labels = [drawn.label for drawn in details.findings]
    lines = explain_names(labels, len(details.joints))
    return ["Names:", *(f"    {line}" for line in lines)] if lines else []


def _describe_models(record: StudyRecord) -> str:
    """Return the errors of the nominal and the chosen model against the noise floor."""
    nominal, chosen = record.ladder[0].estimation, record.ladder[-1]
    numbers = number_repeated(chosen.mechanisms)
    numbered = list(map(write_numbered, chosen.mechanisms, numbers))
    names = sentence_list(numbered) if numbered else "nominal"
    return (
        f"Estimation configurations: {format_mm(nominal.mean_mm)} mm mean and "
        f"{format_mm(nominal.max_mm)} mm at worst with the nominal model, "
        f"{format_mm(chosen.estimation.mean_mm)} mm mean with the chosen one ({names}); noise "
        f"floor {describe_noise_floor(record)}."
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
    more = len(fitted) - MAX_FEATURES
    if more > 0:
        verb = "is" if more == 1 else "are"
        sentences.append(f"{count_words(more, 'more feature')} {verb} in result.json.")
    return sentences


def _correlation_sentences(record: StudyRecord) -> list[str]:
    """Return which parameters the data tell only together."""
    pairs = record.correlation.pairs
    shown = pairs[:MAX_PAIRS]
    sentences = [f"Only together: {pair.sentence}" for pair in shown]
    more = len(pairs) - len(shown)
    further = count_words(more, "further pair")
    verb = "correlates" if more == 1 else "correlate"
    if more > 0:
        remainder = f"Only together: {further} {verb} above 0.9."
        sentences.append(remainder)
    return sentences


def _sampling_sentences(record: StudyRecord) -> list[str]:
    sentences = write_sampling_sentences(record)
    return [f"Sampling: {' '.join(sentences)}"] if sentences else []


def _note_sentences(record: StudyRecord) -> list[str]:
    notes = [warning for warning in record.warnings if warning.code not in ALARMS]
    return [f"Note: {note.sentence}" for note in notes]
