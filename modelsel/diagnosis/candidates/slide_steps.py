"""Steps of a slide's zero that no measurement tells from the instrument's.

Where a slide points the same way in every posture, as that of a SCARA arm does, its zero and the instrument
shift all targets alike. So beside a step of that zero stands a step of the instrument along the slide alone:
with the six numbers of any step it would hardly count."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from ..._typing import Array
from ...fitting.problem import Problem
from ...mechanisms.causes import Cause
from ...mechanisms.environment import STEP, tracker_step
from ...mechanisms.terms import Mechanism, Screw, Term
from ...robot.rigid import AXES

ZERO_STEP, SET_UP_STEP = "zero-step", "tracker-step"
# what stands before the moment in the sentence of a zero that steps
IS_ANOTHER = " is another one "
# change of a direction that is none, and digits of one
NONE = 1e-6
DIGITS = 7


def add_steps_along_slides(
    problem: Problem, mechanisms: Sequence[Mechanism]
) -> tuple[Mechanism, ...]:
    """Add to steps of slides' zeros those of the instrument along them, where such steps are looked for."""
    known = tuple(mechanisms)
    names = {one.name for one in known}
    robot = problem.robot
    if SET_UP_STEP not in names or not any(robot.prismatic):
        return known
    twins = _generate_twins(problem, known)
    return (*known, *twins)


def _generate_twins(problem: Problem, mechanisms: Sequence[Mechanism]) -> Iterator[Mechanism]:
    """Generate the steps of the instrument along slides that point one way."""
    directions = _find_directions(problem)
    for one in mechanisms:
        joint = one.joint
        if one.stem != ZERO_STEP or joint not in directions:
            continue
        (term,) = one.terms
        first, *others = term.screws
        is_own = first.frame == joint and first.axis == "tz"
        if is_own and not others:
            along = directions[joint]
            yield _shift_instrument(problem, one, along, first.cause)


def _find_directions(problem: Problem) -> dict[int, Array]:
    """Find the slides (from 1) that point the same way on all rows, each with its direction (3,) in frame
    0."""
    robot = problem.robot
    at = problem.state.loaded_pose()
    directions = {}
    for k, slides in enumerate(robot.prismatic):
        along = at.axes[k, 2]
        changes = np.ptp(along, axis=1)
        is_still = changes.max() < NONE
        if slides and is_still:
            joint = k + 1
            directions[joint] = along[:, 0]
    return directions


def _shift_instrument(problem: Problem, zero: Mechanism, along: Array, cause: Cause) -> Mechanism:
    """Build the step of the instrument that does what a slide's zero does."""
    robot = problem.robot
    before = robot.joints[0].before
    R = before[:3, :3]
    shares = R.T @ along
    screws = []
    for axis, share in zip(AXES[:3], shares.tolist(), strict=True):
        number = round(share, DIGITS)
        amount = cause
        if number != 1:
            amount = number * cause
        if number:
            screw = Screw(1, axis, amount)
            screws.append(screw)
    _, _, begins = zero.sentence.partition(IS_ANOTHER)
    any_step = tracker_step(robot, 0.5)
    return Mechanism(
        SET_UP_STEP,
        (Term("j", tuple(screws), STEP["t"]),),
        f"The instrument and the base stand differently along the slide of joint {zero.joint} {begins}",
        f"H_1 = j · {cause}, along the slide of joint {zero.joint}",
        any_step.source,
        usual_causes=any_step.usual_causes,
    )
