"""Guess which columns are an orientation, and by which conventions they may be read."""

from __future__ import annotations

from collections.abc import Collection, Sequence

import numpy as np

from ..formats.column_names import (
    AXES,
    COMMANDED,
    MEASURED,
    TURN_WORDS,
    ColumnName,
    parse_column_name,
)
from ..formats.table import Table
from ..quantities.columns import convert_to_numbers
from ..quantities.orientation_columns import (
    CONVENTIONS,
    MAX_ANGLE_RAD,
    QUATERNION_COLUMNS,
    Convention,
)
from .column_guesses import Choice, Reading

# the letters of three columns, and the conventions that have them, each with the contract's columns
# in the letters' order; A B C is KUKA's and Mitsubishi's, EX EY EZ ABB's
LETTERS: dict[tuple[str, str, str], tuple[str, ...]] = {
    ("a", "b", "c"): ("kuka", "rpy"),
    ("w", "p", "r"): ("fanuc",),
    ("rx", "ry", "rz"): ("ur", "staubli", "yaskawa"),
    ("o", "a", "t"): ("kawasaki",),
    ("roll", "pitch", "yaw"): ("rpy",),
    ("ex", "ey", "ez"): ("rpy",),
}
LETTER_WORDS = frozenset[str]().union(*LETTERS)
BY_NAME = {convention.name: convention for convention in CONVENTIONS}
WHAT = "the orientation"
# words beside the letters that leave columns an orientation
ORIENTATION_WORDS = frozenset[str]().union(
    ("euler", "rot", "rotation", "ori", "orient", "orientation", "angle", "winkel", "tcp", "pose"),
    ("flange", "tool", *MEASURED, *COMMANDED),
)
# a quaternion without the contract's names, as textbooks and ABB call it, and by how much its length
# is not one
NUMBERED_QUATERNIONS = (("q0", "q1", "q2", "q3"), ("q1", "q2", "q3", "q4"))
MAX_LENGTH_ERROR = 1e-3


def guess_orientation(table: Table, taken: Collection[str], robot: str) -> Choice | None:
    """Guess the orientation among the columns that are not `taken`; None where there is none.
    `robot`: its name, by which the likelier convention is first."""
    if any(name in table for name in QUATERNION_COLUMNS):
        return None
    names = [
        parse_column_name(name, table.units.get(name))
        for name in table.columns
        if name not in taken
    ]
    readings = _read_quaternion(table, names)
    for letters, conventions in LETTERS.items():
        columns = _find_columns(table, names, letters)
        if columns is not None:
            likely = sorted(conventions, key=lambda name: not robot.lower().startswith(name))
            for name in likely:
                readings += _list_readings(table, columns, BY_NAME[name])
    return Choice(WHAT, tuple(readings)) if readings else None


def find_orientation_columns(table: Table, names: Sequence[ColumnName]) -> list[str]:
    """Find the columns that look like an orientation, whether the arm follows it or not."""
    plain = []
    for name in names:
        others = name.words - LETTER_WORDS
        if others <= ORIENTATION_WORDS:
            plain.append(name)
    listed = dict[str, None]()
    for letters, conventions in LETTERS.items():
        columns = _find_columns(table, plain, letters)
        if columns is None:
            continue
        first = BY_NAME[conventions[0]]
        readings = _list_readings(table, columns, first)
        if readings:
            given = [name.given for name in columns]
            listed |= dict.fromkeys(given)
    return list(listed)


def find_unnamed_quaternion(table: Table, names: Collection[str]) -> list[str]:
    """Find four columns, q0 to q3, q1 to q4 or the w, x, y, z of an orientation, that are numbers of
    length one in every row."""
    lettered = _find_lettered_quaternion(table, [parse_column_name(name) for name in names])
    return lettered or _find_numbered_quaternion(table, names)


def _find_numbered_quaternion(table: Table, names: Collection[str]) -> list[str]:
    """Find four numbered columns, q0 to q3 or q1 to q4, that are a unit quaternion in every row."""
    called = {name.lower(): name for name in names}
    for numbered in NUMBERED_QUATERNIONS:
        given = [called[name] for name in numbered if name in called]
        if _are_unit_quaternions(table, given):
            return given
    return []


def _read_quaternion(table: Table, names: Sequence[ColumnName]) -> list[Reading]:
    """Read the w, x, y, z of an orientation, as ROS calls them, or four numbered columns, of which the
    first or the last is w; nothing where there are none."""
    given = _find_lettered_quaternion(table, names)
    if given:
        return [_read_as_quaternion(given)]
    numbered = _find_numbered_quaternion(table, [name.given for name in names])
    if not numbered:
        return []
    *vector, last = numbered
    return [_read_as_quaternion(numbered), _read_as_quaternion([last, *vector])]


def _read_as_quaternion(given: Sequence[str]) -> Reading:
    """Read four columns as w, x, y, z."""
    columns = dict(zip(QUATERNION_COLUMNS, given, strict=True))
    listed = " ".join(given)
    wanted = " ".join(QUATERNION_COLUMNS)
    return Reading(columns, f'"{listed}" as the unit quaternion {wanted}')


def _find_lettered_quaternion(table: Table, names: Sequence[ColumnName]) -> list[str]:
    """Find the columns w, x, y, z of an orientation: pose.orientation.w, quat_w."""
    families = dict[frozenset[str], dict[str, str]]()
    for name in names:
        letter, others = _split_letter(name)
        is_turn = others & TURN_WORDS
        if letter and is_turn:
            family = families.setdefault(others, {})
            family[letter] = name.given
    for family in families.values():
        letters = ("w", *AXES)
        given = [family[letter] for letter in letters if letter in family]
        if _are_unit_quaternions(table, given):
            return given
    return []


def _split_letter(name: ColumnName) -> tuple[str, frozenset[str]]:
    """Split a name into (w, x, y or z, the other words); no letter where it has none."""
    if name.quantity in AXES:
        return str(name.quantity), name.words
    for word in ("w", *QUATERNION_COLUMNS):
        if word in name.words:
            others = name.words - {word}
            return word[-1], others if word == "w" else others | {"q"}
    return "", name.words


def _are_unit_quaternions(table: Table, given: Sequence[str]) -> bool:
    """Whether four columns are numbers of length one in every row."""
    if not len(table) or len(given) != len(QUATERNION_COLUMNS):
        return False
    columns = [convert_to_numbers(table.columns[name]) for name in given]
    length = np.linalg.norm(columns, axis=0)
    error = np.abs(length - 1)
    is_unit = error <= MAX_LENGTH_ERROR
    return bool(is_unit.all())


def _find_columns(
    table: Table, names: Sequence[ColumnName], letters: tuple[str, str, str]
) -> list[ColumnName] | None:
    """Find three columns of numbers that are called by the letters, and else alike."""
    found: dict[frozenset[str], dict[str, ColumnName]] = {}
    for name in names:
        letter = next((each for each in letters if each in name.words), None)
        if letter is not None and name.quantity is None:
            values = convert_to_numbers(table.columns[name.given])
            if np.isfinite(values).all():
                found.setdefault(name.words - {letter}, {})[letter] = name
    complete = [family for family in found.values() if len(family) == len(letters)]
    return [complete[0][letter] for letter in letters] if complete else None


def _list_readings(
    table: Table, columns: Sequence[ColumnName], convention: Convention
) -> list[Reading]:
    """List the readings by one convention, in the units that are said or that the values allow."""
    said = {name.unit for name in columns}
    values = np.stack([convert_to_numbers(table.columns[name.given]) for name in columns])
    largest = float(np.abs(values).max())
    if said in ({"deg"}, {"rad"}):
        units = [str(said.pop())]
    elif said != {None}:
        return []
    else:
        units = ["deg"] if largest > MAX_ANGLE_RAD else ["rad", "deg"]
    shown = " ".join(name.given for name in columns)
    readings = []
    for unit in units:
        pairs = zip(convention.columns, columns, strict=True)
        mapped = {f"{wanted}_{unit}": name.given for wanted, name in pairs}
        words = f'"{shown}" by the convention {convention.maker}, {convention.formula}, in {unit}'
        readings.append(Reading(mapped, words))
    return readings
