"""What else changed when a covariate did, as rivals of a finding that depends on it.

A temperature that was read once a session tells the sessions apart, as a joint that was set anew
between them does; a load that was carried on one day tells that day, as another tool does; a temperature
that rose all day tells the time. Its finding stands against the same with a step between the sessions,
with one where the covariate jumps, which is taken back where that returns, with the course of the
campaign, warming up with any constant, and with the course in time that the covariate was read off, in
the covariate's place: together these are as probable beforehand, and the data decide as far as the
covariate went another way. A finding that depends on time
stands in the same way against what depends on a covariate that went with it."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from ..._typing import Array
from ...fitting.problem import Problem
from ...measurements.campaign.late_names import list_sources
from ...measurements.measurements import Measurements
from ...mechanisms.causes import Applied, Bump, Cause, Combined, Named, Number
from ...mechanisms.environment import PROGRESS, step_after
from ...mechanisms.motors import joint_axis
from ...mechanisms.terms import Mechanism, Screw, Term
from ..shapes.campaign_clocks import WARM_UP_SHARES, build_warm_ups, choose_clock
from ..shapes.candidate_kinds import CandidateKind
from ..shapes.driver_functions import IN_TIME
from .covariate_jumps import MOST_STEPS, find_stretch, list_moments, measure_jumps, say_moments
from .warm_ups import WARM_UPS

# share of a covariate's variance, explained by the sessions and the course of the campaign, from which
# it is one that these may stand for: one that was drawn for every row is none
CONFOUNDED = 0.7
# terms of a finding, at most
MOST_TERMS = 8
# power of the course of the campaign that a covariate may go with
MOST_POWER = 3
# of the largest, below which courses are told as alike
SMOOTH = 1e-6
# rows of a session, on average, from which its mean says something
FEWEST_ROWS = 4


class Confounded(NamedTuple):
    """Mechanisms of one sort that stand beside a finding's covariate, and of what kind they are; the
    `covariate` that they depend on where that stands in the place of time."""

    mechanisms: list[Mechanism]
    kind: CandidateKind = CandidateKind.CELL
    covariate: str | None = None


def generate_confounded(problem: Problem, found: Mechanism) -> Iterator[Confounded]:
    """Generate a finding's terms with what else changed in the place of its covariate, by sorts; in the
    place of time a covariate's course. None where it has no covariate, or one that went its own way.
    Courses that are fitted to the covariate are named in words: their formulas are long."""
    name = find_confounded(problem, found)
    if name is None:
        return
    found = _straighten(problem, found, name)
    if len(found.terms) > MOST_TERMS:
        return
    if name in found.names():
        yield from _generate_meanwhile(problem, found, name)
    else:
        yield _build_courses(problem, found, name)


def _build_courses(problem: Problem, found: Mechanism, name: str) -> Confounded:
    """Build a finding's terms with a covariate's course, alone and with its square, in the place of
    time."""
    apart = _count_from_middle(problem, name)
    square = apart * apart
    words = _name_course(name)
    linear = _put_in_time(found, [apart], words)
    bent = _put_in_time(found, [apart, square], f"{words} and its square")
    return Confounded([linear, bent], CandidateKind.COURSE, name)


def _generate_meanwhile(problem: Problem, found: Mechanism, name: str) -> Iterator[Confounded]:
    """Generate a finding's terms with what changed meanwhile in the place of its covariate: steps between
    sessions; a stretch that the covariate tells from the rest; time and warming up; the covariate's own
    course in time."""
    moments = list_moments(problem.data, name)
    if moments:
        steps = [step_after(moment) for moment, _ in moments]
        stepping = _put(found, name, steps)
        when = say_moments(problem.data, moments)
        yield Confounded([_tell_steps(problem, stepping, when)])
    stretch = find_stretch(problem.data, name)
    if stretch is not None and len(moments) != 1:
        stepping = _put(found, name, [stretch.course])
        named = _name_in_words(stepping, f"what changed {stretch.when}")
        yield Confounded([_tell_steps(problem, named, stretch.when)], CandidateKind.COURSE)
    in_time = list(_generate_in_time(problem, found, name))
    if in_time:
        is_plain = _is_straight(problem, found, name)
        kind = CandidateKind.CELL if is_plain else CandidateKind.COURSE
        yield Confounded(in_time, kind)
    smooth = _smooth(problem, name)
    alike = _put_value(found, name, smooth, _name_course(name))
    yield Confounded([alike], CandidateKind.COURSE)


def _straighten(problem: Problem, found: Mechanism, name: str) -> Mechanism:
    """Return a free function of a covariate at one place as one that is straight: no other course takes
    the covariate's place in its splines."""
    places = list(found.names_by_place())
    causes = [screw.cause for term in found.terms for screw in term.screws]
    is_free = all(isinstance(cause, Bump) for cause in causes)
    if not is_free or len(places) > 1 or found.names() != {name}:
        return found
    units = problem.names()
    screw = Screw(*places[0], Named(name, units[name]))
    term = Term("m", (screw,))
    return Mechanism(found.name, (term,))


def _name_course(name: str) -> str:
    """Name the course in time that a covariate was read off."""
    return f"the smooth course of {name} in time"


def _generate_in_time(problem: Problem, found: Mechanism, name: str) -> Iterator[Mechanism]:
    """Generate a finding's terms with time in the place of its covariate: even, and warming up."""
    clock, duration = choose_clock(problem)
    if not duration:
        return
    warm_ups = build_warm_ups(problem, WARM_UPS)
    for course in (clock, *warm_ups):
        yield _put_course(problem, found, name, course)


def _put_course(problem: Problem, found: Mechanism, name: str, course: Cause) -> Mechanism:
    """Put a course in time in a covariate's place; where a finding bends with that, from the value on
    from which it bends."""
    if _is_straight(problem, found, name):
        return _put(found, name, [course])
    fitted = _fit_courses(problem, name, [course])
    words = f"{name} as it follows {course} in time"
    return _put_value(found, name, fitted, words)


def _is_straight(problem: Problem, found: Mechanism, name: str) -> bool:
    """Return whether a finding is in proportion to a covariate, counted from any value."""
    values = problem.state.value(name)
    low = float(values.min())
    high = float(values.max())
    middle = (low + high) / 2
    for term in found.terms:
        for screw in term.screws:
            at = []
            for value in (low, middle, high):
                number = Number(value)
                cause = substitute_value(screw.cause, name, number)
                own = cause.of(problem.state)
                at.append(np.asarray(own))
            if _is_bent(*at):
                return False
    return True


def _is_bent(first: Array, half: Array, last: Array) -> bool:
    """Return whether values half way are not the middle of those at both ends."""
    middle = (first + last) / 2
    bend = np.abs(half - middle)
    size = np.abs(first) + np.abs(last)
    least = SMOOTH * size.max()
    return bool(bend.max() > least)


def find_confounded(problem: Problem, found: Mechanism) -> str | None:
    """Find the covariate that a mechanism depends on, if it has one that sessions or the course of the
    campaign may stand for; of one that depends on time the covariate that went most with these."""
    data = problem.data
    covariates = set(data.covariates) - IN_TIME
    own = frozenset(n for n in found.names() if list_sources([n]) <= covariates)
    if len(own) > 1:
        return None
    candidates = own
    if not own and found.names() & IN_TIME:
        candidates = frozenset(covariates)
    likely: dict[str, float] = {}
    for name in sorted(candidates):
        share = _measure_confounded(problem, name)
        if share >= CONFOUNDED:
            likely[name] = share
    return max(likely, key=likely.__getitem__, default=None)


def _tell_steps(problem: Problem, stepping: Mechanism, when: str) -> Mechanism:
    """Tell steps of one joint's reading; of any other place their formula does."""
    places = list(stepping.names_by_place())
    frame, axis = places[0]
    is_one = len(places) == 1 and frame <= problem.robot.n
    is_joint = is_one and axis == joint_axis(problem.robot, frame)
    if not is_joint or stepping.names() != {"progress"}:
        return stepping
    sentence = f"The zero of joint {frame} is another one {when}."
    return replace(stepping, sentence=sentence)


def _measure_confounded(problem: Problem, name: str) -> float:
    """Measure the share of a covariate's variance that sessions and the course of the campaign explain:
    a curve in time, a warm-up, or few jumps, whichever explains more."""
    data = problem.data
    values = problem.state.value(name)
    powers = np.arange(1, MOST_POWER + 1)
    curve = data.progress[:, None] ** powers
    largest = _measure_share(data, values, curve)
    for warm_up in build_warm_ups(problem, WARM_UPS):
        course = np.asarray(warm_up.of(problem.state))
        column = course[:, None]
        share = _measure_share(data, values, column)
        largest = max(largest, share)
    moments = [moment for moment, _ in measure_jumps(data, name)]
    if 0 < len(moments) <= MOST_STEPS:
        passed = data.progress[:, None] > np.array(moments)
        share = _measure_share(data, values, passed.astype(float))
        largest = max(largest, share)
    return largest


def _measure_share(data: Measurements, values: Array, course: Array) -> float:
    """Measure the share of the variance of values (m,) that sessions and a course (m, k) explain."""
    deviation = values - values.mean()
    size = float(deviation @ deviation)
    if not size:
        return 0.0
    stacked = np.column_stack([values, course])
    within = _leave_sessions(data, stacked)
    own = within[:, 0]
    columns = within[:, 1:]
    coefficients, *_ = np.linalg.lstsq(columns, own, rcond=None)
    left = own - columns @ coefficients
    square = float(left @ left)
    return 1 - square / size


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


def _count_from_middle(problem: Problem, name: str) -> Cause:
    """Build the course in time of a covariate, counted from the middle of its range: in few digits, as
    formulas print it."""
    values = problem.state.value(name)
    middle = (values.min() + values.max()) / 2
    rounded = float(f"{middle:.4g}")
    smooth = _smooth(problem, name)
    return smooth - rounded


def _smooth(problem: Problem, name: str) -> Cause:
    """Build the course in time that a covariate is read off with errors of its own: powers of the
    campaign's course and warming up, fitted to its readings."""
    course: list[Cause] = [PROGRESS]
    for _ in range(1, MOST_POWER):
        last = course[-1]
        power = last * PROGRESS
        course.append(power)
    course += build_warm_ups(problem, WARM_UP_SHARES)
    return _fit_courses(problem, name, course)


def _fit_courses(problem: Problem, name: str, courses: Sequence[Cause]) -> Cause:
    """Fit functions of time and a constant to the readings of a covariate."""
    readings = problem.state.value(name)
    columns = [np.ones_like(readings)]
    for cause in courses:
        column = cause.of(problem.state)
        columns.append(np.asarray(column))
    design = np.stack(columns, axis=1)
    coefficients, *_ = np.linalg.lstsq(design, readings, rcond=SMOOTH)
    start, *slopes = coefficients.tolist()
    units = problem.names()
    fitted: Cause = Number(start, units[name])
    for slope, cause in zip(slopes, courses, strict=True):
        summand = slope * cause
        fitted = fitted + summand
    return fitted


def _put(found: Mechanism, name: str, course: Sequence[Cause]) -> Mechanism:
    """Put functions with coefficients of their own in the place of a covariate, whatever that is counted
    from."""

    def insert(cause: Cause, value: Cause) -> Cause:
        return substitute(cause, name, value)

    return _build_beside(found, course, insert)


def _put_value(found: Mechanism, name: str, value: Cause, words: str) -> Mechanism:
    """Put what a covariate was meanwhile, in words, in its place; what it is counted from stays."""

    def insert(cause: Cause, one: Cause) -> Cause:
        return substitute_value(cause, name, one)

    built = _build_beside(found, [value], insert)
    return _name_in_words(built, words)


def _put_in_time(found: Mechanism, course: Sequence[Cause], words: str) -> Mechanism:
    """Put functions with coefficients of their own, in words, in the place of all that depends on time
    alone."""
    built = _build_beside(found, course, substitute_time)
    return _name_in_words(built, words)


def _name_in_words(built: Mechanism, words: str) -> Mechanism:
    """Name a mechanism by its first place, and the course that it follows in words."""
    places = list(built.names_by_place())
    frame, axis = places[0]
    name = f"{frame} {axis} {words}"
    return replace(built, name=name)


def _build_beside(
    found: Mechanism, course: Sequence[Cause], insert: Callable[[Cause, Cause], Cause]
) -> Mechanism:
    """Build a finding's terms with functions of another course, put into its causes."""
    terms = []
    acts: dict[str, None] = {}
    for number, term in enumerate(found.terms, 1):
        for part, function in enumerate(course, 1):
            screws = []
            for screw in term.screws:
                cause = insert(screw.cause, function)
                moved = replace(screw, cause=cause)
                act = f"{moved.frame} {moved.axis} {cause}"
                screws.append(moved)
                acts[act] = None
            put = Term(f"a{number}{part}", tuple(screws))
            terms.append(put)
    words = "; ".join(acts)
    return Mechanism(words, tuple(terms))


def substitute_time(cause: Cause, value: Cause) -> Cause:
    """Put a value in the place of all of a formula that depends on time alone."""

    def is_in_time(part: Cause) -> bool:
        own = part.names()
        return bool(own) and own <= IN_TIME

    return _replace_parts(cause, is_in_time, value)


def substitute_value(cause: Cause, name: str, value: Cause) -> Cause:
    """Put a value in the place of a name in a formula."""

    def is_named(part: Cause) -> bool:
        match part:
            case Named(own):
                return own == name
        return False

    return _replace_parts(cause, is_named, value)


def substitute(cause: Cause, name: str, value: Cause) -> Cause:
    """Put a value in the place of a name in a formula, or of that less a constant: what a temperature is
    counted from is no part of another course."""

    def is_covariate(part: Cause) -> bool:
        match part:
            case Named(own) | Combined("+" | "-", Named(own), Number()):
                return own == name
        return False

    return _replace_parts(cause, is_covariate, value)


def _replace_parts(cause: Cause, is_replaced: Callable[[Cause], bool], value: Cause) -> Cause:
    """Put a value in the place of all parts of a formula that are to be replaced, the largest ones."""
    if is_replaced(cause):
        return value
    match cause:
        case Combined(_, left, right):
            left = _replace_parts(left, is_replaced, value)
            right = _replace_parts(right, is_replaced, value)
            return replace(cause, left=left, right=right)
        case Applied(_, argument):
            argument = _replace_parts(argument, is_replaced, value)
            return replace(cause, argument=argument)
    return cause
