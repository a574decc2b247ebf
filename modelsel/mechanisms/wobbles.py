"""Axes of joints that wobble as their bearings turn."""

from __future__ import annotations

from ..robot.kinematics import Robot
from .causes import Cause, cos, q, sin
from .drives import RUNOUT, scale_angle, wave_terms
from .terms import Mechanism, Screw, Term

# added to how often a turn an axis wobbles: in a circle, with the joint's turning or against it
WITH, AGAINST = 10, 20
# how often a turn an axis wobbles, and the parts that usually make it
WOBBLES = {
    1: ("once", ("inclined bearing race", "bent shaft")),
    2: ("twice", ("oval bearing", "oval seat")),
    3: ("three times", ("bearing seat clamped at three places", "seat with three lobes")),
}


def list_wobbles(robot: Robot, joint: int) -> tuple[int, ...]:
    """List the ways in which an axis may wobble: how often a turn, in any shape, or in a circle with the
    joint's turning or against it. Once with it, the axis only stands askew in what it turns."""
    with_joint = []
    against = []
    for often in WOBBLES:
        against.append(AGAINST + often)
        if often > 1:
            with_joint.append(WITH + often)
    return (*WOBBLES, *with_joint, *against)


def axis_wobble(robot: Robot, joint: int, wobble: int) -> Mechanism:
    """The joint's axis tilts as its bearing turns: once a turn (an inclined race), twice (an oval
    one) or three times (one with three lobes); in any shape, with four numbers, or in a circle, with two.
    `wobble`: one of `list_wobbles`."""
    way, waves = divmod(wobble, WITH)
    often, parts = WOBBLES[waves]
    shape = ""
    nods = wave_terms(joint, waves, "rx", f"x{joint}")
    terms: tuple[Term, ...] = nods + wave_terms(joint, waves, "ry", f"y{joint}")
    equation = f"α{joint}, β{joint} ∝ sin({waves} q{joint}), cos({waves} q{joint})"
    if way:
        terms = _circle(joint, waves, way)
        shape = " in a circle"
        sign, other = ("-", "+") if way > 1 else ("", "-")
        angle = scale_angle(waves, q(joint))
        equation = f"α{joint} + iβ{joint} = (u {other} iv) exp({sign}i {angle})"
    return Mechanism(
        f"axis-wobble:{joint}",
        terms,
        f"The axis of joint {joint} wobbles{shape}, {often} a turn.",
        equation,
        "ISO 230-7, axes of rotation: tilt",
        usual_causes=parts,
    )


def _circle(joint: int, waves: int, way: int) -> tuple[Term, ...]:
    """Build the terms of an axis whose tilt goes round, `way` 1 with the joint's turning and 2 against
    it."""
    angle = scale_angle(waves, q(joint))
    ahead = cos(angle)
    aside = sin(angle)
    yaws: Cause = aside
    back = -1.0 * ahead
    if way > 1:
        yaws = -1.0 * aside
        back = ahead
    terms = []
    for symbol, nod, yaw in (("u", ahead, yaws), ("v", aside, back)):
        nods = Screw(joint, "rx", nod)
        turns = Screw(joint, "ry", yaw)
        term = Term(f"{symbol}{joint}", (nods, turns), RUNOUT)
        terms.append(term)
    return tuple(terms)
