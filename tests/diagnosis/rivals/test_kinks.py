"""Kinks of a joint by a reading: offered beside what depends on one reading, and ever finer around a found one."""

from __future__ import annotations

import numpy as np
import pytest
from builders import bind, drawn, seeds
from exact import flanges_of
from searches import search_separated

from modelsel.diagnosis.candidates.candidate_list import build_candidates
from modelsel.diagnosis.rivals.kinks import SIDES, build_kink, generate_finer_kinks, generate_kinks
from modelsel.diagnosis.shapes.candidate_kinds import CandidateKind
from modelsel.diagnosis.shapes.unregistered import build_cell
from modelsel.fitting.design import Model
from modelsel.measurements.measurements import build_measurements
from modelsel.mechanisms.causes import Cause, Named, q, sin
from modelsel.mechanisms.registry import every, mechanism
from modelsel.robot.files import load_robot

SHAPES = {
    "above": lambda beyond: np.maximum(beyond, 0),
    "below": lambda beyond: np.maximum(-beyond, 0),
    "both": np.abs,
}


@pytest.mark.parametrize("side", SIDES)
@pytest.mark.parametrize("onset", [-0.7, 0.0, 0.4])
def test_a_kink_is_how_far_a_reading_is_beyond_an_angle(
    side: str, onset: float, rng: np.random.Generator
) -> None:
    at = drawn("ur5e", rng, 40)
    kink = build_kink(4, 2, onset, side)
    expected = SHAPES[side](at.data.q[:, 1] - onset)
    np.testing.assert_allclose(at.cause(kink.terms[0].screws[0].cause), expected, atol=1e-12)
    finer = list(generate_finer_kinks(at, kink))
    assert finer
    assert kink not in finer
    nearest = min(np.abs(at.cause(one.terms[0].screws[0].cause) - expected).max() for one in finer)
    assert 0 < nearest < 0.02


@pytest.mark.parametrize(
    ("place", "causes", "offered"),
    [
        ((4, "rz"), (q(4),), True),
        ((4, "rz"), (sin(2.0 * q(1)),), True),
        ((4, "rx"), (q(4),), False),
        ((7, "tx"), (q(4),), False),
        ((4, "rz"), (q(4) * q(1),), False),
        ((4, "rz"), (Named("progress"),), False),
    ],
)
def test_kinks_are_offered_beside_what_depends_on_one_reading(
    place: tuple[int, str], causes: tuple[Cause, ...], offered: bool, rng: np.random.Generator
) -> None:
    at = drawn("ur5e", rng, 40)
    kinks = list(generate_kinks(at, build_cell(place, causes)))
    assert bool(kinks) is offered
    assert not list(generate_finer_kinks(at, build_cell(place, causes)))


@pytest.mark.slow
@seeds(1, 2, 3)
@pytest.mark.parametrize("side", SIDES)
def test_a_hose_that_tightens_is_one_kink(side: str, rng: np.random.Generator) -> None:
    """It was told as a free function, and as two more effects that mend its corner."""
    arm = load_robot(("irb120", "ur5e", "irb1600")[int(rng.integers(3))])
    tool = np.array([40.0, -70.0, 120.0])
    joint, other = rng.choice([2, 3, 4, 5], 2, replace=False)
    q_read = arm.draw(rng, 120)
    readings = q_read[:, other - 1]
    onset = np.quantile(readings, rng.uniform(0.35, 0.65))
    turned = q_read.copy()
    turned[:, joint - 1] += rng.uniform(1e-3, 2e-3) * SHAPES[side](readings - onset)
    flange = flanges_of(arm, turned)
    position = flange[:, :3, 3] + flange[:, :3, :3] @ tool + rng.normal(0, 0.03, (120, 3))
    at = bind(arm, build_measurements(q_read, position), tuple(tool))
    base = Model((mechanism("geometric", arm),))
    effects = search_separated(at, base, build_candidates(at, base, every(arm))).effects
    assert len(effects) <= 2
    for effect in effects:
        assert set(effect.candidate.mechanism.names_by_place()) == {(joint, "rz")}
        assert effect.candidate.mechanism.names() == {f"q{other}"}
    kinds = [effect.candidate.kind for effect in effects]
    # a hose that tightens ever more is nearly the same
    assert kinds in ([CandidateKind.KINK], [CandidateKind.PULL] * 2)
    if kinds == [CandidateKind.KINK]:
        (effect,) = effects
        kink = build_kink(int(joint), int(other), float(onset), side)
        found, expected = (
            one.terms[0].screws[0].cause for one in (effect.candidate.mechanism, kink)
        )
        assert np.corrcoef(at.cause(found), at.cause(expected))[0, 1] > 0.998
