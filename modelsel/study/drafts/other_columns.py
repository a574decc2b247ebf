"""What becomes of the columns of a file that are neither readings nor positions."""

from __future__ import annotations

import re
import shlex
from collections.abc import Collection, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..._names import is_plain_word
from ...exceptions import one_line, sentence_list
from ...measurements.formats.column_names import parse_column_name
from ...measurements.formats.table import Table
from ...measurements.measurements import Measurements
from ...measurements.quantities.columns import convert_to_numbers, describe_cell
from ...measurements.quantities.contract_columns import (
    KNOWN_COVARIATES,
    UNCERTAINTY_COLUMNS,
    list_contract_names,
)
from ...measurements.quantities.orientation_columns import QUATERNION_COLUMNS
from ...measurements.quantities.point_times import (
    DATE_WORDS,
    TIME_WORDS,
    are_clock_times,
    find_date_column,
)
from ...measurements.recognition.column_guesses import Reading
from ...measurements.recognition.uncausal_columns import find_uncertainties

# where the mechanisms of a payload have its mass
PAYLOAD = (
    "payload_kg: its weight is taken to act at the target, the reflector on the flange; where its "
    "centre of mass is elsewhere, the stiffness is wrong by the ratio of the lever arms; which joint "
    "it is remains right."
)
# share of different cells from which a column of text is the names of points
MIN_DISTINCT = 0.9
# share of numbers from which a column is one of numbers with a stray cell
MIN_NUMBERS = 0.5


def describe_optional(optional: Sequence[Reading], data: Measurements) -> list[str]:
    """Say how optional columns are read; a single group says nothing."""
    groups = len(np.unique(data.group))
    lines = []
    for reading in optional:
        is_group = "group" in reading.columns
        if is_group and groups == 1:
            continue
        lines.append(f"Also: {reading.sentence}.")
    return lines


def describe_quaternions(table: Table, data: Measurements) -> list[str]:
    """Say that orientations are read where a file has them under the contract's names."""
    has_quaternions = all(name in table for name in QUATERNION_COLUMNS)
    if data.rotation is None or not has_quaternions:
        return []
    listed = " ".join(QUATERNION_COLUMNS)
    return [f"The orientation: {listed}, unit quaternions of the target in the instrument's frame."]


def describe_other_columns(
    table: Table, taken: Collection[str], data: Measurements, uncausal: Collection[str] = ()
) -> list[str]:
    """Say which of the other columns of a file are looked at as causes, and which are not used;
    `taken`: the columns that are mapped; `uncausal`: those that reading has said to be no causes.
    Names of points, a different one in every row, are for the messages."""
    varying = list[str]()
    constant = list[str]()
    for name, values in data.covariates.items():
        is_constant = np.ptp(values) == 0
        if is_constant:
            constant.append(name)
        elif name not in KNOWN_COVARIATES:
            varying.append(name)
    contract = list_contract_names(data.prismatic)
    known = {*taken, *contract, *data.covariates, *uncausal}
    others = [name for name in table.columns if name not in known]
    commanded = [name for name in others if parse_column_name(name).is_commanded]
    dates = {find_date_column(table, name) for name in taken if name in table}
    times = _list_times(others) if "time_s" in table else []
    used = {*commanded, *dates, *times}
    rest = [name for name in others if name not in used]
    named = [name for name in rest if _holds_point_names(table.columns[name])]
    unused = [name for name in rest if name not in named]
    lines = []
    if "payload_kg" in data.covariates:
        lines.append(PAYLOAD)
    lines += _list_names("Names of the points, by which messages call them", named)
    lines += _list_names("Looked at as possible causes of errors, too", varying)
    lines += _offer_times(varying, table)
    lines += _list_names("The same in all rows, so that nothing can depend on it", constant)
    lines += _list_names("Commanded, not measured, and not used", commanded)
    return lines + _list_names("Not used", unused, table)


def _offer_times(names: Sequence[str], table: Table) -> list[str]:
    """Offer columns that are called times, do not go back and say no unit, as the time; nothing where
    there is one."""
    if "time_s" in table:
        return []
    offered = []
    for name in names:
        parsed = parse_column_name(name)
        steps = np.diff(convert_to_numbers(table.columns[name]))
        is_clock = parsed.words & (TIME_WORDS - {"t"}) and parsed.unit is None
        if is_clock and len(steps) and steps.min() >= 0:
            pair = shlex.quote(f"time_s={name}")
            offered.append(f'If "{one_line(name)}" is a time in seconds: --column {pair}.')
    return offered


def offer_uncertainties(table: Table, columns: Collection[str]) -> list[str]:
    """Offer the stated uncertainties of the coordinates that are not read as standard ones; `columns`:
    the contract's names that are mapped."""
    is_read = any(name in table or name in columns for name in UNCERTAINTY_COLUMNS)
    names = [parse_column_name(name, table.units.get(name)) for name in table.columns]
    found = find_uncertainties(names)
    # of two kinds of uncertainties, none is the likelier one
    if is_read or len(found) != len(UNCERTAINTY_COLUMNS):
        return []
    pairs = zip(UNCERTAINTY_COLUMNS, found, strict=True)
    options = " ".join(f"--column {shlex.quote(f'{wanted}={own}')}" for wanted, own in pairs)
    quoted = sentence_list([f'"{one_line(name)}"' for name in found])
    return [f"If {quoted} are standard deviations in mm: {options}."]


def _list_times(names: Sequence[str]) -> list[str]:
    """List the columns that are called times or dates: `time_s` is made of them."""
    times = []
    for name in names:
        words = parse_column_name(name).words
        if words & (TIME_WORDS | DATE_WORDS):
            times.append(name)
    return times


def _holds_point_names(cells: NDArray[Any]) -> bool:
    """Whether cells are text that differs in every row, or nearly so, and neither numbers nor
    times."""
    if cells.dtype.kind != "O" or are_clock_times(cells):
        return False
    texts = {str(cell) for cell in cells}
    is_distinct = len(texts) >= MIN_DISTINCT * len(cells)
    values = convert_to_numbers(cells)
    is_number = np.isfinite(values)
    share = is_number.mean()
    return bool(is_distinct and share < MIN_NUMBERS)


def _list_names(words: str, names: Sequence[str], table: Table | None = None) -> list[str]:
    """List columns after some words, and of a `table` what keeps one from being looked at; nothing
    where there are none."""
    quoted = []
    for name in names:
        shown = one_line(name)
        reason = "" if table is None else _say_why(table, name)
        quoted.append(f'"{shown}"{reason}')
    listed = ", ".join(quoted)
    return [f"{words}: {listed}."] if quoted else []


def _say_why(table: Table, name: str) -> str:
    """Say what keeps a column of numbers from being looked at as a cause: a cell that is none, or its
    name; empty of a column of words."""
    cells = table.columns[name]
    values = convert_to_numbers(cells)
    is_number = np.isfinite(values)
    share = is_number.mean()
    if share < MIN_NUMBERS:
        return ""
    if share == 1:
        return _propose_name(table, name)
    stray = np.flatnonzero(~is_number)
    row = int(stray[0])
    return f" ({describe_cell(table, name, row)})"


def _propose_name(table: Table, name: str) -> str:
    """Propose a name that a formula can hold to a column whose own name is none."""
    words = re.findall(r"\w+", name)
    proposed = "_".join(words)
    if is_plain_word(name) or not is_plain_word(proposed) or proposed in table:
        return ""
    return f" (call it {proposed} in the file, and it is looked at as a possible cause)"
