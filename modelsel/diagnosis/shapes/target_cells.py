"""Shifts of the target that nobody registered: of several, or of one of them by itself, along one axis
of the flange, with gravity or a column of the data; and in any direction, with a column that has no
words."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from dataclasses import replace

from ...fitting.problem import Problem
from ...mechanisms.causes import Cause, Named, sign
from ...mechanisms.moved_targets import THE_TARGET, limit_to_targets
from ...mechanisms.target_names import number_targets
from ...mechanisms.terms import Mechanism, Screw, Term
from ...robot.rigid import AXES
from .candidate_kinds import CandidateKind
from .cause_words import COLUMNS, name_driver
from .unregistered import Unregistered, list_covariate_causes

PAYLOAD = "payload_kg"
SHIFTS = AXES[:3]


def generate_target_cells(
    problem: Problem, stated: Collection[frozenset[str]] = ()
) -> Iterator[Unregistered]:
    """Generate the shifts of the target that the error map lacks. However many targets there are, one
    by itself is as likely as all of them together."""
    data = problem.data
    shifts = [one for one in _build_shifts(problem) if one.names() not in stated]
    count = len(data.targets)
    if count > 1:
        shifts += _list_cells(problem)
    for shift in shifts:
        yield Unregistered(shift, _classify(shift), weight=1.0)
    if count == 1:
        return
    numbers = number_targets(data.targets, data.listed_targets)
    for place, target in enumerate(data.targets):
        for shift in shifts:
            kind = _classify(shift)
            own = limit_to_targets(shift, {place: target}, numbers)
            if kind is CandidateKind.TARGET_CELL:
                own = _name_cell(own)
            yield Unregistered(own, kind, weight=1 / count)


def _classify(shift: Mechanism) -> CandidateKind:
    """Return whether a shift is along one axis or in any direction."""
    if len(shift.terms) == 1:
        return CandidateKind.TARGET_CELL
    return CandidateKind.TARGET_SHIFT


def _list_cells(problem: Problem) -> Iterator[Mechanism]:
    """List shifts along an axis of the flange with gravity and with columns of the data."""
    for cause, words in _list_causes(problem):
        for axis in SHIFTS:
            sentence = f"{THE_TARGET} shifts along the flange's {axis[1]} axis {words}"
            cell = _build(problem, (axis,), cause, "", sentence)
            yield _name_cell(cell)


def _list_causes(problem: Problem) -> Iterator[tuple[Cause, str]]:
    """List what one target of several may shift with, each in words."""
    covariates = problem.data.covariates
    if problem.robot.gravity is not None:
        for axis in "xyz":
            pull = Named(f"down_{axis}")
            along = f"gravity along the flange's {axis} axis"
            yield pull, f"in proportion to the {along}"
            yield sign(pull), f"with the sign of the {along}"
            if PAYLOAD in covariates:
                yield Named(PAYLOAD, "kg") * pull, f"in proportion to the payload's {along}"
    for cause, *others in list_covariate_causes(problem):
        names = cause.names()
        if not others and len(names) == 1:
            (name,) = names
            yield cause, f"with {name_driver(name)}"


def _build_shifts(problem: Problem) -> Iterator[Mechanism]:
    """Build shifts in any direction in proportion to a column: of those that the registry does not
    know."""
    units = problem.names()
    for name in problem.data.covariates:
        if name in COLUMNS:
            continue
        cause = Named(name, units[name])
        sentence = f"{THE_TARGET} shifts on the flange in proportion to {name_driver(name)}"
        frame = problem.robot.n + 1
        yield _build(problem, SHIFTS, cause, f"frame {frame} shift · {name}", sentence)


def _build(
    problem: Problem, axes: Sequence[str], cause: Cause, name: str, sentence: str
) -> Mechanism:
    """Build a shift of all targets along some axes of the flange, a number each."""
    frame = problem.robot.n + 1
    terms = tuple(Term(f"m{axis[1]}", (Screw(frame, axis, cause),)) for axis in axes)
    return Mechanism(name, terms, sentence)


def _name_cell(cell: Mechanism) -> Mechanism:
    """Name a shift along one axis as the error map names its cells."""
    (term,) = cell.terms
    (screw,) = term.screws
    return replace(cell, name=f"{screw.frame} {screw.axis} {screw.cause}")
