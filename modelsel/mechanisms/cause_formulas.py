"""Causes read from formulas: a study file's strings, with names, numbers, + - * / and functions."""

from __future__ import annotations

import ast
import sys
from collections.abc import Mapping
from dataclasses import dataclass

from ..exceptions import StudyError, suggest
from .cause_functions import FUNCTIONS
from .causes import Applied, Cause, Combined, Named, Number

LARGEST_NUMBER = sys.float_info.max  # in a formula
MAX_LENGTH = 500  # characters of a formula
OPERATORS: dict[type[ast.operator], str] = {ast.Add: "+", ast.Sub: "-", ast.Mult: "*", ast.Div: "/"}


def parse(text: str, units: Mapping[str, str], where: str = "cause") -> Cause:
    """Read a cause from a study file's string; `units` are the known names with their units.
    Raises StudyError."""
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
    return _Formula(text, units, where).build(tree.body)


@dataclass(frozen=True)
class _Formula:
    """A formula that is read: its text, the known names, and where it stands."""

    text: str
    units: Mapping[str, str]
    where: str

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

    def _named(self, name: str) -> Named:
        if name in self.units:
            return Named(name, self.units[name])
        hint = suggest(name, self.units) or "A reading, such as q1, or a column is expected."
        raise StudyError(f'{self.where}: unknown name "{name}" in "{self.text}". {hint}')
