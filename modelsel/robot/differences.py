"""Whether two nominal robots are one, and if not, in what they differ."""

from __future__ import annotations

import numpy as np

from .._typing import Array
from ..exceptions import count_words
from .kinematics import Joint, Robot


def describe_difference(first: Robot, second: Robot, tolerance: float) -> str | None:
    """Describe in what two nominal robots differ by more than a tolerance [mm, entries of a
    rotation, kg]: the first such part of the chain, the flange, the coupling or the masses; None where
    they are one robot. Gravity may point elsewhere: an arm may hang where it stood."""
    parts = (describe_chain_difference, _describe_flange, _describe_coupling, _describe_masses)
    for describe in parts:
        difference = describe(first, second, tolerance)
        if difference is not None:
            return difference
    return None


def describe_chain_difference(first: Robot, second: Robot, tolerance: float) -> str | None:
    """Describe in what the joints, or the transforms before them, of two robots differ; None where
    these are the same."""
    if first.n != second.n:
        joints_of_first = count_words(first.n, "joint")
        return f"one has {joints_of_first}, the other {second.n}"
    joints = zip(first.joints, second.joints, strict=True)
    for number, (joint, other) in enumerate(joints, 1):
        if joint.prismatic != other.prismatic:
            return f"joint {number} turns in one of them and slides in the other"
        if _differ(joint.before, other.before, tolerance):
            return f"joint {number} stands elsewhere or has another zero"
    return None


def _describe_flange(first: Robot, second: Robot, tolerance: float) -> str | None:
    if not _differ(first.last, second.last, tolerance):
        return None
    return "the flange sits elsewhere on the last joint"


def _describe_coupling(first: Robot, second: Robot, tolerance: float) -> str | None:
    if not _differ(_coupling_matrix(first), _coupling_matrix(second), tolerance):
        return None
    return "the motors move the joints in another way (coupling)"


def _describe_masses(first: Robot, second: Robot, tolerance: float) -> str | None:
    joints = zip(first.joints, second.joints, strict=True)
    for number, (joint, other) in enumerate(joints, 1):
        difference = _describe_mass(joint, other, tolerance)
        if difference is not None:
            return f"link {number} {difference}"
    return None


def _describe_mass(joint: Joint, other: Joint, tolerance: float) -> str | None:
    own_mass = joint.mass
    other_mass = other.mass
    if own_mass is None and other_mass is None:
        return None
    if own_mass is None or other_mass is None:
        return "has a known mass for one of them only"
    if abs(own_mass - other_mass) > tolerance:
        return f"has a mass of {own_mass:g} kg and of {other_mass:g} kg"
    own_centre = np.array(joint.com)
    other_centre = np.array(other.com)
    if _differ(own_centre, other_centre, tolerance):
        return "has its centre of mass elsewhere"
    return None


def _differ(values: Array, others: Array, tolerance: float) -> bool:
    """Whether values of one shape differ by more than a tolerance."""
    difference = values - others
    sizes = np.abs(difference)
    largest = sizes.max()
    return bool(largest > tolerance)


def _coupling_matrix(robot: Robot) -> Array:
    """Return how motors move the joints (n, n): each its own where there is no coupling."""
    if robot.coupling is None:
        return np.eye(robot.n)
    return robot.coupling.matrix
