"""Held-out rows whose side of a step no estimation row tells: they say nothing of a model's errors."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from ...diagnosis.findings.effects import Effect
from ...diagnosis.findings.step_sides import OpenSide, find_open_sides, mark_open
from ...exceptions import count_words, one_line
from ...notices import STEP_SIDE_OPEN, Note
from ...selection.evaluation import Evaluation, Split


def exclude_open_rows(
    split: Split, chosen: Evaluation, effects: Sequence[Effect]
) -> tuple[Split, list[Note]]:
    """Leave out the held-out rows whose side of a step of the chosen model is not known, and say so.

    They stay in, and the note says that, where no other row is held out."""
    mechanisms = chosen.fit.model.mechanisms
    sides = find_open_sides(split.problem, split.used, mechanisms, effects)
    held_out = ~split.estimation
    marked = mark_open(sides, held_out)
    if not marked.any():
        return split, []
    stay = bool((marked == held_out).all())
    concerned = [side for side in sides if (side.rows & held_out).any()]
    notes = [_tell(split, side, stay) for side in concerned]
    if stay:
        return split, notes
    outlying = split.outlying | marked
    return replace(split, outlying=outlying, undecided=marked), notes


def _tell(split: Split, side: OpenSide, stay: bool) -> Note:
    """Tell how many rows are on an unknown side of which step, between which rows; or of which target
    it is not known whether it moved."""
    data = split.problem.data
    listed = data.row[side.rows & ~split.estimation]
    count = len(listed)
    before = data.where.name_row_alone(int(data.row[side.before]))
    after = data.where.name_row_alone(int(data.row[side.after]))
    rows_lie = count_words(count, "held-out row")
    lie, were, are = ("lies", "it was", "it is") if count == 1 else ("lie", "they were", "they are")
    place = f"{rows_lie} {lie} between {before} and {after}, as the step {side.step} does"
    question = f"whether {were} measured before or after it, the estimation rows cannot tell"
    if side.target is not None:
        name = one_line(data.targets[side.target])
        of, was = f"{rows_lie} of target {name}", "was" if count == 1 else "were"
        when = f"after {before}" if side.later else f"before {after}"
        place = f"{of} {was} measured {when}, near which the step {side.step} lies"
        question = f"whether target {name} moved, too, the estimation rows cannot tell"
    result = f"{are} left out of the held-out errors"
    if stay:
        result = "as no other row is held out, the held-out errors may be too large"
    sentence = f"{place}: {question}, and {result}."
    numbers = tuple(int(row) for row in listed)
    return Note(STEP_SIDE_OPEN, sentence, numbers)
