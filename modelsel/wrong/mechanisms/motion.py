"""What depends on how a configuration was reached: play in gears, readings taken too early."""
from __future__ import annotations

from ...robot.kinematics import Robot
from ..causes import Named
from ..screws import Mechanism, Screw, Term


def approach_backlash(robot: Robot, joint: int) -> Mechanism:
    """Play or friction leaves the joint short of its reading, on the side it came from."""
    return Mechanism(f"approach-backlash:{joint}", (_side(robot, joint, f"k{joint}", -1),),
                     f"Joint {joint} stops short of its reading, on the side that it came from: backlash or friction.",
                     f"θ{joint} = q{joint} + k · direction of joint {joint}'s last motion, k < 0",
                     "Slamani, Nubiola & Bonev 2012, backlash of robots")


def overshoot(robot: Robot, joint: int) -> Mechanism:
    """The joint rests past its reading, in the direction in which it moved: no play leaves it there."""
    return Mechanism(f"overshoot:{joint}", (_side(robot, joint, f"o{joint}", 1),),
                     f"Joint {joint} rests past its reading, in the direction of its last motion: overshoot, not play.",
                     f"θ{joint} = q{joint} + o · direction of joint {joint}'s last motion, o > 0",
                     "Slamani, Nubiola & Bonev 2012, backlash of robots; the sign is that of an overshoot")


def _side(robot: Robot, joint: int, symbol: str, sign: int) -> Term:
    """A turn (or shift) of a joint by the direction of its last motion."""
    axis = "tz" if robot.joints[joint - 1].prismatic else "rz"
    size = (1e-3, 2.0) if axis == "tz" else (2e-6, 5e-3)
    return Term(symbol, (Screw(joint, axis, Named(f"approach{joint}")),), size, sign)


def read_too_early(robot: Robot) -> Mechanism:
    """Every joint was read before the arm stood still: one lag, a share of each joint's last move."""
    screws = tuple(Screw(j, "tz" if joint.prismatic else "rz", Named(f"approach{j}") * Named(f"move{j}", robot.unit(j)))
                   for j, joint in enumerate(robot.joints, 1))
    return Mechanism("fault:read-too-early", (Term("lag", screws, (1e-6, 5e-2), 1),),
                     "A fault of the data: joints were read before the arm stood still; the error grows with the last move.",
                     "θ = q + lag · last move, all joints alike", "ISO 9283, position stabilisation time",
                     "A fault of the data: targets were measured before the arm stood still; the error grows with the last move.")


def settle(robot: Robot, joint: int) -> Mechanism:
    """Joints read (or the target measured) before the arm stood still: a share of the last move is still missing."""
    slides = robot.joints[joint - 1].prismatic
    cause = Named(f"approach{joint}") * Named(f"move{joint}", robot.unit(joint))
    return Mechanism(f"settle:{joint}", (Term(f"m{joint}", (Screw(joint, "tz" if slides else "rz", cause),), (1e-6, 1e-2), -1),),
                     f"Joint {joint} had not settled when it was measured: a share of its last move was still missing.",
                     f"θ{joint} = q{joint} + m · last move of joint {joint}", "ISO 9283, position stabilisation time",
                     f"Joint {joint} was past its reading by a share of its last move: it was read too early, or swung past.")
