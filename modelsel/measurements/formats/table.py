"""Named columns from a text table, a spreadsheet, a Parquet file or a DataFrame: every refusal says
its place."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias, Union

import numpy as np
from numpy.typing import NDArray

from ..._arguments import name_type
from ..._files import PARQUET_SUFFIXES
from ..._foreign_files import describe_foreign
from ...exceptions import DataError, find_nearest, list_known, list_within, suggest
from ...notices import Note
from .row_places import Where
from .spreadsheet import SPREADSHEET_SUFFIXES, load_spreadsheet
from .stated_units import list_position_units, name_unit
from .summary_rows import drop_summary_rows
from .table_layout import is_blank_row
from .text_table import check_file, load_text_table

if TYPE_CHECKING:
    import pandas as pd
    import pyarrow as pa

Columns = Mapping[str, "NDArray[Any]"]
Source: TypeAlias = Union[str, "os.PathLike[str]", "pd.DataFrame", "Table"]


@dataclass(frozen=True)
class Table:
    """Columns by name, all of one length, and where they come from; `units`: what a row of units
    says below a name; `notes`: what is unusual about the file; `length_unit`: the unit of lengths
    that a comment says, and its line."""

    columns: Columns
    where: Where
    units: Mapping[str, str] = field(default_factory=dict)
    notes: tuple[Note, ...] = ()
    length_unit: tuple[str, int] | None = None

    def __contains__(self, name: object) -> bool:
        return name in self.columns

    def __len__(self) -> int:
        return len(next(iter(self.columns.values()), ()))

    def require_rows(self, each: str) -> None:
        """Refuse a table without rows; `each`: what a row of it is. Raises DataError."""
        if not len(self):
            raise self.where.refuse("a header, but no rows.", remedy=f"Each {each} is a row.")


@dataclass(frozen=True)
class DataFile(os.PathLike[str]):
    """A file and what its user says of it: the sheet of a spreadsheet, the decimal mark where the
    numbers leave it open, whether it may have no header."""

    path: Path
    sheet: str | None = None
    decimal: str | None = None
    headerless: bool = False

    def __fspath__(self) -> str:
        return str(self.path)


def load_table(source: Source, group: int | None = None) -> Table:
    """Load a text table, a spreadsheet, a Parquet file (`group`: one row group of it alone) or a
    DataFrame; a table is returned as it is. Raises DataError."""
    if isinstance(source, (str, os.PathLike)):
        path = Path(source)
        if path.suffix.lower() in PARQUET_SUFFIXES:
            return _load_parquet(path, group)
        file = source if isinstance(source, DataFile) else DataFile(path)
        return _load_grid(file)
    if isinstance(source, Table):
        return source
    import pandas as pd

    if not isinstance(source, pd.DataFrame):
        raise DataError(f"measurements: {describe_no_frame(source)}.")
    return _load_frame(source, Where(""))


def describe_no_frame(value: Any) -> str:
    """Describe what is given in the place of measurements, and is none, without a full stop."""
    found = name_type(value)
    if isinstance(value, (list, np.ndarray)):
        found = "a list or an array; pd.DataFrame(values, columns=names) makes a DataFrame of one"
    elif hasattr(value, "to_pandas"):
        found = f"{found}; give its .to_pandas()"
    return f"expected a file or a pandas DataFrame, found {found}"


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
    if isinstance(source, Table):
        import pandas as pd

        source = pd.DataFrame(dict(source.columns))
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
    # the frame is its owner's to change
    copied = column.to_numpy(copy=True)
    return np.asarray(copied)


def _load_grid(file: DataFile) -> Table:
    """Load a text table or a spreadsheet, without columns that have neither name nor cells; a note
    says what is unusual about the file."""
    path = Path(file)
    foreign = describe_foreign(path)
    if foreign is not None:
        what, remedy = foreign
        raise DataError(what, file=path.name, remedy=remedy)
    is_spreadsheet = path.suffix.lower() in SPREADSHEET_SUFFIXES
    if file.sheet is not None and not is_spreadsheet:
        raise DataError(
            f'it has no sheets; "{file.sheet}" would be one of a spreadsheet.',
            file=path.name,
            remedy=f"Leave sheet out, or give a spreadsheet: {', '.join(SPREADSHEET_SUFFIXES)}.",
        )
    if is_spreadsheet:
        grid = load_spreadsheet(path, file.sheet, file.decimal)
    else:
        grid = load_text_table(path, file.decimal, file.headerless)
    grid = drop_summary_rows(grid)
    names = [name.strip() for name in grid.names]
    kept = [k for k, name in enumerate(names) if name or not is_blank_row(grid.columns[k].tolist())]
    _check_distinct([names[k] for k in kept], grid.where)
    notes = []
    if grid.said:
        sentence = f"{path.name} is read as it is: {', '.join(grid.said)}."
        notes.append(Note("file-format", sentence))
    columns = {names[k]: grid.columns[k] for k in kept}
    return apply_stated_unit(Table(columns, grid.where, grid.units, tuple(notes), grid.length_unit))


def apply_stated_unit(table: Table) -> Table:
    """Give the positions that name no unit the one that a comment of their file says, with a note.
    Raises DataError for a position that names another."""
    if table.length_unit is None:
        return table
    unit, line = table.length_unit
    units = list_position_units(table.columns, table.units, unit, line, table.where)
    stated = [f'"{name}"' for name in units if name not in table.units]
    if not stated:
        return table
    sentence = f"{', '.join(stated)} are in {name_unit(unit)}, as the comment on line {line} says."
    note = Note("file-format", f"{table.where.file}: {sentence}")
    return replace(table, units=units, notes=(*table.notes, note))


def _load_parquet(path: Path, group: int | None) -> Table:
    """Load all of a file, or one of its row groups."""
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
        columns = {name: _load_arrow_column(table.column(name)) for name in names}
        return Table(columns, where)


def _load_arrow_column(column: pa.ChunkedArray) -> NDArray[Any]:
    """Load a column; one that holds neither numbers nor text nor times has no cell that is read."""
    import pyarrow as pa

    if pa.types.is_nested(column.type):
        return np.full(len(column), "(nested)", object)
    if pa.types.is_temporal(column.type):
        return _load_series(column.to_pandas())
    return np.asarray(column.to_numpy())


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

    check_file(path)
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
        if not name and list(header).count(name) > 1:
            raise where.refuse(
                "several columns have no name in the header.",
                remedy="Write a name above each of them, in one row just above the numbers.",
            )
        if list(header).count(name) > 1:
            raise where.refuse(
                "the name appears twice in the header.",
                column=name,
                remedy="Column names must differ.",
            )


def rename_columns(table: Table, columns: Mapping[str, str]) -> Table:
    """Rename a table's columns to the contract's names; `columns` maps these to its own. Raises
    DataError."""
    _refuse_absent_mapped(table, columns)
    new = {given: wanted for wanted, given in columns.items()}
    kept = [name for name in table.columns if name in new or name not in columns]
    _check_distinct([new.get(name, name) for name in kept], table.where)
    renamed = {new.get(name, name): table.columns[name] for name in kept}
    return replace(table, columns=renamed, where=replace(table.where, names=dict(columns)))


def _refuse_absent_mapped(table: Table, columns: Mapping[str, str]) -> None:
    """Refuse a mapping (contract name -> name in the table) of columns that the table lacks. Raises
    DataError."""
    absent = {wanted: given for wanted, given in columns.items() if given not in table}
    if not absent:
        return
    source = "file" if table.where.is_file else "DataFrame"
    names = list(table.columns)
    if len(absent) == 1:
        (wanted, given), *_ = absent.items()
        hint = suggest(given, names)
        raise table.where.refuse(
            f'column "{given}", given for {wanted}, is not in the {source}. {hint}'
        )
    pairs = []
    known = ""
    for wanted, given in absent.items():
        near = find_nearest(given, names)
        pair = f'"{given}", given for {wanted}'
        if near is None:
            known = list_known(names)
        else:
            pair += f' (did you mean "{near}"?)'
        pairs.append(pair)
    listed = list_within(pairs, "; ")
    raise table.where.refuse(f"columns are not in the {source}: {listed}. {known}".rstrip())
