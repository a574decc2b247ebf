"""What happens to a whole campaign is told as itself: a base that rocks, a clock that is off, an arm
that lags, a zero that steps. Campaigns by exact chains of the tests' own."""

from __future__ import annotations

import re

import numpy as np
import pytest
from builders import seeds
from hidden_arm import Arm, State, arm
from hidden_arm import Effect as Planted
from hidden_arm import measured as measure
from scipy.spatial.transform import Rotation

from modelsel.diagnosis.candidates.signatures import PROVEN
from modelsel.diagnosis.findings.claim_sentences import describe_proven
from modelsel.diagnosis.findings.effects import Effect
from modelsel.diagnosis.findings.sentences import label_effect
from modelsel.diagnosis.procedure import diagnose
from modelsel.fitting.problem import Problem
from modelsel.measurements.measurements import build_measurements
from modelsel.robot.files import load_robot

ROBOTS = ("irb120", "ur5e", "puma560")
SIGMA = 0.02
TOOL = (40.0, -30.0, 110.0)
Rng = np.random.Generator


def draw_arm(rng: Rng) -> Arm:
    return arm(load_robot(ROBOTS[int(rng.integers(len(ROBOTS)))]), rng, TOOL)


def bind(body: Arm, q: np.ndarray, position: np.ndarray, **columns: np.ndarray) -> Problem:
    return Problem(
        load_robot(body.name), build_measurements(q, position, covariates=columns), body.tool[None]
    )


def observe(
    rng: Rng, body: Arm, q: np.ndarray, stands: np.ndarray, turn: np.ndarray | None = None
) -> np.ndarray:
    """Positions (m, 3) of the arm at angles (m, n), its base turned by vectors (m, 3), with noise."""
    none: tuple[Planted, ...] = ()
    position = measure(body, State(body, stands), none)
    if turn is not None:
        position = Rotation.from_rotvec(turn).apply(position)
    return position + rng.normal(0, SIGMA, position.shape)


def names(effects: tuple[Effect, ...]) -> list[str]:
    return [label_effect(effect) for effect in effects]


def list_proven(effects: tuple[Effect, ...]) -> set[str]:
    """Names of effects whose cause is proven."""
    return {
        label_effect(effect)
        for effect in effects
        if effect.claim is not None and effect.claim.levels[-1] >= PROVEN
    }


# -- a base that rocks
# --------------------------------------------------------------------------------------------------


@pytest.mark.slow
@seeds(1, 2, 3)
def test_a_base_that_rocks_about_an_edge_is_told_as_that(rng: Rng) -> None:
    """The real masses are others than the drawing's, and the base stays on its side for a little
    while: no joint is off its reading."""
    body = draw_arm(rng)
    m = int(rng.integers(70, 120))
    q = body.draw(rng, m, 2.6)
    real = Arm(**{**body.__dict__, "masses": body.masses * rng.uniform(0.7, 1.4, len(body.masses))})
    angle = rng.uniform(0, np.pi)
    edge = np.array([np.cos(angle), np.sin(angle), 0.0])
    moment = State(real, q).moment(0) @ edge
    stays = 0.03 * np.abs(moment).max()
    side = np.sign(moment)
    for k in range(1, m):
        if abs(moment[k]) < stays:
            side[k] = side[k - 1]
    effects = diagnose(
        bind(body, q, observe(rng, body, q, q, 2.5e-4 * np.outer(side, edge)))
    ).effects
    assert names(effects)[0] == "base-rocking"
    assert list_proven(effects) <= {"base-rocking", "tracker-step", "target-step"}


@pytest.mark.slow
@seeds(4, 5)
def test_a_base_that_yields_does_not_rock(rng: Rng) -> None:
    body = draw_arm(rng)
    q = body.draw(rng, 90, 2.6)
    moment = State(body, q).moment(0) * [1.0, 1.0, 0.0]
    turn = 4e-4 * moment / np.abs(moment).max()
    effects = diagnose(bind(body, q, observe(rng, body, q, q, turn))).effects
    assert names(effects)[0] == "base-tilt"
    assert "base-rocking" not in names(effects)


# -- clocks and lags
# --------------------------------------------------------------------------------------------------


@pytest.mark.slow
@seeds(1, 2)
@pytest.mark.parametrize("words", ["an earlier moment", "a later moment"])
def test_positions_of_another_moment_are_told_with_their_delay(words: str, rng: Rng) -> None:
    """A slow motion that goes on: it was told as a drift of the instrument."""
    body = draw_arm(rng)
    m = int(rng.integers(80, 130))
    delay = rng.uniform(0.003, 0.012) * (-1 if "earlier" in words else 1)
    time = np.cumsum(rng.uniform(0.8, 1.2, m))
    low, high = body.limits.clip(-2.6, 2.6).T
    speed = rng.uniform(1, 4, body.n) * 2 * np.pi / m
    phase = rng.uniform(0, 2 * np.pi, body.n)

    def follow(t: np.ndarray) -> np.ndarray:
        return (low + high) / 2 + 0.45 * (high - low) * np.sin(np.outer(t, speed) + phase)

    q = follow(time)
    problem = bind(body, q, observe(rng, body, q, follow(time + delay)), time_s=time)
    (effect,) = diagnose(problem).effects
    assert label_effect(effect) == "fault:time-offset"
    assert list_proven((effect,)) == {"fault:time-offset"}
    assert effect.estimate[0] == pytest.approx(delay, abs=5 * effect.standard_error[0])
    assert words in describe_proven(effect)
    assert " ms (" in describe_proven(effect)


@pytest.mark.slow
@seeds(1)
@pytest.mark.parametrize(
    ("share", "words"), [(4e-4, "stand past their readings"), (-4e-4, "are short of")]
)
def test_a_lag_of_all_joints_is_told_without_a_sign_that_is_wrong(
    share: float, words: str, rng: Rng
) -> None:
    """Readings that are too early and positions that are: neither is the rarer one. With a clock of
    the moves that tells nothing."""
    body = draw_arm(rng)
    q = body.draw(rng, 80, 2.6)
    stands = q + share * State(body, q).move
    time = np.cumsum(rng.uniform(20, 60, 80))
    (effect,) = diagnose(bind(body, q, observe(rng, body, q, stands), time_s=time)).effects
    assert label_effect(effect) == "fault:read-too-early"
    assert list_proven((effect,)) == {"fault:read-too-early"}
    assert words in describe_proven(effect)
    assert "opposite sign" not in describe_proven(effect)


# -- a zero that steps
# --------------------------------------------------------------------------------------------------


@pytest.mark.slow
@seeds(1, 2, 3)
def test_a_zero_that_steps_is_told_with_its_row(rng: Rng) -> None:
    """It was told as slow waves of the joint."""
    body = draw_arm(rng)
    m = int(rng.integers(60, 120))
    row, joint = int(rng.integers(m // 4, 3 * m // 4)), int(rng.integers(1, 4))
    q = body.draw(rng, m, 2.6)
    stands = q.copy()
    stands[row:, joint - 1] += 6e-4
    (effect,) = diagnose(bind(body, q, observe(rng, body, q, stands))).effects
    assert list_proven((effect,)) == {f"zero-step:{joint}"}
    told = describe_proven(effect)
    found = re.search(r"The zero of joint (\d) is another one from about row (\d+) on", told)
    assert found
    assert int(found[1]) == joint
    assert abs(int(found[2]) - row) <= 3
    assert effect.estimate[0] == pytest.approx(6e-4, abs=5 * effect.standard_error[0])


@pytest.mark.slow
@seeds(1, 2)
@pytest.mark.parametrize("course", ["even", "wave"])
def test_a_zero_that_wanders_is_no_step(course: str, rng: Rng) -> None:
    body = draw_arm(rng)
    q = body.draw(rng, 90, 2.6)
    stands = q.copy()
    share = np.linspace(0, 1, 90)
    by = share if course == "even" else np.sin(2 * np.pi * 1.3 * share)
    stands[:, 1] += 5e-4 * by
    effects = diagnose(bind(body, q, observe(rng, body, q, stands))).effects
    assert effects
    assert not [name for name in list_proven(effects) if name.startswith("zero-step")]
