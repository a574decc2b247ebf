"""What a camera's lens or the calibration of cameras distorts is told as an error of the instrument, and
not as that of a laser tracker's angles: planted by a pinhole and by polynomials of the measured place."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from builders import OFF_AXIS, bind, seeds
from exact import flanges_of
from scipy.spatial.transform import Rotation
from searches import search_separated

from modelsel.diagnosis.candidates.candidate import Candidate
from modelsel.diagnosis.candidates.candidate_list import build_candidates
from modelsel.diagnosis.findings.claim_sentences import describe_what
from modelsel.diagnosis.rivals.field_distortions import generate_distortions
from modelsel.diagnosis.rivals.finding_groups import list_finding_groups
from modelsel.diagnosis.rivals.unlisted_shapes import list_rivals
from modelsel.diagnosis.shapes.candidate_kinds import CandidateKind
from modelsel.fitting.design import Model
from modelsel.fitting.problem import Problem
from modelsel.measurements.measurements import build_measurements
from modelsel.mechanisms.instrument import MISREADINGS, RADIAL
from modelsel.mechanisms.registry import every, mechanism
from modelsel.robot.files import load_robot

NOISE_MM = 0.03
ROWS = 110
ARMS = ("ur5", "irb120", "puma560")
# from the place in the camera's frame (m, 3) to what it measures; a size
Plant = Callable[[np.ndarray, float], np.ndarray]


def bend_rays(seen: np.ndarray, size: float) -> np.ndarray:
    """A pinhole whose picture is distorted in proportion to the cube of the distance from its middle; the
    depth is right."""
    picture = seen[:, :2] / seen[:, 2:]
    square = np.square(picture).sum(1, keepdims=True)
    return np.hstack([picture * (1 + size * square) * seen[:, 2:], seen[:, 2:]])


def warp(seen: np.ndarray, size: float) -> np.ndarray:
    """Quadratic in every coordinate, from the middle of what is seen."""
    x, y, z = ((seen - seen.mean(0)) / 1000).T
    return seen + size * np.stack([x * x - y * z, x * y, 0.7 * z * z + x * z], axis=1)


def draw_seen(rng: np.random.Generator, plant: Plant | None, size: float) -> Problem:
    """Draw what a camera two to three metres away sees of an arm; its axis points at that."""
    arm = load_robot(ARMS[int(rng.integers(len(ARMS)))])
    q = arm.draw(rng, ROWS)
    flange = flanges_of(arm, q)
    position = flange[:, :3, 3] + flange[:, :3, :3] @ np.array(OFF_AXIS)
    turn = Rotation.random(random_state=int(rng.integers(2**31))).as_matrix()
    centre = turn @ position.mean(0)
    away = np.array([0.0, 0.0, rng.uniform(2000, 3000)]) - centre
    seen = position @ turn.T + away
    if plant is not None:
        seen = plant(seen, size)
    seen = seen + rng.normal(0, NOISE_MM, seen.shape)
    at = bind(arm, build_measurements(q, seen))
    return replace(at, placement=(turn[None], away[None]))


@seeds(1)
def test_a_lens_shifts_away_from_its_axis_alone(rng: np.random.Generator) -> None:
    at = draw_seen(rng, None, 0.0)
    lens, *_ = generate_distortions(at, mechanism("tracker-zenith", at.robot))
    assert lens.name == RADIAL
    rotation, _ = at.placement
    seen = at.data.position
    first = at.robot.joints[0].before[:3, :3]
    for power, term in zip((1, 2), lens.terms, strict=True):
        moved = np.zeros((len(at), 3))
        for screw in term.screws:
            along = first[:, "xyz".index(screw.axis[1])]
            moved += np.asarray(screw.cause.of(at.state))[:, None] * along
        in_camera = moved @ rotation[0].T
        square = np.square(seen[:, :2] / seen[:, 2:]).sum(1)
        expected = seen[:, :2] * (square**power)[:, None]
        # nominal targets are where the noise and the arm leave them
        assert np.abs(in_camera[:, 2]).max() < 1e-9 * np.abs(in_camera).max()
        assert np.linalg.norm(in_camera[:, :2] - expected) < 0.01 * np.linalg.norm(expected)


@seeds(1)
def test_distortions_stand_against_errors_of_an_instrument_alone(rng: np.random.Generator) -> None:
    at = draw_seen(rng, None, 0.0)
    names = {one.name for one in generate_distortions(at, mechanism("tracker-zenith", at.robot))}
    # commands to the arm do not correct them
    assert len(names) == 3
    assert names <= set(MISREADINGS)
    zenith = Candidate(mechanism("tracker-zenith", at.robot), CandidateKind.MECHANISM, 0.1)
    axes = Candidate(mechanism("tracker-axes", at.robot), CandidateKind.MECHANISM, 0.1)
    alike = {r.candidate.label for r in list_rivals(at, zenith) if r.agrees == "drivers"}
    assert names <= alike
    (together,) = list_finding_groups(at, {3: zenith, 4: axes})
    assert {shape.label for shape in together.shapes} == names
    # none of its members is a shape that stands against a group
    field = Candidate(together.shapes[-1].mechanism, CandidateKind.DISTORTION, 0.1)
    (beside,) = list_finding_groups(at, {3: axes, 4: field})
    assert {shape.label for shape in beside.shapes} == names - {field.label}
    for name in ("base-tilt", "encoder-scale:2", "geometric"):
        assert list(generate_distortions(at, mechanism(name, at.robot))) == []
    # a tracker beside the arm has no lens that sees all of it
    aside = replace(at, placement=(at.placement[0], np.array([[900.0, 0.0, 0.0]])))
    seen_aside = {one.name for one in generate_distortions(aside, zenith.mechanism)}
    assert seen_aside == names - {RADIAL}


@pytest.mark.slow
@pytest.mark.parametrize("plant", [bend_rays, warp])
@seeds(3, 8)
def test_what_a_camera_distorts_is_no_trackers_angle(
    plant: Plant, rng: np.random.Generator
) -> None:
    size = rng.uniform(0.003, 0.006) if plant is bend_rays else rng.uniform(0.5, 1.0)
    at = draw_seen(rng, plant, size)
    base = Model((mechanism("geometric", at.robot),))
    found = search_separated(at, base, build_candidates(at, base, every(at.robot)))
    assert found.effects
    for effect in found.effects:
        assert effect.claim is not None
        said = describe_what(effect)
        assert effect.claim.level != "cause", said
        assert said.startswith("The instrument measures wrongly"), said
    if plant is bend_rays:
        assert [effect.label for effect in found.effects] == [RADIAL]
