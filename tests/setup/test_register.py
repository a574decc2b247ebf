"""Registration without a start value: the tracker metres away, turned at will, targets unknown, a
tenth of the points gross."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from builders import seeds
from scipy.spatial.transform import Rotation

from modelsel.exceptions import NotEstimable
from modelsel.fitting.design import residuals
from modelsel.fitting.problem import Problem
from modelsel.measurements.measurements import Orientation, build_measurements
from modelsel.robot.files import load_robot, read_robot
from modelsel.robot.kinematics import Robot, pose
from modelsel.setup.registration import register

SIGMA = 0.05
TOOLS = np.array([[40.0, -25, 100], [-60, 30, 80], [10, 70, 150]])


def site(
    rng: np.random.Generator,
    name: str | Robot,
    m: int,
    *,
    targets: int = 1,
    groups: int = 1,
    sigma: float = SIGMA,
    orientation: bool = False,
) -> tuple[Problem, list[np.ndarray], list[np.ndarray], np.ndarray]:
    """(unregistered problem, R and t of every group, target rotations): m configurations, every
    target at each."""
    robot = load_robot(name) if isinstance(name, str) else name
    q = robot.draw(rng, m).repeat(targets, axis=0)
    target, group = np.tile(np.arange(targets), m), np.sort(np.arange(m) % groups).repeat(targets)
    R, t = Rotation.random(groups, rng=rng).as_matrix(), rng.uniform(-8000, 8000, (groups, 3))
    turned = Rotation.random(targets, rng=rng).as_matrix()
    at = pose(robot, q, TOOLS[target])
    position = (
        np.einsum("mij,jm->mi", R[group], at.target) + t[group] + rng.normal(0, sigma, (len(q), 3))
    )
    more = {}
    if orientation:
        wobble = Rotation.from_rotvec(rng.normal(0, 1e-4, (len(q), 3))).as_matrix()
        rotation = wobble @ R[group] @ at.rotation.transpose(2, 0, 1) @ turned[target]
        more = {"orientation": Orientation(rotation)}
    data = build_measurements(
        q, position, target=[f"r{k}" for k in target], group=[f"day{g}" for g in group], **more
    )
    return Problem(robot, data, np.zeros((targets, 3))), R, t, turned


def everything(at: Problem) -> np.ndarray:
    return np.ones(len(at), bool)


def lengths(at: Problem) -> np.ndarray:
    return np.linalg.norm(residuals(at)[:, :3], axis=1)


@seeds(1, 2, 3)
@pytest.mark.parametrize("name", ["ur5", "puma760", "iiwa14"])
def test_placement_and_tool_are_found(name, rng) -> None:
    at, R, t, _ = site(rng, name, 60)
    found = register(at, everything(at), per_group=False)
    assert np.sqrt(np.square(lengths(found)).mean() / 3) < 1.1 * SIGMA
    assert np.abs(found.tools[0] - TOOLS[0]).max() < 1.0  # SIGMA over levers and sqrt(60)
    fresh = load_robot(name).draw(rng, 100)
    want = pose(load_robot(name), fresh, TOOLS[0]).target.T @ R[0].T + t[0]
    other = (
        pose(load_robot(name), fresh, found.tools[0]).target.T @ found.placement[0][0].T
        + found.placement[1][0]
    )
    assert (
        np.linalg.norm(other - want, axis=1).max() < 4 * SIGMA
    )  # whatever the set-up cannot tell apart moves nothing
    R_found = found.placement[0][0]
    np.testing.assert_allclose(R_found @ R_found.T, np.eye(3), atol=1e-12)
    assert np.linalg.det(R_found) == pytest.approx(1)


@seeds(1, 2)
def test_exact_without_noise(rng) -> None:
    at, R, t, _ = site(rng, "ur5", 12, sigma=0.0)
    found = register(at, everything(at), per_group=False)
    np.testing.assert_allclose(found.tools[0], TOOLS[0], atol=1e-5)
    np.testing.assert_allclose(found.placement[0][0], R[0], atol=1e-8)
    np.testing.assert_allclose(found.placement[1][0], t[0], atol=1e-4)


@seeds(1, 2)
def test_several_targets(rng) -> None:
    at, *_ = site(rng, "ur5", 40, targets=3)
    found = register(at, everything(at), per_group=False)
    np.testing.assert_allclose(found.tools, TOOLS, atol=1.0)
    assert np.sqrt(np.square(lengths(found)).mean() / 3) < 1.1 * SIGMA


@seeds(1, slow=(2, 3))
@pytest.mark.parametrize("targets", [1, 2])
def test_per_group(targets, rng) -> None:
    """One placement a group, robot and targets shared; one placement for all would be metres
    off."""
    at, R, *_ = site(rng, "puma760", 60, targets=targets, groups=3)
    found = register(at, everything(at), per_group=True)
    assert np.sqrt(np.square(lengths(found)).mean() / 3) < 1.1 * SIGMA
    for g in range(3):
        np.testing.assert_allclose(found.placement[0][g], R[g], atol=2e-3)
    one = register(at, everything(at), per_group=False)
    assert np.median(lengths(one)) > 100


@seeds(1, 2, 3)
@pytest.mark.parametrize(
    ("share", "groups"),
    [(0.1, 1), (0.1, 2), (0.3, 1)],
    ids=["tenth", "tenth-per-group", "three-tenths"],
)
def test_gross_points(share, groups, rng) -> None:
    """Points metres off, or millimetres, do not move what is found; they stand out afterwards."""
    at, *_ = site(rng, "ur5", 80, groups=groups)
    count = round(80 * share)
    wrong = rng.permutation(80)[:count]
    position = at.data.position.copy()
    position[wrong] += rng.normal(size=(count, 3)) * np.repeat([2000.0, 5.0], count // 2)[:, None]
    found = register(
        replace(at, data=replace(at.data, position=position)), everything(at), per_group=groups > 1
    )
    good = np.setdiff1d(np.arange(80), wrong)
    assert np.sqrt(np.square(lengths(found)[good]).mean() / 3) < 1.15 * SIGMA
    assert np.median(lengths(found)[wrong]) > 50 * SIGMA


@seeds(1, 2)
@pytest.mark.parametrize("targets", [1, 2])
def test_with_orientation(targets, rng) -> None:
    """The target frame's rotation on the flange is found as well: rotational residuals at their
    noise, none near pi."""
    at, *_, turned = site(rng, "ur5", 40, targets=targets, orientation=True)
    found = register(at, everything(at), per_group=False)
    left = residuals(found)
    assert left.shape[1] == 6
    assert np.sqrt(np.square(left[:, :3]).mean()) < 1.1 * SIGMA
    assert np.sqrt(np.square(left[:, 3:]).mean()) < 1.2e-4
    np.testing.assert_allclose(found.tool_rotations, turned, atol=5e-4)


@seeds(1, 2, 3, 4, 5, 6)
@pytest.mark.parametrize("gross", [0, 15])
def test_two_axes_that_meet_are_placed_by_the_orientations(rng, gross) -> None:
    """Without them any placement fits: a target where the axes meet never moves."""
    robot = read_robot(Path(__file__).parents[2] / "studies" / "positioner" / "robot.toml")
    at, *_ = site(rng, robot, 100, orientation=True)
    bad = rng.choice(100, gross, replace=False)
    position, rotation = at.data.position.copy(), at.data.rotation.copy()
    position[bad] += rng.normal(0, 50, (gross, 3))
    rotation[bad] = Rotation.random(gross, rng=rng).as_matrix() if gross else rotation[bad]
    found = register(
        replace(at, data=replace(at.data, position=position, rotation=rotation)),
        everything(at),
        per_group=False,
    )
    left = np.delete(residuals(found), bad, axis=0)
    assert np.sqrt(np.square(left[:, :3]).mean()) < (1.5 if gross else 1.1) * SIGMA
    assert np.sqrt(np.square(left[:, 3:]).mean()) < (1e-2 if gross else 1.2e-4)


def test_only_estimation_rows_count(rng) -> None:
    """What is held out may be anything."""
    at, *_ = site(rng, "ur5", 60)
    use = np.arange(60) < 40
    spoilt = at.data.position.copy()
    spoilt[~use] += 1e4
    first, second = (
        register(replace(at, data=replace(at.data, position=p)), use, per_group=False)
        for p in (at.data.position, spoilt)
    )
    assert np.array_equal(first.tools, second.tools)
    assert np.array_equal(first.placement[1], second.placement[1])


@pytest.mark.parametrize("groups", [1, 3])
def test_too_few_configurations(groups, rng) -> None:
    """Three of one placement are refused, by name of the group; repeats of a target do not count as
    configurations."""
    at, *_ = site(rng, "ur5", 30, targets=2, groups=groups)
    use = everything(at)
    last = at.data.group == groups - 1
    use[np.flatnonzero(last)[6:]] = False  # three configurations of two targets
    where = f"group day{groups - 1} has" if groups > 1 else "the data have"
    with pytest.raises(NotEstimable, match=f"{where} 3 estimation configurations") as caught:
        register(at, use, per_group=groups > 1)
    assert caught.value.exit_code == 4
    assert "Measure more" in str(caught.value)
