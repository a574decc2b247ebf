"""Arms that are not nominal, each with its set-up: a reading's zero is off, or where a joint sits on
the link before it (the a b c of its frame)."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from .._typing import Array
from ..fitting.problem import Problem
from ..robot.kinematics import Robot
from ..robot.rigid import transform

# nearness to a right angle, which has a sentence of its own
NEAR_RIGHT = np.radians(5)


@dataclass(frozen=True, eq=False)
class Arm:
    """A set-up and an arm that is not nominal: R (3, 3), t (3,) mm, tool (3,) mm, zeros (n,) rad or
    mm added to the readings, links (n, 3) mm before every joint."""

    R: Array
    t: Array
    tool: Array
    zeros: Array
    links: Array

    def robot(self, nominal: Robot) -> Robot:
        """Build the arm with these links."""
        if not self.links.any():
            return nominal
        joints = tuple(
            replace(joint, before=joint.before @ transform(None, link))
            for joint, link in zip(nominal.joints, self.links, strict=True)
        )
        return replace(nominal, joints=joints)

    def has_right_angles(self) -> bool:
        """Return whether only zeros are off, by right angles."""
        if self.links.any():
            return False
        quarter = np.pi / 2
        eighth = np.pi / 4
        from_right = (self.zeros + eighth) % quarter - eighth
        size = np.abs(from_right)
        is_near = size < NEAR_RIGHT
        return bool(is_near.all())

    def apply(self, problem: Problem) -> Problem:
        """Apply this arm and set-up to the rows as the nominal ones."""
        groups = len(problem.placement[0])
        targets = len(problem.tools)
        readings = problem.data.q + self.zeros
        data = replace(problem.data, q=readings)
        R = np.tile(self.R, (groups, 1, 1))
        t = np.tile(self.t, (groups, 1))
        return replace(
            problem,
            robot=self.robot(problem.robot),
            data=data,
            placement=(R, t),
            tools=np.tile(self.tool, (targets, 1)),
        )

    def offsets(self) -> Array:
        """Concatenate the zeros and the lengths of the links, (4 n,)."""
        lengths = self.links.ravel()
        return np.concatenate([self.zeros, lengths])


def build_nominal_arm(problem: Problem) -> Arm:
    """Build the nominal arm with the set-up of a problem of one target and one placement."""
    n = problem.robot.n
    R, t = problem.placement
    group = problem.data.group[0]
    target = problem.data.target[0]
    return Arm(
        R=R[group],
        t=t[group],
        tool=problem.tools[target],
        zeros=np.zeros(n),
        links=np.zeros((n, 3)),
    )
