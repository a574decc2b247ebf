"""What the names in a report mean that no registry lists: places and causes, free functions, derived
names, numbers after a name."""

from __future__ import annotations

import re
from collections.abc import Sequence

from ...measurements.campaign.state_names import StateKind, StateVariable, parse_state_name
from ...mechanisms.cause_formulas import MEMBER
from ..shapes.cause_words import SETTLING

WORD = re.compile(r"[A-Za-z_]\w*")
PLACE = re.compile(r"frame (\d+) ([tr])([xyz]) ·")
WAVES = re.compile(r"waves of (\w+) times waves of (\w+)")
SLOW = re.compile(r"([\d.]+) waves along the campaign")
COURSE = re.compile(r"the smooth course of (\w+) in time")
SETTLES = re.compile(rf"{SETTLING} [\d.]+ (?:s|min|h|% of the campaign)")
NUMBERED = re.compile(r" \((\d+)\)$")
# what follows it, such as the name of a target, is no cause
REGISTERED = re.compile(r"(fault:)?[a-z0-9]+(-[a-z0-9]+)+(:|$| )")
FREE = re.compile(r"free\(([^()]+)\)")
MOTIONS = {"t": "shifts along", "r": "turns about"}
PAIR = "a & b: two numbers fitted together, as a sine and a cosine of unknown phase"
# a name that begins so is of an effect that no registry has
FRAME = "frame "


def explain_names(names: Sequence[str], joints: int | None = None) -> list[str]:
    """Explain what of the names is in no registry, each kind once, by the first that has it; nothing
    of names that are registered. `joints`: how many the arm has, where that is known."""
    text = "\n".join(names)
    lines = _explain_place(text, joints)
    lines += _explain_shapes(text)
    causes = [name for name in names if REGISTERED.match(name) is None]
    own_text = "\n".join(causes)
    if " & " in own_text:
        lines.append(PAIR)
    words = WORD.findall(own_text)
    lines += _explain_derived(words)
    lines += _explain_members(words)
    found = map(NUMBERED.search, names)
    numbered = [match for match in found if match is not None]
    if numbered:
        first, *_ = numbered
        number = first[1]
        lines.append(f"({number}) after a name: one of several effects of that name")
    return lines


def _explain_place(text: str, joints: int | None) -> list[str]:
    place = PLACE.search(text)
    if place is None:
        return []
    frame, kind, axis = place.groups()
    lines = [
        f"frame {frame} {kind}{axis} · cause: frame {frame} {MOTIONS[kind]} its {axis} axis with the cause"
    ]
    frames = {int(found[1]) for found in PLACE.finditer(text)}
    if joints is not None and joints + 1 in frames:
        lines.append(f"frame {joints + 1}: the target")
    return lines


def _explain_shapes(text: str) -> list[str]:
    lines = []
    free = FREE.search(text)
    if free is not None:
        lines.append(f"{free[0]}: a function of {free[1]} of any shape, fitted to the data")
    waves = WAVES.search(text)
    if waves is not None:
        lines.append(f"{waves[0]}: any product of a wave once a turn of the one and of the other")
    slow = SLOW.search(text)
    if slow is not None:
        periods = slow[1]
        lines.append(f"{slow[0]}: a wave in time, {periods} periods from the first row to the last")
    settling = SETTLES.search(text)
    if settling is not None:
        words = settling[0]
        lines.append(
            f"{words}: fast at first, then ever slower; after that time 37 % of it is left"
        )
    course = COURSE.search(text)
    if course is not None:
        words = course[0]
        name = course[1]
        lines.append(f"{words}: a smooth curve in time through the readings of {name}")
    return lines


def _explain_derived(words: Sequence[str]) -> list[str]:
    """Explain every derived name, of one kind and axis the first."""
    lines: dict[tuple[StateKind, str | None], str] = {}
    for word in words:
        variable = parse_state_name(word)
        if variable is not None and variable.kind is not StateKind.READING:
            key = variable.kind, variable.axis
            lines.setdefault(key, f"{word}: {describe_variable(variable)}")
    return list(lines.values())


def _explain_members(words: Sequence[str]) -> list[str]:
    lines = map(explain_member, dict.fromkeys(words))
    return [line for line in lines if line is not None]


def explain_member(word: str) -> str | None:
    """Explain the name of one target or group in causes; None of any other."""
    match = MEMBER.fullmatch(word)
    if match is None:
        return None
    kind, number = match.groups()
    return f"{word}: 1 in the rows of {kind} {number} of the measurements, 0 in the others"


def describe_variable(variable: StateVariable) -> str:
    """Describe a derived name in full: what it is, and of which joint, frame and axis."""
    if variable.width is not None:
        return f"{variable.words}, at most {variable.most:g} rad (of a slide mm)"
    is_whole = variable.frame is None and variable.axis is None
    if is_whole:
        return variable.words
    kind = variable.kind
    words = [kind.value]
    if variable.joint is not None:
        words.append(f"joint {variable.joint}")
    if variable.frame is not None:
        words.append(f"frame {variable.frame}")
    if variable.axis is not None:
        words.append(f"{variable.axis} component")
    return ", ".join(words)
