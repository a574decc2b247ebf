"""Kin: mechanisms that are alike in several joints, of which one makes the others likelier."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence

import numpy as np

from .._typing import Index

# log of how much likelier a mechanism is in a joint where another joint has it
KIN = float(np.log(20))


def number_kinds(labels: Sequence[str]) -> Index:
    """Number (P,) the mechanisms that candidates are, whatever their joints."""
    number: dict[str, int] = {}
    kinds = []
    for label in labels:
        stem = find_stem(label)
        kind = number.setdefault(stem, len(number))
        kinds.append(kind)
    return np.array(kinds, dtype=np.intp)


def count_kin(labels: Iterable[str]) -> int:
    """Count the labels that name a mechanism which another one before has in another joint."""
    stems = []
    for label in labels:
        stem = find_stem(label)
        stems.append(stem)
    kinds = set(stems)
    return len(stems) - len(kinds)


def find_stem(label: str) -> str:
    """Find the name of a mechanism without its joint."""
    joint = r":\d+$"
    return re.sub(joint, "", label)
