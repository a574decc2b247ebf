"""A base that yields is told as that where the robot file declares no masses: planted under masses that lie
along the links and beside them, as an exact turn of the whole arm about its foot."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from builders import bind, seeds
from exact import flanges_of
from scipy.spatial.transform import Rotation
from searches import search_separated

from modelsel.diagnosis.candidates.candidate_list import build_candidates
from modelsel.diagnosis.candidates.signatures import LEVELS, PROVEN
from modelsel.fitting.design import Model
from modelsel.measurements.measurements import build_measurements
from modelsel.mechanisms.base_tilts import OF_MAIN, list_tilts
from modelsel.mechanisms.compliance import DECLARED
from modelsel.mechanisms.registry import every, mechanism
from modelsel.robot.files import load_robot
from modelsel.robot.kinematics import Robot

NOISE_MM = 0.03
ROWS = 140
TOOL = np.array([40.0, -70.0, 120.0])
# kg of six links, about as those of a cobot weigh
MASSES = np.array([7.0, 13.0, 5.0, 2.0, 2.0, 0.5])


def without_masses(arm: Robot) -> Robot:
    joints = tuple(replace(joint, mass=None, com=(0.0, 0.0, 0.0)) for joint in arm.joints)
    return replace(arm, joints=joints)


def weigh_moment(arm: Robot, q: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """The moment (m, 3) [N m] about the foot of masses that lie on their links and 30 mm aside."""
    moment = np.zeros((len(q), 3))
    masses = MASSES[: arm.n] * rng.uniform(0.6, 1.6, arm.n)
    for link, mass in enumerate(masses, 1):
        upper = replace(arm, joints=arm.joints[:link], last=np.eye(4), coupling=None)
        frames = flanges_of(upper, q[:, :link])
        ahead = arm.joints[link].before[:3, 3] if link < arm.n else arm.last[:3, 3]
        place = rng.uniform(0.3, 0.7) * ahead + rng.normal(0, 30, 3)
        centre = frames[:, :3, 3] + frames[:, :3, :3] @ place
        moment += np.cross(centre / 1e3, [0, 0, -9.81 * mass])
    return moment


@pytest.mark.slow
@seeds(1, 2, 3, 4)
def test_a_base_that_yields_is_told_without_masses(rng: np.random.Generator) -> None:
    """It was told as a joint that winds up and a shoulder that shifts, or as a link that bends."""
    arm = without_masses(load_robot(("irb120", "ur5e", "irb1600")[int(rng.integers(3))]))
    q = arm.draw(rng, ROWS)
    flange = flanges_of(arm, q)
    position = flange[:, :3, 3] + flange[:, :3, :3] @ TOOL
    tilt = weigh_moment(arm, q, rng)
    largest = np.linalg.norm(tilt - tilt.mean(axis=0), axis=1).max()
    turned = Rotation.from_rotvec(tilt * rng.uniform(6e-4, 1.2e-3) / largest).apply(position)
    measured = turned + rng.normal(0, NOISE_MM, (ROWS, 3))
    at = bind(arm, build_measurements(q, measured), tuple(TOOL))
    base = Model((mechanism("geometric", arm),))
    first, *others = search_separated(at, base, build_candidates(at, base, every(arm))).effects
    assert first.candidate.label == "base-tilt"
    assert first.claim is not None
    assert first.claim.levels[LEVELS.index("cause")] >= PROVEN
    assert not [one for one in others if one.claim.levels[LEVELS.index("cause")] >= PROVEN]


def test_unknown_masses_are_tried_where_not_all_are_declared() -> None:
    arm = load_robot("ur5e")
    bare = without_masses(arm)
    heavy = replace(arm, joints=tuple(replace(joint, mass=2.0) for joint in arm.joints))
    assert OF_MAIN in list_tilts(bare)
    assert OF_MAIN not in list_tilts(heavy)
    assert not list_tilts(replace(bare, gravity=None))
    rail = replace(bare, joints=(replace(bare.joints[0], prismatic=True), *bare.joints[1:]))
    assert list_tilts(rail) == (DECLARED,)
