"""Screw, Term, Mechanism: every error of a robot as a value that prints, hashes and compares.

The screw of frame k sits between the nominal transform N_k and the joint's own rotation, as H_k in
the paper; its axes are tx ty tz rx ry rz of that frame; with cause 1 they are the paper's a b c α β
γ. Frame n+1 is the target."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from .._hashing import hashed_once
from .._names import TEXT, unfit, unseen
from ..robot.rigid import AXES
from .causes import FUNCTIONS, ONE, Applied, Bump, Cause, Combined, Member, Named, Number

FIXTURE_AXES = (*AXES, "length")  # of a feature of the set-up: its place, its tilt, a length
KINDS = (Number, Named, Applied, Combined, Member, Bump)
PLAIN = {"rad/rad": "1", "mm/mm": "1"}  # a share: a turn by another, a shift by another
LETTERS = dict(zip(AXES, "abcαβγ", strict=True))


@hashed_once
@dataclass(frozen=True)
class Screw:
    """WHERE x WHY: a small twist on one axis of one frame, scaled by its cause. Frame 0 is no frame
    of the arm but a feature of the set-up (a wire's anchor, a plane), which moves; it may also have
    a length."""

    frame: int
    axis: str
    cause: Cause = ONE

    def __post_init__(self) -> None:
        feature = (
            self.frame == 0 and isinstance(self.cause, Member) and self.cause.kind == "feature"
        )
        if self.axis not in (FIXTURE_AXES if feature else AXES) or self.frame < (
            0 if feature else 1
        ):
            raise ValueError(
                f"no such place: frame {self.frame}, axis {self.axis}; frames count from 1, axes are {AXES}"
            )

    def __str__(self) -> str:
        return f"frame {self.frame} {self.axis} · {self.cause}"


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

    @property
    def fixture(self) -> bool:
        """Whether it moves a feature of the set-up, not the arm."""
        return self.screws[0].frame == 0

    @property
    def unit(self) -> str:
        """mm or rad per unit of the cause, from its screws; all must agree (rad counts as 1).
        Raises ValueError."""
        units = {
            ratio("rad" if s.axis[0] == "r" else "mm", s.cause.unit): None for s in self.screws
        }
        if len({PLAIN.get(u, u.replace("rad", "1")) for u in units}) != 1:
            raise ValueError(
                f"the screws of {self.symbol} have different units: {', '.join(units)}"
            )
        return "1" if PLAIN.keys() <= units.keys() else max(units, key=lambda u: "rad" in u)


def ratio(top: str, bottom: str) -> str:
    """The unit top/bottom, common factors cancelled: ("mm", "mm °C") -> "1/°C"."""
    if top == bottom:
        return f"{top}/{bottom}"
    up, down = [top], [factor for factor in bottom.replace("/", " / ").split() if factor != "1"]
    if "/" in down:
        up, down = up + down[down.index("/") + 1 :], down[: down.index("/")]
    for factor in list(down):
        if factor in up:
            up.remove(factor)
            down.remove(factor)
    over = " ".join(up) or "1"
    return (
        over
        if not down
        else f"{over}/{down[0]}"
        if len(down) == 1
        else f"{over}/({' '.join(down)})"
    )


@dataclass(frozen=True)
class Mechanism:
    """A named bundle of terms: what goes wrong, in one sentence, with its equation and its source.
    `contrary`: the sentence where its terms have the signs that physics does not expect; without
    one they are then not told as this mechanism."""

    name: str
    terms: tuple[Term, ...]
    sentence: str = ""
    equation: str = ""
    source: str = ""
    contrary: str = ""

    @property
    def stem(self) -> str:
        """The registered name without its joint: "backlash" of "backlash:3"."""
        return self.name.partition(":")[0]

    @property
    def joint(self) -> int | None:
        """The joint of a registered name that has one: 3 of "backlash:3"."""
        joint = self.name.partition(":")[2]
        return int(joint) if joint.isdigit() else None

    @property
    def signs(self) -> tuple[int, ...]:
        """The sign that naming asks of each term, 0 for either."""
        return tuple(0 if self.contrary else t.sign for t in self.terms)

    def names(self) -> frozenset[str]:
        """Names its causes need from the state."""
        return frozenset[str]().union(*(s.cause.names() for t in self.terms for s in t.screws))


def terms_of(mechanisms: Iterable[Mechanism]) -> tuple[Term, ...]:
    """The distinct terms of several mechanisms, in order; a term that two share is fitted once."""
    seen: dict[tuple[Screw, ...], Term] = {}
    for mechanism in mechanisms:
        for term in mechanism.terms:
            seen.setdefault(term.screws, term)
    return tuple(seen.values())


def foreign(cause: Cause) -> str | None:
    """What in a cause is not of modelsel.mechanisms.causes, in words: it prints in no grammar, and no
    file could hold it. A class derived from one of those is not that one."""
    if type(cause) not in KINDS:
        return f"{type(cause).__name__} is a kind of cause of its own"
    if isinstance(cause, Applied):
        return (
            foreign(cause.argument)
            if cause.function in FUNCTIONS
            else f"{cause.function} is a function of its own"
        )
    return foreign(cause.left) or foreign(cause.right) if isinstance(cause, Combined) else None


def unstorable(mechanism: Mechanism) -> str | None:
    """Why no calibration could store a mechanism, in a sentence; None where one can."""
    if (why := unfit(mechanism.name, TEXT)) is not None:
        return f"its name is not one: {why}."
    texts = (
        mechanism.sentence,
        mechanism.equation,
        mechanism.source,
        *(t.symbol for t in mechanism.terms),
    )
    if (c := unseen("".join(texts))) is not None:
        return f"its texts hold U+{ord(c):04X}, which nobody sees and no report can show: write them without, each on one line."
    found = next(
        (what for t in mechanism.terms for s in t.screws if (what := foreign(s.cause))), None
    )
    return (
        None
        if found is None
        else f"{found}, which no calibration can store: build it of those in modelsel.mechanisms.causes."
    )


def letter(frame: int, axis: str) -> str:
    """The paper's symbol of a geometric parameter: a1 … γ7."""
    return f"{LETTERS[axis]}{frame}"
