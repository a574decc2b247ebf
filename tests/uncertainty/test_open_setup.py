"""What is sampled where the data leave the set-up open: a gantry's base and target may lie anywhere along
its axes, and no walker follows the exact chain that far."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from builders import bind, study_of

from modelsel._typing import Array
from modelsel.fitting.design import Model
from modelsel.fitting.least_squares import Fit, fit
from modelsel.measurements.measurements import build_measurements
from modelsel.mechanisms.geometry import build_setup
from modelsel.mechanisms.registry import BUILTIN, mechanism
from modelsel.robot.kinematics import Joint, Robot, forward
from modelsel.selection.evaluation import Split
from modelsel.uncertainty.parameters import label_terms
from modelsel.uncertainty.posterior import Draws, summarise_importance
from modelsel.uncertainty.sampling_options import SamplingOptions
from modelsel.uncertainty.summary import assess_confidence, build_log_posterior, sample_confidence

TOOL = (0.0, 0.0, 0.0)
NOISE = 0.011
RANGES = np.array([2000.0, 1200.0, 600.0])
BRIEF = SamplingOptions(max_steps=2_000)


def gantry() -> Robot:
    """Three slides square to each other, along x, y and z."""
    turns = (
        [[0.0, 0, 1], [0, 1, 0], [-1, 0, 0]],
        [[0.0, -1, 0], [0, 0, 1], [-1, 0, 0]],
        [[0.0, 0, 1], [1, 0, 0], [0, 1, 0]],
    )
    joints = []
    for turn, length in zip(turns, RANGES, strict=True):
        frame = np.eye(4)
        frame[:3, :3] = turn
        joints.append(Joint(frame, True, (0.0, float(length))))
    return Robot("gantry", "made up for tests", tuple(joints), np.eye(4))


def measured_gantry(rng: np.random.Generator) -> tuple[Split, Fit, Model]:
    """A gantry without any error beyond noise, with the model that nothing was added to."""
    arm = gantry()
    q = rng.uniform(0, RANGES, (60, 3))
    position = forward(arm, q, np.array(TOOL)) + rng.normal(0, NOISE, (60, 3))
    at = bind(arm, build_measurements(q, position, prismatic=arm.prismatic), TOOL)
    model = Model((build_setup(arm, 1, 1, True, False), mechanism("geometric", arm)))
    return study_of(at), fit(at, model), model


@pytest.mark.integration
def test_open_coefficients_are_integrated_out(rng: np.random.Generator) -> None:
    """Of a null model the chain converges at once; what the data determine is as in closed form."""
    split, fitted, base = measured_gantry(rng)
    target = build_log_posterior(split, fitted, base, BUILTIN, options=BRIEF)
    assert target is not None
    open_ones = {label_terms(fitted.model)[k] for k in fitted.leaning}
    assert len(open_ones) > 6
    assert not open_ones & set(target.names)
    assert len(target.sampled) + len(open_ones) == fitted.found.rank
    confidence = assess_confidence(split, fitted, [], 3)
    chain = sample_confidence(confidence, split, target, 3, options=BRIEF).sampling
    assert chain is not None
    assert chain.converged
    width = chain.quantiles[:, 2] - chain.quantiles[:, 0]
    closed = chain.closed_form[:, 2] - chain.closed_form[:, 0]
    assert width == pytest.approx(closed, rel=0.1)


def test_all_are_sampled_where_asked_for(rng: np.random.Generator) -> None:
    split, fitted, base = measured_gantry(rng)
    target = build_log_posterior(split, fitted, base, BUILTIN, over="all")
    assert target is not None
    assert len(target.sampled) == fitted.found.rank


def uneven() -> Draws:
    """Draws of which one has all the weight."""
    weight: Array = np.eye(1, 400)[0]
    return Draws(np.zeros((400, 2)), np.ones(400), weight)


def test_an_unconverged_chain_is_not_to_be_believed(rng: np.random.Generator) -> None:
    """Neither the sentence on the closed form says so, nor that of an unconverged study."""
    assert "believe the sampled one" in summarise_importance(uneven()).sentence
    assert "believe" not in summarise_importance(uneven(), is_sampled=False).sentence
    split, fitted, base = measured_gantry(rng)
    short = replace(BRIEF, max_steps=60)
    target = build_log_posterior(split, fitted, base, BUILTIN, options=short)
    confidence = assess_confidence(split, fitted, [], 3)
    chain = sample_confidence(confidence, split, target, 3, options=short).sampling
    assert chain is not None
    assert not chain.converged
    assert "too curved" in chain.importance.sentence
    assert "believe" not in chain.importance.sentence
