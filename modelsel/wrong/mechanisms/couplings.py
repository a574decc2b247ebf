"""Couplings: a joint that turns because another one does."""
from __future__ import annotations

from ...robot.kinematics import Robot
from ..causes import q
from ..screws import Mechanism, Screw, Term

COUPLING = (1e-5, 1e-2)  # rad/rad


def wrist_joints(robot: Robot) -> tuple[int, ...]:
    """The last two joints of an arm with three revolute wrist joints."""
    if robot.n < 5 or any(joint.prismatic for joint in robot.joints[-3:]):
        return ()
    return (robot.n - 1, robot.n)


def wrist_coupling(robot: Robot, joint: int) -> Mechanism:
    """The wrist's drives run through each other: the last joint but one turns with the one before, the last with both."""
    drivers = range(robot.n - 2, joint)
    terms = tuple(Term(f"w{joint}{d}", (Screw(joint, "rz", q(d)),), COUPLING) for d in drivers)
    return Mechanism(f"wrist-coupling:{joint}", terms, f"Joint {joint} turns with {' and '.join(f'joint {d}' for d in drivers)}.",
                     f"θ{joint} = q{joint} + " + " + ".join(f"w{joint}{d} q{d}" for d in drivers),
                     "Whitney, Lozinski & Rourke 1986; the reference, non-geometric errors")
