"""Which parts of the errors measurements can tell, by what, and what would tell the others."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..._part_names import AT_TARGET, IN_GROUP
from ...fitting.possible_parts import MIN_GROUPS, MIN_LEVELS, count_excess, list_parts
from ...fitting.problem import Problem
from ...fitting.shared_errors import MAX_BLOCK
from ...measurements.campaign.visits import count_distinct
from ...measurements.measurements import Measurements
from ..planning.planned_repeats import MAX_POSTURES, TIMES

MAX_ROWS = 100_000  # that are looked at: what they tell, more do
# where rows can tell it
LOUDER = {
    AT_TARGET: "Whether one target is measured with more noise than others: judged by the sizes of single rows' errors.",
    IN_GROUP: "Whether one group is measured with more noise than others: judged by the sizes of single rows' errors.",
}
MEASURE_AGAIN = f"{MAX_POSTURES} postures measured {TIMES} times each, in separate rounds,"


def describe_told_parts(problem: Problem) -> dict[str, Any]:
    """Describe which parts of the errors the rows of a problem can tell: `parts`, each with what
    tells it, and `sentences`. Of many rows the first MAX_ROWS are looked at."""
    seen = []
    if len(problem) > MAX_ROWS:
        problem = problem.take(slice(0, MAX_ROWS))
        seen = [f"Seen by the first {MAX_ROWS:,} rows."]
    data = problem.data
    told = list_parts(problem, np.ones(len(data), bool))
    # of a part that two things tell, the first
    by = {part.name: part.told_by for part in reversed(told)}
    if not told:
        return {"parts": {}, "sentences": [_describe_untellable(problem)]}
    # all joints are told by the same
    joints = [told_by for name, told_by in by.items() if name.startswith("joint ")][:1]
    sentences = [
        *seen,
        *[_describe_joints(data, told_by) for told_by in joints],
        "Whether the instrument errs more in one direction than in others: judged by single rows' errors.",
        *_describe_louder_rows(tuple(by)),
        _describe_configurations(data, by.get("configuration")),
        _describe_groups(data, "group" in by),
        "What lasts from visit to visit: told by the order of the visits.",
    ]
    return {"parts": dict(reversed(by.items())), "sentences": sentences}


def _describe_louder_rows(names: tuple[str, ...]) -> list[str]:
    said = []
    for kind, sentence in LOUDER.items():
        is_told = any(name.startswith(kind) for name in names)
        if is_told:
            said.append(sentence)
    return said


def _describe_untellable(problem: Problem) -> str:
    if not problem.only_points:
        return "Points alone tell it; rows of other kinds do not."
    return (
        f"It takes {MIN_LEVELS} configurations to tell any of it; the file has "
        f"{problem.data.configurations}."
    )


def _describe_joints(data: Measurements, told_by: str) -> str:
    if told_by == "repeats":
        again = data.configurations - count_distinct(data.block)
        return (
            f"What a joint does not repeat: told by {again:,} visits to postures measured before."
        )
    alone = "the direction in which it moves the target"
    if told_by == "targets":
        alone = "the targets that it moves together"
    return (
        f"{_describe_few_repeats(data)}: what a joint does not repeat is seen by {alone} and cannot be told from an "
        f"error of that joint that repeats; {MEASURE_AGAIN} would tell them apart."
    )


def _describe_few_repeats(data: Measurements) -> str:
    again = count_excess(data.block, data.configuration)
    if not again:
        return "No posture was measured twice"
    return f"Only {again} visits were to postures measured before"


def _describe_configurations(data: Measurements, told_by: str | None) -> str:
    if told_by == "targets":
        rows = count_excess(data.configuration, np.arange(len(data)))
        return (
            f"What the rows of one visit share: told by {rows:,} rows beyond the first of their "
            "visit."
        )
    if told_by == "repeats":
        return (
            "What the visits to one posture share: told by the visits to postures measured before."
        )
    return (
        "One target at a visit: what a visit adds to all its targets cannot be told from the "
        "instrument's noise; a second target would tell it."
    )


def _describe_groups(data: Measurements, told: bool) -> str:
    groups = count_distinct(data.group)
    if told:
        return f"What the rows of one group share: told by {groups:,} groups."
    return (
        f"What the rows of one group share (a day, a place of the instrument): it takes {MIN_GROUPS} "
        f"groups of 2 to {MAX_BLOCK} rows; the file has {groups:,}."
    )
