"""A robot from a table of DH or MDH parameters, as people have it: a text table or a spreadsheet
with a row a joint."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from ..._typing import Array
from ...exceptions import DataError, StudyError, sentence_list
from ...measurements.formats.spreadsheet import SPREADSHEET_SUFFIXES
from ...measurements.formats.table import Table, load_table
from ...robot.dh import format_robot_table
from ...robot.files import read_robot, robot_from_table
from ...robot.kinematics import Robot
from .dh_cells import check_unit, find_angle_unit, find_length_unit, parse_cell
from .dh_limits import combine_limits
from .dh_variables import drop_remark_rows, read_variables

TABLE_SUFFIXES = (".csv", ".tsv", ".txt", *SPREADSHEET_SUFFIXES)
CONVENTIONS = {"standard": "standard DH", "modified": "modified DH (Craig)"}
CONVENTION_WORDS = {
    "standard": ("standard", "classic", "distal", "dh"),
    "modified": ("modified", "craig", "proximal", "mdh", "dhm"),
}
ANGLES, LENGTHS = ("theta", "alpha", "beta"), ("d", "a")
# what people call a column, once units, indices and signs are taken away
STEMS = {
    "theta": ("theta", "thetaoffset", "offset", "theta0", "q", "qoffset", "jointoffset", "rz"),
    "d": ("d", "tz", "linkoffset"),
    "a": ("a", "r", "tx", "linklength"),
    "alpha": ("alpha", "rx", "twist", "linktwist"),
    "beta": ("beta", "ry"),
    "kind": ("kind", "type", "jointtype"),
    "name": (
        "joint",
        "link",
        "name",
        "axis",
        "achse",
        "frame",
        "kinematics",
        "no",
        "nr",
        "i",
        "row",
    ),
    "convention": ("convention",),
    "sense": ("sense", "sign", "direction"),
    "low": ("min", "lower", "low", "qmin", "minlimit", "limitmin", "lowerlimit", "limitlower"),
    "high": ("max", "upper", "high", "qmax", "maxlimit", "limitmax", "upperlimit", "limitupper"),
}
MEANINGS = {word: key for key, words in STEMS.items() for word in words}
SPELLED = str.maketrans({"θ": "theta", "α": "alpha", "β": "beta", "−": "-", "–": "-"})
UNIT = re.compile(r"(?:[\s_/,-]+|\s*[\[(]\s*)(deg|degrees?|°|rad|radians?|mm|m)\s*[\])]?\s*$")
PREVIOUS = re.compile(r"[_({\s]*(?:[ijkn]\s*-\s*1|prev(?:ious)?)[)}\s]*")
# what a last row that is no joint is called; "bend" and "wheel" are joints
FLANGE = re.compile(r"(?i)flange|(?<![a-z])(tool|tcp|(ee|end([\s_-]*eff?ector)?)(?![a-z]))")
SLIDES = {"p", "prismatic", "linear", "slide", "translational", "1"}
TURNS = {"r", "revolute", "rotary", "rotational", "turn", "0", ""}
# mm, and the sine of an angle: axes that are nearer coincide
COINCIDENT = 1e-6


@dataclass(frozen=True)
class _Column:
    """What a name says: the key and the word for it, the unit where there is one, whether the row
    holds what comes before its joint."""

    key: str
    word: str
    unit: str | None = None
    is_previous: bool = False


@dataclass
class _Rows:
    """The rows of a table in mm and degrees, and how they were read."""

    values: dict[str, Array]
    slides: list[bool]
    names: list[str]
    senses: Array
    units: str
    stated: str | None
    limits: list[list[float]] | None = None
    unused: list[str] = field(default_factory=list)
    variables: str = ""

    @property
    def joints(self) -> int:
        """How many rows are joints: a last one called flange or tool is none."""
        return _count_joints(self.names)


def _count_joints(names: Sequence[str]) -> int:
    return len(names) - bool(FLANGE.search(names[-1]))


def is_robot_table(path: Path | str) -> bool:
    """Whether a file is a table of DH parameters, by its suffix."""
    return Path(path).suffix.lower() in TABLE_SUFFIXES


def read_any_robot(path: Path, base: str | None = None, tip: str | None = None) -> Robot:
    """Read a robot file of any kind, tables of DH parameters included. Raises StudyError."""
    if is_robot_table(path):
        return read_robot_table(path)[0]
    return read_robot(path, base, tip)


def read_robot_table(path: Path, convention: str | None = None) -> tuple[Robot, str, str]:
    """Read a robot from a table of DH parameters: (robot, its robot file's text, a sentence on how
    the table was read). `convention`: standard or modified, where the table leaves it open. Raises
    StudyError."""
    try:
        loaded = load_table(path)
        table, remarks = drop_remark_rows(loaded, _find_parameters(loaded))
        rows = _read_rows(table)
    except DataError as error:
        raise StudyError(f"the robot's table: {error}") from None
    word, reason = _find_convention(rows, path.name, convention)
    said = f"{CONVENTIONS[word]}, {reason}; {rows.units}; gravity along -z of its base"
    if rows.variables:
        said += f"; {rows.variables}"
    if rows.limits is not None:
        said += "; limits of the joints as the table has them"
    if rows.joints < len(rows.names):
        said += f'; the last row, "{rows.names[-1]}", is not a joint'
    if rows.unused:
        said += f"; not used: {', '.join(rows.unused)}"
    robot_file = _to_robot_file(rows, word, path.stem, f"{path.name}: {said}")
    robot = robot_from_table(robot_file, path.name)
    notes = [*(note.sentence for note in loaded.notes), *remarks]
    sentence = " ".join([*notes, f"{path.name} is read as {said}."])
    return robot, format_robot_table(robot_file), sentence


def _find_parameters(table: Table) -> list[str]:
    """Find the columns that hold parameters."""
    read = {name: _read_name(name, table.units.get(name)) for name in table.columns}
    parameters = (*ANGLES, *LENGTHS)
    return [name for name, column in read.items() if column and column.key in parameters]


def _read_rows(table: Table) -> _Rows:
    columns: dict[str, tuple[_Column, Sequence[Any]]] = {}
    unused = []
    for name, cells in table.columns.items():
        column = _read_name(name, table.units.get(name))
        if column is None:
            unused.append(f'"{name}"')
            continue
        columns[name] = (column, list(cells))
    missing = [key for key in ("a", "alpha", "d") if not _has(columns, key)]
    if missing:
        raise table.where.refuse(
            f"no column for {sentence_list(missing)} was found.",
            remedy="A table of DH parameters has columns theta, d, a, alpha, with units in their "
            "names or in a row below them: theta_deg, d_mm, a_mm, alpha_deg.",
        )
    table.require_rows("joint")
    count = len(table)
    values = {key: np.zeros(count) for key in (*ANGLES, *LENGTHS)}
    angle_unit, length_unit = _add_columns(table, columns, values)
    slides, senses = _read_slides(table, columns, count), _read_senses(table, columns, count)
    own = [(column.key, name, cells) for name, (column, cells) in columns.items()]
    variables = read_variables(table, own, slides)
    senses *= variables.signs
    names = _read_words(columns, "name", count)
    return _Rows(
        values,
        slides,
        names,
        senses,
        f"angles in {angle_unit}, lengths in {length_unit}",
        _read_stated(table, columns),
        limits=_read_limits(table, columns, slides[: _count_joints(names)], senses),
        unused=unused,
        variables=variables.describe(),
    )


def _has(columns: Mapping[str, tuple[_Column, Sequence[Any]]], key: str) -> bool:
    return any(column.key == key for column, _ in columns.values())


def _read_name(name: str, below: str | None) -> _Column | None:
    """Read a column's name, and what a row of units says below it; None where it is no
    parameter."""
    text = name.lower().translate(SPELLED).strip()
    unit = below
    match = UNIT.search(text)
    if match is not None:
        unit = match[1]
        text = text[: match.start()]
    is_previous = PREVIOUS.search(text) is not None
    stem = re.sub(r"[^a-z0-9]", "", PREVIOUS.sub("", text))
    word = stem if stem in MEANINGS else re.sub(r"[ijkn]$", "", stem)
    if word not in MEANINGS:
        return None
    return _Column(MEANINGS[word], word, _spell_unit(unit), is_previous)


def _spell_unit(unit: str | None) -> str | None:
    words = {"°": "degrees", "deg": "degrees", "degree": "degrees", "degrees": "degrees"}
    words |= {"rad": "radians", "radian": "radians", "radians": "radians", "mm": "mm", "m": "m"}
    return None if unit is None else words.get(unit.strip("[]() ").lower())


def _add_columns(
    table: Table, columns: Mapping[str, tuple[_Column, Sequence[Any]]], values: Mapping[str, Array]
) -> tuple[str, str]:
    """Add the columns to the values, in degrees and mm; return the units that they are in. Raises
    DataError for one that is not of the column's kind."""
    read: dict[str, tuple[_Column, Array, bool]] = {}
    for name, (column, cells) in columns.items():
        if column.key not in values:
            continue
        where, key = table.where, column.key
        check_unit(column.unit, key in ANGLES, where, name)
        parsed = [parse_cell(cell, where, row, name, key) for row, cell in enumerate(cells)]
        numbers = np.array([number for number, _ in parsed])
        read[name] = (column, numbers, any(has_pi for _, has_pi in parsed))
    units = []
    for keys, find in ((ANGLES, find_angle_unit), (LENGTHS, find_length_unit)):
        own = [each for each in read.values() if each[0].key in keys]
        open_columns = [(numbers, has_pi) for column, numbers, has_pi in own if not column.unit]
        guess = find(open_columns, table.where) if open_columns else ""
        used = []
        for column, numbers, _ in own:
            unit = column.unit or guess
            factor = {"radians": 180 / np.pi, "m": 1e3}.get(unit, 1.0)
            values[column.key][:] += numbers * factor
            used.append(unit)
        units.append(" and ".join(dict.fromkeys(used)) or "none")
    return units[0], units[1]


def _read_words(
    columns: Mapping[str, tuple[_Column, Sequence[Any]]], key: str, count: int
) -> list[str]:
    """Read the first column of a key as words; empty ones where there is none."""
    for column, cells in columns.values():
        if column.key == key:
            return ["" if cell is None else str(cell).strip() for cell in cells]
    return [""] * count


def _read_slides(
    table: Table, columns: Mapping[str, tuple[_Column, Sequence[Any]]], count: int
) -> list[bool]:
    slides = []
    for row, word in enumerate(_read_words(columns, "kind", count)):
        kind = word.lower()
        if kind not in SLIDES | TURNS:
            raise table.where.refuse(
                f'"{word}" is not a kind of joint.', row=row, remedy="Write revolute or prismatic."
            )
        slides.append(kind in SLIDES)
    return slides


def _read_senses(
    table: Table, columns: Mapping[str, tuple[_Column, Sequence[Any]]], count: int
) -> Array:
    """Read which way each joint counts: 1 or -1."""
    senses = []
    for row, word in enumerate(_read_words(columns, "sense", count)):
        number, _ = parse_cell(word or 1, table.where, row, "sense")
        if abs(number) != 1:
            raise table.where.refuse(
                f"a joint's sense is 1 or -1, found {number:g}.",
                row=row,
                remedy="Correct the cell.",
            )
        senses.append(number)
    return np.array(senses)


def _read_limits(
    table: Table,
    columns: Mapping[str, tuple[_Column, Sequence[Any]]],
    slides: Sequence[bool],
    senses: Array,
) -> list[list[float]] | None:
    """Read the least and the greatest reading of each joint; None where a column is missing."""
    found: dict[str, tuple[Array, str | None]] = {}
    for name, (column, cells) in columns.items():
        if column.key in ("low", "high"):
            own = enumerate(cells[: len(slides)])
            parsed = [parse_cell(cell, table.where, row, name)[0] for row, cell in own]
            found.setdefault(column.key, (np.array(parsed), column.unit))
    if len(found) < 2:
        return None
    (low, below), (high, above) = found["low"], found["high"]
    return combine_limits(low, high, (below, above), slides, senses, table.where)


def _read_stated(table: Table, columns: Mapping[str, tuple[_Column, Sequence[Any]]]) -> str | None:
    """Read which convention the table states, by a column or by the names of others."""
    words = {word.lower() for word in _read_words(columns, "convention", 0) if word}
    stated = {name for name, spellings in CONVENTION_WORDS.items() if words & set(spellings)}
    if len(stated) > 1 or (words and not stated):
        raise table.where.refuse(
            f"the column convention says {' and '.join(sorted(words))}.",
            remedy="Write standard or modified in every row.",
        )
    if stated:
        return stated.pop()
    if any(column.is_previous for column, _ in columns.values() if column.key in ("a", "alpha")):
        return "modified"
    return _find_order([column.word for column, _ in columns.values()])


def _find_order(words: Sequence[str]) -> str | None:
    """Find the convention from columns called after their motions, as RoboDK has them: rx tx tz rz
    are modified, rz tx tz rx standard, in the order in which they are done."""
    if "rx" not in words or "rz" not in words:
        return None
    return "modified" if words.index("rx") < words.index("rz") else "standard"


def _find_convention(rows: _Rows, file: str, given: str | None) -> tuple[str, str]:
    """Find (standard or modified, why). Raises StudyError where both are possible, or neither."""
    if given is not None:
        return given, "as given"
    if rows.stated is not None:
        return rows.stated, "as the table says"
    clashes = {word: _find_coincident(rows, word) for word in CONVENTIONS}
    possible = [word for word, clash in clashes.items() if clash is None]
    if len(possible) == 1:
        (word,) = possible
        (other,) = set(CONVENTIONS) - {word}
        first = clashes[other]
        assert first is not None
        reason = f"since by {CONVENTIONS[other]} the axes of joints {first} and {first + 1} would coincide"
        return word, reason
    if not possible:
        raise StudyError(
            f"{file}: by standard and by modified DH two successive axes would coincide. "
            "Check a and alpha of every row, and their units."
        )
    raise StudyError(
        f"{file}: the table may be standard DH (a row has the link after its joint) or modified DH "
        "(Craig: a row has the link before its joint). Say which: --dh standard or --dh modified, or "
        'a column "convention" with that word.'
    )


def _find_coincident(rows: _Rows, convention: str) -> int | None:
    """Find the first joint (from 1) whose axis is that of the next one; None where there is none."""
    after = 1 if convention == "modified" else 0
    a = rows.values["a"]
    sine = np.sin(np.radians(rows.values["alpha"]))
    for joint in range(rows.joints - 1):
        row = joint + after
        turns = not rows.slides[joint] and not rows.slides[joint + 1]
        if turns and abs(a[row]) < COINCIDENT and abs(sine[row]) < COINCIDENT:
            return joint + 1
    return None


def _to_robot_file(rows: _Rows, convention: str, name: str, source: str) -> dict[str, Any]:
    """Return the table of a robot file."""
    table: dict[str, Any] = {
        "name": name,
        "source": source,
        "gravity": [0, 0, -1],
        "convention": convention,
    }
    senses = rows.senses[: rows.joints]
    if (senses < 0).any():
        table["coupling"] = np.diag(senses).tolist()
    joints = []
    for k in range(rows.joints):
        joint: dict[str, Any] = {"dh": _dh_row(rows, k)}
        if rows.slides[k]:
            joint["kind"] = "prismatic"
        if rows.limits is not None:
            joint["limits_mm" if rows.slides[k] else "limits_deg"] = rows.limits[k]
        joints.append(joint)
    table["joint"] = joints
    if rows.joints < len(rows.names):
        table["last"] = {"dh": _dh_row(rows, rows.joints)}
    return table


def _dh_row(rows: _Rows, k: int) -> dict[str, float]:
    keys = {"theta": "theta_deg", "d": "d_mm", "a": "a_mm", "alpha": "alpha_deg"}
    row = {key: float(rows.values[name][k]) for name, key in keys.items()}
    beta = float(rows.values["beta"][k])
    return row | {"beta_deg": beta} if beta else row
