"""Measurement files as tables: CSV and Parquet -> named columns, cells as they stand; refusals say file, line and remedy."""
from __future__ import annotations

import csv
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..words.errors import DataError
from ..words.text import unreadable

CHUNK = 50_000
Table = dict[str, "NDArray[Any]"]


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


def _read_csv(path: Path) -> Table:
    chunks = _rows(path)
    header = next(chunks)[0]
    distinct(header, path)
    parts: list[list[NDArray[Any]]] = [[np.array(column, dtype=object) for column in zip(*chunk, strict=True)]
                                       for chunk in chunks]
    return {name: np.concatenate([part[k] for part in parts]) if parts else np.zeros(0, object)
            for k, name in enumerate(header)}


def _read_parquet(path: Path, group: int | None = None) -> Table:
    """All of a file, or one of its row groups."""
    import pyarrow as pa
    with _parquet(path) as file:
        names = file.schema_arrow.names
        distinct(names, path)
        table = file.read(use_threads=False) if group is None else file.read_row_group(group, use_threads=False)
        if not names:
            raise DataError("no columns.", file=path.name, remedy="A row per measured point, with named columns, is expected.")
        nested = [name for name in names if pa.types.is_nested(table.schema.field(name).type)]     # no number, no text
        return {name: np.full(len(table), "(nested)", object) if name in nested else table.column(name).to_numpy()
                for name in names}


@contextmanager
def _parquet(path: Path) -> Iterator[Any]:
    """A Parquet file; raises DataError where it, or what is read of it, is none."""
    import pyarrow.lib
    import pyarrow.parquet as pq
    _there(path)
    try:
        with pq.ParquetFile(path) as file:
            yield file
    except (OSError, ValueError, TypeError, NotImplementedError, MemoryError, OverflowError, pyarrow.lib.ArrowException):
        raise DataError("not a readable Parquet file.", file=path.name, remedy="Write it anew, or give a CSV.") from None


def distinct(header: Sequence[str], path: Path) -> None:
    """Refuses a name that stands twice."""
    for name in header:
        if list(header).count(name) > 1:
            raise DataError("the name stands twice in the header.", file=path.name, line=1, column=name or "(no name)",
                            remedy="Column names must differ.")


def read_table(path: Path, group: int | None = None) -> Table:
    """The columns of a CSV or Parquet file; `group`: one row group of a Parquet file alone. Raises DataError."""
    return _read_parquet(path, group) if path.suffix.lower() in (".parquet", ".pq") else _read_csv(path)


def row_groups(path: Path) -> tuple[int, ...]:
    """Rows of every row group of a Parquet file; each can be read alone. Raises DataError."""
    with _parquet(path) as file:
        return tuple(int(file.metadata.row_group(k).num_rows) for k in range(file.metadata.num_row_groups))
