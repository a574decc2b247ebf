"""Errors of a laser tracker's angles and beam, and of its reflector, are told as themselves, planted in
polar coordinates of the instrument's own frame."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from builders import OFF_AXIS, bind, seeds
from exact import flanges_of
from scipy.spatial.transform import Rotation
from searches import search_separated

from modelsel.diagnosis.candidates.candidate_list import build_candidates
from modelsel.diagnosis.candidates.signatures import LEVELS, PROVEN, read_signatures
from modelsel.diagnosis.findings.claim_sentences import describe_proven
from modelsel.diagnosis.findings.outcome import Diagnosis
from modelsel.diagnosis.search.acting_screws import keep_acting_screws
from modelsel.fitting.design import Model
from modelsel.fitting.problem import Problem
from modelsel.measurements.measurements import build_measurements
from modelsel.mechanisms.registry import every, mechanism
from modelsel.robot.files import load_robot
from modelsel.robot.kinematics import Robot

NOISE_MM = 0.02
ROWS = 110
# distances [mm], azimuths, zeniths [rad], cosines of the angle of incidence; a size and a phase
Seen = tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]
Plant = Callable[[Seen, float, float], tuple[np.ndarray, np.ndarray, np.ndarray]]


def turn_off_centre(seen: Seen, size: float, phase: float) -> tuple[np.ndarray, ...]:
    r, azimuth, zenith, _ = seen
    return r, azimuth + size * np.cos(azimuth - phase), zenith


def turn_oval(seen: Seen, size: float, phase: float) -> tuple[np.ndarray, ...]:
    r, azimuth, zenith, _ = seen
    return r, azimuth + size * np.cos(2 * azimuth - phase), zenith


def tilt_off_centre(seen: Seen, size: float, phase: float) -> tuple[np.ndarray, ...]:
    r, azimuth, zenith, _ = seen
    return r, azimuth, zenith + size * np.cos(zenith - phase)


def tilt_the_level_axis(seen: Seen, size: float, phase: float) -> tuple[np.ndarray, ...]:
    r, azimuth, zenith, _ = seen
    return r, azimuth + size / np.tan(zenith), zenith


def shift_the_beam(seen: Seen, size: float, phase: float) -> tuple[np.ndarray, ...]:
    r, azimuth, zenith, _ = seen
    aside, rise = size * np.cos(phase), size * np.sin(phase)
    return r, azimuth + aside / (r * np.sin(zenith)), zenith - rise / r


def count_from_elsewhere(seen: Seen, size: float, phase: float) -> tuple[np.ndarray, ...]:
    r, azimuth, zenith, _ = seen
    return r, azimuth, zenith + size


def meet_aslant(seen: Seen, size: float, phase: float) -> tuple[np.ndarray, ...]:
    r, azimuth, zenith, incidence = seen
    return r + size * (1 - incidence), azimuth, zenith


def err_in_several(seen: Seen, size: float, phase: float) -> tuple[np.ndarray, ...]:
    """An angle that is off centre, one that is tilted, and a beam beside the axes."""
    r, azimuth, zenith, _ = seen
    turned = azimuth + size * np.cos(azimuth - phase) + size / np.tan(zenith)
    raised = zenith + size * np.cos(zenith - phase + 1)
    return r, turned + 1500 * size / (r * np.sin(zenith)), raised


PLANTS: dict[str, tuple[str, Plant, float]] = {
    "off centre": ("tracker-azimuth", turn_off_centre, 4e-4),
    "oval": ("tracker-azimuth", turn_oval, 2e-4),
    "tilt": ("tracker-zenith", tilt_off_centre, 4e-4),
    "axes": ("tracker-transit", tilt_the_level_axis, 5e-4),
    "beam": ("tracker-offset", shift_the_beam, 1.0),
    "index": ("tracker-index", count_from_elsewhere, 4e-4),
    "several": ("tracker-errors", err_in_several, 4e-4),
    "incidence": ("reflector-incidence", meet_aslant, 0.8),
}


def draw_problem(arm: Robot, rng: np.random.Generator, plant: Plant | None, size: float) -> Problem:
    """Draw readings, and what an instrument two to three metres away measures of them."""
    q = arm.draw(rng, ROWS)
    flange = flanges_of(arm, q)
    position = flange[:, :3, 3] + flange[:, :3, :3] @ np.array(OFF_AXIS)
    turn = Rotation.from_rotvec([0.01, -0.02, rng.uniform(-np.pi, np.pi)]).as_matrix()
    bearing = rng.uniform(-np.pi, np.pi)
    away = rng.uniform(2000, 3000)
    base = np.array([away * np.cos(bearing), away * np.sin(bearing), -700.0])
    measured = position @ turn.T + base
    if plant is not None:
        measured = _measure(measured, flange[:, :3, 2] @ turn.T, plant, size, rng)
    measured = measured + rng.normal(0, NOISE_MM, measured.shape)
    at = bind(arm, build_measurements(q, measured))
    return replace(at, placement=(turn[None], base[None]))


def _measure(
    line: np.ndarray, axis: np.ndarray, plant: Plant, size: float, rng: np.random.Generator
) -> np.ndarray:
    r = np.linalg.norm(line, axis=1)
    azimuth, zenith = np.arctan2(line[:, 1], line[:, 0]), np.arccos(line[:, 2] / r)
    incidence = -np.einsum("mi,mi->m", axis, line) / r
    seen = r, azimuth, zenith, incidence
    r, azimuth, zenith = plant(seen, size, rng.uniform(0, 2 * np.pi))
    level = r * np.sin(zenith)
    columns = level * np.cos(azimuth), level * np.sin(azimuth), r * np.cos(zenith)
    return np.stack(columns, 1)


def diagnose(at: Problem) -> Diagnosis:
    base = Model((mechanism("geometric", at.robot),))
    return search_separated(at, base, build_candidates(at, base, every(at.robot)))


@pytest.mark.slow
@seeds(1, 2)
@pytest.mark.parametrize("kind", PLANTS)
def test_an_error_of_the_instrument_is_told(kind: str, rng: np.random.Generator) -> None:
    name, plant, size = PLANTS[kind]
    arm = load_robot(("ur5e", "irb120", "puma560")[int(rng.integers(3))])
    at = draw_problem(arm, rng, plant, float(rng.uniform(1, 2)) * size)
    first, *more = diagnose(at).effects
    assert first.candidate.label == name
    assert first.claim is not None
    assert first.claim.levels[LEVELS.index("cause")] >= PROVEN
    assert not [one for one in more if one.claim and one.claim.levels[-1] >= PROVEN]


@pytest.mark.slow
@seeds(1, 2, 3)
def test_one_too_small_to_be_told_from_others_is_not(rng: np.random.Generator) -> None:
    """Whatever is named then: no false cause is claimed."""
    alone = [kind for kind in PLANTS if kind != "several"]
    kind = alone[int(rng.integers(len(alone)))]
    name, plant, size = PLANTS[kind]
    arm = load_robot(("ur5e", "irb120", "puma560")[int(rng.integers(3))])
    at = draw_problem(arm, rng, plant, float(rng.uniform(0.1, 0.5)) * size)
    for effect in diagnose(at).effects:
        assert effect.claim is not None
        proven = effect.claim.levels[LEVELS.index("cause")] >= PROVEN
        assert effect.candidate.label == name or not proven


@pytest.mark.slow
@seeds(1, 2, 3)
def test_an_instrument_without_errors_is_told_of_none(rng: np.random.Generator) -> None:
    arm = load_robot(("ur5e", "irb120", "puma560")[int(rng.integers(3))])
    assert not diagnose(draw_problem(arm, rng, None, 0.0)).effects


def test_angles_of_the_beam_are_candidates_where_the_instrument_stands_apart() -> None:
    """In the robot's own frame, without its place, it is taken to stand in the robot's base."""
    rng = np.random.default_rng(3)
    arm = load_robot("ur5e")
    q = arm.draw(rng, 30)
    at = bind(arm, build_measurements(q, flanges_of(arm, q)[:, :3, 3]))
    base = Model((mechanism("geometric", arm),))
    told = {"tracker-azimuth", "tracker-zenith", "tracker-transit", "reflector-incidence"}

    def list_names(problem: Problem) -> set[str]:
        return {c.label for c in build_candidates(problem, base, every(arm), cells=False)}

    assert not told & list_names(at)
    assert told <= list_names(replace(at, tracker=(3000.0, 0.0, 500.0)))


def test_errors_of_an_instrument_agree_in_place_and_drivers() -> None:
    """What tells them apart is their shape, however small one of their axes is."""
    rng = np.random.default_rng(4)
    arm = load_robot("puma560")
    at = draw_problem(arm, rng, None, 0.0)
    base = Model((mechanism("geometric", arm),))
    found = build_candidates(at, base, every(arm), cells=False)
    acting = keep_acting_screws(at, found, None, np.zeros((at.data.position.size, 0)))
    place, drivers, shape, _ = read_signatures(acting)
    stems = {"tracker-axes", "tracker-scale", *(name for name, _, _ in PLANTS.values())}
    stems -= {"reflector-incidence"}
    where = [g for g, candidate in enumerate(found) if candidate.label in stems]
    assert len(where) > len(stems)
    assert len(set(place[where])) == len(set(drivers[where])) == 1
    assert len(set(shape[where])) == len(stems)


@pytest.mark.integration
def test_an_error_that_is_not_told_from_others_is_the_instruments(rng: np.random.Generator) -> None:
    arm = load_robot("ur5e")
    effect, *_ = diagnose(draw_problem(arm, rng, turn_off_centre, 8e-4)).effects
    assert effect.claim is not None
    unsure = replace(effect.claim, level="drivers", levels=(1.0, 1.0, 0.6, 0.6))
    told = describe_proven(replace(effect, claim=unsure))
    assert told.startswith("The instrument measures wrongly, by an amount that depends on where")
    assert "(tracker-azimuth" not in told
