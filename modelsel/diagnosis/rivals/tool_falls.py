"""A target that is loose across the flange falls from one side to the other as gravity across it
changes sign; along the flange's axis that is tool-play, which the registry has."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from ..._typing import Array
from ...fitting.problem import Problem
from ...measurements.campaign.state_names import needs_gravity
from ...mechanisms.motors import is_joint_motion
from ...mechanisms.terms import Mechanism, Term
from ...mechanisms.tools import build_fall_screws
from ...robot.kinematics import find_flange_axis

# directions across the flange, from its x axis where its axis is z [degrees]
DIRECTIONS = tuple(5.0 * k for k in range(36))
# what falls so, as far as is known
LOOSE = ("loose target nest", "tool changer with play", "tool that is not drawn tight")


def generate_falls(problem: Problem, found: Mechanism) -> Iterator[Mechanism]:
    """Generate falls of the target across the flange, in many directions. None for a finding that does
    not shift a frame or move the last joint with gravity."""
    names = found.names()
    if not names or not all(map(needs_gravity, names)):
        return
    robot = problem.robot
    for place in found.names_by_place():
        frame, axis = place
        shifts = axis[0] == "t"
        is_last = frame == robot.n and is_joint_motion(robot, place)
        if not (shifts or is_last):
            return
    flange = robot.n + 1
    along = find_flange_axis(robot)
    for degrees in DIRECTIONS:
        yield build_fall(flange, along, degrees)


def build_fall(flange: int, axis: Array, degrees: float) -> Mechanism:
    """Build the fall of the target to either side of a direction across the flange, whose axis (3,) is
    given in its frame."""
    names, first, second = _list_across(axis)
    angle = np.radians(degrees)
    line = np.cos(angle) * first + np.sin(angle) * second
    screws = build_fall_screws(flange, line)
    axes = {0: f"its {names[0]} axis", 90: f"its {names[1]} axis"}
    where = axes.get(round(degrees), f"a line across it at {degrees:g}° to its {names[0]} axis")
    return Mechanism(
        f"{flange} {screws[0].axis} the side that gravity pulls to at {degrees:g}°",
        (Term("m", screws),),
        f"Frame {flange} shifts along {where}, from one side to the other as gravity along that "
        "changes sign",
        usual_causes=LOOSE,
    )


def _list_across(axis: Array) -> tuple[str, Array, Array]:
    """List two directions across an axis, next to two axes of the flange's frame, after the names of these."""
    along = int(np.abs(axis).argmax())
    names = "xyz".replace("xyz"[along], "")
    near = np.eye(3)["xyz".index(names[0])]
    first = near - (near @ axis) * axis
    first /= np.linalg.norm(first)
    second = np.cross(axis, first)
    if second["xyz".index(names[1])] < 0:
        second = -second
    return names, first, second
