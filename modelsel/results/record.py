"""From a run to its record: the contract's keys, the same bytes for the same input."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import asdict
from typing import Any

from .._json import to_plain
from .._records import parse_record
from .._short_numbers import round_numbers
from ..calibration.calibration import calibrate
from ..calibration.held_out_uncertainty import measure_held_out_uncertainty
from ..diagnosis.candidates.candidate import Candidate
from ..diagnosis.candidates.signatures import PROVEN
from ..diagnosis.findings.claim_sentences import is_settled, list_likelier, tell_rest
from ..diagnosis.findings.effects import Effect
from ..diagnosis.findings.rival_names import NAMED_RIVALS, list_rival_labels, list_twin_labels
from ..diagnosis.findings.sentences import label_effect, say_shape, weigh_listed
from ..measurements.measurements import Measurements
from ..mechanisms.terms import Mechanism
from ..notices import HOPELESS_FIT, Note
from ..selection.branch_and_bound import Certified
from ..selection.comparison import SubsetComparison
from ..selection.evaluation import Evaluation, measure_orientation
from .conclusions.cautions import (
    advise_nominal,
    explain_doubted_gravity,
    explain_open_mistake,
    explain_unknown_gravity,
)
from .conclusions.finding_figures import (
    FindingFigures,
    describe_figures,
    describe_small,
    measure_effects,
)
from .conclusions.goodness_of_fit import describe_noise, locate_features, measure_lack_of_fit
from .conclusions.largest_geometric_error import describe_largest_error
from .conclusions.placements import locate_placements
from .conclusions.verdict import Named, NamedErrors, Noise, complete_verdict, write_verdict
from .reading import SCHEMA
from .repeatability.repeatability import describe_errors, measure_unrepeated
from .repeatability.rounded_readings import find_rounding
from .repeatability.unstated_gears import find_unstated_gears
from .repeatability.unsure_joints import tell_unsure
from .runs.finding_records import describe_fault, describe_finding, list_screws
from .runs.study_run import Explanation, ModelSearch, StudyRun
from .schemas.schema import StudyRecord

Values = dict[str, Any]

# least probability of what the verdict lists besides a name
MIN_RIVAL = 0.05


def record_run(run: StudyRun) -> StudyRecord:
    """Return result.json's content of a finished run: floats to 10 significant digits, undefined ones null."""
    return parse_record(to_plain(_values(run)), StudyRecord)


def _values(run: StudyRun) -> Values:
    """Return the contract's keys, in the order of the file."""
    models, diagnosis, data = run.models, run.diagnosis, run.problem.data
    figures = measure_effects(run)
    named = collect_named(run.diagnosis, figures)
    errors = NamedErrors(named, figures.small_rms_mm, figures.told_small_mrad)
    return {
        "schema": SCHEMA,
        "study": run.study.name,
        "robot": run.robot.name,
        "seed": run.study.seed,
        "provenance": dict(run.provenance),
        "verdict": list(_verdict(run, errors)),
        "configurations": _configurations(run),
        "noise_floor": describe_noise(run.floor, data),
        **_placements(run, data),
        "ladder": [describe_rung(rung) for rung in models.ladder],
        "candidates": describe_candidates(models.comparison),
        "weighed_models": _weighed_models(run),
        "findings": _findings(run, figures),
        "small_findings": describe_small(named, figures),
        "repeatability": _repeatability(run),
        "nothing_else": _nothing_else(run),
        "nested_cv": _nested(models),
        "chosen": _chosen(run),
        "path": list(diagnosis.search.path),
        "error_map": _error_map(diagnosis),
        "outliers": data.row[run.split.outliers],
        "unidentifiable": [
            {**asdict(one), "parameters": list(one.parameters), "at_zero": list(one.at_zero)}
            for one in models.unidentifiable
        ],
        "warnings": _warnings((*run.warnings, *run.uncertainty.notes)),
        **run.uncertainty.to_dict(),
    }


def _repeatability(run: StudyRun) -> list[Values]:
    """Return what does not repeat."""
    search = run.diagnosis.search
    errors = search.errors
    ratios = run.study.robot.gear_ratios
    unstated = find_unstated_gears(errors, run.robot, ratios)
    data = run.problem.data
    rounding = find_rounding(data)
    return describe_errors(errors, rounding, unstated)


def _verdict(run: StudyRun, named: NamedErrors) -> tuple[str, ...]:
    """Return the sentences of the first page."""
    models, diagnosis = run.models, run.diagnosis
    nominal = models.ladder[0]
    errors = diagnosis.search.errors
    unrepeated = measure_unrepeated(errors, run.floor)
    unsure = tell_unsure(errors, run.floor)
    noise = Noise(run.floor, unrepeated, _measure_model(run), unsure)
    sentences = write_verdict(
        nominal,
        models.chosen,
        models.gain,
        noise,
        named,
        diagnosis.candidates,
        diagnosis.nothing_else.sentence,
    )
    gained, named_sentence, remainder = sentences
    hopeless = [note.sentence for note in run.warnings if note.code == HOPELESS_FIT]
    if not hopeless:
        named_sentence += _describe_geometry(run)
    named_sentence += explain_unknown_gravity(run.warnings)
    named_sentence += explain_doubted_gravity(diagnosis.findings)
    if diagnosis.mistake is not None:
        named_sentence = explain_open_mistake(diagnosis.mistake)
    sentences = (gained, named_sentence, remainder)
    orientation = measure_orientation(run.split, nominal, models.chosen)
    registered = "its base and the target" if run.study.robot.register_ else None
    told = complete_verdict(sentences, orientation, hopeless[0] if hopeless else None, registered)
    if hopeless:
        return told
    gained, *others = told
    return gained + advise_nominal(models.gain, orientation), *others


def _describe_geometry(run: StudyRun) -> str:
    """Describe the one error that takes most of what the chosen model's geometry explains; nothing where none does."""
    chosen = run.models.chosen
    largest = describe_largest_error(chosen.fit, run.robot)
    if largest is None:
        return ""
    return f" {largest}"


def _measure_model(run: StudyRun) -> float:
    """Measure the chosen model's own uncertainty [mm] at the held-out rows; 0 where it is not known."""
    fitted = run.models.chosen.fit
    c = calibrate(run.study.name, run.split, fitted, run.floor, None, False, run.provenance)
    return measure_held_out_uncertainty(c, run.split) or 0.0


def collect_named(diagnosis: Explanation, figures: FindingFigures) -> list[Named]:
    """Return what the verdict tells of every finding, faults of the data first, as result.json lists them."""
    named = [Named(fault.kind.label, True) for fault in diagnosis.faults]
    for finding, of in zip(diagnosis.findings, figures.each, strict=True):
        effect = finding.effect
        is_known = is_settled(effect)
        is_cause = effect.candidate.registered
        one = Named(
            name=say_shape(effect) if is_known and not is_cause else label_effect(effect),
            is_settled=is_known,
            matters=of.matters,
            doubtful=finding.doubtful,
            rivals=_list_rivals(effect),
            likelier=tuple(list_likelier(effect)),
            is_cause=is_cause,
        )
        named.append(one)
    return named


def _list_rivals(effect: Effect) -> tuple[str, ...]:
    """List what else a finding could be, but not other names of one displacement, and, where the place is proven,
    not other places of one motion: a shift along one axis of a frame and along another frame's may be the
    same. What is less probable than all that is not listed gives way to that, and what is hardly possible is
    left out."""
    candidate = effect.candidate
    left_out = list_twin_labels(effect)
    claim = effect.claim
    is_place_proven = claim is None or claim.levels[0] >= PROVEN
    if is_place_proven and not candidate.registered:
        left_out += _list_same_motions(effect)
    scale = weigh_listed(effect)
    weights = effect.named.sum_by_label()
    labels = list_rival_labels(effect)
    left_out += [label for label in labels if scale * weights[label] < MIN_RIVAL]
    rivals = [label for label in labels if label not in left_out]
    shown = rivals[:NAMED_RIVALS]
    told = tell_rest(effect, shown)
    return tuple(told)


def _list_same_motions(effect: Effect) -> list[str]:
    """List places without a registered name that move the target as the effect does."""
    labels = []
    for entry in effect.named.entries:
        candidate = entry.candidate
        label = candidate.label
        if candidate.registered:
            continue
        if entry.alike:
            labels.append(label)
    return labels


def _weighed_models(run: StudyRun) -> list[Values]:
    """Return the most probable sets of effects."""
    models = run.diagnosis.search.models
    names = _name_apart([one for model in models for one in model.effects])
    return [
        {
            "effects": [names[one.mechanism] for one in model.effects],
            "probability": model.probability,
            "chosen": model.chosen,
        }
        for model in models
    ]


def _name_apart(candidates: Sequence[Candidate]) -> dict[Mechanism, str]:
    """Return the label of every candidate; where several have one, as waves of other numbers, with its cause."""
    labels = {one.mechanism: one.label for one in candidates}
    shared = Counter(labels.values())
    names = {}
    for one in candidates:
        label = one.label
        names[one.mechanism] = label
        if shared[label] > 1 and one.screws:
            cause = one.mechanism.terms[0].screws[0].cause
            names[one.mechanism] = f"{label}, {round_numbers(str(cause))}"
    return names


def _configurations(run: StudyRun) -> Values:
    data, estimation = run.problem.data, run.split.estimation
    return {
        "estimation": data.take(estimation).configurations,
        "held_out": data.take(~estimation).configurations,
        "estimation_rows": data.row[estimation],
    }


def _placements(run: StudyRun, data: Measurements) -> Values:
    """Return where the set-up stands, as far as the study found it out."""
    values: Values = {}
    register = run.study.robot.register_
    if register:
        per_group = register == "per group"
        values["registration"] = locate_placements(run.problem, per_group)
    if data.gauges is not None:
        features = locate_features(run.problem, run.models.chosen.fit)
        values["features"] = [asdict(feature) for feature in features]
    return values


def describe_rung(evaluation: Evaluation) -> Values:
    """Return one model of the ladder or of the table of subsets."""
    return {
        "mechanisms": list(evaluation.names),
        "parameters": evaluation.parameters,
        "rank": evaluation.rank,
        "estimation": asdict(evaluation.estimation),
        "held_out": asdict(evaluation.held_out),
        "cv_rms_mm": evaluation.cv_rms_mm,
        "cv_mean_mm": evaluation.cv_mean_mm,
        "aicc": evaluation.aicc,
        "bic": evaluation.bic,
        "aic": evaluation.aic,
        "gcv": evaluation.gcv,
        "ebic": evaluation.ebic,
        "log_predictive_density": evaluation.log_density,
    }


def describe_candidates(comparison: SubsetComparison | None) -> Values:
    """Return the table of subsets."""
    if comparison is None:
        return {"compared": 0, "choice": None, "considered": [], "set_aside": [], "best": []}
    values: Values = {
        "compared": comparison.compared,
        "choice": list(comparison.choice),
        "considered": list(comparison.considered),
        "set_aside": list(comparison.set_aside),
    }
    if comparison.certified is not None:
        values["search"] = _search(comparison.considered, comparison.certified)
    values["best"] = [
        {**describe_rung(subset), "weight": subset.weight, "note": subset.note}
        for subset in comparison.best
    ]
    return values


def _search(considered: Sequence[str], certified: Certified) -> Values:
    """Return what branch and bound says of the best subset."""
    members = zip(considered, certified.members, strict=True)
    return {
        "mechanisms": len(considered),
        "criterion": "BIC",
        "nodes": certified.nodes,
        "proven": certified.proven,
        "may_be_beaten_by": certified.gap,
        "best": [name for name, is_member in members if is_member],
    }


def _findings(run: StudyRun, figures: FindingFigures) -> list[Values]:
    """Return every finding, faults of the data first."""
    training = run.problem.take(run.split.estimation)
    diagnosis = run.diagnosis
    faults = [describe_fault(fault) for fault in diagnosis.faults]
    findings = [
        describe_finding(finding, training) | describe_figures(of)
        for finding, of in zip(diagnosis.findings, figures.each, strict=True)
    ]
    return [*faults, *findings]


def _nothing_else(run: StudyRun) -> Values:
    limit = run.diagnosis.nothing_else
    predictable = run.diagnosis.predictable
    lack = measure_lack_of_fit(run.models.chosen, run.floor, run.split)
    turning = {} if limit.mrad is None else {"detection_limit_mrad": limit.mrad}
    return {
        "sentence": limit.sentence,
        "detection_limit_mm": limit.mm,
        **turning,
        "predictable": None if predictable is None else asdict(predictable),
        "lack_of_fit": None if lack is None else asdict(lack),
    }


def _nested(models: ModelSearch) -> Values | None:
    nested = models.nested
    if nested is None:
        return None
    return {
        "folds": nested.folds,
        "geometric": asdict(nested.base),
        "chosen": asdict(nested.chosen),
        "named_in_folds": nested.named,
    }


def _chosen(run: StudyRun) -> Values:
    """Return what the chosen model holds: registered mechanisms by name, other cells by their screws."""
    effects = run.diagnosis.search.effects if run.extends else ()
    names = [one.candidate.mechanism.name for one in effects if one.candidate.registered]
    training = run.problem.take(run.split.estimation)
    cells = [
        screw
        for one in effects
        if not one.candidate.registered
        for screw in list_screws(one.candidate, one.estimate, training)
    ]
    return {"mechanisms": [*run.study.model.base, *names], "cells": cells}


def _error_map(diagnosis: Explanation) -> Values:
    whole = diagnosis.error_map
    return {
        "places": list(whole.places),
        "causes": list(whole.causes),
        "f": whole.f,
        "p_family_wise": whole.p,
    }


def _warnings(notes: Sequence[Note]) -> list[Values]:
    return [{"code": note.code, "sentence": note.sentence} for note in notes]
