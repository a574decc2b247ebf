"""A calibration in the forms that other programs read: URDF, DH tables, JSON, tables, robot programs."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ..._arguments import check_type
from ..._choices import EXPORT_FORMS
from ..._names import find_name_problem, quote_name
from ..._typing import Array
from ...exceptions import StudyError, suggest
from ...mechanisms.causes import Named
from ...mechanisms.moved_targets import find_moved_targets
from ...mechanisms.serialization import cause_from_record, cause_record
from ...mechanisms.terms import Screw, Term
from ...robot.rigid import AXES
from ...robot.urdf import read_urdf, read_urdf_text
from ..constant_part import (
    Part,
    compute_points,
    constant_entries,
    leave_out_moves,
    list_left_out,
    resolve_form,
    restrict_to_form,
    rms_and_max,
    sample_workspace,
    split_parts,
)
from .chains import to_dh, to_urdf
from .corrections import to_csv
from .form import Exported, describe_left_out, measure_whole, write_difference
from .grid import to_grid
from .grid_options import GridOptions
from .lookup import (
    MAX_INTERPOLATION_MM,
    build_constant_tables,
    build_tables,
    evaluate_tables,
    write_tables,
)
from .notes import describe_coupling, find_group, list_notes
from .python import to_python
from .ur_calibration import to_ur_calibration

if TYPE_CHECKING:
    from ..calibration import Calibration


def export_grid(c: Calibration, options: GridOptions) -> Exported:
    """Export a table of the target's error over joints of one's own choice. Raises StudyError."""
    _check_names(c)
    return to_grid(c, options)


def export(c: Calibration, form: str) -> Exported:
    """Export a calibration in one of `EXPORT_FORMS`.

    A form that cannot carry all of it gets the best robot that it can carry, refitted; errors of the
    instrument are in none. Raises StudyError for another form, or where a name cannot be written.
    """
    check_type("form", form, str, f"one of {', '.join(FORMS)}")
    if form not in FORMS:
        advice = suggest(form, FORMS)
        raise StudyError(f'unknown form "{form}". {advice}')
    _check_names(c)
    geometry = form in GEOMETRY
    carries = CARRIES.get(form, "whole")
    carried = resolve_form(c, carries)
    restricted = restrict_to_form(c, carried)
    notes = list_notes(c, carried, geometry)
    if form not in WITH_COUPLING:
        notes += describe_coupling(c)
    write = FORMS[form]
    if form in MEASURED:
        return write(c, ())
    made = write(restricted, notes)
    targets = range(len(c.targets) if geometry else 1)
    whole = leave_out_moves(restrict_to_form(c, "whole"))
    kept = leave_out_moves(restricted)
    differences = [_measure_left_out(whole, kept, target) for target in targets]
    parts = list_left_out(c, carried)
    difference = np.concatenate(differences)
    errors = None
    if c.refits is not None:
        errors = c.refits.errors(carried)
    return replace(
        made,
        left_out=describe_left_out(parts),
        left_out_mm=rms_and_max(difference),
        notes=(*notes, *made.notes),
        errors=errors,
    )


def attach_urdf(
    c: Calibration,
    path: Path,
    base: str | None = None,
    tip: str | None = None,
    text: str | None = None,
) -> Calibration:
    """Attach a URDF, or the chain of one between two links, as the file that an export in the form
    "urdf" rewrites; `text`: that of a xacro file once expanded. Raises StudyError."""
    if text is None:
        read = read_urdf(path, base, tip)
    else:
        read = read_urdf_text(text, path.name, base, tip)
    robot = replace(c.robot, urdf=read.urdf)
    return replace(c, robot=robot)


def _check_names(c: Calibration) -> None:
    """Raise StudyError with every name that cannot be written."""
    robot = c.robot
    names = [("study", c.study), ("robot", robot.name)]
    names += [("target", target) for target in c.targets]
    names += [("group", group) for group in c.groups]
    problems = []
    for kind, name in names:
        reason = find_name_problem(name)
        if reason:
            quoted = quote_name(name)
            problem = f"{kind} {quoted}: not a name: {reason}."
            problems.append(problem)
    if problems:
        raise StudyError(*problems)


def _measure_left_out(c: Calibration, restricted: Calibration, target: int) -> Array:
    """Return displacements (m, 3) [mm] of a target between the whole and the restricted model."""
    problem = sample_workspace(c, target)
    points = []
    for model in (c, restricted):
        constant, varying = split_parts(model, target)
        parts = constant + varying
        points.append(compute_points(problem, parts))
    whole, kept = points
    return whole - kept


# -- corrections: everything the model says, as rows
# ---------------------------------------------------------------------------


def to_json(c: Calibration, notes: Sequence[str] = ()) -> Exported:
    """Write the constant corrections of every frame and every other screw, with its cause as
    structure, and with its target where it is of one of several."""
    record = {
        "schema": 1,
        "kind": "corrections",
        "study": c.study,
        "robot": c.robot.name,
        "group": find_group(c),
        "axes": list(AXES),
        "says": "H of a frame = constant entries + Σ estimate × cause; Trans(tx, ty, tz) Rx Ry Rz, mm and rad",
        "constant": {name: constant_entries(c, t).tolist() for t, name in enumerate(c.targets)},
        "effects": [
            {
                **({} if target is None else {"target": target}),
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
            for target, p in _list_varying(c)
            for s in p.term.screws
        ],
    }
    text = json.dumps(record, ensure_ascii=False, indent=1, allow_nan=False) + "\n"
    return measure_whole(c, text, lambda text, t: _parse_json(json.loads(text), c.targets[t]))


def _list_varying(c: Calibration) -> list[tuple[str | None, Part]]:
    """List the parts that vary with the state: those of every target, with None, once; then those of
    single targets with their names."""
    of_targets = [split_parts(c, target)[1] for target in range(len(c.targets))]
    first, *others = of_targets
    shared = [part for part in first if all(part in parts for parts in others)]
    listed: list[tuple[str | None, Part]] = [(None, part) for part in shared]
    for name, parts in zip(c.targets, of_targets, strict=True):
        listed += [(name, part) for part in parts if part not in shared]
    return listed


def _parse_json(record: Mapping[str, Any], target: str) -> list[Part]:
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
        if e.get("target", target) == target
    ]


def to_table(c: Calibration, notes: Sequence[str] = ()) -> Exported:
    """Tabulate every correction: the constant ones, and those of one or two values of the state on
    a grid to interpolate in."""
    constant, varying = split_parts(c)
    at = sample_workspace(c)
    made, over = build_tables(c, varying, at)
    assert not over, "what no table holds was left out before"
    constant_tables = build_constant_tables(constant_entries(c))
    text = write_tables([*constant_tables, *made])
    read = evaluate_tables(text, at)
    covariates = dict(at.data.covariates)
    again = []
    for k, (frame, axis, values) in enumerate(read):
        name = f"table_{k}"
        covariates[name] = values
        screw = Screw(frame, axis, Named(name))
        term = Term("", (screw,))
        again.append(Part("table", term, 1.0, 0.0))
    bound = replace(at, data=replace(at.data, covariates=covariates))
    points = compute_points(bound, again)
    wanted = compute_points(at, constant + varying)
    rms, most = rms_and_max(points - wanted)
    remarks = []
    if len(c.targets) > 1:
        first = c.targets[0]
        is_own = any(map(find_moved_targets, c.model.mechanisms))
        of_what = "corrections" if is_own else "constant corrections"
        remarks.append(f'the {of_what} are those of target "{first}"')
    jump = ""
    if most > 10 * MAX_INTERPOLATION_MM:
        jump = ", beside a jump"
    remarks.append(
        f"interpolated linearly: {write_difference(rms)} rms, {write_difference(most)} at most{jump}"
    )
    return Exported(text, most, len(at), notes=tuple(remarks))


Writer = Callable[["Calibration", Sequence[str]], Exported]
_WRITERS: tuple[Writer, ...] = (
    to_urdf,
    lambda c, notes: to_dh(c, "standard", notes),
    lambda c, notes: to_dh(c, "modified", notes),
    lambda c, notes: to_dh(c, "hayati", notes),
    to_ur_calibration,
    to_json,
    to_csv,
    to_python,
    to_table,
    lambda c, notes: to_grid(c),
)
FORMS: dict[str, Writer] = dict(zip(EXPORT_FORMS, _WRITERS, strict=True))
GEOMETRY = ("urdf", "dh", "mdh", "hayati", "ur-calibration")
# these files hold the coupling of the joints, too
WITH_COUPLING = ("dh", "mdh", "hayati", "python")
MEASURED = ("grid",)  # of the whole model, and what it leaves out is measured with it
CARRIES = {**dict.fromkeys(GEOMETRY, "geometry"), "table": "table"}  # others carry the whole model
__all__ = ["FORMS", "Exported", "GridOptions", "attach_urdf", "export", "export_grid"]
