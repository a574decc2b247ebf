"""A joint's wave that is another one from some moment on, as an encoder that was mounted anew has it, is
told as that. Campaigns by exact chains of the tests' own."""

from __future__ import annotations

import numpy as np
import pytest
from builders import drawn, seeds
from hidden_arm import State, arm
from hidden_arm import measured as measure

from modelsel.diagnosis.candidates.candidate import Candidate
from modelsel.diagnosis.findings.outcome import Diagnosis
from modelsel.diagnosis.findings.step_sides import find_open_sides
from modelsel.diagnosis.procedure import diagnose
from modelsel.diagnosis.rivals.finding_groups import list_finding_groups
from modelsel.diagnosis.rivals.stepped_waves import (
    generate_other_moments,
    generate_stepped_waves,
    join_waves,
)
from modelsel.diagnosis.rivals.unlisted_shapes import list_rivals
from modelsel.diagnosis.shapes.candidate_kinds import CandidateKind
from modelsel.diagnosis.shapes.unregistered import build_cell
from modelsel.fitting.problem import Problem
from modelsel.measurements.measurements import build_measurements
from modelsel.mechanisms.causes import Named, q
from modelsel.mechanisms.environment import zero_step
from modelsel.mechanisms.registry import mechanism
from modelsel.mechanisms.step_moments import list_step_moments
from modelsel.mechanisms.terms import Mechanism
from modelsel.robot.files import load_robot

TOOL = (60.0, -40.0, 120.0)
SIGMA = 0.02
ROWS = 120
WAVE = 3e-4
Rng = np.random.Generator


def in_time(joint: int) -> Mechanism:
    growing = Named("progress") * q(joint) * q(joint)
    return build_cell((joint, "rz"), (growing,))


def find_moment(found: Mechanism) -> float:
    (moment,) = list_step_moments(found.terms)
    return moment


@seeds(1)
def test_a_wave_stands_against_one_that_changes_at_a_moment(rng: Rng) -> None:
    at = drawn("puma760", rng, 60)
    own = mechanism("gear-eccentricity:3", at.robot)
    stepped = list(generate_stepped_waves(at, own))
    assert {one.names() for one in stepped} == {frozenset(("progress", "q3"))}
    rivals = {
        r.candidate.mechanism: r
        for r in list_rivals(at, Candidate(own, CandidateKind.MECHANISM, 0.1))
    }
    assert {rivals[one].agrees for one in stepped} == {"place"}
    angle = at.data.q[:, 2]
    waves = [np.sin(angle), np.cos(angle)]
    for one in stepped:
        after = at.state.value("progress") > find_moment(one)
        assert min(after.sum(), (~after).sum()) > 5
        values = [np.asarray(term.screws[0].cause.of(at.state)) for term in one.terms]
        expected = [after * wave for wave in waves]
        if len(values) == 4:
            expected = waves + expected
        assert values == [pytest.approx(wave) for wave in expected]
    # nothing that is no wave, and none that steps already
    assert not list(generate_stepped_waves(at, mechanism("joint-compliance:3", at.robot)))
    assert not list(generate_stepped_waves(at, stepped[0]))


@seeds(1)
def test_what_changes_with_a_reading_and_time_may_change_at_a_moment(rng: Rng) -> None:
    at = drawn("puma760", rng, 60)
    growing = Candidate(in_time(2), CandidateKind.GROWTH, 0.1)
    rivals = [r.candidate for r in list_rivals(at, growing)]
    offered = {one.mechanism for one in rivals if one.kind is CandidateKind.STEPPED_WAVE}
    assert offered == set(generate_stepped_waves(at, growing.mechanism))
    # two findings, of which one is in time, may be one, too
    step = Candidate(zero_step(at.robot, 2, 0.4), CandidateKind.MECHANISM, 0.1)
    wave = Candidate(mechanism("gear-eccentricity:2", at.robot), CandidateKind.MECHANISM, 0.1)
    (together,) = list_finding_groups(at, {3: step, 8: wave})
    shapes = {one.mechanism for one in together.shapes if one.kind is CandidateKind.STEPPED_WAVE}
    assert shapes == offered
    elsewhere = build_cell((3, "tx"), (Named("progress") * q(3),))
    other = build_cell((3, "rz"), (Named("progress") * q(2),))
    for one in (elsewhere, other):
        assert not list(generate_stepped_waves(at, one))


@seeds(1)
def test_a_wave_that_changes_stands_beside_those_that_do_a_little_sooner_or_later(rng: Rng) -> None:
    at = drawn("puma760", rng, 100)
    stepped = list(generate_stepped_waves(at, mechanism("gear-eccentricity:3", at.robot)))
    own = stepped[len(stepped) // 2]
    near = {find_moment(one) for one in generate_other_moments(at, own)}
    looked_for = sorted({find_moment(one) for one in stepped})
    # all between the neighbours that were looked for
    place = looked_for.index(find_moment(own))
    progress = np.unique(at.data.progress)
    between = (progress[1:] + progress[:-1]) / 2
    low, high = looked_for[place - 1], looked_for[place + 1]
    wanted = [float(m) for m in between if low < m < high]
    assert all(min(abs(m - other) for other in (*near, looked_for[place])) < 5e-3 for m in wanted)
    found = Candidate(own, CandidateKind.STEPPED_WAVE, 0.1)
    rivals = {r.candidate.mechanism: r.agrees for r in list_rivals(at, found)}
    assert {rivals[one] for one in generate_other_moments(at, own)} == {"shape"}


@seeds(1)
def test_held_out_rows_around_the_moment_are_open(rng: Rng) -> None:
    at = drawn("puma760", rng, 100)
    used = np.ones(100, bool)
    used[[40, 47, 48]] = False
    training = at.take(used)
    looked_for = list(generate_stepped_waves(training, mechanism("gear-eccentricity:3", at.robot)))
    near = [other for one in looked_for for other in generate_other_moments(training, one)]
    progress = at.data.progress
    own = next(one for one in near if progress[46] < find_moment(one) < progress[49])
    (side,) = find_open_sides(at, used, [own], ())
    assert np.flatnonzero(side.rows).tolist() == [47, 48]
    assert side.step == "of joint 3's waves"


@seeds(1)
def test_a_wave_that_begins_beside_one_that_stays_is_one_that_changes(rng: Rng) -> None:
    at = drawn("puma760", rng, 60)
    wave = mechanism("gear-eccentricity:3", at.robot)
    stepped = [
        Candidate(m, CandidateKind.STEPPED_WAVE, 0.1) for m in generate_stepped_waves(at, wave)
    ]
    stays = Candidate(wave, CandidateKind.MECHANISM, 0.1)
    begins = next(one for one in stepped if len(one.mechanism.terms) == 2)
    changes = next(one for one in stepped if len(one.mechanism.terms) == 4)
    ((members, joined),) = join_waves(at, {4: stays, 9: begins})
    assert members == (9, 4)
    assert joined.mechanism in [one.mechanism for one in stepped]
    terms = {term.key for term in (*wave.terms, *begins.mechanism.terms)}
    assert {term.key for term in joined.mechanism.terms} == terms
    # neither what changes already, nor a wave of another joint or number
    others = [mechanism(f"encoder-eccentricity:{j}", at.robot) for j in (2, 3)]
    assert not list(join_waves(at, {4: stays, 9: changes}))
    for other in others:
        beside = Candidate(other, CandidateKind.MECHANISM, 0.1)
        assert not list(join_waves(at, {4: beside, 9: begins}))


def explain(rng: Rng, joint: int, before: float, after: float) -> Diagnosis:
    """Plant a joint's wave once a turn with one phase up to a row of the middle, and another from there
    on."""
    body = arm(load_robot("irb120"), rng, TOOL)
    readings = body.draw(rng, ROWS, 2.4)
    later = np.arange(ROWS) >= rng.integers(45, 75)
    own = readings[:, joint - 1]
    stands = readings.copy()
    stands[:, joint - 1] += WAVE * np.sin(own + np.where(later, after, before))
    position = measure(body, State(body, stands), ())
    position = position + rng.normal(0, SIGMA, position.shape)
    data = build_measurements(readings, position)
    return diagnose(Problem(load_robot("irb120"), data, np.array([TOOL])))


@pytest.mark.slow
@seeds(1, 2)
def test_an_encoder_that_was_mounted_anew_is_told_as_that(rng: Rng) -> None:
    """It was told as smooth in time, and a joint that does not repeat."""
    joint = int(rng.integers(1, 4))
    phase = rng.uniform(0, 6)
    found = explain(rng, joint, phase, phase + rng.uniform(1.5, 3.5))
    (effect,) = found.effects
    assert effect.candidate.kind is CandidateKind.STEPPED_WAVE
    assert not [name for name in found.errors.names if name.startswith("joint")]


@pytest.mark.slow
@seeds(3, 4)
def test_a_wave_that_stays_is_no_wave_that_changes(rng: Rng) -> None:
    joint = int(rng.integers(1, 4))
    phase = rng.uniform(0, 6)
    found = explain(rng, joint, phase, phase)
    (effect,) = found.effects
    assert effect.candidate.mechanism.names() == {f"q{joint}"}
