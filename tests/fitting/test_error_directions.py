"""Whether errors lie along what a joint moves, by chance: heavy tails are no joint, a joint is one."""

from __future__ import annotations

import numpy as np
import pytest
from builders import OFF_AXIS, bind, seeds, small_arm

from modelsel.fitting.design import Model
from modelsel.fitting.error_directions import compute_alignment_p, compute_chance
from modelsel.fitting.error_structure import _build_model, find_structure
from modelsel.fitting.least_squares import fit
from modelsel.fitting.possible_parts import DIRECTIONS, list_parts
from modelsel.fitting.problem import Problem
from modelsel.fitting.restricted_likelihood import evaluate_likelihood
from modelsel.measurements.measurements import build_measurements
from modelsel.mechanisms.registry import mechanism
from modelsel.robot.kinematics import forward

ARM = small_arm()
BASE = Model((mechanism("geometric", ARM),))
TOOL = np.array([OFF_AXIS])


@pytest.mark.integration
@seeds(1, slow=(2,))
@pytest.mark.parametrize(("count", "spanned"), [(3, 1), (3, 2), (6, 1), (6, 2)])
def test_random_directions_are_rarely_along_a_part(
    rng: np.random.Generator, count: int, spanned: int
) -> None:
    """The tail where parts are told, against draws: lengths of heavy tails, few of which count."""
    lengths = rng.standard_t(4, (40, count))
    k = rng.standard_normal((40, count))
    most = np.square(lengths).sum(1) * np.square(k).sum(1)
    drawn = rng.standard_normal((20_000, 40, count))
    drawn /= np.linalg.norm(drawn, axis=2, keepdims=True)
    axes = np.linalg.qr(rng.standard_normal((40, count, spanned)))[0]
    squares = np.square(np.einsum("bmc,mcr->bmr", drawn, axes)).sum(2)
    p = np.array([compute_chance(most * square, most, count, spanned) for square in squares])
    at_five_percent = np.mean(p <= 0.05)
    assert at_five_percent <= 0.07
    if spanned == 1:
        assert at_five_percent >= 0.03
    # few rows decide, and none can be further along than its length: far out the tail is too long
    for level in (0.01, 0.001):
        assert np.mean(p <= level) <= 1.4 * level


def test_nothing_left_is_no_part() -> None:
    assert compute_chance(np.zeros(5), np.zeros(5), 3) == 1.0


def find_joints(rng: np.random.Generator, errors: np.ndarray, readings: np.ndarray) -> set[str]:
    """The joints that are said not to repeat, of an arm whose joints were at these readings."""
    q = ARM.draw(rng, len(errors))
    position = forward(ARM, q + readings, TOOL[0]) + errors
    problem = bind(ARM, build_measurements(q, position), TOOL)
    every = np.ones(len(q), bool)
    found = find_structure(problem, every, fit(problem, BASE), list_parts(problem, every))
    return {part.name for part in found.parts if part.told_by == DIRECTIONS}


@seeds(1, 2, 3)
def test_a_joint_that_does_not_repeat_lies_along_its_motion(rng: np.random.Generator) -> None:
    readings = np.zeros((80, ARM.n))
    readings[:, 1] = rng.normal(0, 4e-4, 80)
    assert find_joints(rng, rng.normal(0, 0.05, (80, 3)), readings) == {"joint 2"}


@pytest.mark.slow
@seeds(1)
def test_loud_rows_are_rarely_a_joint(rng: np.random.Generator) -> None:
    """Ten joints of twenty campaigns may be told by chance at 1 % each: no more than a few are."""
    none = np.zeros((60, ARM.n))
    told = [find_joints(rng, 0.05 * rng.standard_t(3, (60, 3)), none) for _ in range(40)]
    assert sum(map(len, told)) <= 6


def test_what_lies_along_a_part_is_seen_beside_a_fit(rng: np.random.Generator) -> None:
    """Errors of the same lengths, along the joint's motion and not."""
    q = ARM.draw(rng, 60)
    exact = forward(ARM, q, TOOL[0])
    ps = []
    for readings in (0.0, 3e-4):
        moved = np.zeros_like(q)
        moved[:, 2] = rng.normal(0, 1, 60) * readings
        position = forward(ARM, q + moved, TOOL[0]) + rng.normal(0, 0.03, exact.shape)
        problem: Problem = bind(ARM, build_measurements(q, position), TOOL)
        every = np.ones(60, bool)
        parts = {part.name: part for part in list_parts(problem, every)}
        model = _build_model(problem.take(every), fit(problem, BASE))
        none = evaluate_likelihood(model, ())
        ps.append(compute_alignment_p(none, parts["joint 3"].error))
    assert ps[0] > 1e-3
    assert ps[1] < 1e-4
