"""Whether positions and readings belong to different moments, of an arm that was measured along lines without
a clock: its speed is known in steps from row to row."""

from __future__ import annotations

import numpy as np

from ...exceptions import NotEstimable, write_rounded
from ...fitting.design import Model
from ...fitting.least_squares import fit
from ...fitting.problem import Problem
from ...measurements.stretches import measure_row_steps, number_stretches
from ...mechanisms.causes import Named
from ...mechanisms.drives import all_joints
from ...mechanisms.motors import drive_screws
from ...mechanisms.terms import Mechanism, Term
from ...notices import ROWS_LATE, Note
from ...robot.kinematics import Robot
from .trial_columns import measure_left, widen_rows

# how far a motor goes from row to row, and the usual delays in such steps
STEP, DELAYS = "row_step_{}", (1e-4, 2.0)
# share of the base's squares that a delay has to take, and times its standard error
LEAST_SHARE, CLEAR = 0.5, 6.0
# mm rms that are rounding, of data without noise
ROUNDING_MM = 1e-6


def late_row_notes(problem: Problem, base: Model) -> tuple[Note, ...]:
    """Return the warning that positions and readings of a problem belong to different moments, where one delay
    explains half of what the base leaves. Where there is a clock, the search finds that itself."""
    data = problem.data
    if data.rate is not None or data.gauges is not None:
        return ()
    if number_stretches(data) is None:
        return ()
    timed = _add_steps(problem)
    late = _build_delay(problem.robot)
    delayed = Model((*base.mechanisms, late))
    try:
        before = fit(problem, base)
        start = np.append(before.theta, 0.0)
        after = fit(timed, delayed, start=start)
    except NotEstimable:
        return ()
    (term,) = after.locate(late)
    delay = float(after.theta[term])
    error = after.standard_errors[term]
    is_clear = abs(delay) > CLEAR * error
    if not is_clear or after.rss > LEAST_SHARE * before.rss:
        return ()
    left = measure_left(problem, before)
    if left < ROUNDING_MM:
        return ()
    own = measure_left(timed, after)
    side = "later" if delay > 0 else "earlier"
    percent = write_rounded(100 * abs(delay))
    sentence = (
        f"The rows follow one another along lines. With positions {percent} % of a step from row to row {side} than the "
        f"joint readings beside them, {write_rounded(own)} mm rms would be left, where the base leaves {write_rounded(left)} mm: "
        "readings and positions seem to belong to different moments. Add the time of every row (time_s), or measure "
        "where the arm stands still."
    )
    return (Note(ROWS_LATE, sentence),)


def _add_steps(problem: Problem) -> Problem:
    """Add to the measurements how far every motor goes from row to row along its line."""
    steps = measure_row_steps(problem.data)
    columns = {STEP.format(joint): column for joint, column in enumerate(steps.T, 1)}
    return widen_rows(problem, columns)


def _build_delay(robot: Robot) -> Mechanism:
    """Build one delay of all joints, in steps from row to row."""
    screws = [
        screw
        for joint in all_joints(robot)
        for screw in drive_screws(robot, joint, Named(STEP.format(joint)))
    ]
    return Mechanism(ROWS_LATE, (Term("delay", tuple(screws), DELAYS),), "", "", "")
