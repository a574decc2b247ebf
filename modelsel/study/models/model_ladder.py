"""Build and evaluate the models of a study's ladder, from the nominal arm to the chosen model."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

from ..._typing import Array
from ...config.study_file import Study
from ...diagnosis.candidates.candidate import Candidate
from ...diagnosis.chosen_moments import choose_step_moments, list_scanned_steps
from ...diagnosis.findings.outcome import Diagnosis
from ...diagnosis.search.state import extend_model
from ...diagnosis.unexplained import is_subsampled
from ...fitting.design import Model
from ...fitting.least_squares import fit
from ...fitting.nested import Reduced, fit_within
from ...fitting.problem import Problem
from ...mechanisms.campaign_registry import set_targets
from ...mechanisms.geometry import build_setup
from ...mechanisms.registry import Registry, mechanism
from ...mechanisms.target_names import number_targets
from ...mechanisms.terms import FixtureTerm, Mechanism, Screw
from ...notices import Note
from ...selection.evaluation import Evaluation, Split, evaluate, summarise_errors
from ..preparation.checks import add_alarms_to_errors
from ..preparation.own_causes import build_own_mechanisms
from .untested_candidates import refuse_unseen, require_causes

SAME = 1 - 1e-9  # share of the largest F from which rounding may be what is left of it
NOMINAL = ("nominal",)  # names of the model without any mechanism


def extends_base(study: Study) -> bool:
    """Return whether anything may extend the base; with `candidates = []` nothing does."""
    candidates = study.model.candidates
    return candidates != []


def searches_cells(study: Study) -> bool:
    """Return whether causes outside the registry may be named, too.

    With `candidates = []` everything is named, although nothing extends the base.
    """
    candidates = study.model.candidates
    return candidates in ("all", [])


def build_model(
    study: Study,
    problem: Problem,
    registry: Registry,
    names: Sequence[str],
    constants: Mapping[str, Mechanism] | None = None,
) -> Model:
    """Return the model of some mechanisms, with the set-up parameters that are left open.

    `constants` gives the mechanism of a name whose constant is scanned, where it is chosen already.
    Raises StudyError where the data lack what one of them depends on.
    """
    data = problem.data
    refuse_unseen(names, problem, registry)
    registry = set_targets(registry, data.targets, data.listed_targets)
    placements = len(data.groups) if study.robot.per_group else 1
    placement = build_setup(
        problem.robot,
        len(data.targets),
        placements,
        bool(study.robot.register_),
        data.rotation is not None,
        () if data.gauges is None else data.gauges.features,
        number_targets(data.targets, data.listed_targets),
    )
    chosen = build_own_mechanisms(study, problem)
    chosen.update(constants or {})
    robot = problem.robot
    mechanisms = [placement] if placement.terms else []
    mechanisms += [chosen.get(name) or mechanism(name, robot, registry) for name in names]
    require_causes(problem, mechanisms)
    return Model(tuple(mechanisms))


def build_nominal(study: Study, problem: Problem, registry: Registry) -> Model:
    """Return the nominal model: what registration left open, where the study asks for it.

    Else the targets are where the study says they are, and only what is not known of the features
    that rows share is fitted: without it these rows could not be predicted."""
    model = build_model(study, problem, registry, ())
    if study.robot.register_:
        return model
    mechanisms = []
    for setup in model.mechanisms:
        of_features = tuple(term for term in setup.terms if isinstance(term, FixtureTerm))
        if of_features:
            kept = replace(setup, terms=of_features)
            mechanisms.append(kept)
    return Model(tuple(mechanisms))


def build_base(study: Study, split: Split, registry: Registry) -> Model:
    """Return the model that the study extends. Raises StudyError where the data lack what it, or a
    model of the study's ladder, depends on: nothing was computed by then."""
    problem = split.problem
    asked = study.model
    for names in asked.ladder:
        build_model(study, problem, registry, names)
    base = asked.base
    moments = choose_moments(study, split, registry, base)
    return build_model(study, problem, registry, base, moments)


def choose_moments(
    study: Study,
    split: Split,
    registry: Registry,
    names: Sequence[str],
    constants: Mapping[str, Mechanism] | None = None,
) -> dict[str, Mechanism]:
    """Choose the moments of the steps of a model that are named without one: those that fit the
    estimation rows best. `constants`: the mechanisms of names that are chosen already, which come
    back, too. Raises StudyError where no estimation row measures a target of theirs."""
    problem = split.problem
    refuse_unseen(names, problem, registry)
    data = problem.data
    registry = set_targets(registry, data.targets, data.listed_targets)
    known = dict(constants or {})
    own = build_own_mechanisms(study, problem)
    steps = {}
    for name in names:
        if name not in known and name not in own:
            listed = list_scanned_steps(name, problem.robot, registry)
            if listed:
                steps[name] = listed
    if not steps:
        return known
    rest = [name for name in names if name not in steps]
    others = build_model(study, problem, registry, rest, known)
    chosen = choose_step_moments(problem.as_stated(), split.used, others, steps)
    return known | chosen


def rehearse_base(study: Study, split: Split, notes: Sequence[Note], registry: Registry) -> Model:
    """Return the model that the study extends, which its rows carry. Raises StudyError or
    NotEstimable as the study's first fit does; `notes` are those of the preparation."""
    base = build_base(study, split, registry)
    training = split.training
    # every row has one coordinate or more: where they are many, there are enough
    if len(training) <= len(base.terms):
        with add_alarms_to_errors(notes):
            fit(training, base)
    return base


def choose_constants(candidates: Sequence[Candidate], single_f: Array) -> dict[str, Mechanism]:
    """Return the best mechanism of every registered name that has several constants.

    Best is the largest F (`single_f`, one per candidate) of the mechanism alone beyond the base, the
    first of those that differ by rounding.
    """
    variants: dict[str, list[int]] = {}
    for k, candidate in enumerate(candidates):
        if candidate.registered:
            name = candidate.mechanism.name
            numbers = variants.setdefault(name, [])
            numbers.append(k)
    best = {}
    for name, numbers in variants.items():
        if len(numbers) < 2:
            continue
        largest = max(single_f[k] for k in numbers)
        strongest = next(k for k in numbers if single_f[k] >= SAME * largest)
        candidate = candidates[strongest]
        best[name] = candidate.mechanism
    return best


def evaluate_effects(split: Split, base: Evaluation, diagnosis: Diagnosis) -> list[Evaluation]:
    """Evaluate the base and one further model for each effect, the largest first.

    The model of all effects is fitted first: where very many rows were reduced for it, the others are
    fitted from that reduction."""
    effects = [effect.candidate for effect in diagnosis.effects]
    if not effects:
        return [base]
    labels = [effect.label for effect in diagnosis.effects]
    whole = diagnosis.model
    is_whole = not is_subsampled(diagnosis, split)
    fitted = diagnosis.fit if is_whole else None
    last = evaluate(split, whole, (*base.names, *labels), fitted, start=diagnosis.fit)
    reduced = None
    if last.fit.reduction.parts:
        reduced = Reduced.by(last.fit, split.folded)
    steps = [base]
    for count in range(1, len(effects)):
        model = extend_model(diagnosis.base, effects[:count])
        names = (*base.names, *labels[:count])
        fitted = None
        if reduced is not None:
            fitted = fit_within(split.training, model, reduced, "all")
        start = steps[-1].fit
        step = evaluate(split, model, names, fitted, start=start)
        steps.append(step)
    return [*steps, last]


def evaluate_ladder(
    study: Study,
    split: Split,
    registry: Registry,
    steps: Sequence[Evaluation],
    constants: Mapping[str, Mechanism],
) -> list[Evaluation]:
    """Evaluate the models of the ladder: the nominal arm, the study's own models, the steps.

    The study's own models are those of its `model.ladder`, else the base. The chosen model is the
    last step, or the base where nothing may extend it. It comes last, and no other model of the
    ladder equals it, unless the nominal one does.
    """
    base = steps[0]
    problem = split.problem
    nominal_model = build_nominal(study, problem, registry)
    nominal = evaluate(split, nominal_model, NOMINAL)
    ladder = [nominal]
    own_rungs = study.model.ladder
    rungs = own_rungs or [list(base.names)]
    for names in rungs:
        if tuple(names) == base.names:
            ladder.append(base)
            continue
        known = choose_moments(study, split, registry, names, constants)
        model = build_model(study, problem, registry, names, known)
        step = evaluate(split, model, names)
        ladder.append(step)

    usable_steps = steps
    if not extends_base(study):
        usable_steps = [base]
    present = [_identify(model) for model in ladder]
    ladder += [step for step in usable_steps if _identify(step) not in present]

    chosen = usable_steps[-1]
    identity = _identify(chosen)
    others = [model for model in ladder[1:] if _identify(model) != identity]
    return [nominal, *others, chosen]


def _identify(evaluation: Evaluation) -> tuple[tuple[str, ...], frozenset[tuple[Screw, ...]]]:
    """Return what makes two models of a ladder the same: their names and what these stand for."""
    terms = evaluation.fit.terms
    screws = frozenset(term.screws for term in terms)
    names = evaluation.names
    return names, screws


def remeasure(evaluation: Evaluation, split: Split) -> Evaluation:
    """Return an evaluation with its errors computed again without the split's outlying rows."""
    residual = evaluation.residual
    estimation, outlying = split.estimation, split.outlying
    held_out = ~estimation
    return replace(
        evaluation,
        estimation=summarise_errors(residual[estimation], outlying[estimation]),
        held_out=summarise_errors(residual[held_out], outlying[held_out]),
    )
