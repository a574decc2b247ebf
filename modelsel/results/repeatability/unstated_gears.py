"""Joints that seem not to repeat, where an error once a turn of the motor would look the same and no
gear ratio is stated."""

from __future__ import annotations

from collections.abc import Sequence

from ...fitting.error_structure import ErrorPart, ErrorStructure
from ...fitting.possible_parts import GIVEN
from ...mechanisms.drives import HIGH_WAVES, WAVES
from ...robot.kinematics import Robot

# share of what is left from which joints that do not repeat are most of it
MOST_SHARE = 0.5


def find_unstated_gears(
    errors: ErrorStructure, robot: Robot, ratios: Sequence[float] | None
) -> tuple[str, ...]:
    """Find the parts of turning joints that seem not to repeat, and have no gear ratio stated, where
    these are most of what is left: a ripple once a turn of the motor is looked for in every search with its
    ratio alone, and without it only screened for, up to some hundred waves a turn of the joint."""
    unstated = []
    for joint, slides in enumerate(robot.prismatic, 1):
        ratio = 0.0 if ratios is None else ratios[joint - 1]
        if not ratio and not slides:
            name = f"joint {joint}"
            unstated.append(name)
    found = [part for part in errors.parts if part.name in unstated]
    shares = [part.share for part in found]
    share = sum(shares)
    if share < MOST_SHARE:
        return ()
    return tuple(part.name for part in found)


def ask_for_gears(part: ErrorPart, unstated: Sequence[str]) -> str:
    """Ask for the gear ratios where an error once a turn of the motor may be what seems not to repeat."""
    if part.name not in unstated or part.told_by in ("repeats", GIVEN):
        return ""
    return (
        f" So would an error that comes once a turn of its motor. Where the ratio is not known, up to {HIGH_WAVES[-1]} "
        "waves a turn are looked for, and only large ones are found above "
        f"{WAVES[-1]}: state gear_ratios under [robot] in the study file."
    )
