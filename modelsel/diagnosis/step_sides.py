"""The sides of steps: a row that was held out, between the two estimation rows that a step lies between,
was measured before it or after it, and no estimation row tells which.

A step's moment is known from the rows that models are fitted to, up to the rows on either side of it.
What was measured at the held-out rows is not looked at: what is said of them stays a prediction."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from .._typing import Mask
from ..fitting.problem import Problem
from ..mechanisms.campaign_registry import TARGET_STEP
from ..mechanisms.moved_targets import find_moved_targets
from ..mechanisms.step_moments import list_step_moments
from ..mechanisms.terms import Mechanism
from .effects import Effect
from .session_steps import name_steps


@dataclass(frozen=True, eq=False)
class OpenSide:
    """The held-out `rows` (m,) whose side of a step is not known.

    `step`: the step's name; `before`, `after`: the indices of the estimation rows around them."""

    step: str
    rows: Mask
    before: int
    after: int


def find_open_sides(
    problem: Problem, used: Mask, mechanisms: Sequence[Mechanism], effects: Sequence[Effect]
) -> tuple[OpenSide, ...]:
    """Find the held-out rows whose side of a fitted model's steps is not known.

    `used` (m,): the rows that it was fitted to. Where more than one moment of a step is likely, as the
    credible sets of `effects` tell, the rows between these are open, too. So are rows around where
    sessions meet: the instrument, a joint or a target may have moved a few rows from there."""
    steps = name_steps(problem)
    found = []
    for mechanism in mechanisms:
        is_of_targets = mechanism.stem == TARGET_STEP
        if mechanism.name not in steps and not is_of_targets:
            continue
        moments = _list_moments(mechanism, effects)
        moved = _find_moved(problem, mechanism)
        side = _find_open(problem, used, moved, mechanism.name, moments)
        if side is not None:
            found.append(side)
    return tuple(found)


def _find_moved(problem: Problem, mechanism: Mechanism) -> Mask:
    """Find the rows (m,) that a step moves: those of its targets where it is of some of several."""
    moved = [target.index for target in find_moved_targets(mechanism)]
    if not moved:
        return np.ones(len(problem), bool)
    return np.isin(problem.data.target, moved)


def _list_moments(mechanism: Mechanism, effects: Sequence[Effect]) -> list[float]:
    """List a step's likely moments: its own, and those of its name in its credible set."""
    alike = {mechanism}
    for effect in effects:
        if effect.candidate.mechanism != mechanism:
            continue
        for entry in effect.named.entries:
            other = entry.candidate.mechanism
            if other.name == mechanism.name:
                alike.add(other)
    terms = [term for one in alike for term in one.terms]
    return sorted(list_step_moments(terms))


def _find_open(
    problem: Problem, used: Mask, moved: Mask, step: str, moments: Sequence[float]
) -> OpenSide | None:
    """Find the rows between the estimation rows around a step's moments, of the rows that it moves;
    None where there are none."""
    progress = problem.data.progress
    earlier = np.flatnonzero(used & moved & (progress < moments[0]))
    later = np.flatnonzero(used & moved & (progress > moments[-1]))
    if not (earlier.size and later.size):
        return None
    last = earlier[progress[earlier].argmax()]
    first = later[progress[later].argmin()]
    between = (progress[last] < progress) & (progress < progress[first])
    rows = between & moved & ~used
    if not rows.any():
        return None
    return OpenSide(step, rows, int(last), int(first))


def mark_open(sides: Sequence[OpenSide], held_out: Mask) -> Mask:
    """Mark the held-out rows (m,) whose side of some step is not known."""
    marked = np.zeros(len(held_out), bool)
    for side in sides:
        marked |= side.rows
    return np.asarray(marked & held_out)
