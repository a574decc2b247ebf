"""What a finding looks like: the residual about its axis against its cause, with the effect left in
and taken out.

With d (3,) the target's displacement per unit of a screw, r the chosen model's residual and f the
effect's fitted twist, d·r / |d|² is what is left about that axis, and f + d·r / |d|² what would be
there without the effect: component plus residual (Larsen & McCleary 1972, "The use of partial
residual plots in regression analysis")."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..._typing import Array, Index
from ...diagnosis.faults.data_faults import Fault
from ...diagnosis.findings.claim_sentences import describe_what
from ...diagnosis.findings.sentences import label_effect
from ...diagnosis.shapes.distinct_places import Place
from ...exceptions import one_line, sentence_list
from ...fitting.design import PLACE, compute_columns
from ...fitting.problem import Problem
from ...mechanisms.causes import Cause, Member, find_bump
from ...mechanisms.moved_targets import split_target
from ...mechanisms.terms import Term
from ..runs.finding_records import Finding
from ..runs.map_details import MIN_DISPLACEMENT
from ..runs.study_run import StudyRun
from .covariate_panel import draw_covariate, find_covariate
from .panel_abscissae import Abscissa, choose_abscissa
from .panel_points import CURVE_POINTS, PanelPoints, select_points

# panels of a finding: the largest effects first
MAX_PANELS = 3
# share of the largest lever: rows with less show noise, no twist
MIN_LEVER = 0.2
# share of the largest displacement: rows with less show noise, no effect
MIN_EFFECT = 0.02
# of a displacement or a lever that may be zero
TINY = 1e-9

Values = dict[str, Any]


@dataclass(frozen=True, eq=False)
class _Group:
    """Coefficients and causes of one finding that act at the same places and are drawn against one
    variable, at some `targets` of several or at all."""

    places: tuple[Place, ...]
    abscissa: Abscissa
    parts: tuple[tuple[float, Cause], ...]
    targets: tuple[Member, ...] = ()

    def evaluate(self, x: Array) -> Array:
        """Return the fitted twist where the variable is x."""
        twist = np.zeros(len(x))
        for coefficient, cause in self.parts:
            values = self.abscissa.evaluate(cause, x)
            part = coefficient * values
            twist = twist + part
        return twist


def describe_panels(run: StudyRun, problem: Problem, field: Array, rows: Index) -> list[Values]:
    """Return one entry per finding of result.json, faults of single rows first.

    `problem`, `field`: the drawn `rows` and the displacement of every place there."""
    residual = run.models.chosen.residual[rows]
    diagnosis = run.diagnosis
    panels = [_describe_fault(fault) for fault in diagnosis.faults]
    for finding in diagnosis.findings:
        panel = _describe_finding(finding, problem, field, residual)
        panels.append(panel)
    return panels


def _describe_fault(fault: Fault) -> Values:
    """Return the entry of a fault of the data: it has nothing to draw against a cause."""
    label = fault.kind.label
    return {
        "label": label,
        "what": fault.sentence.rstrip("."),
        "panels": [],
        "more_panels": 0,
        "rivals": [label],
    }


def _describe_finding(finding: Finding, problem: Problem, field: Array, residual: Array) -> Values:
    """Return the entry of a finding: its largest parts, else its whole displacement."""
    effect = finding.effect
    terms, estimate = effect.candidate.mechanism.terms, effect.estimate
    groups = _group_terms(terms, estimate, problem.names())
    drawn = [_draw_group(group, problem, field, residual) for group in groups]
    panels = sorted((one for one in drawn if one is not None), key=lambda one: -one[0])
    shown = [panel for _, panel in panels]
    driver = find_covariate(terms, problem)
    if driver is not None and all(group.abscissa.variable.names() != {driver} for group in groups):
        along = draw_covariate(terms, estimate, problem, field, residual, driver)
        shown = shown if along is None else [along, *shown]
    if not shown:
        whole = _draw_displacement(terms, estimate, problem, field, residual)
        shown = [] if whole is None else [whole]
    return {
        "label": label_effect(effect),
        "what": describe_what(effect),
        "panels": shown[:MAX_PANELS],
        "more_panels": max(len(shown) - MAX_PANELS, 0),
        "rivals": [entry.candidate.label for entry in effect.named.entries],
    }


def _group_terms(terms: Sequence[Term], estimate: Array, units: Mapping[str, str]) -> list[_Group]:
    """Return the finding's terms by place and variable; none where a term drives screws by different causes, or by a
    free function times another cause."""
    own = [term.screws[0].cause for term in terms]
    if any(find_bump(cause) not in (None, cause) for cause in own):
        return []
    split = [[split_target(screw.cause) for screw in term.screws] for term in terms]
    if any(len({cause for _, cause in each}) > 1 for each in split):
        return []
    places = [
        tuple(dict.fromkeys((screw.frame, screw.axis) for screw in term.screws)) for term in terms
    ]
    causes = [each[0][1] for each in split]
    moved = {tuple(target for target, _ in each if target is not None) for each in split}
    targets = moved.pop() if len(moved) == 1 else ()
    parts: dict[tuple[tuple[Place, ...], Abscissa], list[tuple[float, Cause]]] = {}
    siblings: dict[tuple[Place, ...], list[Cause]] = {}
    for place, cause in zip(places, causes, strict=True):
        siblings.setdefault(place, []).append(cause)
    for place, cause, coefficient in zip(places, causes, estimate, strict=True):
        abscissa = choose_abscissa(cause, siblings[place], units)
        same = parts.setdefault((place, abscissa), [])
        same.append((float(coefficient), cause))
    return [
        _Group(place, abscissa, tuple(each), targets) for (place, abscissa), each in parts.items()
    ]


def _draw_group(
    group: _Group, problem: Problem, field: Array, residual: Array
) -> tuple[float, Values] | None:
    """Return (rms displacement in mm, the panel) of one group; None where it moves nothing here."""
    moved = np.sum([field[frame - 1, PLACE[axis]] for frame, axis in group.places], axis=0)
    part = _observed_part(moved)
    displacement = moved[part].T
    lever = np.linalg.norm(displacement, axis=1)
    if group.targets:
        is_moved = np.isin(problem.data.target, [target.index for target in group.targets])
        lever = lever * is_moved
    rows = select_points(lever > max(MIN_LEVER * lever.max(initial=0), TINY))
    if rows is None:
        return None
    abscissa, lever = group.abscissa, lever[rows]
    along = (displacement * residual[:, part]).sum(1)[rows]
    variable = np.asarray(problem.cause(abscissa.variable), float)
    x = np.broadcast_to(variable, (len(problem),))[rows]
    fitted, left = group.evaluate(x), along / lever**2
    weight = np.square(lever / lever.max(initial=TINY))
    points = _place_points(group, x, left + fitted, left, weight)
    first_axis = group.places[0][1]
    size = float(np.sqrt(np.square(fitted * lever).mean()))
    return size, {
        "frames": [frame for frame, _ in group.places],
        "axis": first_axis,
        "against": _name_axis(group, problem),
        "against_unit": abscissa.unit,
        "unit": "rad" if first_axis[0] == "r" else "mm",
        "kind": abscissa.kind,
        **points.describe(),
    }


def _name_axis(group: _Group, problem: Problem) -> str:
    """Name what a group is drawn against, and the target where it is one of several."""
    words = group.abscissa.words
    every = problem.data.targets
    names = [one_line(every[target.index]) for target in group.targets]
    if not names:
        return words
    kind = "targets"
    if len(names) == 1:
        kind = "target"
    listed = sentence_list(names)
    return f"{words}, {kind} {listed}"


def _observed_part(moved: Array) -> slice:
    """Return which coordinates show a group: the position, else the orientation that it only turns."""
    displacement = float(np.abs(moved[:3]).max())
    has_orientation = len(moved) > 3
    only_turns = has_orientation and displacement <= MIN_DISPLACEMENT
    if only_turns:
        return slice(3, 6)
    return slice(0, 3)


def _place_points(
    group: _Group, x: Array, before: Array, after: Array, weight: Array
) -> PanelPoints:
    """Return the points and the fitted curve, folded where waves are, in the unit that is drawn."""
    abscissa = group.abscissa
    if abscissa.is_folded:
        turn = 2 * np.pi
        x = abscissa.waves * x % turn
        grid = np.linspace(0, turn, CURVE_POINTS)
        curve = group.evaluate(grid / abscissa.waves)
    else:
        grid = _grid(x)
        curve = group.evaluate(grid)
    scale = abscissa.scale
    x = scale * x
    grid = scale * grid
    return PanelPoints(x, before, after, weight, grid, curve)


def _grid(x: Array) -> Array:
    """Return the variable's range, or a unit where it has none."""
    if np.ptp(x) > 0:
        return np.linspace(x.min(), x.max(), CURVE_POINTS)
    return np.array([x[0], x[0] + 1.0])


def _draw_displacement(
    terms: Sequence[Term], estimate: Array, problem: Problem, field: Array, residual: Array
) -> Values | None:
    """Return the panel of an effect that acts in many places: the displacement along its own direction against what
    the effect says, in mm; None where it moves nothing here."""
    columns = compute_columns(problem, field, terms, slice(0, len(problem)))
    moved = np.tensordot(estimate, columns, 1)[:3].T
    size = np.linalg.norm(moved, axis=1)
    rows = select_points(size > MIN_EFFECT * size.max(initial=0))
    if rows is None:
        return None
    direction = moved[rows] / size[rows, None]
    main = int(np.abs(moved).max(0).argmax())
    direction *= np.where(direction[:, [main]] < 0, -1, 1)
    x = (direction * moved[rows]).sum(1)
    left = (direction * residual[rows, :3]).sum(1)
    ends = np.array([x.min(), x.max()])
    points = PanelPoints(x, x + left, left, np.ones(len(x)), ends, ends)
    return {
        "frames": [],
        "axis": "",
        "against": "what the effect says",
        "against_unit": "mm",
        "unit": "mm",
        "kind": "line",
        **points.describe(),
    }
