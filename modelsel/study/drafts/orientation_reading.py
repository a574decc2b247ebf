"""Which convention the nominal arm's orientations follow, among those that fit the columns."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from ..._typing import Array
from ...exceptions import ModelselError
from ...fitting.problem import Problem
from ...measurements.formats.table import Source
from ...measurements.reader import read_measurements
from ...measurements.recognition.column_guesses import Choice, Reading
from ...robot.kinematics import Robot
from ...robot.rigid import nearest_rotation, rotation_vector
from ...setup.measured_orientations import GOOD_ANGLE
from ...setup.other_robots import select_most_frequent
from ...setup.registration import register
from .nominal_misfit import CLEAR_FACTOR

# rows that are examined
MAX_ROWS = 200


def settle_orientation(
    source: Source, robot: Robot, columns: Mapping[str, str], choice: Choice
) -> tuple[Choice, str]:
    """Keep the readings of an orientation that follow the nominal arm, the best alone where it is
    clearly better; return also what is said of columns that follow it by none."""
    angles = [_try_reading(source, robot, {**columns, **r.columns}) for r in choice.readings]
    order = np.argsort(angles)
    best = angles[order[0]]
    if not best <= GOOD_ANGLE:
        inverted = _describe_inverted(source, robot, columns, choice)
        if inverted:
            return replace(choice, readings=()), inverted
        shown = choice.readings[int(order[0])].words
        turn = f"by {np.degrees(best):.3g}° (median)" if np.isfinite(best) else "altogether"
        return replace(choice, readings=()), (
            f"Orientations are left out: read as {shown}, the likeliest way, they miss the nominal "
            f"arm's {turn}. Measured ones are in the instrument's frame; a controller's own are not."
        )
    good = [k for k in order if angles[k] <= max(CLEAR_FACTOR * best, 1e-9)]
    kept = [_explain(choice.readings[k], angles[k]) for k in good]
    return replace(choice, readings=tuple(kept)), ""


def _describe_inverted(
    source: Source, robot: Robot, columns: Mapping[str, str], choice: Choice
) -> str:
    """Say that orientations follow the nominal arm the other way round; empty where they do not."""
    angles = []
    for reading in choice.readings:
        mapped = {**columns, **reading.columns}
        angle = _try_reading(source, robot, mapped, inverted=True)
        angles.append(angle)
    best = int(np.argmin(angles))
    if not angles[best] <= GOOD_ANGLE:
        return ""
    shown = choice.readings[best].words
    degrees = np.degrees(angles[best])
    return (
        f"Orientations are left out: read as {shown}, they are the nominal arm's inverted (to "
        f"{degrees:.2g}°, median), the instrument's as the target sees it. Export the target's in the "
        "instrument's frame."
    )


def _explain(reading: Reading, angle: float) -> Reading:
    degrees = np.degrees(angle)
    reason = f"{degrees:.2g}° from the nominal arm's, in the median"
    return replace(reading, reason=reason)


def _try_reading(
    source: Source, robot: Robot, columns: Mapping[str, str], *, inverted: bool = False
) -> float:
    """Compute the median angle [rad] of measured orientations, or of their inverses, from the
    nominal arm's, the target's own turn on the flange free; infinite where the file cannot be read
    so."""
    try:
        data = read_measurements(source, robot, columns)
        problem = Problem(robot, data, np.zeros((len(data.targets), 3)))
        rows = select_most_frequent(problem, np.ones(len(data), bool))[:MAX_ROWS]
        sample = problem.take(rows)
        placed = register(sample.plain_points(), np.ones(len(rows), bool), per_group=False)
    except ModelselError:
        return float("inf")
    R, _ = placed.placement
    flange = placed.pose(slice(None)).axes[-1, :3].transpose(2, 1, 0)
    carried = R[sample.data.group] @ flange
    rotation = np.asarray(sample.data.rotation)
    if inverted:
        rotation = rotation.transpose(0, 2, 1)
    on_flange = np.einsum("mji,mjk->mik", carried, rotation)
    return _measure_scatter(on_flange)


def _measure_scatter(turns: Sequence[Array] | Array) -> float:
    """Compute the median angle [rad] of rotations (m, 3, 3) from their mean."""
    mean = nearest_rotation(np.mean(turns, axis=0))
    deviation = rotation_vector(np.asarray(turns) @ mean.T)
    return float(np.median(np.linalg.norm(deviation, axis=1)))
