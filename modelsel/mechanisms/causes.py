"""Causes: scalar functions of the state, as small expression trees that print in contract.md's
grammar.

A cause is a value: `sin(2 * q(4))` prints as "sin(2*q4)", equals any other cause built alike, and
knows its unit. It is local in rows: evaluated on some rows of the state it gives those rows of the
whole. Nothing is ever parsed back inside the program; `parse` serves study files alone and
evaluates no code."""

from __future__ import annotations

import operator
from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Protocol

import numpy as np

from .._arguments import check_type, check_whole_number
from .._hashing import cache_hash
from .._typing import Array
from .cause_functions import DIMENSIONLESS, FUNCTIONS

ARITHMETIC: dict[str, Callable[[Any, Any], Any]] = {
    "+": operator.add,
    "-": operator.sub,
    "*": operator.mul,
    "/": np.divide,  # of numbers too: by zero it is not finite, and no error
}
CAUSE_EXPECTED = 'a cause, such as q(2) or Named("payload_kg"), or a number'
RANK = {"+": 1, "-": 1, "*": 2, "/": 2}  # how tightly an operator binds


class State(Protocol):
    """What a cause may look at: named values per row (joint readings, covariates, derived
    quantities)."""

    def value(self, name: str) -> Array:
        """Return the values (m,) of a name. Raises StudyError for one the data do not have."""
        ...


class Cause(ABC):
    """Base of the nodes below; operators build larger causes."""

    @abstractmethod
    def of(self, state: State) -> Array | float:
        """Evaluate the cause at every row (m,), or one number where it is constant."""

    @property
    @abstractmethod
    def unit(self) -> str:
        """Unit of the cause, "1" where it has none."""

    @abstractmethod
    def names(self) -> frozenset[str]:
        """Return the names it needs from the state."""

    def __add__(self, other: Cause | float) -> Cause:
        summand = wrap(other)
        return Combined("+", self, summand)

    def __sub__(self, other: Cause | float) -> Cause:
        subtrahend = wrap(other)
        return Combined("-", self, subtrahend)

    def __mul__(self, other: Cause | float) -> Cause:
        factor = wrap(other)
        return Combined("*", self, factor)

    def __rmul__(self, other: float) -> Cause:
        factor = wrap(other)
        return Combined("*", factor, self)

    def __truediv__(self, other: Cause | float) -> Cause:
        divisor = wrap(other)
        return Combined("/", self, divisor)


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

    def __post_init__(self) -> None:
        check_type("name", self.name, str, "a value's name, such as payload_kg")

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
        function = FUNCTIONS[self.function]
        argument = self.argument.of(state)
        out: Array | float = function(argument)
        return out

    @property
    def unit(self) -> str:
        if self.function in DIMENSIONLESS:
            return "1"
        return self.argument.unit

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
        a = self.left.of(state)
        b = self.right.of(state)
        operator = self.operator
        operate = ARITHMETIC[operator]
        value: Array | float = operate(a, b)
        return value

    @property
    def unit(self) -> str:
        a, b = self.left.unit, self.right.unit
        if self.operator in "+-":
            return b if a == "1" else a
        if b == "1":
            return a
        if self.operator == "/":
            return "1" if a == b else f"{a}/{b}"
        if a == "1":
            return b
        return f"{a} {b}"

    def names(self) -> frozenset[str]:
        left = self.left.names()
        right = self.right.names()
        return left | right

    def __str__(self) -> str:
        return self._text

    @cached_property
    def _text(self) -> str:
        rank = RANK[self.operator]
        left = str(self.left)
        right = str(self.right)
        left_rank = _rank(self.left)
        right_rank = _rank(self.right)
        is_product = rank > RANK["+"]
        is_negative = left.startswith("-")
        is_negative_factor = is_negative and is_product
        if left_rank < rank or is_negative_factor:
            left = f"({left})"
        if self.operator in "-/":
            rank += 1
        is_negative = right.startswith("-")
        if right_rank < rank or is_negative:
            right = f"({right})"
        return f"{left}{self.operator}{right}"


def _rank(cause: Cause) -> int:
    """Rank how tightly a cause's outermost operator binds; above all operators where it has
    none."""
    if isinstance(cause, Combined):
        return RANK[cause.operator]
    return len(RANK)


@dataclass(frozen=True)
class Member(Cause):
    """1 where a row belongs to one target or group, 0 elsewhere: offsets of targets, placements of
    days. `number`: what it is called, where some that come before it were left out of the rows."""

    kind: str  # "target" or "group"
    index: int
    number: int | None = None  # None: one more than the index

    def of(self, state: State) -> Array:
        return np.asarray(state.value(self.kind) == self.index, dtype=float)

    @property
    def unit(self) -> str:
        return "1"

    def names(self) -> frozenset[str]:
        return frozenset((self.kind,))

    def __str__(self) -> str:
        number = self.index + 1 if self.number is None else self.number
        return f"{self.kind}_{number}"


def belongs_to_target(index: int, number: int | None = None) -> Member:
    """Return the cause that is 1 in the rows of one of several targets (0-based); `number`: that of
    the target in its file."""
    if number == index + 1:
        number = None
    return Member("target", index, number)


def wrap(value: Cause | float) -> Cause:
    """Return a number as a cause, a cause as it is. Raises ArgumentError for anything else."""
    if isinstance(value, Cause):
        return value
    check_type("cause", value, (int, float, np.number), CAUSE_EXPECTED)
    number = float(value)
    return Number(number)


ONE = Number(1.0)


def sin(argument: Cause) -> Cause:
    """Return the sine of an angle."""
    return Applied("sin", wrap(argument))


def cos(argument: Cause) -> Cause:
    """Return the cosine of an angle."""
    return Applied("cos", wrap(argument))


def sign(argument: Cause) -> Cause:
    """Return the sign of a cause: -1, 0 or +1."""
    return Applied("sign", wrap(argument))


def q(joint: int, unit: str = "rad") -> Named:
    """Return the reading of a joint (1-based)."""
    check_whole_number("joint", joint, 1)
    name = f"q{joint}"
    return Named(name, unit)


def torque(joint: int) -> Named:
    """Return the gravity torque about a joint's axis [N m]."""
    check_whole_number("joint", joint, 1)
    return Named(f"torque{joint}", "N m")


def shifted(angle: Cause, phase: float) -> Cause:
    """Return angle + phase, or the angle itself where the phase is zero to 1e-9 rad."""
    if abs(phase) < 1e-9:
        return angle
    if phase > 0:
        return angle + phase
    return angle - -phase


@cache_hash
@dataclass(frozen=True)
class Bump(Cause):
    """One cubic B-spline of one value of the state: a free function is many of them side by side,
    each with its coefficient.

    Centred at `centre`, knots `width` apart (in the value's unit), zero two knots away. de Boor
    1978, cardinal B-splines."""

    name: str
    centre: float
    width: float

    def of(self, state: State) -> Array:
        values = state.value(self.name)
        return self.shape(values)

    def shape(self, values: Array) -> Array:
        """Evaluate the spline at values of its variable."""
        distance = np.abs(values - self.centre) / self.width
        # of a turn's many splines, four are not zero at a value
        near = np.nonzero(distance < 2)
        outer = 2 - distance[near]
        inner = np.maximum(outer - 1, 0)
        cubes = outer * outer * outer - 4 * inner * inner * inner
        out = np.zeros(distance.shape)
        out[near] = cubes / 6
        return out

    @property
    def unit(self) -> str:
        return "1"

    def names(self) -> frozenset[str]:
        return frozenset((self.name,))

    def __str__(self) -> str:
        return f"free({self.name})"


def find_bump(cause: Cause) -> Bump | None:
    """Find the spline that a cause is, or is a product of; None for one of no free function."""
    return next((factor for factor in factors(cause) if isinstance(factor, Bump)), None)


def factors(cause: Cause) -> tuple[Cause, ...]:
    """Return the factors of a product, or the cause itself."""
    if not isinstance(cause, Combined):
        return (cause,)
    if cause.operator != "*":
        return (cause,)
    left = factors(cause.left)
    right = factors(cause.right)
    return left + right
