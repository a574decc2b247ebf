"""What else changed when a covariate did, as rivals of a finding that depends on it.

A temperature that was read once a session tells the sessions apart, as a joint that was set anew
between them does; one that rose all day tells the time. Its finding stands against the same with a
step between the sessions, and with the course of the campaign, in the covariate's place: together these
are as probable beforehand, and the data decide as far as the covariate went another way."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from .._typing import Array
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
# power of the course of the campaign that a covariate may go with
MOST_POWER = 3
# rows of a session, on average, from which its mean says something
FEWEST_ROWS = 4
# share of a covariate's range by which it jumps
JUMP = 0.4


def generate_confounded(problem: Problem, found: Mechanism) -> Iterator[list[Mechanism]]:
    """Generate a finding's terms with what else changed in the place of its covariate, by sorts: steps
    between sessions; time; warming up. None where it has no covariate, or one that went its own way."""
    name = find_confounded(problem, found)
    count = len(found.terms)
    if name is None or count > MOST_TERMS:
        return
    moments = _list_moments(problem.data, name)
    if moments:
        steps = [step_after(moment) for moment, _ in moments]
        stepping = _put(found, name, steps)
        told = _tell_steps(problem, stepping, moments)
        yield [replace(stepping, sentence=told)]
    clock, duration = choose_clock(problem)
    if duration:
        in_time = _put(found, name, [clock])
        yield [in_time]
    warmed = []
    for course in build_warming_causes(problem):
        warming = _put(found, name, [course])
        warmed.append(warming)
    if warmed:
        yield warmed


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
    moments = list_changes(data) or list(_list_jumps(data, name))
    if len(moments) > MOST_STEPS:
        return []
    return moments


def _list_jumps(data: Measurements, name: str) -> Iterator[tuple[float, str]]:
    """List the moments where a covariate jumps, in words, too."""
    order = np.argsort(data.progress, kind="stable")
    progress = data.progress[order]
    values = data.covariates[name][order]
    least = JUMP * np.ptp(values)
    size = np.abs(np.diff(values))
    for k in np.flatnonzero(size > least):
        before, after = progress[k : k + 2]
        moment = round_between(before, after)
        share = write_percent(moment, 1)
        yield moment, f"after {share} of the campaign"


def _tell_steps(problem: Problem, stepping: Mechanism, moments: Sequence[tuple[float, str]]) -> str:
    """Tell steps of one joint's reading; of any other place their formula does."""
    places = list(stepping.names_by_place())
    frame, axis = places[0]
    is_one = len(places) == 1 and frame <= problem.robot.n
    is_joint = is_one and axis == joint_axis(problem.robot, frame)
    if not is_joint or stepping.names() != {"progress"}:
        return ""
    when = "in every session"
    if len(moments) == 1:
        _, when = moments[0]
    return f"The zero of joint {frame} is another one {when}."


def _measure_confounded(data: Measurements, name: str) -> float:
    """Measure the share of a covariate's variance that sessions and the course of the campaign explain."""
    values = data.covariates[name]
    deviation = values - values.mean()
    size = float(deviation @ deviation)
    if not size:
        return 0.0
    powers = np.arange(1, MOST_POWER + 1)
    course = data.progress[:, None] ** powers
    own = _leave_sessions(data, values[:, None])[:, 0]
    columns = _leave_sessions(data, course)
    coefficients, *_ = np.linalg.lstsq(columns, own, rcond=None)
    left = own - columns @ coefficients
    share_left = float(left @ left) / size
    return 1 - share_left


def _leave_sessions(data: Measurements, columns: Array) -> Array:
    """Take the mean of its session out of every row of columns (m, k); where there are few rows to a
    session, that of all."""
    _, session, count = np.unique(data.group, return_inverse=True, return_counts=True)
    if len(count) * FEWEST_ROWS > len(session):
        session = np.zeros_like(session)
        count = np.array([len(session)])
    left = np.empty_like(columns)
    for k, column in enumerate(columns.T):
        mean = np.bincount(session, column) / count
        left[:, k] = column - mean[session]
    return left


def _put(found: Mechanism, name: str, course: Sequence[Cause]) -> Mechanism:
    """Put functions with coefficients of their own in a covariate's place."""
    terms = []
    acts: dict[str, None] = {}
    for number, term in enumerate(found.terms, 1):
        for part, function in enumerate(course, 1):
            screws = []
            for screw in term.screws:
                cause = substitute(screw.cause, name, function)
                screws.append(replace(screw, cause=cause))
                acts[f"{screw.frame} {screw.axis} {cause}"] = None
            put = Term(f"a{number}{part}", tuple(screws))
            terms.append(put)
    words = "; ".join(acts)
    return Mechanism(words, tuple(terms))


def substitute(cause: Cause, name: str, value: Cause) -> Cause:
    """Put a value in the place of a name in a formula, or of that less a constant: what a temperature is
    counted from is no part of another course."""
    match cause:
        case Named(own) if own == name:
            return value
        case Combined("+" | "-", Named(own), Number()) if own == name:
            return value
        case Combined(_, left, right):
            left = substitute(left, name, value)
            right = substitute(right, name, value)
            return replace(cause, left=left, right=right)
        case Applied(_, argument):
            argument = substitute(argument, name, value)
            return replace(cause, argument=argument)
    return cause
