"""Load tables of text: the rows, the lines they stand on, and what is unusual about the file."""

from __future__ import annotations

import csv
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..._text import find_read_problem
from ...exceptions import DataError, count_words, one_line
from .decimal_marks import (
    choose_decimal_mark,
    find_doubtful_point,
    has_groups,
    refuse_doubtful_mark,
)
from .number_format import convert_number_text, describe_odd_numbers, is_number, needs_conversion
from .row_places import Where
from .stated_units import find_stated_unit
from .table_layout import Layout, advise_on_width, find_layout, is_blank_row, is_remark
from .text_format import (
    BLANKS,
    ENCODING_NAMES,
    SEPARATOR_NAMES,
    TextFormat,
    mask_comments,
    refuse_open_quote,
    sample_rows,
    sniff_text,
    split_rows,
)

# rows of a CSV that are read together
CHUNK_ROWS = 50_000
LINE_BREAK = re.compile(r"\r\n|\r|\n")
# lines of a kind that a note lists
MAX_LISTED = 6
# remarks that a note quotes, and their characters
MAX_REMARKS = 3
MAX_REMARK_LENGTH = 90


@dataclass
class Grid:
    """The cells of a table as they stand in a file, column by column, under its names; `said`: what
    is unusual about the file."""

    names: list[str]
    columns: list[NDArray[Any]]
    where: Where
    units: dict[str, str] = field(default_factory=dict)
    said: list[str] = field(default_factory=list)
    length_unit: tuple[str, int] | None = None  # that a comment says, and its line


@dataclass
class _Reading:
    """A text file that is being read: its form, its header, the decimal mark, how its numbers are
    written, and which lines are left out."""

    path: Path
    form: TextFormat
    layout: Layout
    first: int  # line of the first row
    decimal: str
    numbers: str  # how they differ from plain ones; empty where they do not
    padded: int  # cells of a row with the empty ones that end all rows
    comments: dict[int, str] = field(default_factory=dict)
    blank: list[int] = field(default_factory=list)
    remarks: dict[int, str] = field(default_factory=dict)
    last: int = 0  # line of the last row that was read

    @property
    def width(self) -> int:
        return len(self.layout.names)


def load_text_table(path: Path, decimal: str | None = None, headerless: bool = False) -> Grid:
    """Load a text table, whatever separates its cells and however it is encoded; `decimal`: its
    decimal mark where both fit; `headerless`: whether it may have no header, its columns then
    called column 1 and so on. Raises DataError."""
    check_file(path)
    try:
        reading = _prepare_reading(path, decimal, headerless)
        parts, starts = [], []
        for rows, lines in _read_chunks(reading):
            starts.append(lines)
            parts.append([np.array(column, dtype=object) for column in zip(*rows, strict=True)])
    except (OSError, UnicodeError, csv.Error) as error:
        reason = getattr(error, "strerror", None) or str(error)
        raise DataError(
            f"the file cannot be read: {reason}.", file=path.name, remedy="Save it as CSV in UTF-8."
        ) from None
    count = sum(len(lines) for lines in starts)
    if not count or any(map(LINE_BREAK.search, reading.remarks.values())):
        refuse_open_quote(path, reading.form)
    at = np.concatenate(starts) if starts else np.zeros(0, np.intp)
    is_plain = reading.first == 2 and np.array_equal(at, np.arange(2, 2 + count))
    header = reading.layout.header
    where = Where(path.name, at=None if is_plain else at, header=header)
    columns = [
        np.concatenate([part[k] for part in parts]) if parts else np.zeros(0, object)
        for k in range(reading.width)
    ]
    _refuse_doubtful_comments(reading, columns)
    grid = Grid(reading.layout.names, columns, where, reading.layout.units)
    grid.said = _describe_reading(reading)
    grid.length_unit = find_stated_unit(reading.comments)
    return grid


def find_text_style(path: Path, decimal: str | None, headerless: bool) -> tuple[TextFormat, str]:
    """Find how a text table is written, and its decimal mark. Raises DataError."""
    reading = _prepare_reading(path, decimal, headerless)
    return reading.form, reading.decimal


def _refuse_doubtful_comments(reading: _Reading, columns: Sequence[NDArray[Any]]) -> None:
    """Refuse a comment that may be a row of measurements whose name begins with the mark: as wide
    as the others, with numbers, where the other rows begin with a name."""
    first: Sequence[Any] = columns[0][:1].tolist() if columns else []
    if not first or is_number(first[0]):
        return
    for line, text in reading.comments.items():
        for cells in split_rows([text], reading.form.separator):
            numbers = sum(map(is_number, cells))
            if len(cells) == reading.width and numbers >= 2:
                raise DataError(
                    f'"{cells[0]}" begins like a comment, but the line has the cells of a row.',
                    file=reading.path.name,
                    line=line,
                    remedy="If it is a name, write it in quotation marks; if the row is not to be "
                    "read, remove it.",
                )


def check_file(path: Path) -> None:
    """Refuse what is not a file."""
    why = find_read_problem(path)
    if why is None:
        return
    remedy = "Check its name and folder; a study looks beside its own file, then in MODELSEL_DATA."
    if path.exists():
        remedy = "Give the file that holds the measurements."
    raise DataError(f"{why}.", file=path.name or str(path), remedy=remedy)


# -- the form of a file
# --------------------------------------------------------------------------------------------


def _prepare_reading(path: Path, decimal: str | None, headerless: bool) -> _Reading:
    """Find a file's form, header and decimal mark in its beginning."""
    form, text = sniff_text(path)
    rows, ends, comments = sample_rows(text, form)
    layout = find_layout(rows)
    if layout is not None:
        line = ends[layout.header] - _count_breaks(rows[layout.header])
        first = ends[layout.skipped - 1] + 1
        body = rows[layout.skipped :]
    else:
        if all(map(is_blank_row, rows)):
            raise _refuse_blank(path.name)
        line, names = _find_commented_header(rows, form, comments)
        if not names and not headerless:
            raise refuse_headerless(path.name)
        names = names or number_columns(rows)
        layout, first, body = Layout(names, 0, 0), 1, rows
    layout = replace(layout, header=line)
    cells = [cell for row in body for cell in row]
    numbers = ""
    doubtful = find_doubtful_point(body)
    if doubtful is not None and decimal is None:
        raise refuse_doubtful_mark(path.name, doubtful)
    if needs_conversion(cells) or has_groups(cells, doubtful, decimal):
        decimal = decimal or choose_decimal_mark(path.name, cells)
        numbers = describe_odd_numbers(cells, decimal)
    padded = _find_padding(body, len(layout.names))
    return _Reading(path, form, layout, first, decimal or ".", numbers, padded)


def _find_padding(body: Sequence[Sequence[str]], width: int) -> int:
    """Find how many cells rows have where all of them end with the same number of empty ones."""
    widths = {len(row) for row in body if not is_blank_row(row) and not is_remark(row, width)}
    longest = max(widths, default=width)
    if len(widths) != 1 or longest <= width:
        return width
    is_padded = all(is_blank_row(row[width:]) for row in body)
    return longest if is_padded else width


def _find_commented_header(
    rows: Sequence[Sequence[str]], form: TextFormat, comments: dict[int, str]
) -> tuple[int, list[str]]:
    """Find (line, names) of a header that is a comment, as numpy writes it; no names where there
    is none."""
    filled = [row for row in rows if not is_blank_row(row)]
    width = len(filled[0]) if filled else 0
    for line in sorted(comments, reverse=True):
        text = comments[line]
        mark = next((mark for mark in form.marks if text.startswith(mark)), "")
        split = split_rows([text.removeprefix(mark).strip()], form.separator)
        names = [cell.strip() for row in split for cell in row]
        if len(names) == width - 1:
            names = [mark, *names]
        if len(names) == width > 1 and any(names):
            names[0] = names[0] or mark
            return line, names
    return 0, []


def number_columns(rows: Sequence[Sequence[Any]]) -> list[str]:
    """Number the columns of a table without header, as many as its first row has."""
    filled = [row for row in rows if not is_blank_row(row)]
    numbers = range(1, len(filled[0]) + 1)
    return [f"column {number}" for number in numbers]


def _refuse_blank(file: str) -> DataError:
    """Return the error of a table of nothing but separators and quotes."""
    return DataError(
        "no row holds a name or a number, only separators or quotes.",
        file=file,
        line=1,
        remedy="Export the table again: a line of column names, then a row for each measured point.",
    )


def refuse_headerless(file: str) -> DataError:
    """Return the error of a table that begins with numbers."""
    return DataError(
        "the table begins with numbers: it has no header.",
        file=file,
        line=1,
        remedy="Write the columns' names in a line above them: q1_deg, …, x_mm, y_mm, z_mm.",
    )


# -- rows
# --------------------------------------------------------------------------------------------


def _read_chunks(reading: _Reading) -> Iterator[tuple[list[list[str]], NDArray[np.intp]]]:
    """Read chunks of (rows, the lines they begin on), without comments and empty rows. Raises
    DataError for ragged rows with their line."""
    with reading.path.open(newline="", encoding=reading.form.encoding) as file:
        lines = mask_comments(file, reading.form.marks, reading.comments)
        for _ in range(reading.first - 1):
            next(lines, None)
        reader = split_rows(lines, reading.form.separator)
        line = reading.first
        while chunk := list(islice(reader, CHUNK_ROWS)):
            end = reading.first + reader.line_num
            is_plain = end == line + len(chunk)
            starts = np.arange(line, end) if is_plain else _find_starts(chunk, line)
            line = end
            rows, starts = _drop_blank_rows(reading, chunk, starts)
            if set(map(len, rows)) - {reading.width}:
                rows, starts = _drop_remarks(reading, rows, starts)
                pairs = zip(rows, starts, strict=True)
                rows = [_fit_row(reading, row, start) for row, start in pairs]
            if reading.numbers:
                mark = reading.decimal
                rows = [[convert_number_text(cell, mark) for cell in row] for row in rows]
            if rows:
                reading.last = int(starts[-1])
                yield rows, starts


def _drop_blank_rows(
    reading: _Reading, chunk: list[list[str]], starts: NDArray[np.intp]
) -> tuple[list[list[str]], NDArray[np.intp]]:
    width = reading.width
    blank = [
        k
        for k, row in enumerate(chunk)
        if not any(row) or (len(row) != width or not row[0]) and is_blank_row(row)
    ]
    if not blank:
        return chunk, starts
    lines = starts[blank].tolist()
    reading.blank += [line for line in lines if line not in reading.comments]
    dropped = set(blank)
    kept = [row for k, row in enumerate(chunk) if k not in dropped]
    return kept, np.delete(starts, blank)


def _drop_remarks(
    reading: _Reading, rows: list[list[str]], starts: NDArray[np.intp]
) -> tuple[list[list[str]], NDArray[np.intp]]:
    """Leave out sentences that stand between or below the rows, and keep them by their lines."""
    found = [k for k, row in enumerate(rows) if is_remark(row, reading.width)]
    mark = reading.form.separator
    for k in found:
        reading.remarks[int(starts[k])] = mark.join(rows[k]).strip(mark + " ")
    kept = [row for k, row in enumerate(rows) if k not in set(found)]
    return kept, np.delete(starts, found)


def _fit_row(reading: _Reading, row: list[str], line: int) -> list[str]:
    """Return a row as wide as the header, without the separators that end all rows of the file.
    Raises DataError for another width."""
    width = reading.width
    if len(row) == width:
        return row
    if len(row) == reading.padded and is_blank_row(row[width:]):
        return row[:width]
    raise DataError(
        f"{count_words(len(row), 'cell')}, but the header has {width}.",
        file=reading.path.name,
        line=int(line),
        remedy=advise_on_width(row, width, reading.form.separator),
    )


def _find_starts(chunk: list[list[str]], line: int) -> NDArray[np.intp]:
    """Find the lines (m,) on which rows begin, the first on `line`: a cell between quotes may have
    several."""
    spans = [1 + _count_breaks(row) for row in chunk]
    before = [0, *spans[:-1]]
    starts = line + np.cumsum(before)
    return np.asarray(starts, dtype=np.intp)


def _count_breaks(row: Sequence[str]) -> int:
    count = 0
    for cell in row:
        breaks = LINE_BREAK.findall(cell)
        count += len(breaks)
    return count


# -- what is said of a file
# --------------------------------------------------------------------------------------------


def _describe_reading(reading: _Reading) -> list[str]:
    """Say how a file differs from plain CSV; nothing where it does not."""
    form = reading.form
    said = []
    if form.encoding in ENCODING_NAMES:
        said.append(f"text in {ENCODING_NAMES[form.encoding]}")
    if form.separator == BLANKS:
        said.append("cells separated by blanks")
    elif form.separator != ",":
        said.append(f"cells separated by {SEPARATOR_NAMES[form.separator]}")
    if reading.numbers:
        said.append(reading.numbers)
    header = reading.layout.header
    if header == 0:
        said.append("no header")
    if header > 1:
        said.append(f"the header on line {header}")
    if reading.layout.units:
        said.append("a row of units below the header")
    comments = [line for line in reading.comments if line != header]
    shown = list(reading.remarks.items())[:MAX_REMARKS]
    said += describe_lines(comments, "a comment", "comments")
    said += [f'line {line} is a remark ("{_shorten(text)}")' for line, text in shown]
    more = len(reading.remarks) - MAX_REMARKS
    if more > 0:
        said.append(
            f"{count_words(more, 'more line')} {'is a remark' if more == 1 else 'are remarks'}"
        )
    between = [line for line in reading.blank if line < reading.last]
    return said + describe_lines(between, "empty", "empty")


def _shorten(text: str) -> str:
    """Shorten a remark to what a note holds."""
    plain = " ".join(one_line(text).split())
    return plain if len(plain) <= MAX_REMARK_LENGTH else plain[:MAX_REMARK_LENGTH].rstrip() + " …"


def describe_lines(lines: Sequence[int], one: str, many: str, word: str = "line") -> list[str]:
    """Say which lines are left out as what; nothing where there are none."""
    if not lines:
        return []
    if len(lines) == 1:
        return [f"{word} {lines[0]} is {one}"]
    shown = ", ".join(map(str, lines[:MAX_LISTED]))
    ellipsis = " …" if len(lines) > MAX_LISTED else ""
    return [f"{len(lines)} {word}s are {many} ({shown}{ellipsis})"]
