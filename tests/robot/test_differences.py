"""Two nominal robots are one only where chain, flange, coupling and masses are, however they are mounted."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from modelsel.robot.alignment import have_same_chain
from modelsel.robot.coupling import Coupling
from modelsel.robot.differences import describe_difference
from modelsel.robot.files import load_robot
from modelsel.robot.kinematics import Robot

PUMA = load_robot("puma560")
TOLERANCE = 1e-6


def with_joint(number: int, **changed: object) -> Robot:
    joints = list(PUMA.joints)
    joints[number - 1] = replace(joints[number - 1], **changed)
    return replace(PUMA, joints=tuple(joints))


def raised(transform: np.ndarray, by: float) -> np.ndarray:
    out = transform.copy()
    out[2, 3] += by
    return out


def coupled(entry: float) -> Robot:
    matrix = np.eye(6)
    matrix[2, 1] = entry
    return replace(PUMA, coupling=Coupling(matrix))


MASS = PUMA.joints[1].mass
OTHERS = {
    "joints": (lambda: replace(PUMA, joints=PUMA.joints[:5]), "one has 6 joints, the other 5"),
    "kind": (
        lambda: with_joint(3, prismatic=True),
        "joint 3 turns in one of them and slides in the other",
    ),
    "transform": (
        lambda: with_joint(4, before=raised(PUMA.joints[3].before, 0.1)),
        "joint 4 stands elsewhere or has another zero",
    ),
    "flange": (
        lambda: replace(PUMA, last=raised(PUMA.last, 200.0)),
        "the flange sits elsewhere on the last joint",
    ),
    "coupling": (lambda: coupled(-1.0), "the motors move the joints in another way (coupling)"),
    "mass": (lambda: with_joint(2, mass=20.0), f"link 2 has a mass of {MASS:g} kg and of 20 kg"),
    "no mass": (lambda: with_joint(2, mass=None), "link 2 has a known mass for one of them only"),
    "centre": (
        lambda: with_joint(2, com=(1.0, 2.0, 3.0)),
        "link 2 has its centre of mass elsewhere",
    ),
}


@pytest.mark.parametrize(("build", "said"), OTHERS.values(), ids=OTHERS)
def test_what_differs_is_said(build: Callable[[], Robot], said: str) -> None:
    assert describe_difference(PUMA, build(), TOLERANCE) == said


def test_what_is_the_same_is_one_robot() -> None:
    near = replace(PUMA, last=raised(PUMA.last, 1e-9), name="another name")
    assert describe_difference(PUMA, near, TOLERANCE) is None
    assert describe_difference(PUMA, coupled(0.0), TOLERANCE) is None
    hung = replace(PUMA, gravity=(0.0, 0.0, 1.0))
    assert describe_difference(PUMA, hung, TOLERANCE) is None


def test_one_chain_may_have_several_flanges() -> None:
    assert have_same_chain(PUMA, replace(PUMA, last=raised(PUMA.last, 200.0)))
    assert not have_same_chain(PUMA, with_joint(4, before=raised(PUMA.joints[3].before, 0.1)))
    assert not have_same_chain(PUMA, replace(PUMA, joints=PUMA.joints[:5]))
