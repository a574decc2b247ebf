"""Causes read from formulas: a study file's strings, with names, numbers, + - * / and functions."""

from __future__ import annotations

import ast
import re
import sys
from collections.abc import Mapping
from dataclasses import dataclass, field

from ..exceptions import StudyError, suggest
from ..measurements.campaign.state_names import find_nearest_width
from .cause_functions import FUNCTIONS
from .causes import Applied, Cause, Combined, Member, Named, Number

LARGEST_NUMBER = sys.float_info.max  # in a formula
MAX_LENGTH = 500  # characters of a formula
MEMBER = re.compile(r"(target|group)_(\d+)")  # names of one target or group, as they print
OPERATORS: dict[type[ast.operator], str] = {ast.Add: "+", ast.Sub: "-", ast.Mult: "*", ast.Div: "/"}


def list_members(targets: int, groups: int) -> dict[str, Member]:
    """List the causes that are 1 at one of several targets or groups and 0 elsewhere, by their
    names; none of what there is one of."""
    members = {}
    for kind, count in (("target", targets), ("group", groups)):
        if count == 1:
            continue
        for index in range(count):
            member = Member(kind, index)
            members[str(member)] = member
    return members


def parse(
    text: str,
    units: Mapping[str, str],
    where: str = "cause",
    members: Mapping[str, Cause] | None = None,
) -> Cause:
    """Read a cause from a study file's string; `units` are the known names with their units,
    `members` those of single targets and groups. Raises StudyError."""
    formula = text.strip()
    if len(formula) > MAX_LENGTH:
        raise StudyError(
            f'{where}: "{formula[:80]}…" has {len(formula):,} characters; at most {MAX_LENGTH} are '
            "expected. Add a column with the value to the measurements, and name that."
        )
    try:
        tree = ast.parse(formula, mode="eval")
    except (SyntaxError, ValueError, RecursionError, MemoryError):
        raise StudyError(
            f'{where}: "{text[:80]}" is not a cause: it cannot be read as a formula.'
        ) from None
    read = _Formula(text, units, where, members or {})
    cause = read.build(tree.body)
    if read.unknown:
        raise StudyError(*map(read.refuse_name, dict.fromkeys(read.unknown)))
    return cause


@dataclass(frozen=True)
class _Formula:
    """A formula that is read: its text, the known names, and where it stands; the `unknown` names
    that were met in it."""

    text: str
    units: Mapping[str, str]
    where: str
    members: Mapping[str, Cause] = field(default_factory=dict)
    unknown: list[str] = field(default_factory=list)

    def build(self, node: ast.expr) -> Cause:
        """Build the cause of a node; raises StudyError for one that no cause has."""
        match node:
            case ast.Constant(value=bool()):
                pass
            case ast.Constant(value=int() | float() as value) if value <= LARGEST_NUMBER:
                return Number(float(value))
            case ast.Name(id=name):
                return self._named(name)
            case ast.UnaryOp(op=ast.UAdd()):
                return self.build(node.operand)
            case ast.UnaryOp(op=ast.USub()):
                inner = self.build(node.operand)
                return Number(-inner.number) if isinstance(inner, Number) else -1.0 * inner
            case ast.BinOp() if type(node.op) in OPERATORS:
                operator = OPERATORS[type(node.op)]
                left = self.build(node.left)
                right = self.build(node.right)
                return Combined(operator, left, right)
            case ast.Call(func=ast.Name(id=name), args=[argument], keywords=[]) if (
                name in FUNCTIONS
            ):
                return Applied(name, self.build(argument))
        raise StudyError(
            f'{self.where}: "{self.text}" is not a cause: names, numbers, + - * /, parentheses and '
            f"{' '.join(FUNCTIONS)} are known."
        )

    def _named(self, name: str) -> Cause:
        """Return a name's cause; one that is unknown is kept for all to be told at once."""
        # a column that has such a name keeps it
        if name in self.units:
            return Named(name, self.units[name])
        if name in self.members:
            return self.members[name]
        self.unknown.append(name)
        return Named(name, "1")

    def refuse_name(self, name: str) -> str:
        """Say what is wrong with a name that is unknown."""
        near = find_nearest_width(name, self.units)
        meant = "" if near is None else f'Did you mean "{near}"?'
        hint = self._count_members(name) or meant or suggest(name, self.units)
        hint = hint or "A reading, such as q1, or a column is expected."
        return f'{self.where}: unknown name "{name}" in "{self.text}". {hint}'

    def _count_members(self, name: str) -> str:
        """Say how many targets or groups there are, to a name of one that there is not."""
        match = MEMBER.fullmatch(name)
        if match is None:
            return ""
        kind = match[1]
        known = [member for member in self.members if member.startswith(f"{kind}_")]
        if not known:
            return f"There is only one {kind}."
        return f"The {kind}s are {known[0]} to {known[-1]}."
