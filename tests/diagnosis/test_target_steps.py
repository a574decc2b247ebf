"""One reflector of several that slips is told by its name; campaigns by exact chains of the tests' own."""

from __future__ import annotations

import re

import numpy as np
import pytest
from builders import seeds
from hidden_arm import Arm, arm

from modelsel.diagnosis.candidates import build_candidates
from modelsel.diagnosis.claim_sentences import describe_proven
from modelsel.diagnosis.procedure import diagnose
from modelsel.diagnosis.sentences import label_effect
from modelsel.diagnosis.session_steps import place_steps
from modelsel.fitting.design import Model
from modelsel.fitting.problem import Problem
from modelsel.measurements.measurements import build_measurements
from modelsel.mechanisms.campaign_registry import set_targets
from modelsel.mechanisms.registry import BUILTIN, every, mechanism
from modelsel.mechanisms.terms import Mechanism
from modelsel.robot.files import load_robot

ROBOTS = ("irb120", "ur5e", "puma560")
SIGMA = 0.02
NAMES = ("A", "B", "C")
TOOLS = np.array([[40.0, -30.0, 110.0], [40.0, 60.0, 90.0], [-50.0, 10.0, 120.0]])
Rng = np.random.Generator


def measure(
    body: Arm, q: np.ndarray, tools: np.ndarray, shifts: np.ndarray, rng: Rng
) -> np.ndarray:
    """Positions (m, T, 3) of targets that are shifted (m, T, 3) on the flange, with noise."""
    twist = np.zeros((len(q), body.n + 1, 6))
    positions = []
    for target, tool in enumerate(tools):
        own = twist.copy()
        own[:, -1, :3] = shifts[:, target]
        carried = Arm(**{**body.__dict__, "tool": tool})
        place, _ = carried.chain(q, own)
        positions.append(place)
    exact = np.stack(positions, axis=1)
    return exact + rng.normal(0, SIGMA, exact.shape)


def draw_campaign(rng: Rng, moved: list[int], count: int = 3) -> tuple[Problem, int, np.ndarray]:
    """A campaign whose `moved` targets slip together at a drawn configuration, by 0.2 to 0.5 mm."""
    robot = load_robot(ROBOTS[int(rng.integers(len(ROBOTS)))])
    body = arm(robot, rng)
    m = int(rng.integers(60, 100))
    row = int(rng.integers(m // 4, 3 * m // 4))
    direction = rng.normal(size=3)
    slip = rng.uniform(0.2, 0.5) * direction / np.linalg.norm(direction)
    q = body.draw(rng, m, 2.6)
    shifts = np.zeros((m, count, 3))
    shifts[row:, moved] = slip
    tools = TOOLS[:count]
    position = measure(body, q, tools, shifts, rng)
    target = np.tile(NAMES[:count], m)
    data = build_measurements(np.repeat(q, count, axis=0), position.reshape(-1, 3), target=target)
    return Problem(robot, data, tools), row, slip


def offer(at: Problem) -> tuple[Mechanism, ...]:
    """Every registered mechanism, steps of the campaign's targets among them."""
    registry = set_targets(BUILTIN, at.data.targets)
    return every(at.robot, registry)


@pytest.mark.slow
@seeds(1, 2, 3)
def test_one_target_that_slips_is_told_by_its_name(rng: Rng) -> None:
    """It was told as a step of a joint's zero and one of all targets."""
    slipped = int(rng.integers(3))
    at, row, slip = draw_campaign(rng, [slipped])
    (effect,) = diagnose(at).effects
    name = NAMES[slipped]
    assert label_effect(effect) == f"target-step:{name}"
    told = describe_proven(effect)
    found = re.search(r"Target (\w) stands elsewhere on the flange from about row (\d+) on", told)
    assert found
    assert found[1] == name
    assert abs(int(found[2]) - (3 * row + slipped)) <= 9
    assert np.abs(effect.estimate - slip).max() < 5 * effect.standard_error.max()


@pytest.mark.slow
@seeds(1, 2)
def test_targets_that_slip_together_are_told_together(rng: Rng) -> None:
    at, _, _ = draw_campaign(rng, [0, 1, 2])
    (effect,) = diagnose(at).effects
    assert label_effect(effect) == "target-step"


@pytest.mark.slow
@seeds(1, 2)
def test_targets_that_stay_are_not_told(rng: Rng) -> None:
    at, _, _ = draw_campaign(rng, [])
    assert not diagnose(at).effects


@pytest.mark.unit
def test_one_target_has_the_candidates_that_it_had(rng: Rng) -> None:
    at, _, _ = draw_campaign(rng, [], count=1)
    placed = place_steps(at, np.ones(len(at), bool), offer(at))
    assert {m.name for m in placed} == {m.name for m in every(at.robot)}


@pytest.mark.unit
def test_targets_share_the_prior_of_one_name(rng: Rng) -> None:
    at, _, _ = draw_campaign(rng, [])
    placed = place_steps(at, np.ones(len(at), bool), offer(at))
    base = Model((mechanism("geometric", at.robot),))
    found = build_candidates(at, base, placed, cells=False)
    alone = [c.prior for c in found if c.label.startswith("target-step:")]
    together = [c.prior for c in found if c.label == "target-step"]
    assert sum(alone) == pytest.approx(sum(together))
