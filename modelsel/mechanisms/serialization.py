"""Mechanisms, terms and causes as plain values, and back: structure as structure, nothing parsed
from text."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, Literal

from pydantic import (
    AfterValidator,
    Discriminator,
    Field,
    Tag,
    TypeAdapter,
    ValidationError,
    model_validator,
)

from .._names import MAX_TEXT_LENGTH, find_name_problem, is_plain_word
from .._records import Number as FiniteNumber
from .._records import OneOf, Pair, StrictRecord, Text, Whole, describe_problem
from .._typing import LARGEST
from ..exceptions import StudyError
from ..robot.rigid import AXES
from .cause_functions import FUNCTIONS
from .causes import RANK, Applied, Bump, Cause, Combined, Member, Named, Number
from .terms import Mechanism, Screw, Term, foreign


def describe_mechanism(mechanism: Mechanism) -> dict[str, Any]:
    """Describe a mechanism in plain values, for people and tables."""

    def expected(size: tuple[float, float] | None, sign: int) -> str:
        words = []
        if size is not None:
            lower, upper = size
            words.append(f"usually {lower:g} to {upper:g}")
        if sign > 0:
            words.append("positive")
        if sign < 0:
            words.append("negative")
        if not words:
            return ""
        listed = ", ".join(words)
        return f"  ({listed})"

    return {
        "name": mechanism.name,
        "sentence": mechanism.sentence,
        "equation": mechanism.equation,
        "source": mechanism.source,
        "usual_causes": list(mechanism.usual_causes),
        "terms": [
            {
                "symbol": t.symbol,
                "unit": t.unit,
                "screws": [str(s) for s in t.screws],
                "size": t.size,
                "sign": t.sign,
                "expected": expected(t.size, t.sign),
            }
            for t in mechanism.terms
        ],
    }


# -- the records
# ------------------------------------------------------------------------------------------------


def _check_word(name: str) -> str:
    if not is_plain_word(name):
        raise ValueError(f'"{name[:40]}" is not a name of the state')
    return name


def _check_name(name: str) -> str:
    if (why := find_name_problem(name, MAX_TEXT_LENGTH)) is not None:
        raise ValueError(f"not a mechanism's name: {why}")
    return name


Word = Annotated[Text, AfterValidator(_check_word)]


class _CauseRecord(StrictRecord, extra="forbid"):
    """One node of a cause: its keys say which kind it is."""


class NumberRecord(_CauseRecord):
    """A constant and its unit."""

    number: FiniteNumber
    unit: Text


class NamedRecord(_CauseRecord):
    """A value of the state, by its name."""

    name: Word
    unit: Text


class AppliedRecord(_CauseRecord):
    """A function of a cause."""

    function: Annotated[str, OneOf(tuple(FUNCTIONS))]
    of: CauseRecord


class CombinedRecord(_CauseRecord):
    """Two causes and the operator between them."""

    operator: Annotated[str, OneOf(tuple(RANK))]
    left: CauseRecord
    right: CauseRecord


class MemberRecord(_CauseRecord):
    """One for the rows of one target or group, zero for the others; the number that it is called by,
    where that is not one more than its index."""

    member: Literal["target", "group"]
    index: Whole
    called: Whole | None = None


class SplineRecord(_CauseRecord):
    """A cubic B-spline of a value of the state: one column of a free function."""

    spline: Word
    centre: FiniteNumber
    width: FiniteNumber


KEYS = ("number", "name", "function", "operator", "member", "spline")  # one names a cause's kind


def _kind(value: Any) -> str | None:
    """Return the tag of a cause's kind: the key that it alone has."""
    keys = value
    if isinstance(value, _CauseRecord):
        keys = type(value).model_fields
    if not isinstance(keys, Mapping):
        return None
    for key in KEYS:
        if key in keys:
            return f"<{key}>"
    return None


CauseRecord = Annotated[
    Annotated[NumberRecord, Tag("<number>")]
    | Annotated[NamedRecord, Tag("<name>")]
    | Annotated[AppliedRecord, Tag("<function>")]
    | Annotated[CombinedRecord, Tag("<operator>")]
    | Annotated[MemberRecord, Tag("<member>")]
    | Annotated[SplineRecord, Tag("<spline>")],
    Discriminator(_kind, custom_error_type="cause", custom_error_message="a cause"),
]


class ScrewRecord(StrictRecord):
    """A small shift or turn at one axis of one frame, scaled by a cause; `prints` is what the cause
    looks like in print."""

    frame: Whole
    axis: Annotated[str, OneOf(AXES)]
    cause: CauseRecord
    prints: Text


class TermRecord(StrictRecord):
    """One fitted number: the screws it drives, its usual size and sign."""

    symbol: Text
    unit: Text
    size: Pair | None
    sign: Literal[-1, 0, 1]
    usual: Annotated[float, Field(gt=0, lt=LARGEST)] | None = None
    screws: Annotated[list[ScrewRecord], Field(min_length=1)]

    @model_validator(mode="after")
    def _check_size(self) -> TermRecord:
        if self.size is None:
            return self
        lower, upper = self.size
        is_interval = 0 <= lower <= upper
        if not is_interval:
            raise ValueError("size: expected the lower and the upper bound, both 0 or more")
        return self


class MechanismRecord(StrictRecord):
    """A mechanism with its terms."""

    name: Annotated[Text, AfterValidator(_check_name)]
    sentence: Text
    equation: Text
    source: Text
    contrary: Text = ""
    usual_causes: list[Text] = Field(default_factory=list)
    terms: list[TermRecord]


for _record in (AppliedRecord, CombinedRecord):
    _record.model_rebuild()
_CAUSE: TypeAdapter[CauseRecord] = TypeAdapter(CauseRecord)


# -- from values to records, and back
# ------------------------------------------------------------------------------------------------


def cause_record(cause: Cause) -> dict[str, Any]:
    """Return a cause as nested JSON values. Raises StudyError for a kind of cause that is not of
    modelsel.mechanisms.causes."""
    if (what := foreign(cause)) is not None:
        raise StudyError(
            f"{what}, which no calibration can store: build it of those in modelsel.mechanisms.causes."
        )
    match cause:
        case Number(number, unit):
            return {"number": number, "unit": unit}
        case Named(name, unit):
            return {"name": name, "unit": unit}
        case Applied(function, argument):
            return {"function": function, "of": cause_record(argument)}
        case Combined(operator, left, right):
            return {"operator": operator, "left": cause_record(left), "right": cause_record(right)}
        case Member(kind, index, number):
            own = {} if number is None else {"called": number}
            return {"member": kind, "index": index, **own}
        case Bump(name, centre, width):
            return {"spline": name, "centre": centre, "width": width}
    raise AssertionError(f"{type(cause).__name__} is one of KINDS without a record")


def cause_from_record(value: Any) -> Cause:
    """Return the cause of a JSON value. Raises ValueError where it is none."""
    try:
        return _restore_cause(_CAUSE.validate_python(value))
    except ValidationError as error:
        problem = describe_problem(error.errors(include_url=False)[0])
        raise ValueError(f"not a cause: {problem}") from None


def _restore_cause(record: CauseRecord) -> Cause:
    match record:
        case NumberRecord(number=number, unit=unit):
            return Number(number, unit)
        case NamedRecord(name=name, unit=unit):
            return Named(name, unit)
        case AppliedRecord(function=function, of=argument):
            return Applied(function, _restore_cause(argument))
        case CombinedRecord(operator=operator, left=left, right=right):
            return Combined(operator, _restore_cause(left), _restore_cause(right))
        case MemberRecord(member=kind, index=index, called=number):
            return Member(kind, index, number)
        case SplineRecord(spline=name, centre=centre, width=width):
            return Bump(name, centre, width)


def find_members(cause: Cause) -> list[Member]:
    """List the targets and groups that a cause names."""
    match cause:
        case Member():
            return [cause]
        case Applied(_, argument):
            return find_members(argument)
        case Combined(_, left, right):
            return [*find_members(left), *find_members(right)]
    return []


def mechanism_record(mechanism: Mechanism) -> dict[str, Any]:
    """Return a mechanism as JSON values: its terms, each with its screws, and what their causes look
    like in print."""
    return {
        "name": mechanism.name,
        "sentence": mechanism.sentence,
        "equation": mechanism.equation,
        "source": mechanism.source,
        **({"contrary": mechanism.contrary} if mechanism.contrary else {}),
        **({"usual_causes": list(mechanism.usual_causes)} if mechanism.usual_causes else {}),
        "terms": [
            {
                "symbol": t.symbol,
                "unit": t.unit,
                "size": None if t.size is None else list(t.size),
                "sign": t.sign,
                **({} if t.usual is None else {"usual": t.usual}),
                "screws": [
                    {
                        "frame": s.frame,
                        "axis": s.axis,
                        "cause": cause_record(s.cause),
                        "prints": str(s.cause),
                    }
                    for s in t.screws
                ],
            }
            for t in mechanism.terms
        ],
    }


def mechanism_from_record(record: MechanismRecord) -> Mechanism:
    """Return the mechanism of a record. Raises ValueError where its units or what its causes print
    are not the stored ones."""
    name = record.name
    terms = tuple(_restore_term(term, name) for term in record.terms)
    return Mechanism(
        name,
        terms,
        record.sentence,
        record.equation,
        record.source,
        record.contrary,
        tuple(record.usual_causes),
    )


def _restore_term(record: TermRecord, mechanism: str) -> Term:
    screws = []
    for screw_record in record.screws:
        cause = _restore_cause(screw_record.cause)
        screw = Screw(screw_record.frame, screw_record.axis, cause)
        screws.append(screw)
    size = None
    if record.size is not None:
        lower, upper = record.size
        size = (lower, upper)
    term = Term(record.symbol, tuple(screws), size, record.sign, record.usual)
    printed = [str(screw.cause) for screw in screws]
    stored = [screw_record.prints for screw_record in record.screws]
    differs = term.unit != record.unit or printed != stored
    if differs:
        raise ValueError(
            f"the unit or the printed causes of {term.symbol} of {mechanism} are not those of its screws"
        )
    return term
