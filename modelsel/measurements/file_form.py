"""How a study reads its measurements file: what a later file of the same form is read by."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from .spreadsheet import SPREADSHEET_SUFFIXES
from .table import DataFile, Table


@dataclass(frozen=True)
class FileForm:
    """A file's `columns` (contract name -> name in the file), the `sheet` of a spreadsheet, and the
    `decimal` mark where the numbers leave it open."""

    columns: Mapping[str, str] = field(default_factory=dict)
    sheet: str | None = None
    decimal: str | None = None

    @property
    def is_plain(self) -> bool:
        """Whether the file has the contract's own form."""
        return self == FileForm()

    def open(self, path: Path, sheet: str | None, decimal: str | None) -> DataFile:
        """Return a file of this form; a `sheet` or `decimal` that is given goes first."""
        if path.suffix.lower() in SPREADSHEET_SUFFIXES:
            sheet = sheet or self.sheet
        return DataFile(path, sheet, decimal or self.decimal)

    def map_columns(self, table: Table, given: Mapping[str, str]) -> dict[str, str]:
        """Return the mapping of a table's columns: `given`, then those of the form that the table
        has under the study's names, not under the contract's."""
        taken = set(given.values())
        columns = dict(given)
        for wanted, name in self.columns.items():
            is_open = wanted not in given and name not in taken and wanted not in table
            if is_open and name in table:
                columns[wanted] = name
        return columns
