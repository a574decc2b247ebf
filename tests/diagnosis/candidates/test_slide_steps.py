"""A shift along a slide between two sessions is told of the slide and of the instrument alike, planted in
exact positions."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from builders import bind, seeds, small_arm
from exact import flanges_of

from modelsel.diagnosis.candidates.candidate import Candidate
from modelsel.diagnosis.candidates.session_steps import place_steps
from modelsel.diagnosis.candidates.signatures import LEVELS, PROVEN, read_signatures
from modelsel.diagnosis.procedure import diagnose_split
from modelsel.diagnosis.separation import Inquiry
from modelsel.diagnosis.shapes.candidate_kinds import CandidateKind
from modelsel.fitting.design import Model, compute_design
from modelsel.fitting.problem import Problem
from modelsel.measurements.measurements import build_measurements
from modelsel.mechanisms.registry import every, mechanism
from modelsel.mechanisms.terms import Mechanism
from modelsel.robot.files import load_robot
from modelsel.robot.kinematics import Robot
from modelsel.selection.evaluation import Split

NOISE_MM = 0.03
ROWS = 100
TOOL = np.array([50.0, 20.0, -40.0])
LINKS = [
    ([0, 0, 320], "revolute"),
    ([325, 0, 0], "revolute"),
    ([275, 0, 0], "prismatic"),
    ([0, 0, 0], "revolute"),
]


@pytest.fixture
def scara(tmp_path: Path) -> Robot:
    lines = ['name = "scara"', 'source = "drawing"', "gravity = [0, 0, -1]"]
    for place, kind in LINKS:
        limits = "limits_mm = [-200, 0]" if kind == "prismatic" else "limits_deg = [-130, 130]"
        lines += ["[[joint]]", f"xyz_mm = {place}", "axis = [0, 0, 1]", f'kind = "{kind}"', limits]
    lines += ["[last]", "xyz_mm = [0, 0, -60]"]
    file = tmp_path / "robot.toml"
    file.write_text("\n".join(lines), encoding="utf-8")
    return load_robot(file)


def measure(arm: Robot, rng: np.random.Generator, raised: float) -> Problem:
    """Two sessions, between which the instrument is lowered."""
    q = arm.draw(rng, ROWS)
    flange = flanges_of(arm, q)
    seen = flange[:, :3, 3] + flange[:, :3, :3] @ TOOL + rng.normal(0, NOISE_MM, (ROWS, 3))
    later = np.arange(ROWS) >= rng.integers(40, 60)
    seen[later, 2] += raised
    groups = np.where(later, "late", "early")
    return bind(arm, build_measurements(q, seen, group=groups, prismatic=arm.prismatic), TOOL)


def list_along(at: Problem) -> list[Mechanism]:
    """List the steps of the instrument of one number."""
    placed = place_steps(at, np.ones(len(at), bool), every(at.robot))
    return [one for one in placed if one.name == "tracker-step" and len(one.terms) == 1]


@pytest.mark.slow
@seeds(1, 2)
def test_a_shift_along_a_slide_is_told_of_both(scara: Robot, rng: np.random.Generator) -> None:
    raised = float(rng.uniform(0.1, 0.2)) * rng.choice([-1, 1])
    at = measure(scara, rng, raised)
    rows = np.ones(ROWS, bool)
    split = Split(at, rows, ~rows, np.arange(ROWS) % 5, known_sigma=False)
    base = Model((mechanism("geometric", scara),))
    _, diagnosis, _ = diagnose_split(split, Inquiry(base, every(scara), 1, cells=True))
    (effect,) = diagnosis.effects
    assert {"zero-step:3", "tracker-step"} <= set(effect.named.sum_by_label())
    assert effect.claim is not None
    assert effect.claim.levels[LEVELS.index("cause")] < PROVEN
    assert abs(effect.estimate[0]) == pytest.approx(abs(raised), abs=5 * effect.standard_error[0])


@seeds(1)
def test_the_instrument_moves_as_the_slide_does(scara: Robot, rng: np.random.Generator) -> None:
    at = measure(scara, rng, 0.0)
    placed = place_steps(at, np.ones(ROWS, bool), every(scara))
    zeros = [one for one in placed if one.name == "zero-step:3"]
    along = list_along(at)
    assert len(along) == len(zeros)
    for zero, twin in zip(zeros, along, strict=True):
        moved, same = (compute_design(at, one.terms)[0] for one in (zero, twin))
        np.testing.assert_allclose(moved, same, atol=1e-9)
        assert twin.sentence.partition(" from ")[2] == zero.sentence.partition(" from ")[2]
        assert "along the slide of joint 3 from about " in twin.sentence


@seeds(1)
def test_a_slide_that_is_turned_has_no_other_name(rng: np.random.Generator) -> None:
    """Nor has an arm without slides, or where steps of the instrument are not looked for."""
    turning = replace(small_arm(prismatic=True), gravity=(0.0, 0.0, -1.0))
    assert any(turning.prismatic)
    q = turning.draw(rng, 30)
    data = build_measurements(q, np.zeros((30, 3)), prismatic=turning.prismatic)
    assert not list_along(bind(turning, data, TOOL))
    puma = load_robot("puma760")
    assert not list_along(bind(puma, build_measurements(puma.draw(rng, 30), np.zeros((30, 3)))))


@seeds(1)
def test_it_is_looked_for_with_the_steps_of_the_instrument(
    scara: Robot, rng: np.random.Generator
) -> None:
    at = measure(scara, rng, 0.0)
    zeros = [one for one in every(scara) if one.name == "zero-step:3"]
    placed = place_steps(at, np.ones(ROWS, bool), zeros)
    assert {one.name for one in placed} == {"zero-step:3"}


@seeds(1)
def test_a_step_along_the_first_slide_is_not_that_joint(rng: np.random.Generator) -> None:
    """Both move frame 1 along its axis; only the joint is off its reading."""
    arm = small_arm(prismatic=True)
    first, second, slide = arm.joints
    track = replace(arm, joints=(slide, first, second))
    at = measure(track, rng, 0.5)
    (twin, *_) = list_along(at)
    placed = place_steps(at, np.ones(ROWS, bool), every(track))
    zero = next(one for one in placed if one.name == "zero-step:1")
    assert zero.names_by_place().keys() == twin.names_by_place().keys()
    found = [Candidate(one, CandidateKind.MECHANISM, 0.1) for one in (zero, twin)]
    for level in read_signatures(found):
        assert level[0] != level[1]
