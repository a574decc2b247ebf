"""Zeros off by any angle and wrong links are found and told with their numbers, in arms with errors
of their own."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest
from builders import OFF_AXIS, seeds
from builders import drawn as drawn_arm
from setup_mistakes import arm, said, shifted

from modelsel._typing import Array
from modelsel.fitting.problem import Problem
from modelsel.robot.kinematics import forward


def same(q: Array, x: Array) -> tuple[Array, Array]:
    return q, x


def off(sentence: str | None, joint: int) -> float:
    """Degrees to be added to a reading, as the sentence says."""
    pattern = rf"joint {joint}'s zero is off by ([\d.]+) degrees \(\1° is (added to|subtracted from) q{joint}\)"
    found = re.search(pattern, sentence or "")
    assert found is not None, sentence
    return float(found[1]) * (1 if found[2] == "added to" else -1)


@pytest.mark.long
@pytest.mark.parametrize(("joint", "degrees"), [(2, 12), (3, 17), (5, -30), (4, 137), (3, 85)])
@pytest.mark.parametrize("name", ["ur5", "iiwa14"])
def test_one_zero(name, joint, degrees, rng) -> None:
    sentence = said(arm(rng, name), shifted(joint, np.radians(degrees)))
    assert off(sentence, joint) == pytest.approx(-degrees, abs=0.5)
    assert f"check where joint {joint} is zero in the controller and in the robot file" in sentence
    assert "nominal arm's" not in sentence


def test_one_zero_in_the_robots_own_frame(rng) -> None:
    assert off(
        said(arm(rng, "ur5", registered=False), shifted(3, np.radians(17)), False), 3
    ) == pytest.approx(-17, abs=0.5)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["ur5", "iiwa14"])
def test_two_zeros(name, rng) -> None:
    by = np.zeros(len(drawn_arm(name, rng, 1).data.q[0]))
    by[[1, 2]] = np.radians([12, -17])
    sentence = said(arm(rng, name), lambda q, x: (q + by, x))
    assert off(sentence, 2) == pytest.approx(-12, abs=0.5)
    assert off(sentence, 3) == pytest.approx(17, abs=0.5)


def with_link(at: Problem, joint: int, by: float) -> Problem:
    """The same rows, the nominal table's link before a joint changed along its x."""
    joints = list(at.robot.joints)
    N = joints[joint - 1].before.copy()
    N[:3, 3] += by * N[:3, 0]
    joints[joint - 1] = replace(joints[joint - 1], before=N)
    return replace(at, robot=replace(at.robot, joints=tuple(joints)))


@pytest.mark.integration
@seeds(1, 2)
@pytest.mark.parametrize("name", ["ur5", "iiwa14"])
def test_a_link_that_the_table_has_wrong(name, rng) -> None:
    sentence = said(with_link(arm(rng, name), 3, -194.0), same) or ""
    found = re.search(
        r"the nominal arm's a3 is off by ([+-][\d.]+) mm: check the robot file", sentence
    )
    assert found is not None, sentence
    assert float(found[1]) == pytest.approx(194, abs=3)


@pytest.mark.slow
@pytest.mark.parametrize("rest", [(3,), (2, 3)])
def test_joints_at_rest_that_were_written_as_0(rest, rng) -> None:
    at = drawn_arm("iiwa14", rng, 60)
    q = at.data.q.copy()
    q[:, rest] = [0.9, -0.6][: len(rest)]
    position = forward(at.robot, q, np.array(OFF_AXIS)) + rng.normal(0, 0.05, (60, 3))
    at = replace(at, data=replace(at.data, q=q, position=position), tools=np.zeros((1, 3)))
    q0 = q.copy()
    q0[:, rest] = 0.0
    sentence = said(at, lambda q, x: (q0, x)) or ""
    assert "0 may mean that nothing was recorded" in sentence
    assert off(sentence, rest[0] + 1) == pytest.approx(np.degrees(0.9), abs=0.5)
