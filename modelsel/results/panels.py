"""What a finding looks like: the residual about its axis against its cause, with the effect left in
and taken out.

With d (3,) the target's displacement per unit of a screw, r the chosen model's residual and f the
effect's fitted twist, d·r / |d|² is what is left about that axis, and f + d·r / |d|² what would be
there without the effect: component plus residual (Larsen & McCleary 1972, "The use of partial
residual plots in regression analysis")."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from .._typing import Array, Index
from ..diagnosis.sentences import describe_candidate
from ..fitting.design import PLACE, compute_columns
from ..fitting.problem import Problem
from ..mechanisms.causes import FUNCTIONS, Applied, Bump, Cause, Named
from ..mechanisms.terms import Term
from .map_details import wave

if TYPE_CHECKING:
    from .finding_records import Finding
    from .result import Result

PANELS = 3  # of a finding; the largest effects first
POINTS = 240  # of a panel
LEVER = 0.2  # of the largest lever: rows with less say nothing of a twist but noise
CURVE = 160
FOLDED = 3  # waves per turn from which they are folded onto one


@dataclass(frozen=True)
class _Line:
    """Only values along one axis: enough of a state for a cause of one name."""

    name: str
    values: Array

    def value(self, name: str) -> Array:
        return self.values


@dataclass(frozen=True, eq=False)
class _Group:
    """Terms of one finding that act at one place and can be drawn against one variable."""

    places: tuple[tuple[int, str], ...]
    terms: tuple[tuple[float, Cause], ...]
    variable: Cause
    kind: str  # line, wave, step, free
    waves: float = 1.0  # per turn of the variable; three and more are drawn folded onto one


def _variable(
    cause: Cause, others: Sequence[Cause], units: Mapping[str, str]
) -> tuple[Cause, str, float]:
    """(what to draw a cause against, in which manner, waves per turn): a wave against its angle, a
    sign against its argument."""
    if isinstance(cause, Bump):
        return Named(cause.name, units.get(cause.name, "1")), "free", 1.0
    if isinstance(cause, Applied) and cause.function == "sign":
        return cause.argument, "step", 1.0
    found = next((w for other in others if (w := wave((cause, other))) is not None), None)
    return (cause, "line", 1.0) if found is None else (found[0], "wave", found[1])


def _groups(
    terms: Sequence[Term], estimate: Array, units: Mapping[str, str]
) -> list[_Group] | None:
    """The finding's terms by place and variable; None where a term drives screws by different
    causes."""
    if any(len({s.cause for s in t.screws}) > 1 for t in terms):
        return None
    keyed: dict[
        tuple[tuple[tuple[int, str], ...], Cause, str, float], list[tuple[float, Cause]]
    ] = {}
    for term, value in zip(terms, estimate, strict=True):
        places, cause = tuple((s.frame, s.axis) for s in term.screws), term.screws[0].cause
        here = [
            t.screws[0].cause for t in terms if tuple((s.frame, s.axis) for s in t.screws) == places
        ]
        keyed.setdefault((places, *_variable(cause, here, units)), []).append((float(value), cause))
    return [
        _Group(places, tuple(parts), variable, kind, waves)
        for (places, variable, kind, waves), parts in keyed.items()
    ]


def _along(group: _Group, x: Array) -> Array:
    """The group's fitted twist where its variable is x."""
    out = np.zeros(len(x))
    for value, cause in group.terms:
        if group.kind == "line":
            out = out + value * x
        elif group.kind == "step" and isinstance(cause, Applied):
            out = out + value * np.sign(x)
        elif isinstance(group.variable, Named):
            out = out + value * np.asarray(cause.of(_Line(group.variable.name, x)))
        elif isinstance(cause, Applied):
            out = out + value * np.asarray(FUNCTIONS[cause.function](x))
    return out


def _panel(
    group: _Group, problem: Problem, field: Array, residual: Array
) -> tuple[float, dict[str, Any]] | None:
    """(rms displacement in mm, the panel) of one group; None where it moves nothing here."""
    d = np.sum([field[f - 1, PLACE[axis]] for f, axis in group.places], axis=0)
    part = slice(0, 3) if float(np.abs(d[:3]).max()) > 1e-6 or len(d) == 3 else slice(3, 6)
    d, r = d[part].T, residual[:, part]
    lever = np.linalg.norm(d, axis=1)
    good = np.flatnonzero(lever > max(LEVER * lever.max(initial=0), 1e-9))
    if len(good) < 2:
        return None
    good = good[np.unique(np.linspace(0, len(good) - 1, min(len(good), POINTS)).astype(int))]
    x = np.broadcast_to(np.asarray(problem.cause(group.variable), float), (len(problem),))[good]
    fitted, against = _along(group, x), str(group.variable)
    left = (d * r).sum(1)[good] / lever[good] ** 2
    grid = np.linspace(x.min(), x.max(), CURVE) if np.ptp(x) > 0 else np.array([x[0], x[0] + 1.0])
    turns, angle = group.places[0][1][0] == "r", group.variable.unit == "rad"
    folded = group.waves >= FOLDED and angle
    if folded:
        against, x, grid = (
            f"{group.waves:g}*{against}, folded",
            group.waves * x % (2 * np.pi),
            np.linspace(0, 2 * np.pi, CURVE),
        )
    curve = _along(group, grid / group.waves if folded else grid)
    size = float(np.sqrt(np.square(fitted * lever[good]).mean()))
    return size, {
        "frames": [f for f, _ in group.places],
        "axis": group.places[0][1],
        "against": against,
        "against_unit": "deg" if angle else group.variable.unit,
        "unit": "rad" if turns else "mm",
        "kind": group.kind,
        **_points(
            np.degrees if angle else np.asarray, x, left + fitted, left, lever[good], grid, curve
        ),
    }


def _points(
    shown: Callable[[Array], Array],
    x: Array,
    before: Array,
    after: Array,
    lever: Array,
    grid: Array,
    curve: Array,
) -> dict[str, Any]:
    def short(values: Array) -> list[float]:
        return [float(f"{v:.5g}") for v in values]

    return {
        "x": short(shown(x)),
        "before": short(before),
        "after": short(after),
        "weight": short(np.square(lever / lever.max(initial=1e-9))),
        "curve": [short(shown(grid)), short(curve)],
    }


def _whole(
    terms: Sequence[Term], estimate: Array, problem: Problem, field: Array, residual: Array
) -> dict[str, Any] | None:
    """The displacement along the effect's own direction against what the effect says, in mm: for
    what acts in many places."""
    moved = np.tensordot(
        estimate, compute_columns(problem, field, terms, slice(0, len(problem))), 1
    )[:3].T
    size = np.linalg.norm(moved, axis=1)
    good = np.flatnonzero(size > 0.02 * size.max(initial=0))
    if len(good) < 2:
        return None
    good = good[np.unique(np.linspace(0, len(good) - 1, min(len(good), POINTS)).astype(int))]
    direction = moved[good] / size[good, None]
    direction *= np.where(direction[:, [int(np.abs(moved).max(0).argmax())]] < 0, -1, 1)
    x, left = (direction * moved[good]).sum(1), (direction * residual[good, :3]).sum(1)
    grid = np.array([x.min(), x.max()])
    return {
        "frames": [],
        "axis": "",
        "against": "what the effect says",
        "against_unit": "mm",
        "unit": "mm",
        "kind": "line",
        **_points(np.asarray, x, x + left, left, np.ones(len(x)), grid, grid),
    }


def _finding(finding: Finding, problem: Problem, field: Array, residual: Array) -> dict[str, Any]:
    terms, estimate = finding.effect.candidate.mechanism.terms, finding.effect.estimate
    groups = _groups(terms, estimate, problem.names())
    panels = [p for g in groups or [] if (p := _panel(g, problem, field, residual)) is not None]
    panels.sort(key=lambda pair: -pair[0])
    shown = [p for _, p in panels[:PANELS]]
    if not shown and (one := _whole(terms, estimate, problem, field, residual)) is not None:
        shown = [one]
    return {
        "label": finding.effect.candidate.label,
        "what": describe_candidate(finding.effect.candidate, finding.effect.estimate),
        "panels": shown,
        "more_panels": max(len(panels) - PANELS, 0),
        "rivals": [e.candidate.label for e in finding.effect.named.entries],
    }


def finding_panels(
    result: Result, problem: Problem, field: Array, rows: Index
) -> list[dict[str, Any]]:
    """One entry per finding of result.json, faults of single rows first (these have nothing to draw
    against a cause)."""
    residual = result.chosen.residual[rows]
    return [
        *(
            {
                "label": f.kind.label,
                "what": f.sentence.rstrip("."),
                "panels": [],
                "more_panels": 0,
                "rivals": [f.kind.label],
            }
            for f in result.faults
        ),
        *(_finding(f, problem, field, residual) for f in result.findings),
    ]
