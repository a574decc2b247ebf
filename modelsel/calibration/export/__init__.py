"""Write a calibration in the forms that other programs read: URDF, DH tables, JSON, CSV, Python,
lookup tables."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from itertools import chain
from typing import Any

import numpy as np

from ..._names import find_name_problem, quote_name
from ...exceptions import StudyError
from ...mechanisms.causes import Named
from ...mechanisms.serialization import cause_from_record, cause_record
from ...mechanisms.terms import Screw, Term
from ...robot.rigid import AXES
from ..calibration import Calibration
from ..constant_part import (
    Part,
    alone,
    constants,
    enough,
    missing,
    parts,
    points,
    rms_and_most,
    workspace,
)
from .chains import _to_dh, to_urdf
from .corrections import to_csv
from .form import Exported, _missing, _whole
from .lookup import FINE_MM, read_table, still, tables, write_tables
from .notes import notes_of
from .python import to_python


def export(c: Calibration, form: str) -> Exported:
    """A calibration as "urdf", "dh", "mdh", "json", "csv", "python" or "table"; of a form that
    cannot carry all of it, the best robot that it can carry, refitted. Raises StudyError where a
    name cannot be one."""
    named = [
        ("study", c.study),
        ("robot", c.robot.name),
        *(("target", t) for t in c.targets),
        *(("group", g) for g in c.groups),
    ]
    if wrong := [
        f"{what} {quote_name(name)}: not a name: {why}."
        for what, name in named
        if (why := find_name_problem(name)) is not None
    ]:
        raise StudyError(*wrong)
    what = enough(c, CARRIES.get(form, "whole"))
    own, notes = alone(c, what), notes_of(c, what, form in GEOMETRY)
    made, difference = FORMS[form](own, notes), []
    for t in range(len(c.targets) if form in GEOMETRY else 1):
        at = workspace(c, t)
        difference.append(points(at, [*chain(*parts(c, t))]) - points(at, [*chain(*parts(own, t))]))
    return replace(
        made,
        left_out=_missing(missing(c, what)),
        left_out_mm=rms_and_most(np.concatenate(difference)),
        notes=(*notes, *made.notes),
        errors=None if c.refits is None else c.refits.errors(what),
    )


# -- corrections: everything the model says, as rows
# ---------------------------------------------------------------------------


def to_json(c: Calibration, notes: Sequence[str] = ()) -> Exported:
    """Constant corrections of every frame and every other screw, with its cause as structure."""
    record = {
        "schema": 1,
        "kind": "corrections",
        "study": c.study,
        "robot": c.robot.name,
        "axes": list(AXES),
        "says": "H of a frame = constant entries + Σ estimate × cause; Trans(tx, ty, tz) Rx Ry Rz, mm and rad",
        "constant": {name: constants(c, t).tolist() for t, name in enumerate(c.targets)},
        "effects": [
            {
                "mechanism": p.mechanism,
                "symbol": p.term.symbol,
                "frame": s.frame,
                "axis": s.axis,
                "cause": cause_record(s.cause),
                "prints": str(s.cause),
                "estimate": p.value,
                "standard_error": p.error,
                "unit": p.term.unit,
            }
            for p in parts(c)[1]
            for s in p.term.screws
        ],
    }
    text = json.dumps(record, ensure_ascii=False, indent=1, allow_nan=False) + "\n"
    return _whole(c, text, lambda text, t: _from_json(json.loads(text), c.targets[t]))


def _from_json(record: Mapping[str, Any], target: str) -> list[Part]:
    out = [
        Part("", Term("", (Screw(f + 1, axis),)), value, 0.0)
        for f, row in enumerate(record["constant"][target])
        for axis, value in zip(AXES, row, strict=True)
    ]
    return out + [
        Part(
            "",
            Term(e["symbol"], (Screw(e["frame"], e["axis"], cause_from_record(e["cause"])),)),
            e["estimate"],
            0.0,
        )
        for e in record["effects"]
    ]


def to_table(c: Calibration, notes: Sequence[str] = ()) -> Exported:
    """Every correction: the constant ones, and those of one or two values of the state on a grid to
    interpolate in."""
    constant, varying = parts(c)
    at = workspace(c)
    made, over = tables(c, varying, at)
    assert not over, "what no table holds was left out before"
    text = write_tables([*still(constants(c)), *made])
    read = read_table(text, at)
    tabled = {f"table_{k}": values for k, (_, _, values) in enumerate(read)}
    bound = at.anew(data=replace(at.data, covariates={**at.data.covariates, **tabled}))
    again = [
        Part("table", Term("", (Screw(frame, axis, Named(f"table_{k}")),)), 1.0, 0.0)
        for k, (frame, axis, _) in enumerate(read)
    ]
    rms, most = rms_and_most(points(bound, again) - points(at, constant + varying))
    said = (
        [f'the constant corrections are those of target "{c.targets[0]}"']
        if len(c.targets) > 1
        else []
    )
    return Exported(
        text,
        most,
        len(at),
        notes=(
            *said,
            f"interpolated linearly: {rms * 1e3:.2g} µm rms, {most * 1e3:.2g} µm at most"
            + (", beside a jump" if most > 10 * FINE_MM else ""),
        ),
    )


FORMS: dict[str, Callable[[Calibration, Sequence[str]], Exported]] = {
    "urdf": to_urdf,
    "dh": lambda c, notes: _to_dh(c, False, notes),
    "mdh": lambda c, notes: _to_dh(c, True, notes),
    "json": to_json,
    "csv": to_csv,
    "python": to_python,
    "table": to_table,
}
GEOMETRY = ("urdf", "dh", "mdh")
CARRIES = {**dict.fromkeys(GEOMETRY, "geometry"), "table": "table"}  # others carry the whole model
__all__ = ["FORMS", "Exported", "export"]
