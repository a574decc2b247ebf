"""Columns that are called as the robot file calls its joints: "base_yaw_joint", or
"/joint_states/base_yaw_joint/position" of the same joint."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TypeAlias

from ..formats.column_names import COMMANDED, MEASURED, ColumnName, find_unit, split_name

Key: TypeAlias = tuple[str, ...]
# words of a column or a joint that do not tell joints apart
COMMON_WORDS = frozenset[str]().union(
    ("joint", "joints", "state", "states", "position", "positions", "pos", "value", "angle"),
    MEASURED,
    COMMANDED,
)


def find_named_joints(
    names: Sequence[ColumnName], joint_names: Sequence[str]
) -> list[list[ColumnName]]:
    """Find the columns of each joint, in the order of the joints, by the names that the robot file
    gives them: one list for measured, commanded and other columns each. None where a joint has no
    column."""
    wanted = _list_keys(joint_names)
    if wanted is None:
        return []
    families: dict[frozenset[str], dict[Key, ColumnName]] = defaultdict(dict)
    for name in names:
        found = _match(name, wanted)
        if found is not None:
            key, matched = found
            family = families[matched.words & (MEASURED | COMMANDED)]
            family.setdefault(key, matched)
    keys = list(wanted)
    count = len(keys)
    complete = []
    for family in families.values():
        if len(family) < count:
            continue
        columns = [family[key] for key in keys]
        complete.append(columns)
    return complete


def _list_keys(joint_names: Sequence[str]) -> Mapping[Key, Key] | None:
    """Map every joint's key to its key without the words that all of them begin with (the prefix of
    one arm of several); None where two joints have one key."""
    keys = [_make_key(split_name(name, None)[0]) for name in joint_names]
    if not all(keys) or len(set(keys)) < len(keys):
        return None
    shared = 0
    for words in zip(*keys, strict=False):
        if len(keys) < 2 or len(set(words)) > 1:
            break
        shared += 1
    short = [key[shared:] for key in keys]
    return dict(zip(keys, short if all(short) else keys, strict=True))


def _make_key(words: Sequence[str]) -> Key:
    return tuple(word for word in words if word not in COMMON_WORDS)


def _match(name: ColumnName, wanted: Mapping[Key, Key]) -> tuple[Key, ColumnName] | None:
    """Find the joint that a column is called by, its unit at the end of the name or not."""
    words, said = split_name(name.given, None)
    bare = replace(name, words=frozenset(words), quantity="joint")
    whole, cut = _make_key(words), _make_key(words[:-1])
    has_unit = len(words) > 1 and find_unit(words[-1]) is not None
    for key, short in wanted.items():
        if whole in (key, short):
            # what ends the name is a part of the joint's, no unit
            is_part = has_unit and not said and name.unit == find_unit(words[-1])
            return key, replace(bare, unit=None) if is_part else bare
    for key, short in wanted.items():
        if has_unit and cut in (key, short):
            return key, bare
    return None
