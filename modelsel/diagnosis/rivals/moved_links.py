"""Links that stand differently from some moment of the campaign on, as a collision bends them: all that
follows is moved and turned alike in the axes of the joint that it hangs on.

They are no candidates: of all moments and links there would be too many. They stand against every other
step, of the instrument, a target or a joint's zero, each of which does a part of what they do."""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Iterator
from itertools import pairwise, starmap

import numpy as np

from ...fitting.problem import Problem
from ...mechanisms.campaign_registry import TARGET_STEP
from ...mechanisms.environment import STEP, step_after
from ...mechanisms.step_moments import list_step_moments
from ...mechanisms.terms import Mechanism, Screw, Term
from ...robot.rigid import AXES
from ..candidates.scanned_constants import COORDINATES_OF_STEP
from ..candidates.session_steps import SET_UP_STEPS, round_between, say_row
from ..candidates.slide_steps import ZERO_STEP

# steps that a link's may pass for
OTHER_STEPS = (*SET_UP_STEPS, TARGET_STEP, ZERO_STEP)
# moments on either side of a found step's that are tried, too
NEAR = 3
NAME = "step of frame "
# what moves a link, as far as is known
BENT = ("collision that bent a link", "screws of a link or a bearing that slipped")


def generate_moved_links(problem: Problem, found: Mechanism) -> Iterator[Mechanism]:
    """Generate steps of what follows each link, about when a found step happened: of the instrument, of
    the target, of a joint's zero, or of what follows another link. None beside any other finding, or
    beside a step of one target of several."""
    moments = sorted(list_step_moments(found.terms))
    if len(moments) != 1 or not _is_step(found):
        return
    (own,) = moments
    robot = problem.robot
    joints = range(2, robot.n + 1)
    near = _list_near(problem, own)
    for at in near:
        begins = say_row(problem.data, at)
        for joint in joints:
            yield _build(joint, at, begins)


def _is_step(found: Mechanism) -> bool:
    """Whether a finding is a step that may be one of a link."""
    if found.name in OTHER_STEPS or found.stem == ZERO_STEP:
        return True
    return find_moved_frame(found) > 0


def find_moved_frame(found: Mechanism) -> int:
    """Find the frame of which a finding is a step, with all that follows; 0 where it is anything else."""
    name = found.name
    if not name.startswith(NAME):
        return 0
    number = name.removeprefix(NAME)
    return int(number)


def _list_near(problem: Problem, own: float) -> list[float]:
    """List a step's moment and those between measured places near it, with rows enough on either side."""
    progress = problem.data.progress
    measured = np.unique(progress).tolist()
    place = bisect_left(measured, own) - 1
    if not 0 <= place < len(measured) - 1:
        return []  # all rows are on one side of it
    first = max(place - NEAR, 0)
    around = measured[first : place + NEAR + 2]
    near = list(starmap(round_between, pairwise(around)))
    near[place - first] = own
    needed = COORDINATES_OF_STEP * len(AXES)
    moments = []
    for at in near:
        before = int((progress < at).sum())
        after = int((progress > at).sum())
        fewest = min(before, after)
        if fewest * problem.components >= needed:
            moments.append(at)
    return moments


def _build(joint: int, at: float, begins: str) -> Mechanism:
    """Build the step of a joint's frame with all that follows, in the six numbers of any step."""
    cause = step_after(at)
    terms = []
    for axis in AXES:
        screw = Screw(joint, axis, cause)
        kind = axis[0]
        term = Term(f"l{joint}{axis}", (screw,), STEP[kind])
        terms.append(term)
    return Mechanism(
        f"{NAME}{joint}",
        tuple(terms),
        f"Joint {joint} and what it carries stand differently on link {joint - 1} {begins}",
        usual_causes=BENT,
    )
