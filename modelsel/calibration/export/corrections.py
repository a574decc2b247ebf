"""A calibration in other programs' forms, each read back and held against the fit; what a form
cannot carry is said."""

from __future__ import annotations

import csv
import io
from collections.abc import Sequence
from typing import TYPE_CHECKING

from ..._names import guard_cell, unguard_cell
from ...mechanisms.cause_formulas import parse
from ...mechanisms.causes import Applied, Bump, Cause, Combined, Named
from ...mechanisms.terms import Screw, Term
from ..constant_part import Part, split_parts
from .form import Exported, measure_whole

if TYPE_CHECKING:
    from ..calibration import Calibration

HEADER = (
    "target",
    "mechanism",
    "symbol",
    "frame",
    "axis",
    "cause",
    "knot",
    "knot_width",
    "value",
    "standard_error",
    "unit",
)


def to_csv(c: Calibration, notes: Sequence[str] = ()) -> Exported:
    """Write a row a screw: place, cause, value. A free function has a row a knot: a cubic B-spline
    centred there."""
    stream = io.StringIO()
    writer = csv.writer(stream, lineterminator="\n")
    writer.writerow(HEADER)
    for t, name in enumerate(c.targets):
        for p in (p for some in split_parts(c, t) for p in some):
            for s in p.term.screws:
                bump = _find_bump(s.cause)
                knot = ("", "") if bump is None else (repr(bump.centre), repr(bump.width))
                texts = map(guard_cell, (name, p.mechanism, p.term.symbol))
                writer.writerow(
                    [
                        *texts,
                        s.frame,
                        s.axis,
                        guard_cell(str(s.cause)),
                        *knot,
                        repr(p.value),
                        repr(p.error),
                        guard_cell(p.term.unit),
                    ]
                )
    return measure_whole(c, stream.getvalue(), lambda text, t: _parse_csv(text, c, c.targets[t]))


def _find_bump(cause: Cause) -> Bump | None:
    if isinstance(cause, Combined):
        return _find_bump(cause.left) or _find_bump(cause.right)
    return (
        cause
        if isinstance(cause, Bump)
        else _find_bump(cause.argument)
        if isinstance(cause, Applied)
        else None
    )


def _restore_bump(cause: Cause, bump: Bump) -> Cause:
    """Return a cause with the spline back where its name stands."""
    if isinstance(cause, Combined):
        return Combined(
            cause.operator, _restore_bump(cause.left, bump), _restore_bump(cause.right, bump)
        )
    return bump if cause == Named("free") else cause


def _parse_csv(text: str, c: Calibration, target: str) -> list[Part]:
    units = dict.fromkeys([*c.needs(), *c.ranges, "free"], "1")
    out = []
    for row in csv.DictReader(io.StringIO(text)):
        if unguard_cell(row["target"]) != target:
            continue
        printed = unguard_cell(row["cause"])
        _, _, after = printed.partition("free(")
        name, _, _ = after.partition(")")
        formula = printed.replace(f"free({name})", "free")
        cause = parse(formula, units)
        if row["knot"]:
            knot = float(row["knot"])
            width = float(row["knot_width"])
            bump = Bump(name, knot, width)
            cause = _restore_bump(cause, bump)
        frame = int(row["frame"])
        screw = Screw(frame, row["axis"], cause)
        term = Term(row["symbol"], (screw,))
        value = float(row["value"])
        part = Part("", term, value, 0.0)
        out.append(part)
    return out
