"""Causes, terms, mechanisms and robots as plain JSON values, and back: structure as structure, nothing parsed from text."""
from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from ..machine.robot import Joint, Robot
from ..words.errors import StudyError
from ..words.rigid import Array
from ..wrong.causes import FUNCTIONS, RANK, Applied, Bump, Cause, Combined, Member, Named, Number
from ..wrong.screws import Mechanism, Screw, Term, foreign

DEEPEST = 200   # a cause nested more deeply than this is no cause of ours


def cause_record(cause: Cause) -> dict[str, Any]:
    """A cause as nested JSON values. Raises StudyError for a kind of cause that is not of modelsel.wrong.causes."""
    if (what := foreign(cause)) is not None:
        raise StudyError(f"{what}, which no calibration can store: build it of those in modelsel.wrong.causes.")
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
    keys = set(record)
    if keys == {"number", "unit"}:
        return Number(_float(record["number"]), str(record["unit"]))
    if keys == {"name", "unit"}:
        return Named(str(record["name"]), str(record["unit"]))
    if keys == {"function", "of"} and record["function"] in FUNCTIONS:
        return Applied(record["function"], cause_of(record["of"], depth + 1))
    if keys == {"operator", "left", "right"} and record["operator"] in RANK:
        return Combined(record["operator"], cause_of(record["left"], depth + 1), cause_of(record["right"], depth + 1))
    if keys == {"member", "index"} and record["member"] in ("target", "group"):
        return Member(record["member"], int(record["index"]))
    if keys == {"spline", "centre", "width"}:
        return Bump(str(record["spline"]), _float(record["centre"]), _float(record["width"]))
    raise ValueError(f"not a cause: {str(dict(record))[:80]}")


def mechanism_record(mechanism: Mechanism) -> dict[str, Any]:
    """A mechanism with its terms, each with its screws; what a term's causes look like in print stands beside them."""
    return {"name": mechanism.name, "sentence": mechanism.sentence, "equation": mechanism.equation, "source": mechanism.source,
            "terms": [{"symbol": t.symbol, "unit": t.unit, "size": None if t.size is None else list(t.size), "sign": t.sign,
                       "screws": [{"frame": s.frame, "axis": s.axis, "cause": cause_record(s.cause), "prints": str(s.cause)}
                                  for s in t.screws]} for t in mechanism.terms]}


def mechanism_of(record: Mapping[str, Any]) -> Mechanism:
    """The mechanism of a record. Raises ValueError or KeyError."""
    terms = tuple(Term(str(t["symbol"]), tuple(Screw(int(s["frame"]), str(s["axis"]), cause_of(s["cause"])) for s in t["screws"]),
                       None if t["size"] is None else (_float(t["size"][0]), _float(t["size"][1])), int(t["sign"]))
                  for t in record["terms"])
    return Mechanism(str(record["name"]), terms, str(record["sentence"]), str(record["equation"]), str(record["source"]))


def robot_record(robot: Robot) -> dict[str, Any]:
    """The nominal robot in full."""
    return {"name": robot.name, "source": robot.source, "gravity": None if robot.gravity is None else list(robot.gravity),
            "joints": [{"before_mm": j.before[:3].tolist(), "prismatic": j.prismatic,
                        "limits": None if j.limits is None else list(j.limits), "mass_kg": j.mass, "com_mm": list(j.com)}
                       for j in robot.joints], "last_mm": robot.last[:3].tolist()}


def robot_of(record: Mapping[str, Any]) -> Robot:
    """The nominal robot of a record. Raises ValueError or KeyError."""
    joints = []
    for j in record["joints"]:
        limits, (x, y, z) = j["limits"], j["com_mm"]
        joints.append(Joint(square(j["before_mm"]), bool(j["prismatic"]),
                            None if limits is None else (_float(limits[0]), _float(limits[1])),
                            None if j["mass_kg"] is None else _float(j["mass_kg"]), (_float(x), _float(y), _float(z))))
    g = record["gravity"]
    return Robot(str(record["name"]), str(record["source"]), tuple(joints), square(record["last_mm"]),
                 None if g is None else (_float(g[0]), _float(g[1]), _float(g[2])))


def square(rows: Sequence[Sequence[float]]) -> Array:
    """The (4, 4) transform of its upper three rows [mm]. Raises ValueError."""
    return np.vstack([numbers(rows, (3, 4)), [0, 0, 0, 1]])


def numbers(value: Any, shape: tuple[int, ...]) -> Array:
    """A finite array of a shape (-1: any length). Raises ValueError."""
    out = np.array(value, dtype=float).reshape(shape)
    if not np.isfinite(out).all():
        raise ValueError("a number is not finite")
    return out


def _float(value: Any) -> float:
    return float(numbers(value, ()))
