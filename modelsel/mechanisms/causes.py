"""Causes: scalar functions of the state, as small expression trees that print in contract.md's
grammar.

A cause is a value: `sin(2 * q(4))` prints as "sin(2*q4)", equals any other cause built alike, and
knows its unit. It is local in rows: evaluated on some rows of the state it gives those rows of the
whole. Nothing is ever parsed back inside the program; `parse` serves study files alone and
evaluates no code."""

from __future__ import annotations

import ast
from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from .._hashing import cache_hash
from .._typing import Array
from ..exceptions import StudyError, suggest

FUNCTIONS = {
    "sin": np.sin,
    "cos": np.cos,
    "sign": np.sign,
    "abs": np.abs,
    "exp": np.exp,
    "tanh": np.tanh,
}
DIMENSIONLESS = {"sin", "cos", "sign", "exp", "tanh"}
RANK = {"+": 1, "-": 1, "*": 2, "/": 2}


class State(Protocol):
    """What a cause may look at: named values per row (joint readings, covariates, derived
    quantities)."""

    def value(self, name: str) -> Array:
        """(m,) values of a name; raises KeyError for one the data do not have."""
        ...


class Cause(ABC):
    """Base of the nodes below; operators build larger causes."""

    @abstractmethod
    def of(self, state: State) -> Array | float:
        """The cause at every row (m,), or one number where it is constant."""

    @property
    @abstractmethod
    def unit(self) -> str:
        """Unit of the cause, "1" where it has none."""

    @abstractmethod
    def names(self) -> frozenset[str]:
        """Names it needs from the state."""

    def __add__(self, other: Cause | float) -> Cause:
        return Combined("+", self, wrap(other))

    def __sub__(self, other: Cause | float) -> Cause:
        return Combined("-", self, wrap(other))

    def __mul__(self, other: Cause | float) -> Cause:
        return Combined("*", self, wrap(other))

    def __rmul__(self, other: float) -> Cause:
        return Combined("*", wrap(other), self)

    def __truediv__(self, other: Cause | float) -> Cause:
        return Combined("/", self, wrap(other))


@dataclass(frozen=True)
class Number(Cause):
    """A constant; 1 is the cause of the geometric parameters."""

    number: float
    dimension: str = "1"

    def of(self, state: State) -> float:
        return self.number

    @property
    def unit(self) -> str:
        return self.dimension

    def names(self) -> frozenset[str]:
        return frozenset()

    def __str__(self) -> str:
        return f"{self.number:.10g}"


@cache_hash
@dataclass(frozen=True)
class Named(Cause):
    """A value of the state by its name: q4, payload_kg, approach2, torque3."""

    name: str
    dimension: str = "1"

    def of(self, state: State) -> Array:
        return state.value(self.name)

    @property
    def unit(self) -> str:
        return self.dimension

    def names(self) -> frozenset[str]:
        return frozenset((self.name,))

    def __str__(self) -> str:
        return self.name


@cache_hash
@dataclass(frozen=True)
class Applied(Cause):
    """A function of a cause: cos(q2+q3)."""

    function: str
    argument: Cause

    def of(self, state: State) -> Array | float:
        out: Array | float = FUNCTIONS[self.function](self.argument.of(state))
        return out

    @property
    def unit(self) -> str:
        return "1" if self.function in DIMENSIONLESS else self.argument.unit

    def names(self) -> frozenset[str]:
        return self.argument.names()

    def __str__(self) -> str:
        return f"{self.function}({self.argument})"


@cache_hash
@dataclass(frozen=True)
class Combined(Cause):
    """Sum, difference, product or quotient of two causes."""

    operator: str
    left: Cause
    right: Cause

    def of(self, state: State) -> Array | float:
        a, b = self.left.of(state), self.right.of(state)
        if self.operator == "/":
            return a / b
        return a + b if self.operator == "+" else a - b if self.operator == "-" else a * b

    @property
    def unit(self) -> str:
        a, b = self.left.unit, self.right.unit
        if self.operator in "+-":
            return b if a == "1" else a
        if b == "1":
            return a
        if self.operator == "*":
            return b if a == "1" else f"{a} {b}"
        return f"{a}/{b}"

    def names(self) -> frozenset[str]:
        return self.left.names() | self.right.names()

    def __str__(self) -> str:
        rank = RANK[self.operator]
        left, right = str(self.left), str(self.right)
        if (
            isinstance(self.left, Combined)
            and RANK[self.left.operator] < rank
            or left.startswith("-")
            and rank > 1
        ):
            left = f"({left})"
        tight = rank + (self.operator in "-/")
        if (
            isinstance(self.right, Combined)
            and RANK[self.right.operator] < tight
            or right.startswith("-")
        ):
            right = f"({right})"
        return f"{left}{self.operator}{right}"


@dataclass(frozen=True)
class Member(Cause):
    """1 where a row belongs to one target, group or feature, 0 elsewhere: offsets of targets,
    placements of days, anchors."""

    kind: str  # "target", "group" or "feature"
    index: int

    def of(self, state: State) -> Array:
        return np.asarray(state.value(self.kind) == self.index, dtype=float)

    @property
    def unit(self) -> str:
        return "1"

    def names(self) -> frozenset[str]:
        return frozenset((self.kind,))

    def __str__(self) -> str:
        return f"{self.kind}_{self.index + 1}"


def wrap(value: Cause | float) -> Cause:
    """A number as a cause."""
    return value if isinstance(value, Cause) else Number(float(value))


ONE = Number(1.0)


def sin(argument: Cause) -> Cause:
    """Sine of an angle cause."""
    return Applied("sin", argument)


def cos(argument: Cause) -> Cause:
    """Cosine of an angle cause."""
    return Applied("cos", argument)


def sign(argument: Cause) -> Cause:
    """-1, 0 or +1."""
    return Applied("sign", argument)


def q(joint: int, unit: str = "rad") -> Named:
    """Reading of a joint (1-based)."""
    return Named(f"q{joint}", unit)


def torque(joint: int) -> Named:
    """Gravity torque about a joint's axis [N m]."""
    return Named(f"torque{joint}", "N m")


def shifted(angle: Cause, phase: float) -> Cause:
    """angle + phase, or the angle itself where the phase is nought to 1e-9."""
    if abs(phase) < 1e-9:
        return angle
    return angle + phase if phase > 0 else angle - -phase


def parse(text: str, units: Mapping[str, str], where: str = "cause") -> Cause:
    """A cause from a study file's string; `units` are the known names with their units. Raises
    StudyError."""

    def build(node: ast.expr) -> Cause:
        if (
            isinstance(node, ast.Constant)
            and isinstance(node.value, (int, float))
            and not isinstance(node.value, bool)
        ):
            return Number(float(node.value))
        if isinstance(node, ast.Name):
            if node.id not in units:
                raise StudyError(
                    f'{where}: unknown name "{node.id}" in "{text}". {suggest(node.id, units)}'
                )
            return Named(node.id, units[node.id])
        if isinstance(node, ast.UnaryOp) and isinstance(node.op, (ast.USub, ast.UAdd)):
            inner = build(node.operand)
            if isinstance(node.op, ast.UAdd):
                return inner
            return Number(-inner.number) if isinstance(inner, Number) else -1.0 * inner
        if isinstance(node, ast.BinOp) and type(node.op) in _OPERATORS:
            return Combined(_OPERATORS[type(node.op)], build(node.left), build(node.right))
        if (
            isinstance(node, ast.Call)
            and isinstance(node.func, ast.Name)
            and node.func.id in FUNCTIONS
            and len(node.args) == 1
            and not node.keywords
        ):
            return Applied(node.func.id, build(node.args[0]))
        raise StudyError(
            f'{where}: "{text}" is not a cause: names, numbers, + - * /, parentheses and '
            f"{' '.join(FUNCTIONS)} are known."
        )

    try:
        tree = ast.parse(text.strip()[:500], mode="eval")
    except (SyntaxError, ValueError, RecursionError, MemoryError):
        raise StudyError(
            f'{where}: "{text[:80]}" is not a cause: it cannot be read as a formula.'
        ) from None
    return build(tree.body)


_OPERATORS = {ast.Add: "+", ast.Sub: "-", ast.Mult: "*", ast.Div: "/"}


@cache_hash
@dataclass(frozen=True)
class Bump(Cause):
    """One cubic B-spline of one value of the state: a free function is many of them side by side,
    each with its coefficient.

    Centred at `centre`, knots `width` apart (in the value's unit), nought two knots away. de Boor
    1978, cardinal B-splines."""

    name: str
    centre: float
    width: float

    def of(self, state: State) -> Array:
        return self.shape(state.value(self.name))

    def shape(self, values: Array) -> Array:
        """The spline at values of its variable."""
        u = np.abs(values - self.centre) / self.width
        near, far = (4 - 6 * u**2 + 3 * u**3) / 6, np.maximum(2 - u, 0) ** 3 / 6
        return np.where(u < 1, near, far)

    @property
    def unit(self) -> str:
        return "1"

    def names(self) -> frozenset[str]:
        return frozenset((self.name,))

    def __str__(self) -> str:
        return f"free({self.name})"


def factors(cause: Cause) -> tuple[Cause, ...]:
    """The factors of a product, or the cause itself."""
    if isinstance(cause, Combined) and cause.operator == "*":
        return factors(cause.left) + factors(cause.right)
    return (cause,)
