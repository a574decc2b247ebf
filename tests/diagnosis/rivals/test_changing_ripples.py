"""A ripple that grows with the torque about its joint is not told as two ripples. Campaigns by exact
chains of the tests' own."""

from __future__ import annotations

import numpy as np
import pytest
from builders import drawn, seeds
from hidden_arm import State, arm
from hidden_arm import measured as measure

from modelsel.diagnosis.candidates.candidate import Candidate
from modelsel.diagnosis.candidates.signatures import PROVEN
from modelsel.diagnosis.findings.effects import Effect
from modelsel.diagnosis.procedure import diagnose
from modelsel.diagnosis.rivals.changing_ripples import generate_loaded_ripples
from modelsel.diagnosis.rivals.finding_groups import list_finding_groups
from modelsel.diagnosis.rivals.unlisted_shapes import list_rivals
from modelsel.diagnosis.shapes.candidate_kinds import CandidateKind
from modelsel.diagnosis.shapes.unregistered import build_wave
from modelsel.fitting.problem import Problem
from modelsel.measurements.measurements import build_measurements
from modelsel.mechanisms.registry import mechanism
from modelsel.mechanisms.terms import Mechanism
from modelsel.robot.files import load_robot

TOOL = (60.0, -40.0, 120.0)
SIGMA = 0.02
ROWS = 130
Rng = np.random.Generator


def keep_ripples(found: list[Candidate]) -> list[Mechanism]:
    return [one.mechanism for one in found if one.kind is CandidateKind.RIPPLE]


def evaluate(at: Problem, mechanism: Mechanism) -> np.ndarray:
    """Evaluate the causes (m, k) of a mechanism."""
    causes = [term.screws[0].cause for term in mechanism.terms]
    return np.stack([cause.of(at.state) for cause in causes], 1)


@seeds(1)
def test_a_changing_ripple_stands_against_two_waves_that_are_two_apart(rng: Rng) -> None:
    at = drawn("puma760", rng, 60)
    count = int(rng.integers(6, 40))
    found = [Candidate(build_wave(2, count + k), CandidateKind.JOINT_WAVE, 0.01) for k in (1, -1)]
    (together,) = list_finding_groups(at, dict(enumerate(found)))
    (loaded,) = keep_ripples(list(together.others))
    turning = keep_ripples(list(together.shapes))
    assert len(turning) > 6
    angle = count * at.data.q[:, 1]
    waves = np.stack([np.sin(angle), np.cos(angle)], 1)
    torque = at.state.value("torque2")[:, None]
    values = evaluate(at, loaded)
    scale = float((values / (torque * waves)).mean())
    assert values == pytest.approx(scale * torque * waves)
    # each is the sides with one relation of their phases: together they take any
    sides = np.hstack([evaluate(at, one.mechanism) for one in found])
    for ripple in turning:
        _, left, rank, _ = np.linalg.lstsq(sides, evaluate(at, ripple), rcond=None)
        assert rank == 4
        assert left == pytest.approx(0, abs=1e-5)
    # others are no sides
    for apart in (1, 3, 4):
        pair = [build_wave(2, count), build_wave(2, count + apart)]
        other = {g: Candidate(m, CandidateKind.JOINT_WAVE, 0.01) for g, m in enumerate(pair)}
        assert not [
            r for one in list_finding_groups(at, other) for r in keep_ripples(list(one.every))
        ]


@seeds(1)
def test_changing_ripples_stand_against_each_other(rng: Rng) -> None:
    at = drawn("puma760", rng, 60)
    pair = [Candidate(build_wave(3, k), CandidateKind.JOINT_WAVE, 0.01) for k in (11, 13)]
    (together,) = list_finding_groups(at, dict(enumerate(pair)))
    (loaded,) = (one for one in together.others if one.kind is CandidateKind.RIPPLE)
    turning = [one for one in together.shapes if one.kind is CandidateKind.RIPPLE]
    beside = [r for r in list_rivals(at, loaded) if r.candidate.kind is CandidateKind.RIPPLE]
    assert {r.candidate.mechanism for r in beside} == {one.mechanism for one in turning}
    assert {r.agrees for r in beside} == {"place"}
    rivals = {r.candidate.mechanism: r.agrees for r in list_rivals(at, turning[0])}
    assert rivals[loaded.mechanism] == "place"
    assert rivals[turning[1].mechanism] == "drivers"


def explain(
    rng: Rng, counts: tuple[float, ...], sizes: tuple[float, ...], load: bool
) -> list[Effect]:
    """Plant ripples of joint 2 with some numbers and amplitudes, in proportion to the torque about it
    with `load`: the effects that are found."""
    body = arm(load_robot("irb120"), rng, TOOL)
    readings = body.draw(rng, ROWS, 2.4)
    own = readings[:, 1]
    share = np.ones(ROWS)
    if load:
        torque = State(body, readings).moment(2)[:, 2]
        share = torque / np.sqrt(np.square(torque).mean())
    stands = readings.copy()
    for count, size in zip(counts, sizes, strict=True):
        stands[:, 1] += size * share * np.sin(count * own + rng.uniform(0, 6))
    position = measure(body, State(body, stands), ())
    position = position + rng.normal(0, SIGMA, position.shape)
    data = build_measurements(readings, position)
    robot = load_robot("irb120")
    return list(diagnose(Problem(robot, data, np.array([TOOL]))).effects)


@pytest.mark.slow
@seeds(1, 2)
def test_a_ripple_that_grows_with_the_torque_is_told_as_one(rng: Rng) -> None:
    """It was told as two gear ripples, each with a probability above 0.9."""
    count = int(rng.integers(9, 25))
    (effect,) = explain(rng, (count,), (3e-4,), load=True)
    assert effect.candidate.kind is CandidateKind.RIPPLE
    assert effect.candidate.mechanism.names() == {"q2", "torque2"}


@pytest.mark.slow
@seeds(3, 4)
def test_two_ripples_of_unlike_size_stay_two(rng: Rng) -> None:
    count = int(rng.integers(12, 25))
    effects = explain(rng, (count - 1, count + 1), (4e-4, 2e-4), load=False)
    labels = [effect.candidate.label for effect in effects]
    assert labels == ["gear-ripple:2", "gear-ripple:2"]


@pytest.mark.parametrize(
    ("found", "offered"),
    [("encoder-eccentricity:2", 1), ("gear-eccentricity:2", 0), ("encoder-eccentricity:1", 0)],
)
def test_one_wave_that_grows_with_the_torque_stands_against_two_a_turn(
    found: str, offered: int
) -> None:
    """Of a joint that holds weight its one side is two waves a turn, the other a constant."""
    robot = load_robot("irb120")
    q = robot.draw(np.random.default_rng(1), 40)
    at = Problem(robot, build_measurements(q, np.zeros((40, 3))), np.array([TOOL]))
    ripples = list(generate_loaded_ripples(at, mechanism(found, robot)))
    assert len(ripples) == offered
    for ripple in ripples:
        assert ripple.names() == {"q2", "torque2"}


@pytest.mark.slow
@seeds(1, 2)
def test_an_eccentric_gear_that_gives_way_under_load_is_no_oval_encoder(rng: Rng) -> None:
    """`encoder-eccentricity:2` was told, with 1.00."""
    effects = explain(rng, (1,), (4e-4,), load=True)
    first = effects[0]
    assert "torque2" in first.candidate.mechanism.names()
    for effect in effects:
        assert effect.claim is not None
        assert effect.claim.level != "cause" or effect.claim.probability < PROVEN
