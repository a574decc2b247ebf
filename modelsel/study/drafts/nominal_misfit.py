"""How far measured positions are from the nominal arm, tracker and target found from them, and what
that says of a file."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ...exceptions import DataError, NotEstimable, sentence_list, write_rounded
from ...fitting.problem import Problem
from ...measurements.campaign.row_order import choose_standstill
from ...measurements.measurements import Measurements
from ...robot.kinematics import Robot
from ...setup.measured_orientations import describe_orientation_mistake
from ...setup.other_robots import (
    MAX_REACH_SHARE,
    MIN_CONFIGURATIONS,
    compute_registered_misfit,
    sample_positions,
)
from ...setup.registration import register
from ...setup.target_places import describe_wrong_targets
from ..preparation.checks import check_setup

# a reading of a file is the right one where the nominal arm fits so much better than by any other
CLEAR_FACTOR = 4.0
# a smaller median misfit [mm] is not one of measurements
MIN_MISFIT_MM = 0.003
# what is said of a nominal arm that does not fit
FAR = "that is far."


def measure_misfit(robot: Robot, data: Measurements) -> float | None:
    """Compute the median distance [mm] of measured positions from the nominal arm, tracker and
    target found from them; None where there are too few configurations."""
    try:
        no_tools = np.zeros((len(data.targets), 3))
        problem = Problem(robot, data, no_tools)
        all_rows = np.ones(len(data), bool)
        sample = sample_positions(problem, all_rows)
    except (DataError, NotEstimable):
        return None
    return None if sample is None else compute_registered_misfit(sample)


def describe_misfit(robot: Robot, data: Measurements) -> list[str]:
    """Say how well the nominal arm fits measurements, or why it is not tried; of a target that is no
    place on the flange, that alone."""
    misplaced = describe_wrong_targets(data)
    if misplaced is not None:
        return [misplaced]
    misfit = measure_misfit(robot, data)
    if misfit is None or not np.isfinite(misfit):
        return [_say_why_untried(data)]
    said = f"Instrument and target found from the rows, the nominal arm fits to {write_rounded(misfit)} mm"
    if misfit < MIN_MISFIT_MM:
        said += " (median): no arm is measured so well. These positions look computed, by the "
        return [said + "controller or a simulation; a calibration needs measured ones."]
    if misfit <= MAX_REACH_SHARE * robot.reach:
        return [f"{said} (median).", *_explain_orientation(robot, data)]
    said += f" (median): {FAR}"
    explained = _explain_misfit(robot, data)
    if explained:
        return [said, *explained]
    said += " Check the robot, the order of the joints and the units; "
    return [said + "modelsel check looks for the likeliest mistake."]


def is_said_far(lines: Sequence[str]) -> bool:
    """Whether lines say that the nominal arm does not fit."""
    text = " ".join(lines)
    return FAR in text


def _say_why_untried(data: Measurements) -> str:
    """Say why the nominal arm is not tried: too few configurations, or they are too much alike."""
    travel = np.ptp(data.q, axis=0)
    standstill = choose_standstill(data.prismatic)
    moves = travel > standstill
    moving = np.flatnonzero(moves) + 1
    if data.configurations < MIN_CONFIGURATIONS or not len(moving):
        return "Too few configurations to try the nominal arm on."
    listed = sentence_list([str(joint) for joint in moving])
    which = f"joint {listed} moves" if len(moving) == 1 else f"joints {listed} move"
    return (
        f"The nominal arm cannot be tried on these configurations: only {which}, which does not tell "
        "where instrument and target are."
    )


def _explain_orientation(robot: Robot, data: Measurements) -> list[str]:
    """Say which mistake in the quaternions explains orientations that are far from those of a nominal
    arm which fits the positions."""
    if data.rotation is None:
        return []
    no_tools = np.zeros((len(data.targets), 3))
    every_row = np.ones(len(data), bool)
    problem = Problem(robot, data, no_tools)
    mistake = describe_orientation_mistake(problem, every_row, registered=True)
    return [] if mistake is None else [mistake]


def _explain_misfit(robot: Robot, data: Measurements) -> list[str]:
    """Say which mistake of the set-up, or which other robot, explains positions that are far from
    the nominal arm, as `modelsel study` would."""
    targets, rows = len(data.targets), len(data)
    no_tools = np.zeros((targets, 3))
    every_row = np.ones(rows, bool)
    problem = Problem(robot, data, no_tools)
    try:
        registered = register(problem, every_row, per_group=False)
    except (DataError, NotEstimable):
        return []
    notes = check_setup(registered, every_row, registered=True, per_group=False)
    return [note.sentence for note in notes]
