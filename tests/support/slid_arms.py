"""Arms of which the first joints slide: gantries with the wrist and the links of a built-in robot."""

from __future__ import annotations

from dataclasses import replace

from modelsel.robot.files import load_robot
from modelsel.robot.kinematics import Robot

TRAVEL = 400.0


def put_on_slides(count: int) -> Robot:
    """An arm of which the first joints slide."""
    arm = load_robot("puma760")
    slides = [
        replace(joint, prismatic=True, limits=(-TRAVEL, TRAVEL)) for joint in arm.joints[:count]
    ]
    return replace(arm, joints=(*slides, *arm.joints[count:]))
