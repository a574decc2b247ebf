"""A calibration in other programs' forms, each read back and held against the fit; what a form cannot carry is said."""
from __future__ import annotations

import csv
import io
import json
import tomllib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import chain
from typing import Any

import numpy as np

from .._names import guarded, quoted, unfit, unguarded
from .._typing import Array
from ..exceptions import StudyError
from ..fitting.problem import Scene
from ..mechanisms.causes import Applied, Bump, Cause, Combined, Named, parse
from ..mechanisms.serialization import cause_of, cause_record
from ..mechanisms.terms import Screw, Term
from ..robot.dh import robot_file, rows_of
from ..robot.files import robot_from_table
from ..robot.kinematics import Robot, forward
from ..robot.rigid import AXES, inverse, transform
from ..robot.urdf import read_urdf_text, write_urdf
from .calibration import Calibration, in_tracker, pose_of
from .carried import Carried, Part, alone, carried, constants, enough, missing, parts, points, rms_and_most, workspace
from .exported import predicted
from .lookup import FINE_MM, read_table, still, tables, write_tables
from .module import data_in, data_of, module_of
from .notes import notes_of


@dataclass(frozen=True)
class Exported:
    """A file's text; `error_mm` largest difference between what is read back and the fit, in what the form can carry, over
    `configurations`; `left_out` in words, and how far the whole model is from the file: (rms, largest) mm. `errors`: of which
    rows, rms [mm] of the nominal arm, of the file, of the whole model (None where that is not known)."""

    text: str
    error_mm: float
    configurations: int
    left_out: tuple[str, ...] = ()
    left_out_mm: tuple[float, float] = (0.0, 0.0)
    notes: tuple[str, ...] = ()
    errors: tuple[str, float, float, float] | None = None

    @property
    def worse(self) -> str | None:
        """That the file is worse than the nominal arm, in words; None where it is not, or nobody knows."""
        if self.errors is None or self.errors[2] <= self.errors[1]:
            return None
        rows, nominal, own, _ = self.errors
        return f"this file is worse than the nominal arm: {own:.3g} mm rms against {nominal:.3g} mm, {rows}"


def export(c: Calibration, form: str) -> Exported:
    """A calibration as "urdf", "dh", "mdh", "json", "csv", "python" or "table"; of a form that cannot carry all of it, the best
    robot that it can carry, refitted. Raises StudyError where a name cannot be one."""
    named = [("study", c.study), ("robot", c.robot.name), *(("target", t) for t in c.targets), *(("group", g) for g in c.groups)]
    if wrong := [f"{what} {quoted(name)}: not a name: {why}." for what, name in named if (why := unfit(name)) is not None]:
        raise StudyError(*wrong)
    what = enough(c, CARRIES.get(form, "whole"))
    own, notes = alone(c, what), notes_of(c, what, form in GEOMETRY)
    made, difference = FORMS[form](own, notes), []
    for t in range(len(c.targets) if form in GEOMETRY else 1):
        at = workspace(c, t)
        difference.append(points(at, [*chain(*parts(c, t))]) - points(at, [*chain(*parts(own, t))]))
    return replace(made, left_out=_missing(missing(c, what)), left_out_mm=rms_and_most(np.concatenate(difference)),
                   notes=(*notes, *made.notes), errors=None if c.refits is None else c.refits.errors(what))


def _missing(some: Sequence[Part]) -> tuple[str, ...]:
    """What a set of screws is, in words, once each mechanism."""
    out: dict[str, list[str]] = {}
    for p in some:
        places = out.setdefault(p.mechanism, [])
        places += [place for s in p.term.screws if (place := f"frame {s.frame} {s.axis}") not in places]
    return tuple(f"{name} ({', '.join(places)})" for name, places in out.items())


def _geometry(c: Calibration, text: str, read: Callable[[str, int], Callable[[Array], Array]], notes: tuple[str, ...]
              ) -> Exported:
    """Measured as a chain: `read` gives, of the file's text, the target's position in frame 0 at joint readings."""
    worst = 0.0
    for t in range(len(c.targets)):
        at = workspace(c, t)
        worst = max(worst, float(np.linalg.norm(read(text, t)(at.data.q) - points(at, parts(c, t)[0]), axis=1).max()))
    return Exported(text, worst, len(at) * len(c.targets), notes=notes)


def to_urdf(c: Calibration, notes: Sequence[str] = ()) -> Exported:
    """The calibrated chain as a URDF: targets on the flange, the tracker on the base."""
    made, links = carried(c), _links(c.targets)
    tips = {links[name]: place for name, place in made.targets.items()}
    tracker = inverse(transform(c.placement[0][0], c.placement[1][0]))
    robot, bounded = _bounded(made.robot, c.ranges)
    text = write_urdf(robot, tips, {"tracker": tracker} if c.registered else {}, [made.robot.source, *notes, *bounded])
    def read(text: str, target: int) -> Callable[[Array], Array]:
        back = read_urdf_text(text, "the export", "base", links[c.targets[target]])
        return lambda q: forward(back, q, np.zeros(3))
    return _geometry(c, text, read, bounded)


def _bounded(robot: Robot, ranges: Mapping[str, tuple[float, float]]) -> tuple[Robot, tuple[str, ...]]:
    """(the robot, what is to be said): a URDF's slide must have limits; where the robot file has none, those of the readings."""
    bare = [j for j, joint in enumerate(robot.joints, 1) if joint.prismatic and joint.limits is None]
    joints = (replace(joint, limits=ranges[f"q{j}"]) if j in bare else joint for j, joint in enumerate(robot.joints, 1))
    return replace(robot, joints=tuple(joints)), tuple(
        f"joint {j} slides, and a URDF wants its limits: they are those of the readings the calibration has seen" for j in bare)


def _links(targets: Sequence[str]) -> dict[str, str]:
    """Target -> the name of its link: its own, unless a link of the arm or another target's has it."""
    out: dict[str, str] = {}
    for name in sorted(targets, key=lambda name: (_taken(name), targets.index(name))):     # who may keep its name does
        link = name
        while _taken(link) or link in out.values():
            link = f"target_{link}"
        out[name] = link
    return out


def _taken(name: str) -> bool:
    return name in ("world", "base", "flange", "tracker") or name.startswith("link")


def _to_dh(c: Calibration, modified: bool, notes: Sequence[str]) -> Exported:
    made = carried(c)
    nearly = tuple(f"joints {a} and {b} are almost parallel: their rows have a large d; small changes of the angle change it much"
                   for a, b in rows_of(made.robot, modified).nearly)
    where = tuple(f"target {name} on the flange: x, y, z = {', '.join(repr(float(v)) for v in T[:3, 3])} mm"
                  for name, T in made.targets.items())
    text = robot_file(made.robot, modified, [*notes, *where, *nearly])
    def read(text: str, target: int) -> Callable[[Array], Array]:
        back = robot_from_table(tomllib.loads(text), "the export")
        return lambda q: forward(back, q, _offset(made, c.targets[target]))
    return _geometry(c, text, read, nearly)


def _offset(made: Carried, target: str) -> Array:
    return np.asarray(made.targets[target][:3, 3])


# -- corrections: everything the model says, as rows ---------------------------------------------------------------------------


def to_json(c: Calibration, notes: Sequence[str] = ()) -> Exported:
    """Constant corrections of every frame and every other screw, with its cause as structure."""
    record = {"schema": 1, "kind": "corrections", "study": c.study, "robot": c.robot.name, "axes": list(AXES),
              "says": "H of a frame = constant entries + Σ estimate × cause; Trans(tx, ty, tz) Rx Ry Rz, mm and rad",
              "constant": {name: constants(c, t).tolist() for t, name in enumerate(c.targets)},
              "effects": [{"mechanism": p.mechanism, "symbol": p.term.symbol, "frame": s.frame, "axis": s.axis,
                           "cause": cause_record(s.cause), "prints": str(s.cause), "estimate": p.value,
                           "standard_error": p.error, "unit": p.term.unit} for p in parts(c)[1] for s in p.term.screws]}
    text = json.dumps(record, ensure_ascii=False, indent=1, allow_nan=False) + "\n"
    return _whole(c, text, lambda text, t: _from_json(json.loads(text), c.targets[t]))


def _from_json(record: Mapping[str, Any], target: str) -> list[Part]:
    out = [Part("", Term("", (Screw(f + 1, axis),)), value, 0.0) for f, row in enumerate(record["constant"][target])
           for axis, value in zip(AXES, row, strict=True)]
    return out + [Part("", Term(e["symbol"], (Screw(e["frame"], e["axis"], cause_of(e["cause"])),)), e["estimate"], 0.0)
                  for e in record["effects"]]


HEADER = ("target", "mechanism", "symbol", "frame", "axis", "cause", "knot", "knot_width", "value", "standard_error", "unit")


def to_csv(c: Calibration, notes: Sequence[str] = ()) -> Exported:
    """A row a screw: place, cause, value. A free function has a row a knot: a cubic B-spline centred there."""
    stream = io.StringIO()
    writer = csv.writer(stream, lineterminator="\n")
    writer.writerow(HEADER)
    for t, name in enumerate(c.targets):
        for p in (p for some in parts(c, t) for p in some):
            for s in p.term.screws:
                bump = _bump(s.cause)
                knot = ("", "") if bump is None else (repr(bump.centre), repr(bump.width))
                texts = map(guarded, (name, p.mechanism, p.term.symbol))
                writer.writerow([*texts, s.frame, s.axis, guarded(str(s.cause)), *knot, repr(p.value), repr(p.error),
                                 guarded(p.term.unit)])
    return _whole(c, stream.getvalue(), lambda text, t: _from_csv(text, c, c.targets[t]))


def _bump(cause: Cause) -> Bump | None:
    if isinstance(cause, Combined):
        return _bump(cause.left) or _bump(cause.right)
    return cause if isinstance(cause, Bump) else _bump(cause.argument) if isinstance(cause, Applied) else None


def _swapped(cause: Cause, bump: Bump) -> Cause:
    """With the spline back where its name stands."""
    if isinstance(cause, Combined):
        return Combined(cause.operator, _swapped(cause.left, bump), _swapped(cause.right, bump))
    return bump if cause == Named("free") else cause


def _from_csv(text: str, c: Calibration, target: str) -> list[Part]:
    units = dict.fromkeys([*c.needs(), *c.ranges, "free"], "1")
    out = []
    for row in csv.DictReader(io.StringIO(text)):
        if unguarded(row["target"]) != target:
            continue
        printed = unguarded(row["cause"])
        name = printed.partition("free(")[2].partition(")")[0]
        cause = parse(printed.replace(f"free({name})", "free"), units)
        if row["knot"]:
            cause = _swapped(cause, Bump(name, float(row["knot"]), float(row["knot_width"])))
        out.append(Part("", Term(row["symbol"], (Screw(int(row["frame"]), row["axis"], cause),)), float(row["value"]), 0.0))
    return out


def _whole(c: Calibration, text: str, read: Callable[[str, int], list[Part]]) -> Exported:
    """Measured as screws put back into the nominal chain."""
    worst = 0.0
    for t in range(len(c.targets)):
        at = workspace(c, t)
        wanted = pose_of(at, c.terms, c.theta).target.T
        worst = max(worst, float(np.linalg.norm(points(at, read(text, t)) - wanted, axis=1).max()))
    return Exported(text, worst, len(at) * len(c.targets))


# -- a function and a table ----------------------------------------------------------------------------------------------------


def to_python(c: Calibration, notes: Sequence[str] = ()) -> Exported:
    """A module of its own: numpy only, the numbers in it."""
    text = module_of(data_of(c))
    there = data_in(text)
    def run(t: int, at: Scene) -> Array:
        return predicted(there, at.data.q, c.targets[t], {n: at.value(n) for n in there["needs"]})[1]
    worst = 0.0
    for t in range(len(c.targets)):
        at = workspace(c, t)
        wanted = in_tracker(at, pose_of(at, c.terms, c.theta).target.T)
        worst = max(worst, float(np.linalg.norm(run(t, at) - wanted, axis=1).max()))
    return Exported(text, worst, len(at) * len(c.targets))


def to_table(c: Calibration, notes: Sequence[str] = ()) -> Exported:
    """Every correction: the constant ones, and those of one or two values of the state on a grid to interpolate in."""
    constant, varying = parts(c)
    at = workspace(c)
    made, over = tables(c, varying, at)
    assert not over, "what no table holds was left out before"
    text = write_tables([*still(constants(c)), *made])
    read = read_table(text, at)
    tabled = {f"table_{k}": values for k, (_, _, values) in enumerate(read)}
    bound = at.anew(data=replace(at.data, covariates={**at.data.covariates, **tabled}))
    again = [Part("table", Term("", (Screw(frame, axis, Named(f"table_{k}")),)), 1.0, 0.0) for k, (frame, axis, _) in
             enumerate(read)]
    rms, most = rms_and_most(points(bound, again) - points(at, constant + varying))
    said = [f'the constant corrections are those of target "{c.targets[0]}"'] if len(c.targets) > 1 else []
    return Exported(text, most, len(at), notes=(
        *said, f"interpolated linearly: {rms * 1e3:.2g} µm rms, {most * 1e3:.2g} µm at most"
        + (", beside a jump" if most > 10 * FINE_MM else "")))


FORMS: dict[str, Callable[[Calibration, Sequence[str]], Exported]] = {
    "urdf": to_urdf, "dh": lambda c, notes: _to_dh(c, False, notes), "mdh": lambda c, notes: _to_dh(c, True, notes),
    "json": to_json, "csv": to_csv, "python": to_python, "table": to_table}
GEOMETRY = ("urdf", "dh", "mdh")
CARRIES = {**dict.fromkeys(GEOMETRY, "geometry"), "table": "table"}      # others carry the whole model
__all__ = ["FORMS", "Exported", "export"]
