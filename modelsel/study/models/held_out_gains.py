"""What models and findings gain on configurations that they have not seen."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise

from ..._random import generator
from ...config.study_file import Study
from ...diagnosis.findings.outcome import Diagnosis
from ...diagnosis.search.state import extend_model
from ...results.runs.finding_records import Finding
from ...selection.evaluation import Evaluation, Split, evaluate
from ...selection.gain import Gain, ResampledErrors, resample_errors


def resample_held_out(
    study: Study, split: Split, models: Sequence[Evaluation]
) -> list[ResampledErrors]:
    """Draw the held-out configurations anew, the same for all models, outliers left out."""
    held_out = ~split.estimation
    judged = held_out & ~split.outlying
    residuals = [model.residual[judged] for model in models]
    block = split.problem.data.block
    configurations = block[judged]
    rng = generator(study.seed, "gain")
    return resample_errors(residuals, configurations, rng)


def measure_findings(diagnosis: Diagnosis, steps: Sequence[ResampledErrors]) -> tuple[Finding, ...]:
    """Return a finding for each named effect, with the gain of the step that adds it."""
    findings = []
    steps_by_pairs = pairwise(steps)
    for effect, pair in zip(diagnosis.effects, steps_by_pairs, strict=True):
        before, after = pair
        gain = before.gain_of(after)
        finding = Finding(effect, gain)
        findings.append(finding)
    return tuple(findings)


def judge_beside_others(
    findings: Sequence[Finding], study: Study, split: Split, last: Evaluation, diagnosis: Diagnosis
) -> tuple[Finding, ...]:
    """Judge findings that gain nothing where they join the ladder beside all others, as the model has
    them: a small effect may help once larger ones that were named later stand.

    `last`: the model with all of them. Where it gains by a finding, that is the finding's gain."""
    judged = []
    for number, finding in enumerate(findings):
        one = finding
        if finding.doubtful:
            gain = _measure_beside_others(number, study, split, last, diagnosis)
            fall = None if gain.change is None else gain.change.fall
            if fall is not None and fall > 0:
                one = replace(finding, gain=gain)
        judged.append(one)
    return tuple(judged)


def _measure_beside_others(
    number: int, study: Study, split: Split, last: Evaluation, diagnosis: Diagnosis
) -> Gain:
    """Measure what a model gains by one of its effects."""
    others = [effect.candidate for effect in diagnosis.effects]
    del others[number]
    names = [one.label for one in others]
    model = extend_model(diagnosis.base, others)
    start = last.fit
    without = evaluate(split, model, names, start=start)
    models = [without, last]
    before, after = resample_held_out(study, split, models)
    return before.gain_of(after)
