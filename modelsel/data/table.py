"""Named columns from a CSV or Parquet file or a DataFrame: every refusal says its place."""
from __future__ import annotations

import csv
import hashlib
import os
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias, Union

import numpy as np
from numpy.typing import NDArray

from ..words.errors import DataError, suggest
from ..words.text import unreadable

if TYPE_CHECKING:
    import pandas as pd

CHUNK = 50_000
Columns = Mapping[str, "NDArray[Any]"]
Source: TypeAlias = Union[str, "os.PathLike[str]", "pd.DataFrame"]


@dataclass(frozen=True)
class Where:
    """Where a table comes from, in the words of its user: a file has lines, the header line 1; a DataFrame has rows from 0."""

    file: str

    @property
    def is_file(self) -> bool:
        """Whether it is a file."""
        return bool(self.file)

    def refuse(self, what: str, *, row: int | None = None, column: str | None = None, remedy: str = "") -> DataError:
        """The error to raise, with its place: 0-based `row`, without it the header's."""
        if not self.is_file:
            return DataError(what, file="DataFrame", row=row, column=column, remedy=remedy)
        return DataError(what, file=self.file, line=1 if row is None else row + 2, column=column, remedy=remedy)

    def named(self, row: int) -> str:
        """A row in words."""
        return f"line {row + 2}" if self.is_file else f"row {row}"

    def mapping(self, wanted: str, given: str) -> str:
        """How to say that a column has another name."""
        return (f'in the study file: [measurements] columns = {{ {wanted} = "{given}" }} (of a command without one: '
                f'--column {wanted}={given})' if self.is_file else
                f'by columns={{"{wanted}": "{given}"}} (of a Study: measurements={{"frame": …, "columns": …}})')


@dataclass(frozen=True)
class Table:
    """Columns by name, all of one length, and where they come from."""

    columns: Columns
    where: Where

    def __contains__(self, name: object) -> bool:
        return name in self.columns

    def __len__(self) -> int:
        return len(next(iter(self.columns.values()), ()))


def read_table(source: Source, group: int | None = None) -> Table:
    """A CSV or Parquet file (`group`: one row group of it alone) or a DataFrame. Raises DataError."""
    if isinstance(source, (str, os.PathLike)):
        path = Path(source)
        if path.suffix.lower() in (".parquet", ".pq"):
            return _parquet(path, Where(path.name), group)
        return _csv(path, Where(path.name))
    import pandas as pd
    if not isinstance(source, pd.DataFrame):
        raise DataError(f"measurements are a file's path or a pandas DataFrame, found {type(source).__name__}.")
    return _frame(source, Where(""))


def digest(source: Source) -> str:
    """SHA-256 of a file's bytes; of a DataFrame, of the CSV file that `to_csv(index=False)` would write. Raises DataError."""
    if isinstance(source, (str, os.PathLike)):
        try:
            with Path(source).open("rb") as file:
                return hashlib.file_digest(file, "sha256").hexdigest()
        except OSError as error:
            raise DataError(f"cannot be read any more: {error.strerror}.", file=Path(source).name,
                            remedy="Run again when it is there.") from None
    return hashlib.sha256(source.to_csv(index=False, lineterminator="\n").encode()).hexdigest()


def _frame(frame: pd.DataFrame, where: Where) -> Table:
    """Cells as a file would have them: numbers as numbers, what is missing as nan or None. The index is not looked at."""
    strange = [name for name in frame.columns if not isinstance(name, str)]
    if strange:
        raise where.refuse(f"a column is called {strange[0]!r}, which is not text.", remedy="Column names are words: x_mm.")
    names = [name.strip() for name in frame.columns]
    _distinct(names, where)
    out: dict[str, NDArray[Any]] = {}
    for k, name in enumerate(names):
        column = frame.iloc[:, k]
        if column.dtype.kind in "fiub":
            out[name] = column.to_numpy(dtype=float, na_value=np.nan) if column.hasnans else column.to_numpy()
        else:
            cells = column.to_numpy(dtype=object, copy=True)
            cells[column.isna().to_numpy()] = None
            out[name] = cells
    return Table(out, where)


def _rows(path: Path) -> Iterator[list[list[str]]]:
    """Chunks of CSV rows, the header first as a chunk of its own; refuses ragged rows with their line."""
    _there(path)
    try:
        with path.open(newline="", encoding="utf-8-sig") as file:
            reader = csv.reader(file)
            header = next(reader, None)
            if not header or "\0" in "".join(header):
                raise DataError("the file is empty or not text.", file=path.name,
                                remedy="A CSV with a header line and a row per measured point is expected.")
            _separated(header, path)
            yield [[name.strip() for name in header]]
            line = 2
            while chunk := list(islice(reader, CHUNK)):
                for k, row in enumerate(chunk):
                    if len(row) != len(header):
                        if not row and all(not later for later in chunk[k:]):
                            chunk = chunk[:k]
                            break
                        comma = " Numbers need a decimal point: a comma parts cells." if len(row) > len(header) else ""
                        raise DataError(f"{len(row)} cells, but the header has {len(header)}.", file=path.name,
                                        line=line + k, remedy=f"Every row needs as many cells as the header.{comma}")
                if chunk:
                    yield chunk
                line += len(chunk)
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        reason = getattr(error, "strerror", None) or ("it is not UTF-8 text" if isinstance(error, ValueError) else str(error))
        raise DataError(f"the file cannot be read: {reason}.", file=path.name, remedy="Save it as CSV in UTF-8.") from None


def _there(path: Path) -> None:
    """Refuses what is not a file."""
    if (why := unreadable(path)) is not None:
        raise DataError(f"{why}.", file=path.name, remedy="Put it beside the study file, or set MODELSEL_DATA to the folder that "
                        "holds it.")


def _separated(header: Sequence[str], path: Path) -> None:
    """Refuses a header in one cell that other marks than commas part."""
    for mark, word in ((";", "semicolons"), ("\t", "tabs"), ("|", "bars"), (" ", "blanks")):
        if len(header) == 1 and mark in header[0].strip():
            raise DataError(f"{word} part its cells; a CSV with commas is expected.", file=path.name, line=1,
                            remedy="Save it with commas between the cells and points in the numbers (1.5, not 1,5).")


def _csv(path: Path, where: Where) -> Table:
    chunks = _rows(path)
    header = next(chunks)[0]
    _distinct(header, where)
    parts: list[list[NDArray[Any]]] = [[np.array(column, dtype=object) for column in zip(*chunk, strict=True)]
                                       for chunk in chunks]
    return Table({name: np.concatenate([part[k] for part in parts]) if parts else np.zeros(0, object)
                  for k, name in enumerate(header)}, where)


def _parquet(path: Path, where: Where, group: int | None) -> Table:
    """All of a file, or one of its row groups."""
    import pyarrow as pa
    with _opened(path) as file:
        names = file.schema_arrow.names
        _distinct(names, where)
        table = file.read(use_threads=False) if group is None else file.read_row_group(group, use_threads=False)
        if not names:
            raise DataError("no columns.", file=path.name, remedy="A row per measured point, with named columns, is expected.")
        nested = [name for name in names if pa.types.is_nested(table.schema.field(name).type)]     # no number, no text
        return Table({name: np.full(len(table), "(nested)", object) if name in nested else table.column(name).to_numpy()
                      for name in names}, where)


def damaged() -> tuple[type[Exception], ...]:
    """What pyarrow raises of a file that is no Parquet file, or a damaged one."""
    import pyarrow.lib
    return OSError, ValueError, TypeError, NotImplementedError, MemoryError, OverflowError, pyarrow.lib.ArrowException


@contextmanager
def _opened(path: Path) -> Iterator[Any]:
    """A Parquet file; raises DataError where it, or what is read of it, is none."""
    import pyarrow.parquet as pq
    _there(path)
    try:
        with pq.ParquetFile(path) as file:
            yield file
    except damaged():
        raise DataError("not a readable Parquet file.", file=path.name, remedy="Write it anew, or give a CSV.") from None


def row_groups(path: Path) -> tuple[int, ...]:
    """Rows of every row group of a Parquet file; each can be read alone. Raises DataError."""
    with _opened(path) as file:
        return tuple(int(file.metadata.row_group(k).num_rows) for k in range(file.metadata.num_row_groups))


def _distinct(header: Sequence[str], where: Where) -> None:
    for name in header:
        if list(header).count(name) > 1:
            raise where.refuse("the name stands twice in the header.", column=name or "(no name)",
                               remedy="Column names must differ.")


def renamed(table: Table, columns: Mapping[str, str]) -> Table:
    """A table under the contract's names; `columns` maps these to its own. Raises DataError."""
    for wanted, given in columns.items():
        if given not in table:
            raise table.where.refuse(f'the study maps {wanted} to "{given}", which is not in the '
                                     f'{"file" if table.where.is_file else "DataFrame"}. {suggest(given, table.columns)}')
    new = {given: wanted for wanted, given in columns.items()}
    kept = [name for name in table.columns if name in new or name not in columns]
    _distinct([new.get(name, name) for name in kept], table.where)
    return Table({new.get(name, name): table.columns[name] for name in kept}, table.where)
