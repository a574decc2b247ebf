"""A small effect that was named before a large one is judged beside it, as the model has both."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
from builders import drawn, planted, seeds, study_of, study_with

from modelsel.diagnosis.candidates.candidate import Candidate
from modelsel.diagnosis.search.state import extend_model
from modelsel.diagnosis.shapes.candidate_kinds import CandidateKind
from modelsel.fitting.design import Model
from modelsel.mechanisms.causes import q, sin
from modelsel.mechanisms.registry import mechanism
from modelsel.mechanisms.terms import Mechanism, Screw, Term
from modelsel.results.runs.finding_records import Finding
from modelsel.robot.files import load_robot
from modelsel.selection.evaluation import evaluate
from modelsel.selection.gain import Gain
from modelsel.study.models.held_out_gains import judge_beside_others

ARM = load_robot("irb120")
NOISE = 0.03
DOUBTED = Gain(0.49, 0.5, (-0.02, 0.01))


def wave(joint: int, count: int) -> Candidate:
    name = f"wave {count} of joint {joint}"
    term = Term(name, (Screw(joint, "rz", sin(float(count) * q(joint))),))
    return Candidate(Mechanism(name, (term,)), CandidateKind.WAVE, 1e-3)


@seeds(1, 2)
def test_what_gains_beside_the_others_is_not_doubted(rng: np.random.Generator) -> None:
    small, large, none = wave(3, 2), wave(2, 1), wave(5, 3)
    base = Model((mechanism("geometric", ARM),))
    truth = extend_model(base, [small, large])
    sizes = np.concatenate([np.zeros(len(base.terms)), [3e-4, 3e-3]])
    split = study_of(planted(drawn(ARM, rng, 140), truth.terms, sizes, rng, NOISE), held_out=50)
    effects = [SimpleNamespace(candidate=one) for one in (small, none, large)]
    diagnosis = SimpleNamespace(base=base, effects=effects)
    last = evaluate(split, extend_model(base, [small, none, large]), ())
    findings = [Finding(effect, DOUBTED) for effect in effects]
    judged = judge_beside_others(findings, study_with(), split, last, diagnosis)
    assert [one.doubtful for one in judged[:1]] == [False]
    assert judged[0].gain.interval_mm[0] > 0
    assert judged[1].gain is DOUBTED or judged[1].gain.change.fall < 0.1 * NOISE
