"""The sides of steps: a row that was held out, between the two estimation rows that a step lies between,
was measured before it or after it, and no estimation row tells which.

A step's moment is known from the rows that models are fitted to, up to the rows on either side of it.
What was measured at the held-out rows is not looked at: what is said of them stays a prediction."""

from __future__ import annotations

from collections.abc import Container, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..._typing import Mask
from ...fitting.problem import Problem
from ...mechanisms.campaign_registry import TARGET_STEP
from ...mechanisms.moved_targets import find_moved_targets
from ...mechanisms.step_moments import list_step_moments
from ...mechanisms.terms import Mechanism
from ..candidates.session_steps import name_steps
from ..rivals.moved_links import find_moved_frame
from ..rivals.stepped_waves import find_stepped_joint
from .effects import Effect


@dataclass(frozen=True, eq=False)
class OpenSide:
    """The held-out `rows` (m,) whose side of a step is not known.

    `step`: the step's name, or of which waves or frame it is; `before`, `after`: the indices of the estimation rows around it, between
    which they lie; or else they are of the `target` (0-based) of which no estimation row tells whether it
    moved, and `later`, or not, than that."""

    step: str
    rows: Mask
    before: int
    after: int
    target: int | None = None
    later: bool = True


def find_open_sides(
    problem: Problem, used: Mask, mechanisms: Sequence[Mechanism], effects: Sequence[Effect]
) -> tuple[OpenSide, ...]:
    """Find the held-out rows whose side of a fitted model's steps is not known.

    `used` (m,): the rows that it was fitted to. Where more than one moment of a step is likely, as the
    credible sets of `effects` tell, the rows between these are open, too. So are rows around where
    sessions meet: the instrument, a joint or a target may have moved a few rows from there. Where every
    target moved that was fitted on both sides of a step, the others may have, too."""
    steps = name_steps(problem)
    found = []
    for mechanism in mechanisms:
        name = _name_step(mechanism, steps)
        if name is None:
            continue
        moments = _list_moments(mechanism, effects)
        moved = _find_moved(problem, mechanism)
        around = _find_around(problem, used & moved, moments)
        if around is None:
            continue
        sides = [_find_between(problem, moved, name, around)]
        if mechanism.stem == TARGET_STEP:
            sides += _find_untold(problem, used, moved, name, around)
        for side in sides:
            rows = side.rows & ~used
            if rows.any():
                found.append(replace(side, rows=rows))
    return tuple(found)


def _name_step(mechanism: Mechanism, steps: Container[str]) -> str | None:
    """Return a step's name, or of which waves or frame it is; None for a mechanism that is no step."""
    if joint := find_stepped_joint(mechanism):
        return f"of joint {joint}'s waves"
    if frame := find_moved_frame(mechanism):
        return f"of frame {frame}"
    if mechanism.name in steps or mechanism.stem == TARGET_STEP:
        return mechanism.name
    return None


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


def _find_around(problem: Problem, used: Mask, moments: Sequence[float]) -> tuple[int, int] | None:
    """Find the last of the used rows (m,) before a step's moments and the first after them; None where
    there are none."""
    progress = problem.data.progress
    is_before = progress < moments[0]
    is_after = progress > moments[-1]
    earlier = np.flatnonzero(used & is_before)
    later = np.flatnonzero(used & is_after)
    if not (earlier.size and later.size):
        return None
    last = earlier[progress[earlier].argmax()]
    first = later[progress[later].argmin()]
    return int(last), int(first)


def _find_between(problem: Problem, moved: Mask, step: str, around: tuple[int, int]) -> OpenSide:
    """Find the rows between the two around a step, of the rows (m,) that it moves."""
    progress = problem.data.progress
    last, first = around
    is_later = progress[last] < progress
    is_earlier = progress < progress[first]
    between = is_later & is_earlier
    rows = between & moved
    return OpenSide(step, rows, last, first)


def _find_untold(
    problem: Problem, used: Mask, moved: Mask, step: str, around: tuple[int, int]
) -> list[OpenSide]:
    """Find the rows of targets of which the used rows (m,) do not tell whether they moved, as these are
    on one side of a step alone, or there are none; none where another target stood still."""
    data = problem.data
    last, first = around
    progress = data.progress
    is_before = progress <= progress[last]
    is_after = progress >= progress[first]
    before = data.target[used & is_before].tolist()
    after = data.target[used & is_after].tolist()
    both = set(before) & set(after)
    own = data.target[moved].tolist()
    if not both <= set(own):
        return []
    sides = []
    for target in range(len(data.targets)):
        if target in both:
            continue
        own = data.target == target
        later = target not in after
        beyond = ~is_before if later else ~is_after
        side = OpenSide(step, own & beyond, last, first, target, later)
        sides.append(side)
    return sides


def mark_open(sides: Sequence[OpenSide], held_out: Mask) -> Mask:
    """Mark the held-out rows (m,) whose side of some step is not known."""
    marked = np.zeros(len(held_out), bool)
    for side in sides:
        marked |= side.rows
    return np.asarray(marked & held_out)
