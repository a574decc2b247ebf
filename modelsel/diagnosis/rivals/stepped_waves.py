"""Waves of a joint that are other ones from some moment of the campaign on, as an encoder's disk has them
that was taken off and mounted anew, or that begin then.

They are no candidates: of all moments and joints there would be too many. They stand against a joint's
wave that seems to stay, and against what changes smoothly with its reading and the course of the
campaign."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import pairwise, permutations

import numpy as np

from ..._typing import Array
from ...fitting.problem import Problem
from ...mechanisms.causes import cos, q, sin
from ...mechanisms.environment import step_after
from ...mechanisms.step_moments import list_step_moments
from ...mechanisms.terms import Mechanism
from ...mechanisms.waves import read_wave
from ..candidates.candidate import Candidate
from ..candidates.session_steps import round_between, say_row
from ..shapes.arm_shapes import list_turning
from ..shapes.distinct_places import Place
from ..shapes.driver_functions import IN_TIME
from ..shapes.shape_constants import find_own_wave
from ..shapes.unregistered import build_cell

# waves a turn that are looked for beside what is no wave
COUNTS = (1.0, 2.0, 3.0)
# moments at which a wave may change, at most, and places in the campaign that each side needs
MOMENTS = 40
MIN_PLACES = 6
# terms of one wave: a sine and a cosine
WAVE_TERMS = 2
# what has such waves, as far as is known
ANEW = (
    "encoder, gear or coupling that was mounted anew",
    "collision, tooth or coupling that slipped",
)


def generate_stepped_waves(problem: Problem, found: Mechanism) -> Iterator[Mechanism]:
    """Generate a joint's waves that change at some moment, beside a wave of it, of as many a turn, or
    beside what depends on its reading and the course of the campaign. None beside any other finding,
    or beside one that steps."""
    if list_step_moments(found.terms):
        return
    joint, count = find_own_wave(found)
    if count:
        counts: Sequence[float] = (count,)
    elif depends_in_time(problem, list(found.names_by_place()), found.names()):
        counts = COUNTS
    else:
        return
    yield from _build_all(problem, joint, counts, _choose_moments(problem))


def generate_waves_in_time(
    problem: Problem, place: Place, found: Sequence[Mechanism]
) -> Iterator[Mechanism]:
    """Generate the waves of a joint that change at some moment, one of theirs, too, beside several
    findings of one place that depend on its reading and the course of the campaign together."""
    joint, _ = place
    names = [one.names() for one in found]
    drivers = frozenset[str]().union(*names)
    if not depends_in_time(problem, [place], drivers):
        return
    terms = [term for one in found for term in one.terms]
    own = sorted(list_step_moments(terms))
    moments = np.append(_choose_moments(problem), own)
    waves = _build_all(problem, joint, COUNTS, np.unique(moments))
    yield from (wave for wave in waves if wave not in found)


def generate_other_moments(problem: Problem, found: Mechanism) -> Iterator[Mechanism]:
    """Generate waves like a found one that changes at a moment, which change at another one near."""
    joint = find_stepped_joint(found)
    if not joint:
        return
    counts = _read_counts(found)
    own = min(list_step_moments(found.terms))
    every = _list_between(problem)
    spacing = len(every) / MOMENTS
    nearest = np.argsort(np.abs(every - own))
    near = nearest[: 2 * int(np.ceil(spacing)) + 1]
    every_near = _build_all(problem, joint, counts, every[np.sort(near)])
    yield from (one for one in every_near if one != found)


def join_waves(
    problem: Problem, effects: Mapping[int, Candidate]
) -> Iterator[tuple[tuple[int, ...], Candidate]]:
    """Join a wave that is there from a moment on with one of as many a turn that stays: together they
    are a wave that changes then. Yields the numbers of both, and that wave."""
    for (g, later), (h, other) in permutations(effects.items(), 2):
        joint = find_stepped_joint(later.mechanism)
        counts = _read_counts(later.mechanism)
        is_new = len(later.mechanism.terms) == WAVE_TERMS
        if not joint or not is_new or find_own_wave(other.mechanism) != (joint, counts[0]):
            continue
        (at,) = list_step_moments(later.mechanism.terms)
        begins = say_row(problem.data, at)
        joined = _build(joint, counts[0], at, begins, is_new=False)
        yield (g, h), replace(later, mechanism=joined)


def find_stepped_joint(found: Mechanism) -> int:
    """Find the joint of which a finding is a wave that changes at a moment; 0 where it is anything else."""
    if not list_step_moments(found.terms) or not _read_counts(found):
        return 0
    return found.terms[0].screws[0].frame


def depends_in_time(problem: Problem, places: Sequence[Place], drivers: frozenset[str]) -> bool:
    """Return whether some drivers are the reading of the one joint that turns and the course of the
    campaign."""
    if len(places) != 1:
        return False
    ((joint, axis),) = places
    others = drivers - IN_TIME
    is_own = others == {f"q{joint}"} and others != drivers
    return is_own and axis == "rz" and joint in list_turning(problem.robot)


def _read_counts(found: Mechanism) -> list[float]:
    """Read the waves a turn of a found wave that changes."""
    counts = set()
    for term in found.terms:
        cause = term.screws[0].cause
        wave = read_wave(cause) or read_wave(getattr(cause, "right", cause))
        if wave is not None:
            counts.add(wave.count)
    return sorted(counts)


def _list_between(problem: Problem) -> Array:
    """List the middles between the places in the campaign that were measured, with enough on either
    side."""
    measured = np.unique(problem.data.progress)
    between = [round_between(before, after) for before, after in pairwise(measured.tolist())]
    inner = between[MIN_PLACES - 1 : len(between) - MIN_PLACES + 1]
    return np.array(inner)


def _choose_moments(problem: Problem) -> Array:
    """Choose the moments at which a wave may change, evenly among what was measured."""
    every = _list_between(problem)
    count = min(MOMENTS, len(every))
    last = max(len(every) - 1, 0)
    chosen = np.linspace(0, last, count).round()
    return every[chosen.astype(np.intp)]


def _build_all(
    problem: Problem, joint: int, counts: Sequence[float], moments: Array
) -> Iterator[Mechanism]:
    for at in moments.tolist():
        begins = say_row(problem.data, at)
        for count in counts:
            yield _build(joint, count, at, begins, is_new=False)
            yield _build(joint, count, at, begins, is_new=True)


def _build(joint: int, count: float, at: float, begins: str, is_new: bool) -> Mechanism:
    """Build a joint's wave that is another one after a moment, or that is there after it alone
    (`is_new`)."""
    angle = q(joint) if count == 1 else count * q(joint)
    step = step_after(at)
    waves = (sin(angle), cos(angle))
    later = tuple(step * wave for wave in waves)
    often = "one wave a turn"
    if count > 1:
        often = f"{count:g} waves a turn"
    causes = later
    words = f"{often} from some moment on"
    told = f"{often} {begins}"
    if not is_new:
        causes = (*waves, *later)
        changes = "changes" if count == 1 else "change"
        words = f"{often} that {changes} at some moment"
        told = f"{often}, which {changes} {begins}"
    sentence = f"Joint {joint} turns unevenly, {told}"
    built = build_cell((joint, "rz"), causes, words, sentence)
    return replace(built, usual_causes=ANEW)
