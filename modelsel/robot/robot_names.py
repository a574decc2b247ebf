"""Names of robots as people spell them: "UR10", "ur-10e", "Puma 760", "KUKA LBR iiwa 14 R820"."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from difflib import SequenceMatcher, get_close_matches

# words before or after a type's name, and what some types are called in full
MAKERS = frozenset[str]().union(
    ("abb", "kuka", "lbr", "universal", "robots", "robot", "unimation", "unimate", "franka"),
    ("emika", "r820", "series", "cb", "cb2", "cb3", "arm"),
)
FULL_NAMES = {"research3": "fr3"}
MAX_SUGGESTED = 3
# how alike two names must be, and the letters of both: "KR 10" is no UR10
MIN_ALIKE = 0.6


def find_robot_name(given: str, known: Sequence[str]) -> str | None:
    """Find the known robot that a name means, whatever its capitals, blanks and hyphens and with
    or without its maker's; None where there is none, or more than one."""
    if given in known:
        return given
    spellings = _list_spellings(given)
    means = [name for name in known if _squeeze(name) in spellings]
    if len(means) == 1:
        return means[0]
    return None


def find_full_name(given: str, full_names: Mapping[str, str]) -> str | None:
    """Find the robot, of full names by names, whose full name is given, whatever its capitals,
    blanks and marks and with or without its maker's; None where there is none."""
    spellings = set(_list_spellings(given))
    for name, full in full_names.items():
        if spellings & set(_list_spellings(full)):
            return name
    return None


def has_robot_name(full: str, name: str) -> bool:
    """Whether a full name holds a robot's name: "ABB IRB 1600-10/1.45" holds irb1600."""
    short = _squeeze(name)
    long = _squeeze(full)
    return short in long


def suggest_robots(given: str, known: Sequence[str]) -> str:
    """Offer the known robots whose names are close, else all."""
    squeezed = {_squeeze(name): name for name in known}
    near = list[str]()
    for spelling in _list_spellings(given):
        alike = [name for name in squeezed if _have_like_letters(spelling, name)]
        near += get_close_matches(spelling, alike, MAX_SUGGESTED, cutoff=MIN_ALIKE)
    if near:
        *others, last = [f'"{squeezed[name]}"' for name in dict.fromkeys(near)]
        listed = f"{', '.join(others)} or {last}" if others else last
        return f"Did you mean {listed}?"
    return f"Known: {', '.join(known)}; another robot takes a file: TOML, URDF, or a table of DH parameters."


def _have_like_letters(given: str, name: str) -> bool:
    """Whether the letters of two names are alike, whatever their numbers; a name without any is."""
    letters = re.sub(r"[0-9]", "", given)
    own = re.sub(r"[0-9]", "", name)
    alike = SequenceMatcher(None, letters, own).ratio()
    return not letters or alike >= MIN_ALIKE


def _list_spellings(given: str) -> list[str]:
    """List a name without blanks and marks, as given and without words of its maker."""
    words = re.findall(r"[a-z0-9]+", given.lower())
    bare = "".join(word for word in words if word not in MAKERS)
    spellings = [bare, "".join(words)]
    return [FULL_NAMES.get(spelling, spelling) for spelling in spellings]


def _squeeze(name: str) -> str:
    small = name.lower()
    return re.sub(r"[^a-z0-9]", "", small)
