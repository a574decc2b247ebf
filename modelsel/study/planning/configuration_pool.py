"""Draw or complete the pool of configurations that could be measured next."""

from __future__ import annotations

import re
from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace

import numpy as np

from ..._arguments import check_type, describe_value
from ..._random import generator
from ..._typing import Array
from ...calibration.calibration import Calibration
from ...exceptions import StudyError, sentence_list, suggest
from ...measurements.measurements import Measurements, build_measurements
from ...measurements.quantities.columns import READING_UNITS, UNITS
from ...robot.kinematics import Robot

COLLISIONS = (
    "Collisions are not known here: look at every posture before the arm moves there, and leave out "
    "those that it cannot take."
)
SETTABLE = ("payload_kg", "temperature_C")
TIME = "time_s"
# columns of a plan that are no conditions
OWN_COLUMN = re.compile(r"q\d+_(rad|deg|mm|m)|approach\d+|configuration")
APPROACH_COLUMN = re.compile(r"approach\d+")
# what rounding may add to a range that is given [deg, rad or mm]
SLACK = 1e-6
POOL_SIZE = 2000  # configurations of a pool that is drawn within ranges


def find_joint_ranges(
    robot: Robot, data: Measurements, limits: bool, joints: Mapping[str, tuple[float, float]]
) -> Array:
    """Return the range (n, 2) [rad or mm] in which each joint is drawn.

    It is the range measured; with `limits` that of the robot file, where it gives one; `joints`,
    such as {"q2_deg": (-90, 45)}, go before both. Raises StudyError.
    """
    lower = data.q.min(0)
    upper = data.q.max(0)
    ranges = np.stack([lower, upper], 1)
    for k, joint in enumerate(robot.joints):
        stated = joint.limits
        if limits and stated is not None:
            ranges[k] = stated
    check_joint_ranges(robot, joints)
    columns = _list_joint_columns(robot)
    for name, (low, high) in joints.items():
        k, factor = columns[name]
        ranges[k] = low * factor, high * factor
    return ranges


def check_joint_ranges(robot: Robot, joints: Mapping[str, tuple[float, float]]) -> None:
    """Check that ranges are of joints that a robot has, each from a lower to a higher number.
    Raises StudyError."""
    check_type("joints", joints, Mapping, 'ranges by name, as {"q2_deg": (-90, 45)}')
    columns = _list_joint_columns(robot)
    for name, bounds in joints.items():
        if name not in columns:
            hint = suggest(name, columns)
            problem = f'"{name}" is not a joint of {robot.name}.'
            raise StudyError(f"{problem} {hint}")
        try:
            low, high = bounds
            is_finite = np.isfinite(bounds).all()
        except (TypeError, ValueError):
            found = describe_value(bounds)
            raise StudyError(
                f"{name}: expected the two ends of a range, as (-90, 45), found {found}."
            ) from None
        is_range = is_finite and low <= high
        if not is_range:
            raise StudyError(
                f"{name}: a joint's range goes from a lower to a higher number, found {low:g} to "
                f"{high:g}."
            )


def _list_joint_columns(robot: Robot) -> dict[str, tuple[int, float]]:
    """Return the possible columns of readings: name -> (joint from 0, factor to rad or mm)."""
    columns = {}
    for k, prismatic in enumerate(robot.prismatic):
        units = READING_UNITS[prismatic]
        for unit in units:
            name = f"q{k + 1}_{unit}"
            factor = UNITS[unit]
            columns[name] = (k, factor)
    return columns


def draw_pool(
    calibration: Calibration, seed: int, data: Measurements, ranges: Array
) -> Measurements:
    """Draw configurations within the `ranges` (n, 2), each approached from a drawn side.

    Their covariates are those of measured rows.
    """
    robot = calibration.robot
    rng = generator(seed, "simulate")
    low, high = ranges.T
    q = rng.uniform(low, high, (POOL_SIZE, robot.n))
    rows = rng.integers(len(data), size=POOL_SIZE)
    approach = rng.choice([-1.0, 1.0], q.shape)
    return build_measurements(
        q,
        np.zeros((POOL_SIZE, 3)),
        approach=approach,
        covariates={name: values[rows] for name, values in data.covariates.items()},
        prismatic=robot.prismatic,
        coupling=robot.coupling,
    )


def keep_conditions(pool: Measurements, used: Collection[str]) -> Measurements:
    """Return a pool with the covariates alone that are conditions of a measurement: payload and
    temperature, and those whose names are `used`. A clock or a counter of the campaign is none:
    what follows the course of the campaign cannot be set."""
    conditions = {*SETTABLE, *used} - {TIME}
    covariates = {name: v for name, v in pool.covariates.items() if name in conditions}
    return replace(pool, covariates=covariates)


def repeat_for_targets(data: Measurements, targets: Sequence[str]) -> Measurements:
    """Return a pool with a row for each of the study's targets, where it lists none itself."""
    count = len(targets)
    lists_targets = len(data.targets) > 1
    if count == 1 or lists_targets:
        return data
    configurations = len(data)
    all_rows = np.arange(configurations)
    rows = np.repeat(all_rows, count)
    numbers = np.arange(count)
    target = np.tile(numbers, configurations)
    repeated = data.take(rows)
    names = tuple(targets)
    return replace(repeated, target=target, targets=names)


def draw_approaches(data: Measurements, seed: int) -> Measurements:
    """Draw the directions of approach of a pool whose file gives none; the plan prescribes them."""
    if not data.approach_from_order:
        return data
    configuration = data.configuration
    configurations = int(configuration.max()) + 1
    joints = data.q.shape[1]
    shape = (configurations, joints)
    rng = generator(seed, "simulate")
    drawn = rng.choice([-1.0, 1.0], shape)
    approach = drawn[configuration]
    return replace(data, approach=approach, path=None)


def leave_out_approaches(columns: Mapping[str, Array]) -> dict[str, Array]:
    """Return the columns of a plan without directions of approach."""
    return {n: values for n, values in columns.items() if not APPROACH_COLUMN.fullmatch(n)}


def describe_approaches(columns: Collection[str]) -> str:
    """Say that the directions of approach of a plan are instructions; nothing where it has none."""
    names = [name for name in columns if APPROACH_COLUMN.fullmatch(name)]
    if not names:
        return ""
    return (
        f"{names[0]} … {names[-1]} are instructions: come into each configuration with every joint "
        "moving that way (1: its reading grows). Where the arm goes straight from row to row, leave "
        "these columns out of the file that the study reads: the order of the rows says otherwise."
    )


def describe_conditions(columns: Collection[str]) -> str:
    """Say what to do with the columns of a plan that are neither readings nor directions; nothing
    where there are none."""
    conditions = [name for name in columns if not OWN_COLUMN.fullmatch(name)]
    if not conditions:
        return ""
    return (
        f"{sentence_list(conditions)}: as in the measured rows. Set what can be set; of what cannot, "
        "write down the value when you measure, and give that to the study."
    )


def describe_ranges(robot: Robot, limits: bool, joints: Mapping[str, tuple[float, float]]) -> str:
    """Return in words within what a pool was drawn."""
    text = "the joint ranges measured"
    limited = [joint.limits is not None for joint in robot.joints]
    if limits and all(limited):
        text = "the robot file's limits"
    elif limits and any(limited):
        text = "the robot file's limits where it gives any"
    elif limits:
        text += ", since the robot file gives no limits"
    if joints:
        text += f", {', '.join(joints)} as given"
    sentences = [text, *_list_ranges_beyond_limits(robot, joints)]
    return ". ".join(sentences)


def _list_ranges_beyond_limits(
    robot: Robot, joints: Mapping[str, tuple[float, float]]
) -> list[str]:
    """List the given ranges that leave the robot file's limits, in words."""
    columns = _list_joint_columns(robot)
    beyond = []
    for name, (low, high) in joints.items():
        k, factor = columns[name]
        limits = robot.joints[k].limits
        if limits is None:
            continue
        least, most = (limit / factor for limit in limits)
        if low < least - SLACK or high > most + SLACK:
            beyond.append(
                f"{name} goes beyond the joint's limits in the robot file, {least:.6g} to {most:.6g}: "
                "the arm may not reach these postures"
            )
    return beyond
