"""What depends on how a configuration was reached: play in gears, readings taken too early."""
from __future__ import annotations

from ...machine.robot import Robot
from ..causes import Named
from ..screws import Mechanism, Screw, Term


def approach_backlash(robot: Robot, joint: int) -> Mechanism:
    """Play or friction leaves the joint on the side it came from."""
    axis = "tz" if robot.joints[joint - 1].prismatic else "rz"
    size = (1e-3, 2.0) if axis == "tz" else (2e-6, 5e-3)
    return Mechanism(f"approach-backlash:{joint}", (Term(f"k{joint}", (Screw(joint, axis, Named(f"approach{joint}")),), size),),
                     f"Joint {joint} rests beside its reading, on the side that its last motion decides: backlash or friction.",
                     f"θ{joint} = q{joint} + k · direction of joint {joint}'s last motion",
                     "Slamani, Nubiola & Bonev 2012, backlash of robots")


def read_too_early(robot: Robot) -> Mechanism:
    """Every joint was read before the arm stood still: one lag, a share of each joint's last move."""
    screws = tuple(Screw(j, "tz" if joint.prismatic else "rz", Named(f"approach{j}") * Named(f"move{j}", robot.unit(j)))
                   for j, joint in enumerate(robot.joints, 1))
    return Mechanism("fault:read-too-early", (Term("lag", screws, (1e-6, 5e-2)),),
                     "A fault of the data: joints were read before the arm stood still; the error grows with the last move.",
                     "θ = q + lag · last move, all joints alike", "ISO 9283, position stabilisation time")


def settle(robot: Robot, joint: int) -> Mechanism:
    """Joints read (or the target measured) before the arm stood still: a share of the last move is still missing."""
    slides = robot.joints[joint - 1].prismatic
    cause = Named(f"approach{joint}") * Named(f"move{joint}", robot.unit(joint))
    return Mechanism(f"settle:{joint}", (Term(f"m{joint}", (Screw(joint, "tz" if slides else "rz", cause),), (1e-6, 1e-2)),),
                     f"Joint {joint} had not settled when it was measured: the error grows with its last move.",
                     f"θ{joint} = q{joint} + m · last move of joint {joint}", "ISO 9283, position stabilisation time")
