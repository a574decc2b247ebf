"""What lasts is told from an effect: a base that settles is named, errors that fade are not."""

from __future__ import annotations

import numpy as np
import pytest
from builders import seeds
from hidden_arm import Effect as Planted
from hidden_arm import State, arm, measured
from hidden_effects import at, together

from modelsel.diagnosis.outcome import Diagnosis
from modelsel.diagnosis.procedure import diagnose
from modelsel.fitting.problem import Problem
from modelsel.measurements.measurements import build_measurements
from modelsel.robot.files import load_robot

SIGMA = 0.05
ROBOTS = ("puma760", "ur10e", "irb120")


def observe(rng: np.random.Generator, settles: float, fading: float) -> Problem:
    """Measure an arm whose base settles exponentially, by so many mm, with errors beside the noise
    that fade from one configuration to the next."""
    name = ROBOTS[int(rng.integers(3))]
    body = arm(load_robot(name), rng, (40.0, -25.0, 100.0))
    state = State(body, body.draw(rng, 80), {})
    lasts = rng.uniform(0.1, 0.3)
    axis = str(rng.choice(["tx", "ty", "tz"]))
    term = together(at(1, axis, lambda s: settles * (1 - np.exp(-s.progress / lasts))))
    exact = measured(body, state, (Planted("planted", "", (term,), np.ones(1)),))
    errors = rng.standard_normal(exact.shape)
    for k in range(1, len(errors)):
        errors[k] = 0.8 * errors[k - 1] + 0.6 * errors[k]
    noisy = exact + fading * errors + SIGMA * rng.standard_normal(exact.shape)
    return Problem(load_robot(name), build_measurements(state.q, noisy), body.tool[None])


def list_words(told: Diagnosis) -> set[str]:
    """List what the findings depend on."""
    return {name for effect in told.effects for name in effect.candidate.mechanism.names()}


@pytest.mark.integration
@seeds(1, 2, 3)
def test_a_base_that_settles_is_an_effect(rng: np.random.Generator) -> None:
    told = diagnose(observe(rng, settles=14 * SIGMA, fading=0.0), seed=1)
    assert list_words(told) == {"progress"}
    assert "lasting" not in told.errors.names


@pytest.mark.integration
@seeds(1, 2, 3)
def test_errors_that_fade_are_none(rng: np.random.Generator) -> None:
    told = diagnose(observe(rng, settles=0.0, fading=2 * SIGMA), seed=1)
    assert told.effects == ()
    assert "lasting" in told.errors.names
