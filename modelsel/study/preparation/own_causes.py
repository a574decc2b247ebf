"""Causes of a study's own, [[covariate]], against its robot, its registry and its measurements."""

from __future__ import annotations

import re
from collections.abc import Collection, Iterator, Sequence
from itertools import chain, combinations

import numpy as np

from ..._typing import Array
from ...config.covariate_table import CovariateTable, list_words
from ...config.study_file import Study
from ...diagnosis.candidates.own_candidates import OwnCandidates
from ...diagnosis.shapes.unregistered import Causes, build_cell, list_distinct_places, list_places
from ...exceptions import StudyError, one_line, sentence_list
from ...fitting.problem import Problem
from ...measurements.measurements import Measurements
from ...mechanisms.cause_formulas import list_members, parse
from ...mechanisms.causes import Cause, Number, belongs_to_target
from ...mechanisms.registry import Registry
from ...mechanisms.terms import Mechanism, describe_frame_motion
from ...notices import Note
from ...robot.kinematics import Robot

# spread of a cause over the rows, of its largest value, below which it is one value
MIN_SPREAD = 1e-9
# square of the cosine between the values of two causes above which they are one
EQUAL = 1 - 1e-12
WORD = re.compile(r"\w+")  # a name or a number of a formula


def list_own_names(study: Study) -> list[str]:
    """List the names that a study gives to causes of its own."""
    return [table.name for table in study.covariate if table.name is not None]


def list_own_words(study: Study) -> set[str]:
    """List the words of a study's own causes, columns of its file among them."""
    tables = study.covariate
    words = [list_words(table) for table in tables]
    return set(chain.from_iterable(words))


def find_own_name_problems(study: Study, registry: Registry) -> list[str]:
    """Find names of a study's own that the registry has, in sentences."""
    return [
        f'covariate.{number}.name: "{table.name}" is a registered mechanism; choose another name.'
        for number, table in enumerate(study.covariate, 1)
        if table.name in registry
    ]


def check_own_causes(study: Study, robot: Robot, data: Measurements) -> None:
    """Check a study's own causes against its measurements. Raises StudyError with every problem."""
    if not study.covariate:
        return
    problem = Problem(robot, data, np.zeros((len(data.targets), 3)))
    problems: list[str] = []
    for number, table in enumerate(study.covariate, 1):
        place = f"covariate.{number}"
        problems += _find_place_problems(place, table, problem)
        try:
            causes = _parse_causes(place, table, problem)
        except StudyError as error:
            problems += error.problems
            continue
        problems += _find_cause_problems(place, causes, problem, table.as_ == "alone")
    if problems:
        raise StudyError(*problems)


def _find_place_problems(place: str, table: CovariateTable, problem: Problem) -> Iterator[str]:
    if table.frame is None or (table.frame, table.axis) in list_places(problem):
        return
    robot = problem.robot
    last = robot.n + 1
    if table.frame > last:
        yield f"{place}.frame: {table.frame}, but {robot.name} has frames 1 to {last}."
        return
    yield (
        f"{place}.axis: positions alone do not show that frame {last}, the target, turns; use tx, ty "
        "or tz."
    )


def _parse_causes(place: str, table: CovariateTable, problem: Problem) -> list[Cause]:
    """Read the causes of a table. Raises StudyError for those that cannot be read."""
    units = problem.names()
    data = problem.data
    members = _place_members(data)
    causes: list[Cause] = []
    problems: list[str] = []
    for text in table.causes:
        try:
            causes.append(parse(text, units, f"{place}.causes", members))
        except StudyError as error:
            problems += error.problems
    if problems:
        columns = describe_columns(data)
        told = add_columns(problems, columns)
        raise StudyError(*told)
    return causes


def _place_members(data: Measurements) -> dict[str, Cause]:
    """Return the causes of single targets and groups by their names, which number the targets of the
    file: that of a target that was left out is 0 in every row that is left."""
    listed = data.listed_targets or data.targets
    members = list_members(len(listed), len(data.groups))
    placed = dict[str, Cause]()
    for name, member in members.items():
        placed[name] = member
        if member.kind != "target":
            continue
        target = listed[member.index]
        if target in data.targets:
            index = data.targets.index(target)
            placed[name] = belongs_to_target(index, member.index + 1)
        else:
            placed[name] = Number(0.0)
    return placed


def add_columns(problems: Sequence[str], columns: str) -> list[str]:
    """Add a sentence on the `columns` that there are to the last of some problems with formulas, once
    for all of them."""
    *others, last = problems
    stem = last.rstrip()
    told = f"{stem} {columns}"
    return [*others, told]


def describe_columns(data: Measurements) -> str:
    """Describe the columns that formulas may name beside the readings."""
    columns = sorted(data.covariates)
    if not columns:
        return "The file has no further columns of numbers."
    return f"The file's further columns of numbers: {', '.join(columns)}."


def _find_cause_problems(
    place: str, causes: Sequence[Cause], problem: Problem, alone: bool
) -> Iterator[str]:
    columns = set(problem.data.covariates)
    without = [str(cause) for cause in causes if not cause.names() & columns]
    # of causes together some may be of the robot alone
    if len(without) > (0 if alone else len(causes) - 1):
        them = "it" if len(without) == 1 else "them"
        yield (
            f"{place}.causes: {sentence_list(without)}: no column of the file is in {them}. "
            f"{describe_columns(problem.data)}"
        )
    varying: list[tuple[Cause, Array]] = []
    for cause in causes:
        with np.errstate(all="ignore"):
            values = np.broadcast_to(cause.of(problem.state), len(problem))
        is_broken = ~np.isfinite(values)
        broken = np.flatnonzero(is_broken)
        if len(broken):
            first = broken[0]
            data = problem.data
            row = data.where.name_row(int(data.row[first]))
            yield (
                f'{place}.causes: "{cause}" is not a finite number on {row}; write it so '
                "that it is one in every row."
            )
        elif np.ptp(values):
            varying.append((cause, values))
    if not alone:
        yield from _find_equal_causes(place, varying)


def _find_equal_causes(place: str, evaluated: Sequence[tuple[Cause, Array]]) -> Iterator[str]:
    """Find causes that are the same but for a factor, by their values (m,) in all rows."""
    for (first, a), (second, b) in combinations(evaluated, 2):
        square = float(a @ a) * float(b @ b)
        product = float(a @ b)
        if product * product > EQUAL * square:
            yield (
                f'{place}.causes: "{first}" and "{second}" are the same but for a factor; combine '
                "different causes."
            )


def note_constant_causes(study: Study, problem: Problem) -> list[Note]:
    """Note the causes of a study's own that have one value in all rows."""
    notes = []
    for number, table in enumerate(study.covariate, 1):
        place = f"covariate.{number}"
        causes = _parse_causes(place, table, problem)
        for text, cause in zip(table.causes, causes, strict=True):
            values = np.broadcast_to(cause.of(problem.state), len(problem))
            largest = float(np.abs(values).max())
            if np.ptp(values) > MIN_SPREAD * largest:
                continue
            sentence = _describe_constant(text, cause, values, problem.data)
            note = Note("cause-constant", f"{place}: {sentence}")
            notes.append(note)
    return notes


def _describe_constant(text: str, cause: Cause, values: Array, data: Measurements) -> str:
    """Describe a cause that has one value: that of a target that was left out as what was asked."""
    words = set(WORD.findall(text))
    listed = data.listed_targets
    unseen = [
        name
        for number, name in enumerate(listed, 1)
        if name not in data.targets and f"target_{number}" in words
    ]
    if unseen:
        quoted = [f'"{one_line(name)}"' for name in unseen]
        targets = "target" if len(quoted) == 1 else "targets"
        return f'"{text}" cannot be tested: no estimation row measures {targets} {sentence_list(quoted)}.'
    value = values[0]
    return (
        f'"{cause}" has one value, {value:.4g}, in all rows: what it alone does cannot be told from '
        "the geometry."
    )


def build_own_candidates(study: Study, problem: Problem) -> tuple[OwnCandidates, ...]:
    """Build what a study adds to the search. Raises StudyError for causes that the data lack.

    A name that model.candidates leaves out is no candidate."""
    listed = study.model.candidates
    own = []
    for number, table in enumerate(study.covariate, 1):
        is_named = table.name is not None
        is_open = listed in ("all", [])
        if is_named and not is_open and table.name not in listed:
            continue
        place = f"covariate.{number}"
        mechanisms = tuple(_generate_mechanisms(place, table, problem))
        group = OwnCandidates(mechanisms, is_named, table.prior)
        own.append(group)
    return tuple(own)


def build_own_mechanisms(study: Study, problem: Problem) -> dict[str, Mechanism]:
    """Build the mechanisms that a study gives names, by these names."""
    named = {}
    for number, table in enumerate(study.covariate, 1):
        if table.name is not None:
            place = f"covariate.{number}"
            (mechanism,) = _generate_mechanisms(place, table, problem)
            named[table.name] = mechanism
    return named


def _generate_mechanisms(
    place: str, table: CovariateTable, problem: Problem
) -> Iterator[Mechanism]:
    causes = _parse_causes(place, table, problem)
    columns = problem.data.covariates.keys()
    combined = _combine(table, causes, columns)
    combined_causes = list(combined)
    places = list_distinct_places(problem)
    if table.frame is not None and table.axis is not None:
        only = (table.frame, str(table.axis))
        places = (only,)
    for where in places:
        for each in combined_causes:
            cell = build_cell(where, each)
            if table.name is not None:
                cell = _give_name(table.name, cell)
            yield cell


def _combine(
    table: CovariateTable, causes: Sequence[Cause], columns: Collection[str]
) -> Iterator[Causes]:
    """Generate the causes of each effect that a table stands for, those without a column left out."""
    if table.as_ == "alone":
        yield from ((cause,) for cause in causes)
        return
    for first, second in combinations(causes, 2):
        product = first * second
        if not product.names() & set(columns):
            continue
        if table.as_ == "products":
            yield (product,)
        else:
            yield first, second


def _give_name(name: str, cell: Mechanism) -> Mechanism:
    screws = [term.screws[0] for term in cell.terms]
    first = screws[0]
    causes = sentence_list([str(screw.cause) for screw in screws])
    motion = describe_frame_motion(first.frame, first.axis)
    sentence = f"{motion} with {causes}"
    return Mechanism(name, cell.terms, sentence)
