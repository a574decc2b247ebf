"""What goes wrong with joints that slide is found and named: a screw's pitch, a bowed rail, a scale
that grows with temperature.

Positions come from readings moved by the error, through the nominal chain: no screw of this package
has a part in them."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from builders import bind, measured, seeds, small_arm, study_of

from modelsel.diagnosis.candidates.candidate import Candidate
from modelsel.diagnosis.candidates.candidate_list import build_candidates
from modelsel.diagnosis.findings.effects import Effect
from modelsel.diagnosis.findings.sentences import describe_candidate
from modelsel.diagnosis.procedure import diagnose_split
from modelsel.diagnosis.separation import Inquiry
from modelsel.diagnosis.shapes.candidate_kinds import CandidateKind
from modelsel.diagnosis.shapes.slide_waves import PITCHES, build_pitch_wave
from modelsel.fitting.design import Model
from modelsel.measurements.measurements import build_measurements
from modelsel.mechanisms.registry import every, mechanism
from modelsel.robot.kinematics import Robot, forward, pose

ARM: Robot = replace(small_arm(prismatic=True), gravity=(0.0, 0.0, -1.0))
BASE = Model((mechanism("geometric", ARM),))
TOOL, SIGMA = np.array([250.0, -60.0, 90.0]), 0.03
Array = np.ndarray


def pitch(q: Array, warm: Array) -> Array:
    return 0.12 * np.sin(2 * np.pi * q[:, 2] / 17.3 + 0.4)


def growth(q: Array, warm: Array) -> Array:
    return 6e-5 * (warm - 20.0) * q[:, 2]


def said(
    rng: np.random.Generator, error: Callable[[Array, Array], Array], across: bool = False
) -> tuple[Effect, ...]:
    """Effects found in 90 configurations whose slide errs along itself, or across itself by the
    third frame's x."""
    q, warm = ARM.draw(rng, 90), rng.uniform(15, 35, 90)
    off, moved = error(q, warm), q.copy()
    if across:
        position = forward(ARM, q, TOOL) + (off * pose(ARM, q, TOOL).axes[2, 0]).T
    else:
        moved[:, 2] += off
        position = forward(ARM, moved, TOOL)
    at = bind(
        ARM,
        build_measurements(
            q, position, covariates={"temperature_C": warm}, prismatic=ARM.prismatic
        ),
        TOOL,
    )
    at = measured(at, at.data.position + rng.normal(0, SIGMA, position.shape))
    return diagnose_split(study_of(at), Inquiry(BASE, every(ARM), 1, cells=True))[1].effects


@pytest.mark.slow
@pytest.mark.parametrize(
    ("error", "across", "names", "words"),
    [
        (pitch, False, {"q3"}, "Joint 3 slides unevenly, a wave every 17"),
        pytest.param(
            growth,
            False,
            {"q3", "temperature_C"},
            "(temperature_C-20)*q3 and q3",
            id="growth-False-names1-temperature_C*q3 and q3",
        ),  # the stream of draws goes by this name
        (lambda q, warm: 2e-5 * (q[:, 2] - 120.0) ** 2, True, {"q3"}, "q3 and q3*q3"),
    ],
)
def test_one_cause_is_one_finding(error, across, names, words, rng) -> None:
    (effect,) = said(rng, error, across)
    assert effect.candidate.mechanism.names() == names
    assert words in describe_candidate(effect.candidate, effect.estimate)
    assert effect.named.verdict == "found"


@pytest.mark.slow
@seeds(1, 2, 3)
def test_a_rail_that_is_not_straight_is_one_finding(rng: np.random.Generator) -> None:
    length, phase = rng.uniform(40, 200), rng.uniform(0, 2 * np.pi)

    def wave(q: Array, warm: Array) -> Array:
        return np.asarray(0.15 * np.sin(2 * np.pi * q[:, 2] / length + phase))

    (effect,) = said(rng, wave, across=True)
    told = describe_candidate(effect.candidate, effect.estimate)
    (found,) = re.findall(
        r"Joint 3 does not slide straight: a wave every (\S+) mm along the x axis of frame 3", told
    )
    assert float(found) == pytest.approx(length, rel=0.05)


@pytest.mark.slow
@pytest.mark.parametrize("lead", [2.5, np.pi])
def test_a_usual_screw_or_rack_of_many_turns_is_found(lead, rng) -> None:
    """Over the travel there are more waves of it than are looked for one by one."""
    travel = np.ptp(ARM.draw(rng, 90)[:, 2])
    assert travel / lead > PITCHES[-1]
    phase = rng.uniform(0, 2 * np.pi)

    def wave(q: Array, warm: Array) -> Array:
        return np.asarray(0.12 * np.sin(2 * np.pi * q[:, 2] / lead + phase))

    (effect,) = said(rng, wave)
    told = describe_candidate(effect.candidate, effect.estimate)
    (found,) = re.findall(r"Joint 3 slides unevenly, a wave every (\S+) mm", told)
    assert float(found) == pytest.approx(lead, rel=0.005)


def test_waves_of_a_slide_are_finer_than_its_travel_tells_apart() -> None:
    """Between two neighbours no wave loses more than 1 % of its length to the nearer; a slide that
    stood still has none."""
    step = max(b - a for a, b in pairwise(PITCHES))
    assert np.sinc(step / 2) > 0.99
    q = np.zeros((20, 3))
    q[:, :2] = np.random.default_rng(1).uniform(-2, 2, (20, 2))
    at = bind(ARM, build_measurements(q, forward(ARM, q, TOOL), prismatic=ARM.prismatic), TOOL)
    assert not [
        c
        for c in build_candidates(at, BASE, every(ARM))
        if "slides unevenly" in c.mechanism.sentence
    ]


def test_a_wave_of_a_slide_is_called_by_its_length() -> None:
    wave = build_pitch_wave(1, 1.75, 700.0, "tx")
    label = Candidate(wave, CandidateKind.SLIDE_WAVE, 0.1).label
    assert label == "frame 1 tx · wave of q1 every 400 mm"


def test_the_axis_that_a_slide_is_not_straight_along_is_named_with_its_frame() -> None:
    wave = build_pitch_wave(2, 1.0, 1264.1, "ty")
    assert wave.sentence == (
        "Joint 2 does not slide straight: a wave every 1,260 mm along the y axis of frame 2"
    )
