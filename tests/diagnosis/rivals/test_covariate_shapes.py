"""A shape of a joint that changes with a covariate is told by that, and not by the course of the
campaign. Campaigns by exact chains of the tests' own."""

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
from modelsel.diagnosis.rivals.covariate_shapes import (
    generate_by_covariates,
    generate_instead_of_time,
    generate_wave_products,
)
from modelsel.diagnosis.rivals.unlisted_shapes import list_rivals
from modelsel.diagnosis.shapes.candidate_kinds import CandidateKind
from modelsel.fitting.problem import Problem
from modelsel.measurements.measurements import build_measurements
from modelsel.mechanisms.causes import Named, q
from modelsel.mechanisms.registry import mechanism
from modelsel.mechanisms.terms import Mechanism, Screw, Term
from modelsel.robot.files import load_robot

TOOL = (40.0, -30.0, 110.0)
SIGMA = 0.02
ROWS = 110
IN_TIME = {"progress", "time_s"}
Rng = np.random.Generator


@seeds(1)
def test_a_finding_stands_against_itself_times_each_covariate(rng: Rng) -> None:
    at = drawn("puma760", rng, 40)
    play = mechanism("approach-backlash:3", at.robot)
    changing = list(generate_by_covariates(at, play))
    covariates = [name for name in at.data.covariates if name != "time_s"]
    assert [one.names() for one in changing] == [{"approach3", name} for name in covariates]
    # none has the finding's own name, by which its numbers would be measured
    assert all(one.terms[0].screws == play.terms[0].screws for one in changing)
    assert not [one for one in changing if one.stem == play.stem]
    rivals = list_rivals(at, Candidate(play, CandidateKind.MECHANISM, 0.1))
    assert set(changing) <= {rival.candidate.mechanism for rival in rivals}
    # the factor is counted from the middle of the measured range
    (one,) = [one for one in changing if "temperature_C" in one.names()]
    (screw,) = one.terms[1].screws
    factor = np.abs(screw.cause.of(at.state))
    assert factor.max() == pytest.approx(1, abs=1e-4)
    warm = mechanism("thermal-zero:3", at.robot)
    assert list(generate_by_covariates(at, warm)) == []


@seeds(1)
def test_a_covariate_that_stays_the_same_is_no_factor(rng: Rng) -> None:
    at = drawn("puma760", rng, 20, covariates={"payload_kg": np.full(20, 3.0)})
    play = mechanism("approach-backlash:3", at.robot)
    assert list(generate_by_covariates(at, play)) == []


@seeds(1)
def test_covariates_stand_in_the_place_of_time(rng: Rng) -> None:
    at = drawn("puma760", rng, 40)
    side = Named("approach3") * Named("time_s", "s")
    growing = Mechanism("own", (Term("m", (Screw(3, "rz", side),)),))
    groups = list(generate_instead_of_time(at, growing))
    covariates = [name for name in at.data.covariates if name != "time_s"]
    assert len(groups) == len(covariates) > 1
    for name, shapes in zip(covariates, groups, strict=True):
        assert shapes
        assert all(one.names() == {"approach3", name} for one in shapes)
    rivals = {
        rival.candidate.mechanism
        for rival in list_rivals(at, Candidate(growing, CandidateKind.GROWTH, 0.1))
    }
    assert {shape for shapes in groups for shape in shapes} <= rivals
    drift = Mechanism("own", (Term("m", (Screw(3, "rz", Named("time_s", "s")),)),))
    lasting = Mechanism("own", (Term("m", (Screw(3, "rz", q(3)),)),))
    assert list(generate_instead_of_time(at, drift)) == []
    assert list(generate_instead_of_time(at, lasting)) == []


@seeds(1)
def test_a_joint_may_turn_unevenly_in_proportion_to_a_covariate(rng: Rng) -> None:
    at = drawn("puma760", rng, 40)
    warm = Named("temperature_C", "C") * q(3)
    found = Mechanism("own", (Term("m", (Screw(3, "rz", warm),)),))
    alone, beside = generate_wave_products(at, found)
    temperature = at.data.covariates["temperature_C"]
    middle = (temperature.min() + temperature.max()) / 2
    share = 2 * (temperature - middle) / np.ptp(temperature)
    angle = at.data.q[:, 2]
    for term, wave in zip(alone.terms, (np.sin(angle), np.cos(angle)), strict=True):
        (screw,) = term.screws
        assert (screw.frame, screw.axis) == (3, "rz")
        assert screw.cause.of(at.state) == pytest.approx(share * wave, abs=1e-4)
    assert len(beside.terms) == 4
    rivals = list_rivals(at, Candidate(found, CandidateKind.SHAPE, 0.1))
    assert {alone, beside} <= {rival.candidate.mechanism for rival in rivals}
    assert list(generate_wave_products(at, mechanism("encoder-scale:3", at.robot))) == []


def swing(rng: Rng) -> np.ndarray:
    """A temperature (m,) that goes up and down some times in a campaign."""
    share = np.arange(ROWS) / ROWS
    turns = rng.uniform(2.2, 3.4)
    wave = np.sin(2 * np.pi * (turns * share + rng.uniform()))
    return 21 + 6 * wave + rng.normal(0, 0.3, ROWS)


def explain(
    rng: Rng, joint: int, shape: str, **covariates: np.ndarray
) -> tuple[tuple[Effect, ...], list[str]]:
    """Plant a joint's shape in proportion to the only covariate, or nothing for no shape: the effects
    that are found, and the parts of the errors."""
    body = arm(load_robot("irb120"), rng, TOOL)
    readings = body.draw(rng, ROWS, 2.4)
    own = readings[:, joint - 1]
    side = np.sign(np.diff(own, prepend=own[0]))
    (values,) = covariates.values()
    shares = {
        "play": -side * values / values.mean(),
        "wave": np.sin(own + rng.uniform(0, 6)) * (values - values.mean()) / values.std(),
        "": np.zeros(ROWS),
    }
    stands = readings.copy()
    stands[:, joint - 1] += 2.5e-4 * shares[shape]
    position = measure(body, State(body, stands), ())
    position = position + rng.normal(0, SIGMA, position.shape)
    data = build_measurements(readings, position, covariates=covariates)
    found = diagnose(Problem(load_robot("irb120"), data, np.array([TOOL])))
    return found.effects, list(found.errors.names)


@pytest.mark.slow
@seeds(1, 2)
@pytest.mark.parametrize("name", ["payload_kg", "speed_pct"])
def test_play_that_grows_with_a_covariate_is_told_as_that(name: str, rng: Rng) -> None:
    """It was told as play of one size, and a joint that does not repeat."""
    values = rng.choice([2.0, 10.0, 20.0, 40.0], ROWS)
    (effect,), parts = explain(rng, 2, "play", **{name: values})
    assert effect.candidate.mechanism.names() == {"approach2", name}
    assert "joint 2" not in parts


@pytest.mark.slow
@seeds(3, 4)
@pytest.mark.parametrize("shape", ["play", "wave"])
def test_what_changes_with_the_temperature_is_not_told_by_time(shape: str, rng: Rng) -> None:
    joint = int(rng.integers(1, 4))
    effects, parts = explain(rng, joint, shape, temperature_C=swing(rng))
    names = frozenset[str]().union(*(effect.candidate.mechanism.names() for effect in effects))
    assert "temperature_C" in names
    assert not names & IN_TIME
    assert f"joint {joint}" not in parts


@pytest.mark.slow
@seeds(5, 6)
def test_a_covariate_of_no_account_brings_no_finding(rng: Rng) -> None:
    effects, _ = explain(rng, 2, "", temperature_C=swing(rng))
    proven = [one for one in effects if one.claim is not None and one.claim.levels[0] >= PROVEN]
    assert proven == []
