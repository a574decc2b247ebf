"""Files that come after a study: of the form of its own, or two that are joined as its own were."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from ..calibration.calibration import Calibration
    from ..measurements.formats.table import DataFile, Table
    from ..measurements.measurements import Measurements
    from ._join_options import JointLog


OWN_DATA = (
    "these are the measurements that made the calibration: where the target was measured is taken "
    "for where it is wanted. Without their position columns it is wanted where the nominal robot has "
    "it."
)
OWN_FILE = (
    "These are the measurements that made the calibration, so they cannot contradict it: measure new "
    "configurations to learn whether it still holds."
)


@dataclass(frozen=True)
class LaterFiles:
    """A table, the mapping of its columns (contract name -> its own), what is said of how it is read,
    and the SHA-256 that the study has where it was made from the same files."""

    table: Table
    columns: Mapping[str, str]
    said: tuple[str, ...]
    sha256: str

    def is_own(self, c: Calibration) -> bool:
        """Whether the file is, byte for byte, that of the study which made a calibration."""
        own = c.provenance.get("data_sha256")
        return self.sha256 == own

    def note_own(self, c: Calibration, data: Measurements) -> list[str]:
        """Note that the measurements which made a calibration are given as targets."""
        return [OWN_DATA] if self.is_own(c) or count_own(c, data) else []

    def describe_own(self, c: Calibration, own: int, total: int) -> list[str]:
        """Say that `own` of `total` rows are measurements that made the calibration; where none
        are known, that the file is theirs."""
        from ..calibration.estimation_rows import describe_own_rows

        if own:
            return [describe_own_rows(c.estimation_rows, own, total)]
        return [OWN_FILE] if self.is_own(c) else []

    def matched(self) -> LaterFiles:
        """Return the rows that have a point; those of a log alone are no targets."""
        from ..measurements.quantities.missed_rows import take_rows

        table = self.table
        points = next(iter(table.where.parts.values()), None)
        if points is None:
            return self
        lines = [points.number(row) for row in range(len(table))]
        rows = np.flatnonzero(lines)
        matched = take_rows(table, rows)
        return replace(self, table=matched)


def count_own(c: Calibration, data: Measurements) -> int:
    """Count the rows that a calibration was estimated from."""
    from ..calibration.estimation_rows import count_own_rows

    return count_own_rows(c.estimation_rows, data, c.floor.coordinate_mm)


def load_later(
    c: Calibration, file: DataFile, log: JointLog | None, columns: Mapping[str, str]
) -> LaterFiles:
    """Load a file of the form of a study's, or points and readings in two. Raises DataError."""
    import hashlib

    from ..measurements.formats.table import DataFile, hash_source, load_table
    from ..measurements.recognition.headerless_columns import name_columns

    if log is None:
        is_joined = bool(c.form.joined)
        source = replace(file, headerless=file.headerless or is_joined)
        table = load_table(source)
        if is_joined:
            table = name_columns(table, c.robot.n)
        mapping, mapped = c.form.read_columns(table, columns)
        if is_joined:
            _refuse_points_alone(c, table, mapping)
        return LaterFiles(table, mapping, (mapped,) if mapped else (), hash_source(file))
    from ..study.drafts.joined_study import draft_joined_study, map_later_columns
    from ..study.drafts.study_folder import write_joined_table

    readings = DataFile(log.path, decimal=file.decimal)
    given = map_later_columns(file, readings, c.robot, c.form, columns)
    draft = draft_joined_study(
        file, readings, c.robot, given, log.way, log.max_gap, log.clock_offset
    ).choose_first()
    digest = hashlib.sha256(write_joined_table(draft.contract_table())).hexdigest()
    return LaterFiles(load_table(draft.source), draft.columns, draft.remarks, digest)


def _refuse_points_alone(c: Calibration, table: Table, mapping: Mapping[str, str]) -> None:
    """Refuse points without joint readings, of a study whose rows were joined; readings under other
    names are left to the reader, who proposes a mapping. Raises DataError."""
    from ..measurements.formats.table import rename_columns
    from ..measurements.quantities.numbered_joints import find_numbered_joints
    from ..measurements.recognition.column_guesses import guess_columns, list_missing_joints
    from ..measurements.recognition.grad_columns import JOINTS
    from ..robot.urdf import read_joint_names

    renamed = rename_columns(table, mapping)
    prismatic = c.robot.prismatic
    missing = list_missing_joints(renamed, prismatic)
    if len(missing) < c.robot.n or find_numbered_joints(renamed):
        return
    guesses = guess_columns(renamed, prismatic, read_joint_names(c.robot))
    if any(guess.readings for guess in guesses if guess.what == JOINTS):
        return
    raise table.where.refuse(
        "it holds points only; the study's rows were joined from points and joint readings in two "
        "files.",
        remedy="Give the file of joint readings, too: --joints LOG.",
    )
