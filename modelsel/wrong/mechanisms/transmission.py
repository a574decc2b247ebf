"""What turns unevenly: gears, encoders, bearings. Every one exists once a joint."""
from __future__ import annotations

from ...robot.kinematics import Robot
from ..causes import cos, q, sin
from ..screws import Mechanism, Screw, Term

RUNOUT = (5e-6, 3e-3)    # rad at the joint
SCALE = (1e-6, 1e-2)     # rad/rad
WAVES = tuple(range(3, 61))


def revolute_joints(robot: Robot) -> tuple[int, ...]:
    """Joints that turn."""
    return tuple(j for j, joint in enumerate(robot.joints, 1) if not joint.prismatic)


def all_joints(robot: Robot) -> tuple[int, ...]:
    """Every joint."""
    return tuple(range(1, robot.n + 1))


def wave(joint: int, count: float, axis: str, symbol: str) -> tuple[Term, Term]:
    """A wave of unknown phase: sine and cosine of `count` times the joint's angle at one place of its frame."""
    angle = q(joint) if count == 1 else float(count) * q(joint)
    return (Term(f"{symbol}s", (Screw(joint, axis, sin(angle)),), RUNOUT),
            Term(f"{symbol}c", (Screw(joint, axis, cos(angle)),), RUNOUT))


def gear_eccentricity(robot: Robot, joint: int) -> Mechanism:
    """The output gear turns about a point beside its centre: once a turn."""
    return Mechanism(f"gear-eccentricity:{joint}", wave(joint, 1, "rz", f"e{joint}"),
                     f"Joint {joint} turns unevenly, once a turn: its gear runs out of centre.",
                     f"θ{joint} = q{joint} + es sin(q{joint}) + ec cos(q{joint})", "Whitney, Lozinski & Rourke 1986")


def encoder_eccentricity(robot: Robot, joint: int) -> Mechanism:
    """What two reading heads leave of a disk's eccentricity, and an oval ring: twice a turn."""
    return Mechanism(f"encoder-eccentricity:{joint}", wave(joint, 2, "rz", f"d{joint}"),
                     f"Joint {joint} turns unevenly, twice a turn: its encoder disk or ring is oval or read by two heads.",
                     f"θ{joint} = q{joint} + ds sin(2 q{joint}) + dc cos(2 q{joint})", "Lopez-Rubio et al. 2010, encoder errors")


def gear_ripple(robot: Robot, joint: int, waves: int) -> Mechanism:
    """Tooth mesh and strain-wave gears: some tens of waves a turn; the number is scanned."""
    return Mechanism(f"gear-ripple:{joint}", wave(joint, waves, "rz", f"r{joint}"),
                     f"Joint {joint} turns unevenly: {waves} waves per turn, gear ripple.",
                     f"θ{joint} = q{joint} + rs sin({waves} q{joint}) + rc cos({waves} q{joint})",
                     "Tuttle & Seering 1996, harmonic-drive gear transmission")


def encoder_scale(robot: Robot, joint: int) -> Mechanism:
    """The joint moves a little more or less than its encoder counts."""
    slides = robot.joints[joint - 1].prismatic
    cause = q(joint, robot.unit(joint))
    return Mechanism(f"encoder-scale:{joint}", (Term(f"s{joint}", (Screw(joint, "tz" if slides else "rz", cause),), SCALE),),
                     f"Joint {joint} moves more (or less) than its encoder says, in proportion.",
                     f"θ{joint} = (1 + s) q{joint}", "Whitney, Lozinski & Rourke 1986")


def axis_wobble(robot: Robot, joint: int, waves: int) -> Mechanism:
    """The joint's axis tilts as its bearing turns: once a turn (an inclined race) or twice (an oval one)."""
    terms = wave(joint, waves, "rx", f"x{joint}") + wave(joint, waves, "ry", f"y{joint}")
    return Mechanism(f"axis-wobble:{joint}", terms,
                     f"The axis of joint {joint} wobbles, {'once' if waves == 1 else 'twice'} a turn.",
                     f"α{joint}, β{joint} ∝ sin({waves} q{joint}), cos({waves} q{joint})", "ISO 230-7, axes of rotation: tilt")
