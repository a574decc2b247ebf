"""Columns that number the joints of an arm, J1, J2 and so on, and those that are missing of them."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from typing import TypeAlias

from ...exceptions import one_line, sentence_list
from ..formats.column_names import OTHER_QUANTITIES, ColumnName, parse_column_name
from ..formats.table import Table

# columns by the number of their joint
Numbered: TypeAlias = dict[int, ColumnName]
# columns that number joints, at least
MIN_JOINTS = 3


def group_numbered_joints(names: Sequence[ColumnName]) -> list[Numbered]:
    """Group the columns that number joints: those of one list have the same words in their names."""
    families: dict[tuple[str, frozenset[str]], Numbered] = defaultdict(dict)
    for name in names:
        is_other = name.words & OTHER_QUANTITIES
        is_joint = name.quantity == "joint"
        if is_other or not is_joint or name.number is None:
            continue
        family = families[name.stem, name.words]
        family.setdefault(name.number, name)
    return list(families.values())


def find_numbered_joints(table: Table) -> Numbered:
    """Find the longest list of columns that number joints; empty for fewer than three."""
    units = table.units
    names = [parse_column_name(name, units.get(name)) for name in table.columns]
    families = group_numbered_joints(names)
    longest = max(families, key=len, default={})
    return longest if len(longest) >= MIN_JOINTS else {}


def describe_missing_joints(table: Table, joints: int) -> str:
    """Say which of so many joints have no column where the others have one; empty where all have, or
    none looks like a joint's."""
    found = find_numbered_joints(table)
    first = 0 if 0 in found else 1
    wanted = range(first, first + joints)
    missing = [number for number in wanted if number not in found]
    is_within = set(found) <= set(wanted)
    if not found or not missing or not is_within:
        return ""
    columns = [found[number] for number in sorted(found)]
    listed = sentence_list([f'"{one_line(name.given)}"' for name in columns])
    numbers = sentence_list(list(map(str, missing)))
    one = len(missing) == 1
    # columns that count from 0 number the first joint 0
    word = "joint" if first else "number"
    word = word if one else f"{word}s"
    verb = "has" if one else "have"
    return f"{listed} look like joint readings, but {word} {numbers} of {joints} {verb} no column."
