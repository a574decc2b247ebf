"""Mechanisms, terms and causes as plain values, and back."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from .._json import PAIR, Each, Maybe, misfit
from .._names import TEXT, plain_word, unfit
from .._typing import LARGEST
from ..exceptions import StudyError
from ..robot.rigid import AXES
from .causes import FUNCTIONS, RANK, Applied, Bump, Cause, Combined, Member, Named, Number
from .terms import Mechanism, Screw, Term, foreign


def mechanism_card(mechanism: Mechanism) -> dict[str, Any]:
    """A mechanism as plain values."""

    def expected(size: tuple[float, float] | None, sign: int) -> str:
        words = [] if size is None else [f"usually {size[0]:g} to {size[1]:g}"]
        if sign:
            words.append("positive" if sign > 0 else "negative")
        return f"  ({', '.join(words)})" if words else ""

    return {
        "name": mechanism.name,
        "sentence": mechanism.sentence,
        "equation": mechanism.equation,
        "source": mechanism.source,
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


DEEPEST = 200  # a cause nested more deeply than this is no cause of ours
SCREW = {"frame": int, "axis": frozenset(AXES), "cause": {}, "prints": str}
TERM = {
    "symbol": str,
    "unit": str,
    "size": Maybe(PAIR),
    "sign": int,
    "usual?": float,
    "screws": Each(SCREW, least=1),
}


def cause_record(cause: Cause) -> dict[str, Any]:
    """A cause as nested JSON values. Raises StudyError for a kind of cause that is not of
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
        case Member(kind, index):
            return {"member": kind, "index": index}
        case Bump(name, centre, width):
            return {"spline": name, "centre": centre, "width": width}
    raise AssertionError(f"{type(cause).__name__} is one of KINDS without a record")


def cause_of(record: Any, depth: int = 0) -> Cause:
    """The cause of a record. Raises ValueError for anything else."""
    if not isinstance(record, Mapping) or depth > DEEPEST:
        raise ValueError(f"not a cause: {str(record)[:60]}")
    found = [
        make
        for shape, make in CAUSES
        if record.keys() == shape.keys() and misfit(dict(record), shape) is None
    ]
    if not found:
        raise ValueError(f"not a cause: {str(dict(record))[:80]}")
    return found[0](record, depth + 1)


def _word(name: str) -> str:
    """A name of the state. Raises ValueError for a text that is no plain word."""
    if not plain_word(name):
        raise ValueError(f'"{name[:40]}" is not a name of the state')
    return name


CAUSES: tuple[tuple[dict[str, Any], Callable[[Mapping[str, Any], int], Cause]], ...] = (
    ({"number": float, "unit": str}, lambda r, _: Number(float(r["number"]), r["unit"])),
    ({"name": str, "unit": str}, lambda r, _: Named(_word(r["name"]), r["unit"])),
    (
        {"function": frozenset(FUNCTIONS), "of": {}},
        lambda r, deep: Applied(r["function"], cause_of(r["of"], deep)),
    ),
    (
        {"operator": frozenset(RANK), "left": {}, "right": {}},
        lambda r, deep: Combined(
            r["operator"], cause_of(r["left"], deep), cause_of(r["right"], deep)
        ),
    ),
    (
        {"member": frozenset(["target", "group"]), "index": int},
        lambda r, _: Member(r["member"], r["index"]),
    ),
    (
        {"spline": str, "centre": float, "width": float},
        lambda r, _: Bump(_word(r["spline"]), float(r["centre"]), float(r["width"])),
    ),
)


def members(cause: Cause) -> list[Member]:
    """The targets and groups that a cause is of."""
    match cause:
        case Member():
            return [cause]
        case Applied(_, argument):
            return members(argument)
        case Combined(_, left, right):
            return [*members(left), *members(right)]
    return []


def mechanism_record(mechanism: Mechanism) -> dict[str, Any]:
    """A mechanism with its terms, each with its screws; what a term's causes look like in print
    stands beside them."""
    return {
        "name": mechanism.name,
        "sentence": mechanism.sentence,
        "equation": mechanism.equation,
        "source": mechanism.source,
        **({"contrary": mechanism.contrary} if mechanism.contrary else {}),
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


def mechanism_of(record: Mapping[str, Any]) -> Mechanism:
    """The mechanism of a record of its shape. Raises ValueError where its units or what its causes
    print are not the stored ones."""
    terms = tuple(
        Term(
            t["symbol"],
            tuple(Screw(s["frame"], s["axis"], cause_of(s["cause"])) for s in t["screws"]),
            None if t["size"] is None else (float(t["size"][0]), float(t["size"][1])),
            t["sign"],
            None if "usual" not in t else float(t["usual"]),
        )
        for t in record["terms"]
    )
    for term, stored in zip(terms, record["terms"], strict=True):
        if term.unit != stored["unit"] or [str(s.cause) for s in term.screws] != [
            s["prints"] for s in stored["screws"]
        ]:
            raise ValueError(
                f"what {term.symbol} of {record['name']} prints is not what its screws say"
            )
        if (
            term.sign not in (-1, 0, 1)
            or term.size is not None
            and not 0 <= term.size[0] <= term.size[1]
        ):
            raise ValueError(f"the usual size or sign of {term.symbol} of {record['name']} is none")
    if (why := unfit(record["name"], TEXT)) is not None:
        raise ValueError(f"the name of a mechanism is not one: {why}")
    if any(t.usual is not None and not 0 < t.usual < LARGEST for t in terms):
        raise ValueError(f"the usual size of a parameter of {record['name']} must be above 0")
    return Mechanism(
        record["name"],
        terms,
        record["sentence"],
        record["equation"],
        record["source"],
        record.get("contrary", ""),
    )
