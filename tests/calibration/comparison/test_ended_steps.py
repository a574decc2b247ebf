"""A calibration as the arm stood at the end or at the beginning of its campaign."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from wide_calibration import wide

from modelsel.calibration.calibration import Calibration
from modelsel.calibration.comparison.ended_steps import settle_steps
from modelsel.calibration.prediction import predict
from modelsel.fitting.design import Model
from modelsel.mechanisms.drifts import tracker_drift
from modelsel.mechanisms.environment import step_after, target_step, zero_step
from modelsel.mechanisms.moved_targets import limit_to_targets
from modelsel.mechanisms.terms import Mechanism, Screw, Term

pytestmark = pytest.mark.unit


def with_more(made: Calibration, mechanism: Mechanism, rng: np.random.Generator) -> Calibration:
    """A calibration with a mechanism more, of some size."""
    count = len(mechanism.terms)
    factor = rng.normal(0, 1e-4, (count, made.factor.shape[1]))
    return replace(
        made,
        model=Model((*made.model.mechanisms, mechanism)),
        theta=np.concatenate([made.theta, rng.uniform(1e-3, 3e-3, count)]),
        factor=np.vstack([made.factor, factor]),
        kept=(*made.kept, *range(len(made.theta), len(made.theta) + count)),
    )


@pytest.mark.parametrize("kind", ["zero of joint 4", "target b"])
def test_what_stepped_is_part_of_the_constants_at_the_end_and_not_there_before(kind, rng) -> None:
    made, at = wide(rng)
    robot = made.robot
    step = zero_step(robot, 4, 0.7)
    if kind == "target b":
        step = limit_to_targets(target_step(robot, 0.7), {1: "b"})
    stepped = with_more(made, step, rng)
    late = stepped.problem(at.data)
    ended = settle_steps(stepped, at_end=True)
    assert ended.model.mechanisms == made.model.mechanisms
    np.testing.assert_allclose(predict(ended, late), predict(stepped, late), atol=1e-9)
    assert ended.factor.shape == made.factor.shape
    moved = np.flatnonzero(ended.theta != made.theta)
    assert len(moved) == len(step.terms)
    np.testing.assert_allclose(ended.theta[moved] - made.theta[moved], stepped.theta[-len(moved) :])
    np.testing.assert_allclose(
        ended.factor[moved] - made.factor[moved], stepped.factor[-len(moved) :]
    )
    begun = settle_steps(stepped, at_end=False)
    np.testing.assert_array_equal(begun.theta, made.theta)
    assert begun.kept == made.kept


def test_what_is_no_step_or_has_no_constant_stays(rng) -> None:
    made, _ = wide(rng)
    robot = made.robot
    assert settle_steps(made, at_end=True) is made
    drifting = with_more(made, tracker_drift(robot, 1.0), rng)
    assert settle_steps(drifting, at_end=True) is drifting
    alone = Mechanism("odd step", (Term("s", (Screw(2, "rx", step_after(0.4) * 2.0),)),))
    growing = with_more(made, alone, rng)
    assert settle_steps(growing, at_end=True) is growing
