"""Parts of a study's errors for tests that need no study."""

from __future__ import annotations

import math

import numpy as np

from modelsel._records import parse_record
from modelsel.fitting.error_structure import ErrorPart, ErrorStructure
from modelsel.results.repeatability.repeatability import describe_errors
from modelsel.results.schemas.schema import ErrorPartRecord

TOLD_BY = {"instrument": "what is left", "group": "groups", "lasting": "order"}


def part(name: str, scale: float, low: float, high: float, **more: object) -> ErrorPart:
    """A part of the errors; a joint turns, and everything else is a length, unless told otherwise."""
    values = {
        "unit": "rad" if name.startswith("joint") else "mm",
        "share": 0.4,
        "at_target": 0.0112,
        "told_by": TOLD_BY.get(name, "repeats"),
    } | more
    return ErrorPart(name=name, scale=scale, low=low, high=high, **values)


INSTRUMENT = part("instrument", 0.0081, 0.0076, 0.0087, share=0.6)


def records(*parts: ErrorPart) -> list[ErrorPartRecord]:
    """The parts as result.json has them."""
    described = describe_errors(ErrorStructure(parts))
    return [parse_record(one, ErrorPartRecord) for one in described]


def many(count: int) -> list[ErrorPart]:
    """The instrument and more parts, whose shares add up to one."""
    squares = np.arange(1.0, count + 1)
    shares = squares / squares.sum()
    parts = [part("instrument", 0.01, 0.009, 0.011, share=shares[0], at_target=0.01 * math.sqrt(3))]
    total = 3 * 0.01**2 / shares[0]
    for joint, share in enumerate(shares[1:].tolist(), 1):
        moved = math.sqrt(share * total)
        parts.append(part(f"joint {joint}", 1e-5, 8e-6, 2e-5, share=share, at_target=moved))
    return parts
