"""What else changed when a covariate did, as rivals of a finding that depends on it.

A temperature that was read once a session tells the sessions apart, as a joint that was set anew
between them does; one that rose all day tells the time. Its finding stands against the same with a
step between the sessions, and with the course of the campaign, in the covariate's place: together these
are as probable beforehand, and the data decide as far as the covariate went another way."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from ..exceptions import write_percent
from ..fitting.problem import Problem
from ..measurements.measurements import Measurements
from ..mechanisms.causes import Applied, Cause, Combined, Named, Number
from ..mechanisms.environment import step_after
from ..mechanisms.motors import joint_axis
from ..mechanisms.terms import Mechanism, Term
from .driver_functions import IN_TIME
from .session_steps import list_changes, round_between
from .unregistered import build_warming_causes, choose_clock

# share of a covariate's variance, explained by the sessions and the course of the campaign, from which
# it is one that these may stand for: one that was drawn for every row is none
CONFOUNDED = 0.7
# terms of a finding, and steps, at most
MOST_TERMS, MOST_STEPS = 8, 6
# share of a covariate's range by which it jumps
JUMP = 0.4


def generate_confounded(problem: Problem, found: Mechanism) -> Iterator[list[Mechanism]]:
    """Generate a finding's terms with what else changed in the place of its covariate, by sorts: steps
    between sessions; time; warming up. None where it has no covariate, or one that went its own way."""
    name = find_confounded(problem, found)
    if name is None or len(found.terms) > MOST_TERMS:
        return
    moments = _list_moments(problem.data, name)
    if moments:
        (stepping,) = _put(found, name, [[step_after(moment) for moment, _ in moments]])
        yield [replace(stepping, sentence=_tell_steps(problem, stepping, moments))]
    clock, duration = choose_clock(problem)
    if duration:
        yield _put(found, name, [[clock]])
    yield _put(found, name, [[warming] for warming in build_warming_causes(problem)])


def find_confounded(problem: Problem, found: Mechanism) -> str | None:
    """Find the covariate that a mechanism depends on, if it has one that sessions or the course of the
    campaign may stand for."""
    names = found.names() & set(problem.data.covariates) - IN_TIME
    if len(names) != 1:
        return None
    (name,) = names
    return name if _measure_confounded(problem.data, name) >= CONFOUNDED else None


def _list_moments(data: Measurements, name: str) -> list[tuple[float, str]]:
    """List the moments where sessions meet, or else those where a covariate jumps, each with what begins
    there in words; none of many."""
    moments = [(moment, f'from the group "{group}" on') for moment, group in list_changes(data)]
    if not moments:
        order = np.argsort(data.progress, kind="stable")
        values, progress = data.covariates[name][order], data.progress[order]
        for k in np.flatnonzero(np.abs(np.diff(values)) > JUMP * np.ptp(values)):
            moment = round_between(progress[k], progress[k + 1])
            moments.append((moment, f"after {write_percent(moment, 1)} of the campaign"))
    return moments if len(moments) <= MOST_STEPS else []


def _tell_steps(problem: Problem, stepping: Mechanism, moments: Sequence[tuple[float, str]]) -> str:
    """Tell steps of one joint's reading; of any other place their formula does."""
    robot = problem.robot
    screws = [screw for term in stepping.terms for screw in term.screws]
    places = {(screw.frame, screw.axis) for screw in screws}
    joints = [j for j in range(1, robot.n + 1) if {(j, joint_axis(robot, j))} == places]
    if not joints or stepping.names() != {"progress"}:
        return ""
    when = moments[0][1] if len(moments) == 1 else "in every session"
    return f"The zero of joint {joints[0]} is another one {when}."


def _measure_confounded(data: Measurements, name: str) -> float:
    """Measure the share of a covariate's variance that sessions and the course of the campaign explain."""
    values = data.covariates[name]
    values = values - values.mean()
    size = float(values @ values)
    if not size:
        return 0.0
    progress = data.progress
    groups = data.group[:, None] == np.unique(data.group)
    columns = np.column_stack([np.ones(len(values)), progress, progress**2, progress**3, groups])
    fitted = columns @ np.linalg.lstsq(columns, values, rcond=None)[0]
    left = values - fitted
    return 1 - float(left @ left) / size


def _put(found: Mechanism, name: str, courses: Sequence[Sequence[Cause]]) -> list[Mechanism]:
    """Put every one of some courses, functions with coefficients of their own, in a covariate's place."""
    built = []
    for course in courses:
        terms = []
        for number, term in enumerate(found.terms, 1):
            for part, function in enumerate(course, 1):
                screws = [
                    replace(s, cause=substitute(s.cause, name, function)) for s in term.screws
                ]
                terms.append(Term(f"a{number}{part}", tuple(screws)))
        acts = dict.fromkeys(f"{s.frame} {s.axis} {s.cause}" for t in terms for s in t.screws)
        built.append(Mechanism("; ".join(acts), tuple(terms)))
    return built


def substitute(cause: Cause, name: str, value: Cause) -> Cause:
    """Put a value in the place of a name in a formula, or of that less a constant: what a temperature is
    counted from is no part of another course."""
    match cause:
        case Named(own) if own == name:
            return value
        case Combined("+" | "-", Named(own), Number()) if own == name:
            return value
        case Combined(_, left, right):
            left, right = (substitute(part, name, value) for part in (left, right))
            return replace(cause, left=left, right=right)
        case Applied(_, argument):
            return replace(cause, argument=substitute(argument, name, value))
    return cause
