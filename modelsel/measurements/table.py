"""Named columns from a CSV or Parquet file or a DataFrame: every refusal says its place."""

from __future__ import annotations

import csv
import hashlib
import os
import re
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias, Union

import numpy as np
from numpy.typing import NDArray

from .._text import find_read_problem
from ..exceptions import DataError, suggest

if TYPE_CHECKING:
    import pandas as pd

# rows of a CSV that are read together
CHUNK_ROWS = 50_000
LINE_BREAK = re.compile(r"\r\n|\r|\n")
PARQUET_SUFFIXES = (".parquet", ".pq")
# marks that separate the cells of files that are no CSV, and their names
OTHER_SEPARATORS = {";": "semicolons", "\t": "tabs", "|": "vertical bars", " ": "blanks"}
Columns = Mapping[str, "NDArray[Any]"]
Source: TypeAlias = Union[str, "os.PathLike[str]", "pd.DataFrame"]


@dataclass(frozen=True, eq=False)
class Where:
    """Where a table comes from and what its user calls its rows: a text file has `lines`, the
    header line 1; a DataFrame and a Parquet file have rows, counted from 0. `first`: the number of
    the table's first row, where it is a piece of a file; `at` (m,): the line of every row, where
    cells with line breaks in them put rows further down."""

    file: str = ""
    lines: bool = True
    first: int = 0
    at: Mapping[int, int] | NDArray[np.intp] | None = None

    @property
    def is_file(self) -> bool:
        """Whether it is a file."""
        return bool(self.file)

    @property
    def is_text(self) -> bool:
        """Whether it is a file of lines."""
        is_lines = self.lines
        return self.is_file and is_lines

    def number(self, row: int) -> int:
        """Number the 0-based `row` as the user does."""
        if self.at is not None:
            return int(self.at[row])
        first = self.first
        if self.is_text:
            first = 2
        return row + first

    def refuse(
        self, what: str, *, row: int | None = None, column: str | None = None, remedy: str = ""
    ) -> DataError:
        """Return the error to raise, with its place: 0-based `row`, without it the header's."""
        number = None if row is None else self.number(row)
        if self.is_text:
            line = 1 if number is None else number
            return DataError(what, file=self.file, line=line, column=column, remedy=remedy)
        place = self.file or "DataFrame"
        return DataError(
            what,
            file=place,
            row=number,
            column=column,
            remedy=remedy,
        )

    def named(self, row: int) -> str:
        """Name a row: line 3, or row 1."""
        word = "row"
        if self.is_text:
            word = "line"
        return f"{word} {self.number(row)}"

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
        word = "line" if self.is_text else "row"
        if count != 1:
            word += "s"
        ellipsis = " …" if is_cut else ""
        base = "" if self.is_text else ", counted from 0"
        return f"{word} {shown}{ellipsis}{base}"

    def record(self, rows: NDArray[np.intp]) -> dict[str, Any]:
        """Return plain values that say of the `rows` how they are numbered; `where_from_record`
        reads them."""
        at = None if self.at is None else {str(row): self.number(row) for row in rows.tolist()}
        first = 2 if self.is_text else self.first
        return {"word": "line" if self.is_text else "row", "first": first, "at": at}

    def mapping(self, wanted: str, given: str) -> str:
        """Say how to map a column that has another name."""
        if self.is_file:
            return (
                f'in the study file: [measurements] columns = {{ {wanted} = "{given}" }} (for a command '
                f"without a study file: --column {wanted}={given})"
            )
        return (
            f'by columns={{"{wanted}": "{given}"}} (for a Study: measurements={{"frame": …, '
            '"columns": …})'
        )


@dataclass(frozen=True)
class Table:
    """Columns by name, all of one length, and where they come from."""

    columns: Columns
    where: Where

    def __contains__(self, name: object) -> bool:
        return name in self.columns

    def __len__(self) -> int:
        return len(next(iter(self.columns.values()), ()))


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
    return Where("the file", is_text, first, at)


def load_table(source: Source, group: int | None = None) -> Table:
    """Load a CSV or Parquet file (`group`: one row group of it alone) or a DataFrame. Raises
    DataError."""
    if isinstance(source, (str, os.PathLike)):
        path = Path(source)
        if path.suffix.lower() in PARQUET_SUFFIXES:
            return _load_parquet(path, group)
        return _load_csv(path)
    import pandas as pd

    if not isinstance(source, pd.DataFrame):
        raise DataError(
            f"measurements are a file's path or a pandas DataFrame, found {type(source).__name__}."
        )
    return _load_frame(source, Where(""))


def hash_source(source: Source) -> str:
    """Compute the SHA-256 of a file's bytes; of a DataFrame, of the CSV file that
    `to_csv(index=False)` would write. Raises DataError."""
    if isinstance(source, (str, os.PathLike)):
        try:
            with Path(source).open("rb") as file:
                return hashlib.file_digest(file, "sha256").hexdigest()
        except OSError as error:
            raise DataError(
                f"cannot be read any more: {error.strerror}.",
                file=Path(source).name,
                remedy="Run again when it is there.",
            ) from None
    text = source.to_csv(index=False, lineterminator="\n")
    return hashlib.sha256(text.encode("utf-8", "surrogatepass")).hexdigest()


def _load_frame(frame: pd.DataFrame, where: Where) -> Table:
    """Load cells as a file would have them: numbers as numbers, what is missing as nan or None. The
    index is not looked at."""
    strange = [name for name in frame.columns if not isinstance(name, str)]
    if strange:
        raise where.refuse(
            f"a column is called {strange[0]!r}, which is not text.",
            remedy="Column names are words: x_mm.",
        )
    names = [name.strip() for name in frame.columns]
    _check_distinct(names, where)
    columns = {}
    for k, name in enumerate(names):
        columns[name] = _load_series(frame.iloc[:, k])
    return Table(columns, where)


def _load_series(column: pd.Series[Any]) -> NDArray[Any]:
    if column.dtype.kind not in "fiub":
        cells = column.to_numpy(dtype=object, copy=True)
        is_missing = column.isna().to_numpy()
        cells[is_missing] = None
        return np.asarray(cells)
    if column.hasnans:
        numbers = column.to_numpy(dtype=float, na_value=np.nan)
        return np.asarray(numbers)
    return np.asarray(column.to_numpy())


def _read_csv_chunks(path: Path) -> Iterator[tuple[list[list[str]], NDArray[np.intp] | None]]:
    """Read chunks of CSV rows, the header first as a chunk of its own, and the lines they begin on
    where some have several. Raises DataError for ragged rows with their line."""
    _check_file(path)
    try:
        with path.open(newline="", encoding="utf-8-sig") as file:
            reader = csv.reader(file)
            header = _read_header(reader, path)
            yield [header], None
            line = reader.line_num + 1
            plain = line == 2  # so far a row was a line
            while chunk := list(islice(reader, CHUNK_ROWS)):
                plain = plain and reader.line_num == line + len(chunk) - 1
                starts = np.arange(line, line + len(chunk)) if plain else _find_starts(chunk, line)
                line = reader.line_num + 1
                rows = _check_rows(chunk, starts, len(header), path)
                if rows:
                    yield rows, None if plain else starts[: len(rows)]
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        reason = getattr(error, "strerror", None)
        if not reason:
            reason = "it is not UTF-8 text" if isinstance(error, ValueError) else str(error)
        raise DataError(
            f"the file cannot be read: {reason}.", file=path.name, remedy="Save it as CSV in UTF-8."
        ) from None


def _read_header(reader: Iterator[list[str]], path: Path) -> list[str]:
    header = next(reader, None)
    if not header or "\0" in "".join(header):
        raise DataError(
            "the file is empty or not text.",
            file=path.name,
            remedy="A CSV with a header line and a row per measured point is expected.",
        )
    _check_separator(header, path)
    return [name.strip() for name in header]


def _check_rows(
    chunk: list[list[str]], starts: NDArray[np.intp], width: int, path: Path
) -> list[list[str]]:
    """Return a chunk without empty lines at its end. Raises DataError for a row of another
    width."""
    for number, row in enumerate(chunk):
        if len(row) == width:
            continue
        if not any(chunk[number:]):
            return chunk[:number]
        remedy = "Every row needs as many cells as the header."
        if len(row) > width:
            remedy += " Numbers need a decimal point: a comma separates cells."
        raise DataError(
            f"{len(row)} cells, but the header has {width}.",
            file=path.name,
            line=int(starts[number]),
            remedy=remedy,
        )
    return chunk


def _find_starts(chunk: list[list[str]], line: int) -> NDArray[np.intp]:
    """Find the lines (m,) on which rows begin, the first on `line`: a cell between quotes may have
    several."""
    spans = [1 + sum(len(LINE_BREAK.findall(cell)) for cell in row) for row in chunk]
    return np.asarray(line + np.cumsum([0, *spans[:-1]]), dtype=np.intp)


def _check_file(path: Path) -> None:
    """Refuse what is not a file."""
    if (why := find_read_problem(path)) is not None:
        raise DataError(
            f"{why}.",
            file=path.name,
            remedy="Put it beside the study file, or set MODELSEL_DATA to the folder that "
            "holds it.",
        )


def _check_separator(header: Sequence[str], path: Path) -> None:
    """Refuse a header in one cell that other marks than commas separate."""
    for mark, name in OTHER_SEPARATORS.items():
        if len(header) == 1 and mark in header[0].strip():
            raise DataError(
                f"its cells are separated by {name}; a CSV with commas is expected.",
                file=path.name,
                line=1,
                remedy="Save it with commas between the cells and points in the numbers (1.5, not 1,5).",
            )


def _load_csv(path: Path) -> Table:
    chunks = _read_csv_chunks(path)
    header = next(chunks)[0][0]
    _check_distinct(header, Where(path.name))
    parts: list[list[NDArray[Any]]] = []
    starts: list[NDArray[np.intp]] = []
    plain = True
    for chunk, at in chunks:
        first = 2 + sum(len(some) for some in starts)
        starts.append(np.arange(first, first + len(chunk)) if at is None else at)
        plain = plain and at is None
        parts.append([np.array(column, dtype=object) for column in zip(*chunk, strict=True)])
    where = Where(path.name, at=None if plain else np.concatenate(starts))
    return Table(
        {
            name: np.concatenate([part[k] for part in parts]) if parts else np.zeros(0, object)
            for k, name in enumerate(header)
        },
        where,
    )


def _load_parquet(path: Path, group: int | None) -> Table:
    """Load all of a file, or one of its row groups."""
    import pyarrow as pa

    with _open_parquet(path) as file:
        names = file.schema_arrow.names
        where = Where(
            path.name,
            lines=False,
            first=sum(file.metadata.row_group(k).num_rows for k in range(group or 0)),
        )
        _check_distinct(names, where)
        table = (
            file.read(use_threads=False)
            if group is None
            else file.read_row_group(group, use_threads=False)
        )
        if not names:
            raise DataError(
                "no columns.",
                file=path.name,
                remedy="A row per measured point, with named columns, is expected.",
            )
        nested = [
            name for name in names if pa.types.is_nested(table.schema.field(name).type)
        ]  # no number, no text
        return Table(
            {
                name: np.full(len(table), "(nested)", object)
                if name in nested
                else table.column(name).to_numpy()
                for name in names
            },
            where,
        )


def parquet_errors() -> tuple[type[Exception], ...]:
    """List what pyarrow raises of a file that is no Parquet file, or a damaged one."""
    import pyarrow.lib

    return (
        OSError,
        ValueError,
        TypeError,
        NotImplementedError,
        MemoryError,
        OverflowError,
        pyarrow.lib.ArrowException,
    )


@contextmanager
def _open_parquet(path: Path) -> Iterator[Any]:
    """Open a Parquet file; raises DataError where it, or what is read of it, is none."""
    import pyarrow.parquet as pq

    _check_file(path)
    try:
        with pq.ParquetFile(path) as file:
            yield file
    except parquet_errors():
        raise DataError(
            "not a readable Parquet file.", file=path.name, remedy="Write it anew, or give a CSV."
        ) from None


def count_row_groups(path: Path) -> tuple[int, ...]:
    """Count the rows of every row group of a Parquet file; each can be read alone. Raises
    DataError."""
    with _open_parquet(path) as file:
        return tuple(
            int(file.metadata.row_group(k).num_rows) for k in range(file.metadata.num_row_groups)
        )


def _check_distinct(header: Sequence[str], where: Where) -> None:
    for name in header:
        if list(header).count(name) > 1:
            raise where.refuse(
                "the name stands twice in the header.",
                column=name or "(no name)",
                remedy="Column names must differ.",
            )


def rename_columns(table: Table, columns: Mapping[str, str]) -> Table:
    """Rename a table's columns to the contract's names; `columns` maps these to its own. Raises
    DataError."""
    for wanted, given in columns.items():
        if given not in table:
            raise table.where.refuse(
                f'the study maps {wanted} to "{given}", which is not in the '
                f"{'file' if table.where.is_file else 'DataFrame'}. {suggest(given, table.columns)}"
            )
    new = {given: wanted for wanted, given in columns.items()}
    kept = [name for name in table.columns if name in new or name not in columns]
    _check_distinct([new.get(name, name) for name in kept], table.where)
    return Table({new.get(name, name): table.columns[name] for name in kept}, table.where)
