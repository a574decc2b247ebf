"""benchmarks.listed: what is right of a finding about a listed effect."""

from __future__ import annotations

import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from hidden_arm import Effect, State, arm, measured
from hidden_effects import at

ROOT = Path(__file__).parents[2]
if not (ROOT / "benchmarks").is_dir():
    pytest.skip("a source distribution has no benchmarks", allow_module_level=True)
sys.path.append(str(ROOT))

from benchmarks import listed  # noqa: E402
from benchmarks.cases import Case, bound  # noqa: E402
from benchmarks.score import Judge  # noqa: E402
from modelsel import load_robot  # noqa: E402
from modelsel.diagnosis.candidates.candidate import Candidate  # noqa: E402
from modelsel.diagnosis.findings.effects import Claim  # noqa: E402
from modelsel.diagnosis.shapes.candidate_kinds import CandidateKind  # noqa: E402
from modelsel.mechanisms.causes import Named, cos, q, sin  # noqa: E402
from modelsel.mechanisms.registry import build_mechanisms  # noqa: E402
from modelsel.mechanisms.terms import Mechanism, Screw, Term  # noqa: E402

pytestmark = pytest.mark.unit
ROBOT = load_robot("puma760")


def campaign(*effects: Effect) -> Case:
    """A case of some effects on an arm with geometric errors."""
    rng = np.random.default_rng(3)
    body = arm(ROBOT, rng, (40.0, -25.0, 100.0))
    states = []
    for m in (40, 120):
        columns = {"payload_kg": rng.choice([0.0, 5.0], m), "temperature_C": rng.uniform(18, 30, m)}
        states.append(State(body, body.draw(rng, m), columns))
    return Case("puma760", body, *states, effects, (1.0,) * len(effects), np.zeros(120))


def wave(joint: int) -> Effect:
    """Joint 2 turns with twice the angle of a joint."""
    values = lambda s: np.sin(2 * s.q[:, joint - 1])  # noqa: E731
    return Effect("wave", f"2 with {joint}", (at(2, "rz", values),), np.array([1e-3]))


def cell(frame: int, axis: str, *causes: object) -> Mechanism:
    terms = [Term(f"m{k}", (Screw(frame, axis, cause),)) for k, cause in enumerate(causes)]
    return Mechanism("cell", tuple(terms))


def judged(case: Case, own: Mechanism, kind: CandidateKind = CandidateKind.CELL) -> list[str]:
    """The levels at which an explanation is right."""
    unseen = bound(case.arm, case.robot, case.fresh, measured(case.arm, case.fresh, case.effects))
    rng = np.random.default_rng(0)
    truths = [listed.find_listed(effect, case.fresh, rng) for effect in case.effects]
    finding = SimpleNamespace(candidate=Candidate(own, kind, 0.1))
    held = Judge(case, unseen).held(finding.candidate)
    right = listed.judge_listed(finding, held, truths, unseen)
    return [level for level, holds in right.items() if holds]


def test_an_explanation_is_right_as_deep_as_it_agrees() -> None:
    case = campaign(wave(3))
    twice = 2.0 * q(3)
    assert judged(case, cell(2, "rz", sin(twice), cos(twice))) == ["place", "drivers", "shape"]
    assert judged(case, cell(2, "rz", sin(3.0 * q(3)))) == ["place", "drivers"]
    assert judged(case, cell(2, "rz", sin(2.0 * q(4)))) == ["place"]
    assert judged(case, cell(5, "rx", sin(2.0 * q(4)))) == []


def test_a_registered_name_that_does_the_same_is_right_at_every_level() -> None:
    case = campaign(wave(2))
    (name,) = build_mechanisms("encoder-eccentricity:2", ROBOT)
    levels = judged(case, name, CandidateKind.MECHANISM)
    assert levels == ["place", "drivers", "shape", "cause"]
    (other,) = build_mechanisms("gear-eccentricity:2", ROBOT)
    assert "cause" not in judged(case, other, CandidateKind.MECHANISM)


def test_drivers_beside_the_readings_are_found_alone() -> None:
    """Motions, times, payloads and temperatures are exchanged with the readings left as they are."""
    values = {
        "move2": lambda s: s.move[:, 1],
        "time": lambda s: s.progress,
        "payload": lambda s: s.covariates["payload_kg"],
        "temperature": lambda s: s.covariates["temperature_C"],
        "q5": lambda s: s.q[:, 4],
    }
    for name, one in values.items():
        effect = Effect("own", name, (at(2, "rz", one),), np.array([1e-4]))
        case = campaign(effect)
        truth = listed.find_listed(effect, case.fresh, np.random.default_rng(0))
        assert truth.drivers == {name}
        assert (2, "rz") in truth.places
    case = campaign(wave(3))
    warm = cell(2, "rz", Named("temperature_C", "°C"))
    assert listed.list_drivers(warm, case.problem()) == {"temperature"}


def test_what_is_claimed_is_right_no_deeper_than_it_is_claimed() -> None:
    case = campaign(wave(3))
    unseen = case.unseen()
    truths = [listed.find_listed(wave(3), case.fresh, np.random.default_rng(0))]
    candidate = Candidate(cell(2, "rz", sin(3.0 * q(3))), CandidateKind.CELL, 0.1)
    for level, right in (("drivers", True), ("shape", False)):
        claim = Claim(level, (1.0, 1.0, 1.0, 0.0), True)
        finding = SimpleNamespace(candidate=candidate, claim=claim)
        assert listed.is_rightly_told(finding, [0.5], truths, unseen) is right
    unclaimed = SimpleNamespace(candidate=candidate, claim=None)
    assert not listed.is_rightly_told(unclaimed, [1.0], truths, unseen)
