"""The analysis of one study's measurements: outliers, names, ladder, table, gain."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from .._random import generator
from .._typing import Say
from .._version import VERSION
from ..config.study_file import Study
from ..diagnosis.candidates import Candidate, choose_strongest
from ..diagnosis.error_map import build_error_map
from ..diagnosis.outliers import GROSS_THRESHOLD, find_far_rows, misplaced
from ..diagnosis.procedure import diagnose_split, run_nested_folds
from ..diagnosis.state import extend_model
from ..diagnosis.stepwise import Diagnosis
from ..diagnosis.unexplained import (
    count_rows_seen,
    describe_unexplained,
    estimate_floor,
    is_subsampled,
    predict_remainder,
)
from ..fitting.design import Model, whitened
from ..fitting.noise import Floor
from ..fitting.undetermined import describe_unidentifiable
from ..measurements.measurements import Measurements
from ..mechanisms.geometry import build_setup
from ..mechanisms.registry import Registry, mechanism
from ..mechanisms.terms import Mechanism, TermKey
from ..notices import Note
from ..results.cautions import harmful_base_notes, restriction_notes
from ..results.finding_notes import (
    opposed_finding_notes,
    partial_map_notes,
    surprise_notes,
    uneven_noise_notes,
)
from ..results.finding_records import Finding
from ..results.goodness_of_fit import lack_of_fit_notes, measure_lack_of_fit
from ..results.study_run import Explanation, ModelSearch, StudyRun
from ..robot.kinematics import Robot
from ..selection.comparison import MAX_CANDIDATES, SubsetComparison, compare_subsets
from ..selection.evaluation import (
    Evaluation,
    Gain,
    RowResampling,
    Split,
    bootstrap_gain,
    evaluate,
    summarise_errors,
)
from ..uncertainty.sampler import Keeper
from ..uncertainty.summary import assess_confidence, build_log_posterior, sample_confidence
from .checks import believed, outcome, told_with, turns_believed, unsaid
from .preparation import Plan, prepare, reweigh_rotation
from .result import Result


@dataclass(frozen=True, eq=False)
class Question:
    """What a study asks: its file, its set-up, the nominal robot, the mechanisms that may extend
    the base, the registry."""

    study: Study
    plan: Plan
    robot: Robot
    everything: tuple[Mechanism, ...]
    registry: Registry

    def model(
        self,
        names: Sequence[str],
        measured: Measurements,
        best: Mapping[str, Mechanism] | None = None,
    ) -> Model:
        """The mechanisms of a rung, with what the set-up leaves open; `best` says which constant a
        scanned name stands for."""
        groups = len(measured.groups) if self.plan.per_group else 1
        features = () if measured.gauges is None else measured.gauges.features
        placement = build_setup(
            self.robot,
            len(measured.targets),
            groups,
            self.plan.register,
            measured.rotation is not None,
            features,
        )
        return Model(
            (
                *((placement,) if placement.terms else ()),
                *((best or {}).get(n) or mechanism(n, self.robot, self.registry) for n in names),
            )
        )

    @property
    def cells(self) -> bool:
        """Whether causes nobody registered may be named, too; with `candidates = []` everything is
        said, nothing extended."""
        return self.study.model.candidates in ("all", [])


def analyse(
    question: Question,
    measured: Measurements,
    *,
    labels: NDArray[np.object_] | None = None,
    say: Say = lambda _: None,
    data_sha256: str = "",
) -> Result:
    """The study of measurements already read. Raises StudyError, DataError or NotEstimable."""
    plan = question.plan
    say("registering and splitting" if plan.register else "splitting")
    data, floor, notes = prepare(question.robot, measured, plan, labels)
    with told_with(notes):
        return _analysed(question, data, floor, notes, say, data_sha256)


def _analysed(
    question: Question,
    split: Split,
    floor: Floor | None,
    notes: tuple[Note, ...],
    say: Say,
    data_sha256: str,
) -> Result:
    """The study of data that are registered, weighed and split."""
    study, plan = question.study, question.plan
    measured = split.problem.data  # without the rows that nothing can be said of
    base, base_names = question.model(study.model.base, measured), tuple(study.model.base)
    split = _weighed(question, split, base)
    say("looking for outliers")
    split, extension, found = diagnose_split(
        split, base, question.everything, study.seed, question.cells, say
    )
    split, floor, doubts = believed(split, floor, extension.fit)
    nominal, base_rung = (
        evaluate(split, question.model((), measured), ("nominal",)),
        evaluate(split, base, base_names),
    )
    if is_subsampled(extension, split):
        notes = (
            *notes,
            Note(
                "scan-of-some",
                f"What is wrong was looked for in {count_rows_seen(extension, split)} of "
                f"the {int(split.used.sum())} estimation rows, drawn by the seed; every fit, error and gain is of "
                "all rows.",
            ),
        )
    notes = (
        *notes,
        *restriction_notes(study.model.candidates),
        *doubts,
        *turns_believed(split, extension.fit),
        *uneven_noise_notes(extension),
        *(partial_map_notes(split.problem) if question.cells else ()),
    )
    say("comparing all subsets of the candidates")
    offered, aside = choose_strongest(
        found,
        extension.single_f,
        [e.candidate for e in extension.effects],
        study.comparison.mechanisms or MAX_CANDIDATES,
    )
    comparison = (
        compare_subsets(split, base_rung.fit, offered, base_names, aside, len(found))
        if offered
        else None
    )
    say("measuring the gain")
    steps = _steps(split, base_rung, extension)
    rungs = [
        nominal,
        *_ladder(question, split, measured, base_rung, best_constants(found, extension.single_f)),
    ]
    rungs += [
        r
        for r in (steps if study.model.candidates != [] else steps[:1])
        if _same(r) not in [_same(x) for x in rungs]
    ]
    chosen = steps[-1] if study.model.candidates != [] else base_rung
    rungs = [
        *(r for r in rungs if r is not chosen and (_same(r) != _same(chosen) or r is nominal)),
        chosen,
    ]

    split = replace(
        split,
        outlying=split.outlying | held_out_outliers(split, [r for r in rungs if r is not nominal]),
    )
    faults = unsaid(
        misplaced(split.problem, split.outlying, chosen.fit, generator(study.seed, "null")), notes
    )
    held = ~split.estimation & ~split.outlying
    drawn = RowResampling.prepare(measured.block[held], generator(study.seed, "gain"))

    def gained(before: Evaluation, after: Evaluation) -> Gain:
        return bootstrap_gain(before.residual[held][:, :3], after.residual[held][:, :3], drawn)

    findings = tuple(
        Finding(e, gained(a, b))
        for e, a, b in zip(extension.effects, steps, steps[1:], strict=False)
    )
    notes = (
        *notes,
        *_of_table(comparison, chosen),
        *harmful_base_notes(base_names, gained(nominal, base_rung)),
        *opposed_finding_notes(findings),
        *surprise_notes(split, chosen),
    )
    if not doubts:  # else that is said, and by how much
        notes = (
            *notes,
            *lack_of_fit_notes(
                measure_lack_of_fit(chosen, floor, split),
                floor is not None and np.isinf(floor.freedom),
            ),
        )
    within = None
    if study.split.nested_folds:
        say(f"the whole procedure again in {study.split.nested_folds} folds")
        within = run_nested_folds(
            split, base, question.everything, study.seed, question.cells, study.split.nested_folds
        )
    ladder = tuple(remeasured(r, split) for r in rungs)
    if lost := [
        " + ".join(r.names) for r in ladder if r.cv_rms_mm is None or not np.isfinite(r.cv_rms_mm)
    ]:
        notes = (
            *notes,
            Note(
                "cv-not-estimable",
                f"No cross-validation of {', '.join(lost)}: without one of the folds the data "
                "do not determine it, and its cv_rms_mm is null. More folds or configurations are needed.",
            ),
        )
    say("weighing every mechanism of the chosen model")
    sure = assess_confidence(split, chosen.fit, chosen.names, study.seed)
    noise, nothing = (
        per_row(floor or estimate_floor(chosen, split), split),
        describe_unexplained(extension, found, split, steps[-1]),
    )
    notes = outcome(
        split,
        remeasured(chosen, split),
        noise,
        nothing[1],
        notes,
        plan.per_group if plan.register else None,
        faults,
    )
    untold = describe_unidentifiable(chosen.fit.found, chosen.fit.terms, chosen.fit.leaning)
    chosen = remeasured(chosen, split)
    models = ModelSearch(ladder, comparison, chosen, gained(nominal, chosen), within, untold)
    diagnosis = Explanation(
        findings,
        faults,
        extension,
        build_error_map(extension, found),
        nothing,
        predict_remainder(split, steps[-1], generator(study.seed, "flips")),
    )
    run = StudyRun(
        study,
        question.robot,
        split,
        noise,
        models,
        diagnosis,
        sure,
        notes,
        provenance(study, data_sha256),
    )
    return Result(run)


def _of_table(comparison: SubsetComparison | None, chosen: Evaluation) -> tuple[Note, ...]:
    """Where the table of subsets chooses otherwise, and where its best is not proven."""
    out: list[Note] = []
    if comparison is not None and set(comparison.choice) != set(chosen.names):
        out.append(
            Note(
                "table-differs",
                "The one-standard-error choice of the table of subsets is "
                f"{' + '.join(comparison.choice)}; the chosen model follows what was named.",
            )
        )
    if (
        comparison is not None
        and comparison.certified is not None
        and not comparison.certified.proven
    ):
        out.append(
            Note(
                "search-unproven",
                f"Of 2^{len(comparison.considered)} subsets of the candidates the best by BIC "
                f"that was found is not proven: another may have up to {comparison.certified.gap:.3g} less.",
            )
        )
    return tuple(out)


def with_sampling(
    question: Question, result: Result, say: Say = lambda _: None, keeper: Keeper | None = None
) -> Result:
    """A result with its chosen model's posterior sampled."""
    plan, study, measured = question.plan, question.study, result.problem.data
    stated = plan.stated_mm is not None and result.split.known_sigma
    log_posterior = build_log_posterior(
        result.split,
        result.models.chosen.fit,
        question.model(study.model.base, measured),
        question.registry,
        over=study.sampling.over,
        instrument=None if stated else plan.instrument,
    )
    confidence = sample_confidence(
        result.uncertainty, result.split, log_posterior, study.seed, say, keeper
    )
    return result.with_uncertainty(confidence)


def _weighed(question: Question, split: Split, base: Model) -> Split:
    """With orientations of unstated uncertainty: rotational rows weighed by their own residuals,
    nominal then base."""
    if split.problem.data.rotation is not None:
        for model in (question.model((), split.problem.data), base):
            split = reweigh_rotation(split, question.plan, evaluate(split, model, ()).residual)
    return split


def _same(r: Evaluation) -> tuple[tuple[str, ...], frozenset[TermKey]]:
    """What makes two rungs one: their names and what these stand for."""
    return r.names, frozenset(t.key for t in r.fit.terms)


def best_constants(
    found: Sequence[Candidate], single_f: NDArray[np.float64]
) -> dict[str, Mechanism]:
    """Of every registered name with several constants, the one that alone explains most beyond the
    base."""
    best: dict[str, tuple[float, Mechanism]] = {}
    count: dict[str, int] = {}
    for candidate, f in zip(found, single_f, strict=True):
        if candidate.registered:
            name = candidate.mechanism.name
            count[name] = count.get(name, 0) + 1
            if name not in best or f > best[name][0]:
                best[name] = (float(f), candidate.mechanism)
    return {name: m for name, (_, m) in best.items() if count[name] > 1}


def _ladder(
    question: Question,
    split: Split,
    measured: Measurements,
    base_rung: Evaluation,
    best: Mapping[str, Mechanism],
) -> list[Evaluation]:
    """The study's own rungs, or the base."""
    return [
        base_rung
        if tuple(names) == base_rung.names
        else evaluate(split, question.model(names, measured, best), names)
        for names in question.study.model.ladder or [list(base_rung.names)]
    ]


def _steps(split: Split, base_rung: Evaluation, diagnosis: Diagnosis) -> list[Evaluation]:
    """From the base, a rung to every effect, in the order they were found."""
    steps = [base_rung]
    for k in range(1, len(diagnosis.effects) + 1):
        so_far = [e.candidate for e in diagnosis.effects[:k]]
        names = (*base_rung.names, *(c.label for c in so_far))
        last = (
            diagnosis.fit
            if k == len(diagnosis.effects) and not is_subsampled(diagnosis, split)
            else None
        )
        steps.append(
            evaluate(split, extend_model(diagnosis.base, so_far), names, last, start=steps[-1].fit)
        )
    return steps


def provenance(study: Study, data_sha256: str) -> dict[str, str]:
    """Versions and hashes; no path, time or host."""
    import scipy

    return {
        "modelsel": VERSION,
        "numpy": np.__version__,
        "scipy": scipy.__version__,
        "data_sha256": data_sha256,
        "study_sha256": hashlib.sha256(study.model_dump_json().encode()).hexdigest(),
    }


def held_out_outliers(split: Split, rungs: Sequence[Evaluation]) -> NDArray[np.bool_]:
    """Held-out rows beyond 8 robust standard deviations of the estimation residuals in every rung
    from the base on."""
    out = ~split.estimation
    for r in rungs:
        size = whitened(split.problem, r.residual)
        out = out & find_far_rows(
            size,
            size[split.used],
            GROSS_THRESHOLD,
            None if split.problem.measured is None else split.problem.measured[split.used],
        )
    return np.asarray(out)


def remeasured(r: Evaluation, split: Split) -> Evaluation:
    """A rung with its errors taken again, the outlying rows left out."""
    return replace(
        r,
        estimation=summarise_errors(r.residual[split.estimation], split.outlying[split.estimation]),
        held_out=summarise_errors(r.residual[~split.estimation], split.outlying[~split.estimation]),
    )


def per_row(floor: Floor, split: Split) -> Floor:
    """With the number of coordinates that a row has."""
    seen = split.problem.measured
    return floor if seen is None else replace(floor, coordinates=float(seen[:, :3].sum(1).mean()))
