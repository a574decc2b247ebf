"""The joints' own variables in a table of DH parameters, and rows of it that are remarks."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ..._typing import Array
from ...exceptions import one_line, sentence_list
from ...measurements.formats.table import Table
from ...measurements.formats.table_layout import MIN_REMARK_WORDS, WORD
from ...measurements.quantities.columns import find_blank_cells
from .dh_cells import find_variable


@dataclass(frozen=True)
class JointVariables:
    """The variable of every row as the table writes it, empty where there is none, and its sign
    (m,): -1 where the joint counts the other way."""

    words: tuple[str, ...]
    signs: Array

    def describe(self) -> str:
        """Say which words were taken for the joints' readings; nothing where there are none."""
        found = [word for word in self.words if word]
        if not found:
            return ""
        listed = found[0] if len(found) == 1 else f"{found[0]} to {found[-1]}"
        verb = "is the joint's own reading" if len(found) == 1 else "are the joints' own readings"
        said = f"{listed} {verb}"
        reversed_joints = [str(k) for k, sign in enumerate(self.signs, 1) if sign < 0]
        if reversed_joints:
            word, verb = ("joint", "counts") if len(reversed_joints) == 1 else ("joints", "count")
            said += f", and {word} {sentence_list(reversed_joints)} {verb} the other way"
        return said


def read_variables(
    table: Table, columns: Sequence[tuple[str, str, Sequence[Any]]], slides: Sequence[bool]
) -> JointVariables:
    """Read the variables of the rows: in theta of a joint that turns, in d of one that slides;
    `columns`: (what a column holds, its name, its cells). Raises DataError for two variables in a
    cell, and for those that are not in the order of the joints."""
    words, signs = [""] * len(slides), np.ones(len(slides))
    for key, name, cells in columns:
        for row, cell in enumerate(cells):
            found = find_variable(cell, table.where, row, name, key)
            if found is not None and (key == "d") == slides[row]:
                words[row], signs[row] = found
    _check_order(table, words)
    return JointVariables(tuple(words), signs)


def _check_order(table: Table, words: Sequence[str]) -> None:
    """Refuse variables whose numbers do not follow one another with the rows."""
    numbered = [(row, re.search(r"\d+$", word)) for row, word in enumerate(words)]
    steps = [(row, int(match[0]) - row) for row, match in numbered if match is not None]
    for row, step in steps:
        if step != steps[0][1]:
            raise table.where.refuse(
                f"{words[row]} stands in the row of joint {row + 1}.",
                row=row,
                remedy="Write the rows in the order of the joints, from the base on.",
            )


def drop_remark_rows(table: Table, parameters: Sequence[str]) -> tuple[Table, list[str]]:
    """Drop the rows that hold a sentence and no parameter; return also what is said of them."""
    if not parameters or not len(table):
        return table, []
    is_empty = np.all([find_blank_cells(table.columns[name]) for name in parameters], axis=0)
    others = [cells for name, cells in table.columns.items() if name not in parameters]
    said, kept = list[str](), np.ones(len(table), bool)
    for row in np.flatnonzero(is_empty).tolist():
        text = " ".join(str(cells[row]).strip() for cells in others if cells[row] is not None)
        if len(WORD.findall(text)) >= MIN_REMARK_WORDS:
            kept[row] = False
            said.append(f'{table.where.name_row(row)} is a remark ("{one_line(text)}").')
    if not said:
        return table, []
    at = np.array([table.where.number(row) for row in np.flatnonzero(kept).tolist()], np.intp)
    columns = {name: cells[kept] for name, cells in table.columns.items()}
    where = replace(table.where, at=at)
    return replace(table, columns=columns, where=where), said
