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
    stems = [find_stem(label) for label in labels]
    first = {stem: number for number, stem in reversed(list(enumerate(stems)))}
    return np.array([first[stem] for stem in stems], dtype=np.intp)


def count_kin(labels: Iterable[str]) -> int:
    """Count the labels that name a mechanism which another one before has in another joint."""
    stems = [find_stem(label) for label in labels]
    return len(stems) - len(set(stems))


def find_stem(label: str) -> str:
    """Find the name of a mechanism without its joint."""
    joint = r":\d+$"
    return re.sub(joint, "", label)
