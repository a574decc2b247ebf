"""The ladder, the table of subsets and the repeated procedure in figures."""

from __future__ import annotations

from ...results.schemas.model_schema import CandidatesRecord, NestedRecord, RungRecord, SubsetRecord
from ...results.schemas.schema import StudyRecord
from ...results.sentences.study_sentences import (
    SETS_PURPOSE,
    SETS_TITLE,
    TABLE_PURPOSE,
    common_mechanisms,
    describe_sets,
    format_mm,
    format_weight,
)
from ...results.sentences.tables import label_ladder
from ..document import Block, Source, make_heading, make_table, make_text

MAX_SET_ASIDE = 12  # names of what the table of subsets does not hold
MAX_SUBSETS = 4  # rows of the table of subsets
LADDER_COLUMNS = ("parameters", "rank", "rms", "worst", "held-out rms", "worst", "CV rms")


def write_models_page(source: Source) -> list[Block]:
    """Write the ladder, the table of subsets, the repeated procedure."""
    record = source.record
    blocks = [make_heading("Models"), *_write_ladder(record)]
    if record.candidates.best:
        blocks += _write_subsets(record.candidates)
    if record.weighed_models:
        blocks += _write_sets(record)
    if record.nested_cv is not None:
        blocks += _write_nested(record.nested_cv)
    return blocks


def _write_ladder(record: StudyRecord) -> list[Block]:
    labels = label_ladder(record)
    rows = [
        [label, str(rung.parameters), str(rung.rank), *_list_errors(rung)]
        for label, rung in zip(labels, record.ladder, strict=True)
    ]
    columns = [("model", "left"), *((name, "right") for name in LADDER_COLUMNS)]
    caption = (
        "Errors in mm: lengths of the residual vectors. Rank: parameters that the data determine. CV: cross-validated on the "
        "estimation configurations. A row that begins with + adds to the row above it."
    )
    widths = [1.0, *[0.0] * len(LADDER_COLUMNS)]
    table = make_table(columns, rows, caption, widths)
    return [make_heading("The ladder", 2), table]


def _list_errors(rung: RungRecord) -> list[str]:
    """Return rms and worst error [mm] of both sides of the split, and the cross-validated rms."""
    sides = (rung.estimation, rung.held_out)
    errors = [format_mm(error) for side in sides for error in (side.rms_mm, side.max_mm)]
    return [*errors, format_mm(rung.cv_rms_mm)]


def _write_subsets(candidates: CandidatesRecord) -> list[Block]:
    common = common_mechanisms(candidates.best)
    rows = [_subset_row(subset, len(common)) for subset in _select_subsets(candidates.best)]
    columns = [
        (f"{' + '.join(common)} and" if common else "mechanisms", "left"),
        ("rank", "right"),
        ("CV rms", "right"),
        ("held-out rms", "right"),
        ("weight", "right"),
        ("note", "left"),
    ]
    explanation = (
        f"Of {candidates.compared:,} subsets of the strongest registered mechanisms, these stand out. They check the ladder "
        f"from another side: each is fitted by one linear step and measured alike. {TABLE_PURPOSE}"
    )
    caption = "Errors in mm; weight: the subset's probability among those compared."
    return [
        make_heading("The table of subsets", 2),
        make_text(explanation + _search_sentence(candidates)),
        make_table(
            columns, rows, caption + _set_aside_sentence(candidates), [1.4, 0.0, 0.0, 0.0, 0.0, 0.8]
        ),
    ]


def _select_subsets(best: list[SubsetRecord]) -> list[SubsetRecord]:
    """Return the rows to show: the first, and those further down that a criterion chooses."""
    chosen = [subset for subset in best[MAX_SUBSETS:] if _is_chosen(subset)]
    return [*best[: max(MAX_SUBSETS - len(chosen), 1)], *chosen]


def _is_chosen(subset: SubsetRecord) -> bool:
    """Return whether a criterion chooses a subset, not only cannot tell it from the one it chooses."""
    notes = [note.strip() for note in subset.note.split(";")]
    return any(note.endswith("choice") or note.startswith("lowest") for note in notes)


def _subset_row(subset: SubsetRecord, common: int) -> list[str]:
    """Return one row of the table, without the mechanisms that all rows begin with."""
    return [
        " + ".join(subset.mechanisms[common:]) or "nothing more",
        str(subset.rank),
        format_mm(subset.cv_rms_mm),
        format_mm(subset.held_out.rms_mm),
        format_weight(subset.weight),
        subset.note,
    ]


def _search_sentence(candidates: CandidatesRecord) -> str:
    """Return whether branch and bound proved the best subset; nothing where all were walked through."""
    search = candidates.search
    if search is None:
        return ""
    outcome = (
        "proves the best."
        if search.proven
        else f"did not finish: its best may be beaten by up to {search.may_be_beaten_by:.3g}."
    )
    return f" Among all 2^{search.mechanisms} subsets, branch and bound by BIC {outcome}"


def _set_aside_sentence(candidates: CandidatesRecord) -> str:
    """Return which mechanisms the subsets do not hold; nothing where they hold all."""
    shown = candidates.set_aside[:MAX_SET_ASIDE]
    more = len(candidates.set_aside) - len(shown)
    if not shown:
        return ""
    rest = f" and {more} more" if more else ""
    return (
        f" The subsets are made of {len(candidates.considered)} mechanisms; weaker alone, and left out: "
        f"{', '.join(shown)}{rest}."
    )


def _write_sets(record: StudyRecord) -> list[Block]:
    models = record.weighed_models
    rows = []
    for words, model in zip(describe_sets(models), models, strict=True):
        probability = format_weight(model.probability)
        rows.append([words, probability])
    columns = [("effects", "left"), ("probability", "right")]
    table = make_table(columns, rows, SETS_PURPOSE, [1.0, 0.0])
    return [make_heading(SETS_TITLE, 2), table]


def _write_nested(nested: NestedRecord) -> list[Block]:
    explanation = (
        f"Everything, naming included, was repeated in {nested.folds} folds of the estimation configurations: rms error "
        f"{format_mm(nested.geometric.rms_mm)} mm with the base, {format_mm(nested.chosen.rms_mm)} mm with what each "
        "fold chose."
    )
    rows = [[name, str(count)] for name, count in nested.named_in_folds.items()]
    columns = [("name", "left"), ("folds in which it comes back", "right")]
    return [
        make_heading("The whole procedure repeated", 2),
        make_text(explanation),
        make_table(columns, rows, "", [0.0, 0.0]),
    ]
