"""Screw, Term, Mechanism: every error of a robot as a value that prints, hashes and compares.

The screw of frame k sits between the nominal transform N_k and the joint's own rotation, as H_k in
the paper; its axes are tx ty tz rx ry rz of that frame; with cause 1 they are the paper's a b c α β
γ. Frame n+1 is the target."""

from __future__ import annotations

from collections import Counter
from collections.abc import Hashable, Iterable, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np

from .._arguments import check_type, collect_all, describe_value
from .._hashing import cache_hash
from .._names import MAX_TEXT_LENGTH, find_hidden_character, find_name_problem
from ..exceptions import ArgumentError
from ..robot.rigid import AXES
from .cause_functions import FUNCTIONS
from .causes import ONE, Applied, Bump, Cause, Combined, Member, Named, Number, wrap

FIXTURE_AXES = (*AXES, "length")  # of a feature of the set-up: its place, its tilt, a length
KINDS = (Number, Named, Applied, Combined, Member, Bump)
SHARES = {"rad/rad": "1", "mm/mm": "1"}  # a rotation by another, a shift by another
SCREWS_EXPECTED = 'a list of screws, as (Screw(3, "rz", q(2)),)'
TERMS_EXPECTED = 'a list of terms, as (Term("k", screws),)'
NO_NAMES: frozenset[str] = frozenset()
TermKey = tuple[Hashable, ...]
LETTERS = dict(zip(AXES, "abcαβγ", strict=True))
MOTIONS = {"t": "shifts along", "r": "turns about"}


@cache_hash
@dataclass(frozen=True)
class Screw:
    """WHERE x WHY: a small twist on one axis of one frame, scaled by its cause."""

    frame: int
    axis: str
    cause: Cause = ONE

    def __post_init__(self) -> None:
        _check_place(self.frame, self.axis)
        cause = wrap(self.cause)
        object.__setattr__(self, "cause", cause)

    @property
    def unit(self) -> str:
        """mm or rad per unit of its cause."""
        is_turn = self.axis[0] == "r"
        own_unit = "mm"
        if is_turn:
            own_unit = "rad"
        cause_unit = self.cause.unit
        return ratio(own_unit, cause_unit)

    def __str__(self) -> str:
        return f"frame {self.frame} {self.axis} · {self.cause}"


@cache_hash
@dataclass(frozen=True)
class Term:
    """ONE fitted number; it drives its screws together. `size` is the usual range of its magnitude,
    `sign` the one that physics allows (0: either): a fit of the other sign is not told as this
    mechanism. `usual`: of a constant parameter of the arm or its set-up, its standard deviation
    about zero; such a parameter is fitted even where the data do not tell it from others."""

    symbol: str
    screws: tuple[Screw, ...]
    size: tuple[float, float] | None = None
    sign: int = 0
    usual: float | None = None

    def __post_init__(self) -> None:
        screws = collect_all("screws", self.screws, Screw, SCREWS_EXPECTED)
        object.__setattr__(self, "screws", screws)

    @property
    def key(self) -> TermKey:
        """What the term is, whatever it is called: terms with one key are one fitted number."""
        return self.screws

    @property
    def fixture(self) -> bool:
        """Whether it is a number of the set-up's features and moves no part of the arm."""
        return False

    @property
    def unit(self) -> str:
        """mm or rad per unit of the cause, from its screws; all must agree (rad counts as 1).
        Raises ValueError."""
        units = list(dict.fromkeys(screw.unit for screw in self.screws))
        alike = set()
        for unit in units:
            without_angle = unit.replace("rad", "1").removeprefix("1 ")
            alike.add(SHARES.get(unit, without_angle))
        if len(alike) != 1:
            raise ValueError(
                f"the screws of {self.symbol} have different units: {', '.join(units)}"
            )
        if SHARES.keys() <= set(units):
            return "1"
        return max(units, key=lambda unit: "rad" in unit)


@cache_hash
@dataclass(frozen=True)
class FixtureTerm(Term):
    """One fitted number of a feature of the set-up (a wire's anchor, a plane): its place, its tilt
    or a length. It drives no screw of the arm; `feature` is the feature's index, `axis` one of
    FIXTURE_AXES. Raises ValueError for another axis."""

    screws: tuple[Screw, ...] = ()
    feature: int = field(default=0, kw_only=True)
    axis: str = field(default="tx", kw_only=True)

    def __post_init__(self) -> None:
        if self.axis not in FIXTURE_AXES or self.feature < 0:
            raise ValueError(
                f"no such number: feature {self.feature}, axis {self.axis}; features count from 0, "
                f"axes are {FIXTURE_AXES}"
            )

    @property
    def key(self) -> TermKey:
        feature = self.feature
        return feature, self.axis

    @property
    def fixture(self) -> bool:
        return True

    @property
    def unit(self) -> str:
        """rad of a tilt, else mm."""
        kind = self.axis[0]
        if kind == "r":
            return "rad"
        return "mm"


POWERS = {1: "", 2: "²", 3: "³"}


def ratio(top: str, bottom: str) -> str:
    """Return the unit top/bottom, common factors cancelled: ("mm", "mm °C") -> "1/°C"."""
    if top == bottom:
        return f"{top}/{bottom}"
    divisor, _, dividend = bottom.partition("/")
    above = [top, *_unit_factors(dividend)]
    below = _unit_factors(divisor)
    for factor in list(below):
        if factor in above:
            above.remove(factor)
            below.remove(factor)
    numerator = _write_powers(above) or "1"
    if not below:
        return numerator
    denominator = _write_powers(below)
    if " " in denominator:
        denominator = f"({denominator})"
    return f"{numerator}/{denominator}"


def _write_powers(factors: Sequence[str]) -> str:
    """Write a product of units, those that are equal as a power."""
    written = []
    for factor, power in Counter(factors).items():
        written.append(factor + POWERS.get(power, f"^{power}"))
    return " ".join(written)


def _unit_factors(unit: str) -> list[str]:
    """List the factors of a unit's part without a quotient, ones left out."""
    return [factor for factor in unit.split() if factor != "1"]


@cache_hash
@dataclass(frozen=True)
class Mechanism:
    """A named bundle of terms: what goes wrong, in one sentence, with its equation and its source.
    `contrary`: the sentence where its terms have the signs that physics does not expect; without
    one they are then not told as this mechanism. Where physics expects neither, it is the sentence of
    negative terms. A sentence says what moves; `usual_causes` are
    the parts that usually do this, of which the data say nothing."""

    name: str
    terms: tuple[Term, ...]
    sentence: str = ""
    equation: str = ""
    source: str = ""
    contrary: str = ""
    usual_causes: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        check_type("name", self.name, str, "the mechanism's name")
        terms = collect_all("terms", self.terms, Term, TERMS_EXPECTED)
        object.__setattr__(self, "terms", terms)

    @property
    def stem(self) -> str:
        """The registered name without its joint: "backlash" of "backlash:3"."""
        stem, _, _ = self.name.partition(":")
        return stem

    @property
    def joint(self) -> int | None:
        """The joint of a registered name that has one: 3 of "backlash:3"."""
        _, _, joint = self.name.partition(":")
        if joint.isdecimal():
            return int(joint)
        return None

    @property
    def signs(self) -> tuple[int, ...]:
        """The sign that naming asks of each term, 0 for either."""
        signs = []
        for term in self.terms:
            sign = term.sign
            if self.contrary:
                sign = 0
            signs.append(sign)
        return tuple(signs)

    def names(self) -> frozenset[str]:
        """Return the names its causes need from the state."""
        return NO_NAMES.union(*self._names_by_place.values())

    def names_by_place(self) -> dict[tuple[int, str], frozenset[str]]:
        """Return the places (frame, axis) where it acts, each with the names its causes need
        there."""
        return dict(self._names_by_place)

    @cached_property
    def _names_by_place(self) -> dict[tuple[int, str], frozenset[str]]:
        names: dict[tuple[int, str], frozenset[str]] = {}
        for term in self.terms:
            for screw in term.screws:
                place = screw.frame, screw.axis
                names[place] = names.get(place, NO_NAMES) | screw.cause.names()
        return names


def terms_of(mechanisms: Iterable[Mechanism]) -> tuple[Term, ...]:
    """Return the distinct terms of several mechanisms, in order; a term that two share is fitted
    once."""
    distinct: dict[TermKey, Term] = {}
    for mechanism in mechanisms:
        for term in mechanism.terms:
            distinct.setdefault(term.key, term)
    return tuple(distinct.values())


def foreign(cause: Cause) -> str | None:
    """Say what in a cause is not of modelsel.mechanisms.causes; None where all is: such a cause
    prints in no grammar, and no file could hold it. A class derived from one of those is not that
    one."""
    if type(cause) not in KINDS:
        return f"{type(cause).__name__} is a kind of cause of its own"
    if isinstance(cause, Combined):
        return foreign(cause.left) or foreign(cause.right)
    if not isinstance(cause, Applied):
        return None
    if cause.function not in FUNCTIONS:
        return f"{cause.function} is a function of its own"
    return foreign(cause.argument)


def unstorable(mechanism: Mechanism) -> str | None:
    """Say why no calibration could store a mechanism, in a sentence; None where one can."""
    misfit = find_name_problem(mechanism.name, MAX_TEXT_LENGTH)
    if misfit is not None:
        return f"its name is not one: {misfit}."
    symbols = [term.symbol for term in mechanism.terms]
    texts = (mechanism.sentence, mechanism.equation, mechanism.source, *symbols)
    texts += mechanism.usual_causes
    character = find_hidden_character("".join(texts))
    if character is not None:
        return (
            f"its texts hold U+{ord(character):04X}, which nobody sees and no report can show: "
            "write them without, each on one line."
        )
    causes = [screw.cause for term in mechanism.terms for screw in term.screws]
    unknown = next(filter(None, map(foreign, causes)), None)
    if unknown is None:
        return None
    return (
        f"{unknown}, which no calibration can store: build it of those in "
        "modelsel.mechanisms.causes."
    )


def _check_place(frame: Any, axis: Any) -> None:
    """Refuse what is not a frame's number and the name of an axis. Raises ArgumentError."""
    is_axis = isinstance(axis, str) and axis in AXES
    is_frame = isinstance(frame, (int, np.integer)) and frame >= 1
    if is_axis and is_frame:
        return
    shown = axis if isinstance(axis, str) else describe_value(axis)
    found = describe_value(frame)
    raise ArgumentError(
        f"no such place: frame {found}, axis {shown}; frames count from 1, axes are {AXES}"
    )


def as_mechanisms(given: Any) -> tuple[Mechanism, ...]:
    """Return mechanisms that are given in a list. Raises ArgumentError for anything else."""
    expected = 'a list of mechanisms, as (mechanism("geometric", robot),)'
    return collect_all("mechanisms", given, Mechanism, expected)


def letter(frame: int, axis: str) -> str:
    """Return the paper's symbol of a geometric parameter: a1 … γ7."""
    axis_letter = LETTERS[axis]
    return f"{axis_letter}{frame}"


def describe_frame_motion(frame: int, axis: str) -> str:
    """Describe how a place of the arm moves: "Frame 5 shifts along its y axis"."""
    motion = MOTIONS[axis[0]]
    return f"Frame {frame} {motion} its {axis[1]} axis"
