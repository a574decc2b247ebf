"""Kin: mechanisms that are alike in several joints, of which one makes the others likelier."""

from __future__ import annotations

import re
from collections.abc import Sequence

import numpy as np

from ..._typing import Index
from ...measurements.campaign.visits import number_keys

# log of how much likelier a mechanism is in a joint where another joint has it
KIN = float(np.log(20))


def number_kinds(labels: Sequence[str]) -> Index:
    """Number (P,) the mechanisms that candidates are, whatever their joints."""
    stems = list(map(find_stem, labels))
    numbers, _ = number_keys(stems)
    return numbers


def find_stem(label: str) -> str:
    """Find the name of a mechanism without its joint."""
    joint = r":\d+$"
    return re.sub(joint, "", label)
