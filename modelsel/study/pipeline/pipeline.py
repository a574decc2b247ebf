"""The steps of a study, from its measurements to its result.

prepare -> find outliers and diagnose -> evaluate the ladder -> compare all subsets -> measure the
gain -> repeat in nested folds -> collect the warnings -> assess the uncertainty -> result.

`analyse` calls them in this order. Each step takes values and returns new ones. The ladder is a
list of evaluations: the first is of the nominal arm, the last of the chosen model.
"""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ..._progress import keep_silent
from ..._random import generator
from ..._typing import Say
from ..._version import VERSION
from ...config.study_file import Study
from ...diagnosis.candidates.candidate import Candidate
from ...diagnosis.candidates.candidate_list import choose_strongest
from ...diagnosis.error_map import build_error_map
from ...diagnosis.faults.data_faults import Fault, find_misplaced_rows
from ...diagnosis.findings.outcome import Diagnosis
from ...diagnosis.procedure import Nested, run_nested_folds
from ...diagnosis.separation import Inquiry
from ...diagnosis.unexplained import describe_unexplained, predict_remainder
from ...fitting.least_squares import Fit
from ...fitting.noise import Floor
from ...fitting.undetermined import Unidentifiable, describe_unidentifiable
from ...measurements.measurements import Measurements
from ...mechanisms.campaign_registry import set_targets
from ...mechanisms.registry import BUILTIN, Registry
from ...notices import Note
from ...results.conclusions.cautions import harmful_base_notes
from ...results.conclusions.finding_figures import order_findings
from ...results.conclusions.orientation_gains import add_orientation_gains
from ...results.runs.finding_records import Finding
from ...results.runs.study_run import Explanation, ModelSearch, StudyRun
from ...robot.kinematics import Robot
from ...robot.plain_values import hash_robot
from ...selection.comparison import MAX_CANDIDATES, SubsetComparison, compare_subsets
from ...selection.evaluation import Evaluation, Split, evaluate
from ...uncertainty.parameters import Parameter, label_terms
from ...uncertainty.sampler import Keeper
from ...uncertainty.summary import (
    Confidence,
    assess_confidence,
    build_log_posterior,
    sample_confidence,
)
from ..inputs.inputs import list_candidates
from ..inputs.noise_parts import note_untold_parts
from ..models.cause_search import MISTAKE_FIRST, build_inquiry, seek_causes
from ..models.held_out_gains import judge_beside_others, measure_findings, resample_held_out
from ..models.held_out_outliers import exclude_held_out_outliers
from ..models.model_ladder import choose_constants, evaluate_effects, evaluate_ladder, remeasure
from ..models.open_rows import exclude_open_rows
from ..models.rehearsed_folds import rehearse_folds
from ..models.untested_candidates import find_unseen_steps, find_untested
from ..preparation.checks import add_alarms_to_errors, check_chosen_model, drop_known_faults
from ..preparation.gravity_direction import doubt_gravity, note_other_gravity
from ..preparation.preparation import prepare, read_instrument
from ..preparation.stated_noise import check_stated_noise, choose_noise_floor
from .late_rows import late_row_notes
from .payload_elsewhere import payload_elsewhere_notes
from .payload_springs import add_payload_springs
from .result import Result
from .steps import (
    FOLDS,
    GAIN,
    LADDER,
    OUTLIERS,
    REGISTERING,
    SAMPLING,
    SPLITTING,
    SUBSETS,
    WEIGHING,
)
from .study_notes import (
    collect_comparison_notes,
    collect_diagnosis_notes,
    collect_fit_notes,
    collect_held_out_notes,
)


def analyse(
    study: Study,
    robot: Robot,
    measured: Measurements,
    *,
    registry: Registry = BUILTIN,
    labels: NDArray[np.object_] | None = None,
    say: Say = keep_silent,
    data_sha256: str = "",
) -> Result:
    """Run the steps of a study on measurements that are read already.

    `labels` (m,) say which rows estimate, where the study names a column for it; `data_sha256` is
    the hash of the measurements' file. Raises StudyError, DataError or NotEstimable.
    """
    say(REGISTERING if study.robot.register_ else SPLITTING)
    split, floor, notes = prepare(study, robot, measured, labels)
    with add_alarms_to_errors(notes):
        provenance = record_provenance(study, robot, data_sha256)
        return _analyse_prepared(study, registry, split, floor, notes, say, provenance)


def _analyse_prepared(
    study: Study,
    registry: Registry,
    split: Split,
    floor: Floor | None,
    notes: tuple[Note, ...],
    say: Say,
    provenance: dict[str, str],
) -> Result:
    """Run the steps that follow the preparation.

    `floor` is the noise floor where it is known, `notes` those of the preparation.
    """
    # targets that no estimation row measures have been left out
    registry = set_targets(registry, split.problem.data.targets, split.problem.data.listed_targets)
    base, _ = rehearse_folds(study, split, (), registry)
    unseen = find_unseen_steps(study.model.candidates, split.problem, registry)
    mechanisms = list_candidates(study, split.problem.robot, registry, unseen)
    untested = find_untested(study.model.candidates, split.problem, mechanisms, unseen)

    say(OUTLIERS)
    notes = (*notes, *late_row_notes(split.training, base))
    asked = build_inquiry(study, split, base, mechanisms, say)
    mistake, asked, split, diagnosis, candidates = seek_causes(
        study, registry, split, asked, floor, notes
    )
    parts_sought = bool(diagnosis.errors.parts)
    split, floor, noise_notes = check_stated_noise(split, floor, diagnosis.fit, parts_sought)
    notes = (*notes, *note_untold_parts(study.noise, split))

    say(LADDER)
    steps = evaluate_effects(split, evaluate(split, base, study.model.base), diagnosis)
    ladder = evaluate_ladder(
        study, split, registry, steps, choose_constants(candidates, diagnosis.single_f)
    )

    # the table of subsets leaves out the same rows as the ladder
    split, side_notes = exclude_open_rows(split, ladder[-1], diagnosis.effects)
    split = exclude_held_out_outliers(split, ladder, diagnosis.errors)
    ladder = [remeasure(evaluation, split) for evaluation in ladder]

    say(SUBSETS)
    comparison = compare_candidates(study, split, steps[0], diagnosis, candidates)

    say(GAIN)
    chosen = ladder[-1]
    faults = () if mistake else find_data_faults(study, split, chosen, notes)
    resampled = resample_held_out(study, split, [ladder[0], chosen, *steps])
    nominal_errors, chosen_errors, *step_errors = resampled
    findings = measure_findings(diagnosis, step_errors)
    findings = judge_beside_others(findings, study, split, steps[-1], diagnosis)
    findings = add_orientation_gains(findings, diagnosis, split, steps, chosen, study.seed)
    within_folds = None if mistake else repeat_in_folds(study, split, asked)
    noise = choose_noise_floor(split, floor, steps[-1])
    detection_limit = describe_unexplained(
        diagnosis,
        candidates,
        split,
        steps[-1],
        MISTAKE_FIRST if mistake else untested.reason,
        bool(faults),
    )

    # every warning is collected here, in the order in which it is reported
    gain = nominal_errors.gain_of(chosen_errors)
    warnings = [
        *notes,
        *note_other_gravity(
            split.training.as_stated(),
            steps[0].fit,
            diagnosis.registered,
            steps[-1].fit,
            notes,
            study.robot.gravity is not None,
        ),
        *untested.note(),
        *collect_diagnosis_notes(study, split, diagnosis, noise_notes, detection_limit.mm),
        *collect_comparison_notes(comparison, chosen),
        *harmful_base_notes(study.model.base, nominal_errors.gain_of(step_errors[0]), gain),
        *side_notes,
        *collect_held_out_notes(split, chosen, findings),
        *payload_elsewhere_notes(split.training, steps[-1].fit),
        *collect_fit_notes(split, ladder, floor, floor_doubted=bool(noise_notes)),
    ]
    limit_mm = detection_limit.mm if _adds_named(chosen, steps) else None
    warnings += check_chosen_model(
        split, chosen, noise, limit_mm, warnings, study.robot.register_, faults
    )
    models = ModelSearch(
        ladder=tuple(ladder),
        comparison=comparison,
        chosen=chosen,
        gain=gain,
        nested=within_folds,
        unidentifiable=list_unidentifiable(chosen.fit),
    )
    uncertainty = assess_uncertainty(study, split, chosen, say)
    explanation = Explanation(
        findings=doubt_gravity(
            _measure_loads(findings, split, diagnosis, chosen.fit, uncertainty.parameters),
            warnings,
            split.problem.robot,
        ),
        faults=faults,
        search=diagnosis,
        error_map=build_error_map(diagnosis, candidates),
        nothing_else=detection_limit,
        predictable=None
        if mistake
        else predict_remainder(split, steps[-1], generator(study.seed, "flips")),
        candidates=untested.select_tested(study.model.candidates),
        mistake=mistake,
    )
    run = StudyRun(
        study=study,
        robot=split.problem.robot,
        split=split,
        floor=noise,
        models=models,
        diagnosis=explanation,
        uncertainty=uncertainty,
        warnings=tuple(warnings),
        provenance=provenance,
    )
    return Result(order_findings(run))


def compare_candidates(
    study: Study,
    split: Split,
    base: Evaluation,
    diagnosis: Diagnosis,
    candidates: Sequence[Candidate],
) -> SubsetComparison | None:
    """Compare all subsets of the named and the strongest candidates beyond the base.

    None where no registered candidate may extend it.
    """
    named = [effect.candidate for effect in diagnosis.effects]
    count = len(candidates)
    most = study.comparison.mechanisms or MAX_CANDIDATES
    single_f = diagnosis.single_f
    offered, set_aside = choose_strongest(candidates, single_f, named, most)
    if not offered:
        return None
    return compare_subsets(split, base.fit, offered, base.names, set_aside, count)


def find_data_faults(
    study: Study, split: Split, chosen: Evaluation, notes: Sequence[Note]
) -> tuple[Fault, ...]:
    """Return the faults among the outlying rows that no note of the preparation reports already."""
    rng = generator(study.seed, "null")
    faults = find_misplaced_rows(split.problem, split.outliers, chosen.fit, rng)
    return drop_known_faults(faults, notes)


def _measure_loads(
    findings: Sequence[Finding],
    split: Split,
    diagnosis: Diagnosis,
    fitted: Fit,
    parameters: Sequence[Parameter],
) -> tuple[Finding, ...]:
    """Return the findings with the standard uncertainties of the chosen model's parameters, each spring
    under two loads with what it is under each."""
    widened = widen_errors(findings, fitted, parameters)
    return add_payload_springs(widened, split.training, diagnosis.fit)


def widen_errors(
    findings: Sequence[Finding], fitted: Fit, parameters: Sequence[Parameter]
) -> tuple[Finding, ...]:
    """Return the findings with the standard uncertainties of the chosen model's parameters.

    Each is the larger of the least-squares and the bootstrap error. Terms that the chosen model does
    not have keep theirs."""
    larger = {one.symbol: np.fmax(one.standard_error, one.bootstrap_error) for one in parameters}
    labels = label_terms(fitted.model)
    by_term = {
        term.key: larger[label]
        for term, label in zip(fitted.terms, labels, strict=True)
        if label in larger
    }
    widened = []
    for finding in findings:
        effect = finding.effect
        terms = effect.candidate.mechanism.terms
        known = zip(terms, effect.standard_error, strict=True)
        errors = np.array([by_term.get(term.key, error) for term, error in known])
        widened.append(replace(finding, effect=replace(effect, standard_error=errors)))
    return tuple(widened)


def repeat_in_folds(study: Study, split: Split, asked: Inquiry) -> Nested | None:
    """Repeat outlier rejection, diagnosis and fit without each fold; None where no folds are asked for."""
    folds = study.split.nested_folds
    if not folds:
        return None
    asked.say(FOLDS)
    return run_nested_folds(split, asked, folds)


def _adds_named(chosen: Evaluation, steps: Sequence[Evaluation]) -> bool:
    """Return whether the chosen model has all that was named: else what it leaves is known."""
    return chosen.fit is steps[-1].fit


def list_unidentifiable(fitted: Fit) -> tuple[Unidentifiable, ...]:
    """List the combinations of a fitted model's parameters that the data do not determine."""
    found = fitted.found
    terms = fitted.terms
    leaning = fitted.leaning
    return describe_unidentifiable(found, terms, leaning, label_terms(fitted.model))


def assess_uncertainty(study: Study, split: Split, chosen: Evaluation, say: Say) -> Confidence:
    """Assess the chosen model's parameters, and what each of its mechanisms contributes."""
    say(WEIGHING)
    names = chosen.names
    return assess_confidence(split, chosen.fit, names, study.seed)


def sample_posterior(
    result: Result, registry: Registry, say: Say = keep_silent, keeper: Keeper | None = None
) -> Result:
    """Return a result with its chosen model's posterior sampled; as it is where a mistake of the set-up
    comes first.

    `keeper` stores an unfinished chain, from which an interrupted run continues.
    """
    if result.run.diagnosis.mistake is not None:
        return result
    say(SAMPLING)
    study, split = result.study, result.split
    stated = study.noise.floor_mm is not None and split.known_sigma
    log_posterior = build_log_posterior(
        split,
        result.models.chosen.fit,
        result.diagnosis.search.base,
        registry,
        over=study.sampling.over,
        instrument=None if stated else read_instrument(study.noise),
    )
    uncertainty = sample_confidence(
        result.uncertainty, split, log_posterior, study.seed, say, keeper
    )
    return result.with_uncertainty(uncertainty)


def record_provenance(study: Study, robot: Robot, data_sha256: str) -> dict[str, str]:
    """Return versions and hashes of a study, its nominal robot and its data. No path, time or host:
    the same study writes the same bytes."""
    import scipy

    return {
        "modelsel": VERSION,
        "numpy": np.__version__,
        "scipy": scipy.__version__,
        "data_sha256": data_sha256,
        "study_sha256": hashlib.sha256(study.model_dump_json().encode()).hexdigest(),
        "robot_sha256": hash_robot(robot),
    }
