"""Steps of a slide's zero that no measurement tells from the instrument's.

Where a slide points the same way in every posture, as that of a SCARA arm does, its zero and the instrument
shift all targets alike. So beside a step of that zero stands a step of the instrument along the slide alone:
with the six numbers of any step it would hardly count."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from .._typing import Array
from ..fitting.problem import Problem
from ..mechanisms.causes import Cause
from ..mechanisms.environment import STEP, tracker_step
from ..mechanisms.terms import Mechanism, Screw, Term
from ..robot.rigid import AXES

ZERO_STEP, SET_UP_STEP = "zero-step", "tracker-step"
# what stands before the moment in the sentence of a zero that steps
IS_ANOTHER = " is another one "
# share of a direction that is none
NONE = 1e-6


def add_steps_along_slides(
    problem: Problem, mechanisms: Sequence[Mechanism]
) -> tuple[Mechanism, ...]:
    """Add to steps of slides' zeros those of the instrument along them, where such steps are looked for."""
    is_offered = any(one.name == SET_UP_STEP for one in mechanisms)
    if not is_offered or not any(problem.robot.prismatic):
        return tuple(mechanisms)
    return (*mechanisms, *_generate_twins(problem, mechanisms))


def _generate_twins(problem: Problem, mechanisms: Sequence[Mechanism]) -> Iterator[Mechanism]:
    """Generate the steps of the instrument along slides that point one way."""
    directions = _find_directions(problem)
    for one in mechanisms:
        if one.stem != ZERO_STEP or one.joint not in directions:
            continue
        screws = one.terms[0].screws
        if [(screw.frame, screw.axis) for screw in screws] == [(one.joint, "tz")]:
            along = directions[one.joint]
            yield _shift_instrument(problem, one, along, screws[0].cause)


def _find_directions(problem: Problem) -> dict[int, Array]:
    """Find the slides (from 1) that point the same way on all rows, each with its direction (3,) in frame
    0."""
    robot = problem.robot
    axes = problem.state.loaded_pose().axes
    directions = {}
    for k, slides in enumerate(robot.prismatic):
        along = axes[k, 2]
        if slides and np.ptp(along, axis=1).max() < NONE:
            directions[k + 1] = along[:, 0]
    return directions


def _shift_instrument(problem: Problem, zero: Mechanism, along: Array, cause: Cause) -> Mechanism:
    """Build the step of the instrument that does what a slide's zero does."""
    shares = problem.robot.joints[0].before[:3, :3].T @ along
    screws = []
    for axis, share in zip(AXES[:3], shares.tolist(), strict=True):
        if abs(share) > NONE:
            number = round(share, 9)
            screws.append(Screw(1, axis, cause if number == 1 else number * cause))
    _, _, begins = zero.sentence.partition(IS_ANOTHER)
    any_step = tracker_step(problem.robot, 0.5)
    return Mechanism(
        SET_UP_STEP,
        (Term("j", tuple(screws), STEP["t"]),),
        f"The instrument and the base stand differently along the slide of joint {zero.joint} {begins}",
        f"H_1 = j · {cause}, along the slide of joint {zero.joint}",
        any_step.source,
        usual_causes=any_step.usual_causes,
    )
