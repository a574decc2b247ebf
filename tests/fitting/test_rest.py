"""A joint that rests gives no direction of approach, whatever its encoder's noise says; small and
slow motions still do."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from builders import drawn, seeds, small_arm

from modelsel.diagnosis.candidates.candidate_list import build_candidates
from modelsel.diagnosis.columns.candidate_columns import build_columns, stack_design
from modelsel.diagnosis.inference.scan import build_scan, compute_basis
from modelsel.fitting.design import Model
from modelsel.fitting.least_squares import fit
from modelsel.measurements.measurements import Measurements, build_measurements
from modelsel.mechanisms.registry import every, mechanism


def read(q: np.ndarray, **more: object) -> Measurements:
    return build_measurements(q, np.zeros((len(q), 3)), **more)  # type: ignore[arg-type]


def rests(data: Measurements) -> str:
    return " ".join(n.sentence for n in data.notes if n.code == "joint-rests")


@seeds(1, 2, 3)
def test_a_joint_that_rests_throughout_has_no_motion(rng: np.random.Generator) -> None:
    noise = 10 ** rng.uniform(-5.5, -3.6)
    q = rng.uniform(-2, 2, (60, 3))
    q[:, 1] = 0.7 + noise * rng.standard_normal(60)
    data = read(q)
    assert not data.approach[:, 1].any()
    assert not data.move[:, 1].any()
    assert (data.approach[1:, [0, 2]] == np.sign(np.diff(q[:, [0, 2]], axis=0))).all()
    assert "joint 2 (at most " in rests(data)
    assert "joint 1" not in rests(data)


@seeds(1, 2, 3)
def test_a_joint_that_rests_at_times_keeps_the_side_it_came_from(rng: np.random.Generator) -> None:
    """It moves every tenth visit; between, its reading flickers. Told by a loop that knows which
    visits are motions."""
    noise = 10 ** rng.uniform(-5.5, -4.2)
    goal = np.repeat(rng.permutation(8) * 0.3, 10)
    q = np.stack([rng.uniform(-2, 2, 80), goal + noise * rng.standard_normal(80)], 1)
    group = ["a"] * 40 + ["b"] * 40
    data = read(q, group=group)
    side, expected, moves = 0.0, [], []
    for k in range(80):
        moved = k not in (0, 40) and goal[k] != goal[k - 1]
        side = 0.0 if k in (0, 40) else np.sign(goal[k] - goal[k - 1]) if moved else side
        expected.append(side)
        moves.append(abs(q[k, 1] - q[k - 1, 1]) if moved else 0.0)
    np.testing.assert_array_equal(data.approach[:, 1], expected)
    np.testing.assert_allclose(data.move[:, 1], moves)
    assert "joint 2" in rests(data)


@seeds(1, 2)
def test_small_and_slow_motions_are_motions(rng: np.random.Generator) -> None:
    """Steps of every size down to noise's, and a slow sweep of steps that are each below a tenth of
    a degree, with jumps."""
    q = np.stack(
        [
            np.cumsum(rng.choice([-1, 1], 200) * 10 ** rng.uniform(-5, 0, 200)),
            np.tile(np.linspace(0, 0.05, 50), 4) + np.repeat(np.arange(4.0), 50),
        ],
        1,
    )
    data = read(q)
    assert not rests(data)
    np.testing.assert_array_equal(data.approach[1:], np.sign(np.diff(q, axis=0)))


def test_a_slide_rests_within_a_tenth_of_a_millimetre(rng: np.random.Generator) -> None:
    q = np.stack([rng.uniform(-2, 2, 40), rng.normal(100, 0.01, 40)], 1)
    data = read(q, prismatic=(False, True))
    assert not data.approach[:, 1].any()
    assert " mm)" in rests(data)
    wide = read(q * [1, 100], prismatic=(False, True))
    assert wide.approach[1:, 1].all()
    assert not rests(wide)


@pytest.mark.integration
def test_a_resting_joint_is_the_place_of_no_cause_of_motion(rng: np.random.Generator) -> None:
    """Neither its approach, nor its overshoot, nor its settling can be named: they move nothing."""
    robot = small_arm()
    q = robot.draw(rng, 40)
    q[:, 1] = 0.4 + 1e-5 * rng.standard_normal(40)
    at = drawn(robot, rng, 40)
    at = replace(at, data=build_measurements(q, at.data.position))
    base = Model((mechanism("geometric", robot),))
    fitted, found = fit(at, base), build_candidates(at, base, every(robot), cells=False)
    X, _ = stack_design(at, base.terms, fitted.at())
    sizes = build_scan(build_columns(at, found, fitted.at()), compute_basis(X)).sizes
    moved = {c.label: k for c, k in zip(found, sizes, strict=True)}
    assert [moved[f"{stem}:2"] for stem in ("approach-backlash", "overshoot", "settle")] == [
        0,
        0,
        0,
    ]
    assert [moved[f"{stem}:1"] for stem in ("approach-backlash", "overshoot", "settle")] == [
        1,
        1,
        1,
    ]
