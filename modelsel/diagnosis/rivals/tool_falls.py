"""A target that is loose across the flange falls from one side to the other as gravity across it
changes sign; along the flange's axis that is tool-play, which the registry has."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from ...fitting.problem import Problem
from ...measurements.campaign.state_names import needs_gravity
from ...mechanisms.causes import Cause, Named, sign
from ...mechanisms.motors import is_joint_motion
from ...mechanisms.terms import Mechanism, Screw, Term

# directions across the flange, from its x axis [degrees]
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
    for degrees in DIRECTIONS:
        yield build_fall(flange, degrees)


def build_fall(flange: int, degrees: float) -> Mechanism:
    """Build the fall of the target to either side of a direction across the flange."""
    angle = np.radians(degrees)
    shares = {"x": float(np.cos(angle)), "y": float(np.sin(angle))}
    across = {axis: float(f"{share:.6g}") for axis, share in shares.items() if abs(share) > 1e-9}
    pulls = [_weigh(share, Named(f"down_{axis}")) for axis, share in across.items()]
    side = sign(pulls[0] if len(pulls) == 1 else pulls[0] + pulls[1])
    screws = [Screw(flange, f"t{axis}", _weigh(share, side)) for axis, share in across.items()]
    axes = {0: "its x axis", 90: "its y axis"}
    where = axes.get(round(degrees), f"a line across it at {degrees:g}° to its x axis")
    return Mechanism(
        f"{flange} t{next(iter(across))} the side that gravity pulls to at {degrees:g}°",
        (Term("m", tuple(screws)),),
        f"Frame {flange} shifts along {where}, from one side to the other as gravity along that "
        "changes sign",
        usual_causes=LOOSE,
    )


def _weigh(share: float, cause: Cause) -> Cause:
    if share == 1:
        return cause
    return share * cause
