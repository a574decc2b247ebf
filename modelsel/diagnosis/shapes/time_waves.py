"""Slow waves along a campaign: a hall that warms by day, a stand or a base that sways.

What changes slowly resembles an error that lasts. Unlike that, a wave is predicted."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from ...fitting.problem import Problem
from ...mechanisms.causes import Cause, cos, sin
from ...mechanisms.terms import Mechanism, Screw, Term
from ...mechanisms.waves import find_common_wave
from .campaign_clocks import choose_clock
from .candidate_kinds import CandidateKind
from .distinct_places import Place
from .unregistered import Unregistered, list_distinct_places

# waves over the whole campaign that are looked for, how far these are apart, and the steps between
# them once one is found
COUNTS = (0.5, 1.0, 1.5, 2.0, 2.5)
SPACING = 0.5
STEP = 0.02
DIGITS = 2
# largest gap between rows, in shares of a wave's period
LARGEST_GAP = 0.25


def generate_time_waves(problem: Problem) -> Iterator[Unregistered]:
    """Generate slow waves along the campaign at every place; those of a place weigh as much as a
    cell."""
    clock, duration = choose_clock(problem)
    if not duration:
        return
    counts = [count for count in COUNTS if _is_covered(problem, clock, duration / count)]
    kind = CandidateKind.TIME_WAVE
    weight = 1 / len(COUNTS)
    for place in list_distinct_places(problem):
        for count in counts:
            wave = _build_wave(place, count, clock, duration)
            yield Unregistered(wave, kind, weight)


def generate_finer_time_waves(problem: Problem, found: Mechanism) -> Iterator[Mechanism]:
    """Generate slow waves whose numbers lie between those of a found one's neighbours."""
    clock, duration = choose_clock(problem)
    wave = find_common_wave([term.screws[0].cause for term in found.terms])
    places = list(found.names_by_place())
    if wave is None or wave[0] != clock or len(places) != 1 or not duration:
        return
    own = wave[1] * duration / (2 * np.pi)
    steps = round(SPACING / STEP)
    for k in range(1 - steps, steps):
        count = round(own + k * STEP, DIGITS)
        if k and count > 0 and _is_covered(problem, clock, duration / count):
            yield _build_wave(places[0], count, clock, duration)


def _is_covered(problem: Problem, clock: Cause, period: float) -> bool:
    """Return whether rows cover a wave: one that runs through long gaps may be of any size there."""
    times = np.unique(clock.of(problem.state))
    gaps = np.diff(times)
    widest = gaps.max(initial=0.0)
    return bool(widest <= LARGEST_GAP * period)


def _build_wave(place: Place, count: float, clock: Cause, duration: float) -> Mechanism:
    """Build a wave of unknown phase at a place, `count` over the campaign."""
    factor = float(f"{2 * np.pi * count / duration:.6g}")
    angle = factor * clock
    terms = (Term("ms", (Screw(*place, sin(angle)),)), Term("mc", (Screw(*place, cos(angle)),)))
    waves = "one wave" if count == 1 else f"{count:g} waves"
    return Mechanism(f"{place[0]} {place[1]} {waves} along the campaign", terms)
