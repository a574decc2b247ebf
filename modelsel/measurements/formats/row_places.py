"""Where the rows of a table are: the line, row or record that a message names."""

from __future__ import annotations

import shlex
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...exceptions import MAX_LISTED_LETTERS, DataError


@dataclass(frozen=True, eq=False)
class Where:
    """Where a table comes from and what its user calls its rows: a text file has `lines`, the
    header line 1 unless `header` says another; the sheet of a spreadsheet has rows, numbered as
    the spreadsheet does; a DataFrame and a Parquet file have rows, counted from 0. `first`: the
    number of the table's first row, where it is a piece of a file; `at` (m,): the line or sheet
    row of every row, where rows do not follow one another from the second line on; `names`: what
    the user calls columns that are renamed; `labels`: what the file calls its rows; `parts`: of
    rows that were joined from two files, where the cells of the other file's columns stand."""

    file: str = ""
    lines: bool = True
    first: int = 0
    at: Mapping[int, int] | NDArray[np.intp] | None = None
    header: int = 1
    sheet: str = ""
    names: Mapping[str, str] = field(default_factory=dict)
    labels: Mapping[int, str] | NDArray[Any] | None = None
    parts: Mapping[str, Where] = field(default_factory=dict)

    @property
    def is_file(self) -> bool:
        """Whether it is a file."""
        return bool(self.file)

    @property
    def is_text(self) -> bool:
        """Whether it is a file of lines."""
        has_lines = self.lines
        is_sheet = bool(self.sheet)
        return self.is_file and has_lines and not is_sheet

    @property
    def is_counted_from_zero(self) -> bool:
        """Whether its first row is row 0."""
        is_sheet = bool(self.sheet)
        is_numbered = self.is_text or is_sheet
        return not is_numbered

    def number(self, row: int) -> int:
        """Number the 0-based `row` as the user does."""
        if self.at is not None:
            return int(self.at[row]) if len(self.at) else self.header + 1
        first = self.first
        if self.is_text:
            first = 2
        return row + first

    def take(self, rows: NDArray[np.intp]) -> Where:
        """Return where some rows are, each with its own number."""
        numbers = [self.number(row) for row in rows.tolist()]
        at = np.array(numbers, dtype=np.intp)
        parts = {}
        for name, part in self.parts.items():
            parts[name] = part.take(rows)
        return replace(self, at=at, parts=parts)

    def refuse(
        self, what: str, *, row: int | None = None, column: str | None = None, remedy: str = ""
    ) -> DataError:
        """Return the error to raise, with its place: 0-based `row`, without it the header's."""
        if column is not None:
            column = self.names.get(column, column)
            part = self.parts.get(column)
            if part is not None:
                return part.refuse(what, row=row, column=column, remedy=remedy)
        number = None if row is None else self.number(row)
        if self.is_text:
            line = self.header if number is None else number
            return DataError(what, file=self.file, line=line, column=column, remedy=remedy)
        place = self.file or "DataFrame"
        if self.sheet:
            place = f'{self.file}, sheet "{self.sheet}"'
            number = self.header if number is None else number
        return DataError(what, file=place, row=number, column=column, remedy=remedy)

    def name_row(self, row: int) -> str:
        """Name a row: line 3, or row 1."""
        return f"{self.name_row_alone(row)}{self._of_file}"

    def locate(self, row: int, column: str) -> str:
        """Name the file and the row of a cell: points.csv, line 3."""
        own = self.names.get(column, column)
        where = self.parts.get(own, self)
        file = where.file or "DataFrame"
        place = where.name_row_alone(row)
        return f"{file}, {place}"

    def name_row_alone(self, row: int) -> str:
        """Name a row without its file."""
        number = self.number(row)
        return f"{self.word} {number}"

    @property
    def word(self) -> str:
        """What a row is called: line, or row."""
        return "line" if self.is_text else "row"

    def listed(self, rows: Sequence[int] | NDArray[np.intp], most: int = 10) -> str:
        """List the first so many rows: lines 3, 4, 9 … or rows 1, 2, 7 …, counted from 0."""
        return self._say_rows(
            ", ".join(str(self.number(int(row))) for row in rows[:most]),
            len(rows),
            len(rows) > most,
        )

    def spans(self, rows: NDArray[np.intp], most: int = 8) -> str:
        """List many rows, neighbours together: lines 12 to 40, 52, 60."""
        numbers = np.unique([self.number(int(row)) for row in rows])
        runs = np.split(numbers, np.flatnonzero(np.diff(numbers) > 1) + 1)
        words = [str(run[0]) if len(run) == 1 else f"{run[0]} to {run[-1]}" for run in runs[:most]]
        return self._say_rows(", ".join(words), len(numbers), len(runs) > most)

    def _say_rows(self, shown: str, count: int, is_cut: bool) -> str:
        word = self.word
        if count != 1:
            word += "s"
        ellipsis = " …" if is_cut else ""
        base = ", counted from 0" if self.is_counted_from_zero else ""
        return f"{word} {shown}{ellipsis}{base}{self._of_file}"

    @property
    def _of_file(self) -> str:
        """The file whose rows are numbered, where they were joined from several."""
        return f" of {self.file}" if self.parts else ""

    def label(self, rows: Sequence[int], most: int) -> str:
        """List what the file calls the first so many rows; empty where it has no names."""
        if self.labels is None or not rows:
            return ""
        names = [str(self.labels[row]).strip() for row in rows[:most]]
        ellipsis = " …" if len(rows) > most else ""
        return ", ".join(names) + ellipsis

    def record(self, rows: NDArray[np.intp], labelled: Sequence[int] = ()) -> dict[str, Any]:
        """Return plain values that say of the `rows` how they are numbered, and of those `labelled`
        what the file calls them; `where_from_record` reads them."""
        labels = None
        if self.labels is not None and len(labelled):
            labels = {str(row): str(self.labels[row]).strip() for row in labelled}
        at = None if self.at is None else {str(row): self.number(row) for row in rows.tolist()}
        first = 2 if self.is_text else self.first
        word = "sheet row" if self.sheet else "line" if self.is_text else "row"
        return {"word": word, "first": first, "at": at, "labels": labels}

    def mapping(self, wanted: str, given: str) -> str:
        """Say how to map a column that has another name."""
        columns = {wanted: given}
        return self.mapping_all(columns)

    def mapping_all(self, columns: Mapping[str, str]) -> str:
        """Say how to map columns that have other names: contract name -> their own."""
        if self.is_file:
            pairs = ", ".join(f'{wanted} = "{given}"' for wanted, given in columns.items())
            written = list(_write_options(columns))
            options = " ".join(written)
            if len(pairs) + len(options) > MAX_LISTED_LETTERS:
                options = f"{written[0]} and so on"
            return (
                f"in the study file: [measurements] columns = {{ {pairs} }} (for a command without a "
                f"study file: {options})"
            )
        pairs = ", ".join(f'"{wanted}": "{given}"' for wanted, given in columns.items())
        return f'by columns={{{pairs}}} (for a Study: measurements={{"frame": …, "columns": …}})'


def _write_options(columns: Mapping[str, str]) -> Iterator[str]:
    """Write a mapping of columns as options of a command."""
    for wanted, given in columns.items():
        pair = f"{wanted}={given}"
        yield f"--column {shlex.quote(pair)}"


def where_from_record(record: Mapping[str, Any] | None) -> Where:
    """Restore how rows are numbered from a record of it; without one, as lines of a text file."""
    if record is None:
        return Where("the file")
    at = record["at"]
    if at is not None:
        at = {int(row): number for row, number in at.items()}
    first = 0
    is_text = record["word"] == "line"
    if not is_text:
        first = record["first"]
    sheet = "the sheet" if record["word"] == "sheet row" else ""
    named = record.get("labels")
    labels = None
    if named is not None:
        labels = {int(row): label for row, label in named.items()}
    return Where("the file", is_text, first, at, sheet=sheet, labels=labels)
