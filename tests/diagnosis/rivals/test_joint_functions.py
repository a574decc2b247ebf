"""Functions of any shape are found where a joint would else be said not to repeat."""

from __future__ import annotations

import numpy as np
import pytest
from builders import drawn, measured, seeds, small_arm
from searches import search_separated

from modelsel.diagnosis.candidates.candidate_list import build_candidates
from modelsel.diagnosis.rivals.finding_groups import FURTHER
from modelsel.diagnosis.rivals.joint_functions import (
    generate_curves,
    generate_surfaces,
    list_joint_functions,
)
from modelsel.diagnosis.rivals.unlisted_shapes import UNLISTED_ODDS
from modelsel.diagnosis.shapes.candidate_kinds import CandidateKind
from modelsel.fitting.design import Model
from modelsel.mechanisms.registry import every, mechanism
from modelsel.robot.kinematics import forward

SIGMA = 0.03
TIME = "time_s"


@pytest.mark.parametrize(("joint", "axis"), [(3, "tz"), (2, "rz")])
@seeds(1)
def test_functions_are_offered_at_the_motion_of_a_joint(
    joint: int, axis: str, rng: np.random.Generator
) -> None:
    at = drawn(small_arm(prismatic=True), rng, 40)
    curves = list(generate_curves(at, joint))
    surfaces = list(generate_surfaces(at, joint))
    for one in (*curves, *surfaces):
        assert list(one.names_by_place()) == [(joint, axis)]
    others = {f"q{j}" for j in range(1, at.robot.n + 1)} - {f"q{joint}"}
    assert {name for one in curves for name in one.names()} == others | {f"move{joint}"}
    pairs = {one.names() for one in surfaces}
    assert {frozenset({f"q{joint}", other}) for other in others} <= pairs
    assert {frozenset({reading, TIME}) for reading in (*others, f"q{joint}")} <= pairs
    # either of two drivers has its turn
    assert len(surfaces) == 2 * len(pairs)


@pytest.mark.integration
@seeds(1)
def test_functions_are_as_probable_as_unlisted_shapes(rng: np.random.Generator) -> None:
    at = drawn("puma760", rng, 40)
    found = build_candidates(at, Model((mechanism("geometric", at.robot),)), every(at.robot))
    cell = max(one.prior for one in found if one.kind is CandidateKind.CELL)
    priors: dict[frozenset[str], float] = {}
    for one in list_joint_functions(at, found, 3):
        names = one.mechanism.names()
        if one.kind is CandidateKind.HYSTERESIS:
            # all of it, whatever the width, and of both forms
            names = frozenset({"hysteresis"})
        priors[names] = priors.get(names, 0.0) + one.prior
    for names, prior in priors.items():
        further = FURTHER if len(names) > 1 else 1.0
        assert prior == pytest.approx(further * UNLISTED_ODDS * cell)
    assert frozenset({"hysteresis"}) in priors
    assert list_joint_functions(at, (), 3) == []


@pytest.mark.slow
@seeds(1, 2, 3)
def test_a_joint_that_errs_by_two_drivers_is_no_joint_that_does_not_repeat(
    rng: np.random.Generator,
) -> None:
    at = drawn("irb1600", rng, 90)
    joint = int(rng.integers(1, 4))
    t = np.linspace(-1, 1, 90)
    own = at.data.q[:, joint - 1]
    wave = np.cos(rng.uniform(0.7, 1.2) * own + rng.uniform(2, 3) * t + rng.uniform(0, 6))
    other = np.sin(rng.uniform(0.7, 1.2) * own - rng.uniform(2, 3) * t + rng.uniform(0, 6))
    q = at.data.q.copy()
    q[:, joint - 1] += 6e-4 * (wave + other)
    shift = forward(at.robot, q, at.tools[0]) - forward(at.robot, at.data.q, at.tools[0])
    bent = measured(at, at.data.position + shift + rng.normal(0, SIGMA, shift.shape))
    base = Model((mechanism("geometric", at.robot),))
    found = search_separated(bent, base, build_candidates(bent, base, every(at.robot)))
    assert not [name for name in found.errors.names if name.startswith("joint")], found.path
    acts = {}
    for effect in found.effects:
        for place, names in effect.candidate.mechanism.names_by_place().items():
            # either is the course of the campaign
            acts[place] = {TIME if name == "progress" else name for name in names}
    assert acts == {(joint, "rz"): {f"q{joint}", TIME}}, found.path
    left = found.fit.residuals(bent)
    assert np.sqrt(np.square(left).mean()) < 1.3 * SIGMA
