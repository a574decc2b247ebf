"""What a user of `modelsel init` says of the set-up: the target on the flange, whether the positions
are in the robot's base frame, which way gravity points."""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import hypot

import numpy as np

from ..._typing import LARGEST
from ...exceptions import DataError, NotEstimable, StudyError, write_rounded
from ...fitting.design import residuals
from ...fitting.problem import Problem
from ...measurements.measurements import Measurements
from ...robot.kinematics import Robot
from ...setup.other_robots import sample_positions
from ...setup.registration import register
from ..preparation.gravity_direction import describe_upward_gravity, write_direction

# of the reach: positions farther from the arm, as aligned, are in another frame
FAR_SHARE = 0.02
OTHER_FRAME = (
    "That is far: the base frame of the robot file may be turned against the controller's, as it often "
    "is in tables of DH parameters. Without --aligned the frame is found."
)
Triple = tuple[float, float, float]


@dataclass(frozen=True)
class StatedSetup:
    """What is said: `tool` [mm, flange frame], `aligned` positions, `gravity` in the base frame."""

    tool: Triple | None = None
    aligned: bool = False
    gravity: Triple | None = None

    def __post_init__(self) -> None:
        """Raises StudyError for numbers that no place and no direction has."""
        stated = {"--tool": self.tool, "--gravity": self.gravity}
        for option, values in stated.items():
            if values is None:
                continue
            is_valid = np.abs(values) <= LARGEST
            if not is_valid.all():
                listed = " ".join(map(str, values))
                raise StudyError(
                    f"{option}: expected three finite numbers below {LARGEST:g}, found {listed}."
                )
        if self.gravity is not None and not any(self.gravity):
            raise StudyError(
                "--gravity: expected a direction in the base frame, such as 0 0 -1, found 0 0 0. "
                "Leave it out where it is not known."
            )

    def place(self, robot: Robot) -> Robot:
        """Return a robot with the gravity that is stated."""
        return robot if self.gravity is None else point_gravity(robot, self.gravity)

    def format_lines(self) -> list[str]:
        """Write the lines of the study's table [robot]."""
        lines = ["register = true  # instrument frame and target are found from the measurements"]
        note = "  # a first guess: it is found from the measurements"
        if self.aligned:
            lines = ["register = false  # positions are in the robot's base frame"]
            note = ""
        tool = self.tool
        gravity = self.gravity
        if tool is not None:
            given = _write_numbers(tool)
            lines.append(f"tool_mm = {given}{note}")
        if gravity is not None:
            given = _write_numbers(gravity)
            lines.append(f"gravity = {given}  # in the robot's base frame")
        return lines

    def describe(self, robot: Robot, data: Measurements) -> list[str]:
        """Say what follows from it: how the nominal arm fits positions as aligned, and whether gravity
        points upwards where the robot was found to stand."""
        lines = []
        if self.gravity is not None:
            lines.append(f"Gravity as given: {write_direction(self.gravity)} in the base frame.")
        try:
            problem = sample_positions(self._set_up(robot, data), np.ones(len(data), bool))
            if problem is None:
                return lines
            if self.aligned:
                left = _compute_misfit(problem)
                said = f"As aligned, with the target given, the nominal arm fits to {write_rounded(left)} mm"
                lines.append(f"{said} (median), including the alignment error.")
                if not _is_near(problem):
                    lines.append(OTHER_FRAME)
            elif self.gravity is None:
                placed = register(problem, np.ones(len(problem), bool), per_group=False)
                if _is_near(placed):
                    lines.append(describe_upward_gravity(robot, placed) or "")
        except (DataError, NotEstimable):
            return lines
        return [line for line in lines if line]

    def _set_up(self, robot: Robot, data: Measurements) -> Problem:
        tool = np.array(self.tool or (0.0, 0.0, 0.0))
        return Problem(robot, data, np.tile(tool, (len(data.targets), 1)))


def _compute_misfit(problem: Problem) -> float:
    """Compute the median distance [mm] of the positions from the nominal arm as it stands."""
    offset = residuals(problem)[:, :3]
    distance = np.linalg.norm(offset, axis=1)
    return float(np.median(distance))


def _is_near(problem: Problem) -> bool:
    """Whether the nominal arm fits: of one that is far off, nothing is known of where it stands."""
    farthest = FAR_SHARE * problem.robot.reach
    return _compute_misfit(problem) <= farthest


def _write_numbers(values: Triple) -> str:
    """Write numbers as a list of TOML."""
    numbers = []
    for value in values:
        text = f"{value:.10g}"
        numbers.append(text)
    listed = ", ".join(numbers)
    return f"[{listed}]"


def point_gravity(robot: Robot, direction: Triple | list[float]) -> Robot:
    """Return a robot with gravity in another direction, of any length, in its base frame."""
    length = hypot(*direction)  # also where the squares are too small to be numbers
    x, y, z = direction
    return replace(robot, gravity=(x / length, y / length, z / length))
