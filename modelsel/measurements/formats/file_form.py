"""How a study reads its measurements file: what a later file of the same form is read by."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from .spreadsheet import SPREADSHEET_SUFFIXES
from .table import DataFile, Table


@dataclass(frozen=True)
class FileForm:
    """A file's `columns` (contract name -> name in the file), the `sheet` of a spreadsheet, the
    `decimal` mark where the numbers leave it open, and whether it has no header; `joined`: contract
    name -> name in the two files that were joined into it."""

    columns: Mapping[str, str] = field(default_factory=dict)
    sheet: str | None = None
    decimal: str | None = None
    headerless: bool = False
    joined: Mapping[str, str] = field(default_factory=dict)

    @property
    def is_plain(self) -> bool:
        """Whether the file has the contract's own form."""
        return self == FileForm()

    def open(self, path: Path, sheet: str | None, decimal: str | None) -> DataFile:
        """Return a file of this form; a `sheet` or `decimal` that is given goes first."""
        if path.suffix.lower() in SPREADSHEET_SUFFIXES:
            sheet = sheet or self.sheet
        return DataFile(path, sheet, decimal or self.decimal, self.headerless)

    def map_columns(self, table: Table, given: Mapping[str, str]) -> dict[str, str]:
        """Return the mapping of a table's columns: `given`, then those of the form that the table
        has under the study's names, not under the contract's."""
        taken = set(given.values())
        columns = dict(given)
        for wanted, name in [*self.columns.items(), *self.joined.items()]:
            if wanted in columns or wanted in table:
                continue
            if name in taken:
                continue
            if name in table:
                columns[wanted] = name
        return columns

    def read_columns(self, table: Table, given: Mapping[str, str]) -> tuple[dict[str, str], str]:
        """Return the mapping of a table's columns, and a sentence on those that are read as the
        study's file has them; an empty one where there are none."""
        columns = self.map_columns(table, given)
        own = [f'"{name}" as {wanted}' for wanted, name in columns.items() if wanted not in given]
        if not own:
            return columns, ""
        return columns, f"Columns are read as in the study's file: {', '.join(own)}."
