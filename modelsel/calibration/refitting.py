"""The best robot that a form can carry: what it has no place for is left out, and the rest fitted
to the same rows without it.

A geometry fitted beside other effects is the geometry of an arm without them, which nobody has:
alone it may be worse than the drawing. A refit that does not predict better than something simpler,
by cross-validation, gives way to it. What the instrument measures wrongly is no effect of the arm: no
form carries it, and it is taken off the measurements before anything is fitted to them. Nor is it an
effect of the arm that instrument and base moved against each other: a form that has no place for that
has the arm beside which it was fitted."""

from __future__ import annotations

from collections.abc import Callable, Collection, Hashable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from .._typing import Array, Mask
from ..exceptions import NotEstimable
from ..fitting.design import Model, residuals
from ..fitting.least_squares import Fit
from ..measurements.campaign.late_names import list_sources
from ..measurements.campaign.reference_temperature import TEMPERATURE
from ..measurements.gauges import Gauges
from ..mechanisms.environment import INSTRUMENT_MOVES
from ..mechanisms.geometry import SETUP
from ..mechanisms.terms import Term, TermKey
from ..selection.evaluation import Evaluation, Split, evaluate, summarise_errors
from .arm_alone import list_misreadings
from .calibration_schema import RefitRecord, RefitsRecord
from .known_names import LABEL_NAMES

MAX_TABLE_NAMES = 2  # values of the state that a table may hang on
NESTED_FORMS = (
    "nominal",
    "geometry",
    "table",
)  # each carries what the one before it does, and more


@dataclass(frozen=True, eq=False)
class Refit:
    """Some of a calibration's terms fitted alone: `terms` (k,) their places among the
    calibration's, theta (k,) in their units; rms lengths of what is left [mm] on the rows that fit,
    and held out (None where nothing is)."""

    terms: tuple[int, ...]
    theta: Array
    estimation_rms_mm: float | None
    held_out_rms_mm: float | None


@dataclass(frozen=True, eq=False)
class Refits:
    """`alone`: the refit of "nominal" (the set-up alone), of "geometry" (what is constant) and of
    "table" (what hangs on two values at most as well); one is missing where it is the whole model,
    or the data do not determine it. `whole`: rms lengths left by the whole model, as in Refit.
    `mean_celsius` of the rows that fit, where the model looks at it; `corrected`: whether errors of the
    instrument were taken off the measurements first."""

    alone: Mapping[str, Refit]
    whole: tuple[float | None, float | None]
    mean_celsius: float | None
    corrected: bool = False

    def nominal(self, form: str) -> bool:
        """Whether the best robot that a form can carry is the nominal one."""
        nominal = self.alone.get("nominal")
        carried = self.alone.get(form)
        if nominal is None or carried is None:
            return False
        return nominal.terms == carried.terms

    def errors(self, form: str) -> tuple[str, float, float, float] | None:
        """Return which rows, and the rms [mm] of the nominal arm, of what is carried ("whole":
        everything), of the whole model; None where one of them is not known."""
        held_out = {}
        estimation = {}
        for name, refit in self.alone.items():
            held_out[name] = refit.held_out_rms_mm
            estimation[name] = refit.estimation_rms_mm
        estimation["whole"], held_out["whole"] = self.whole
        if "nominal" not in held_out or form not in held_out:
            return None
        sides = ((held_out, "held out"), (estimation, "on the rows that were fitted"))
        for rms, rows in sides:
            nominal = rms["nominal"]
            own = rms[form]
            whole = rms["whole"]
            if nominal is not None and own is not None and whole is not None:
                return rows, nominal, own, whole
        return None


def is_constant(term: Term) -> bool:
    """Whether a term is part of the geometry: it does not change with the state."""
    names = set[str]()
    for screw in term.screws:
        names |= screw.cause.names()
    return names <= LABEL_NAMES


def is_tabled(term: Term) -> bool:
    """Whether a table can hold a term: each of its screws hangs on two values at most."""
    for screw in term.screws:
        names = screw.cause.names()
        values = names - LABEL_NAMES
        if len(values) > MAX_TABLE_NAMES:
            return False
    return True


def select_carried(model: Model, form: str) -> Callable[[Term], bool]:
    """Select what a form carries: whether "nominal", "geometry", "table" or "whole" has a term; none
    has an error of the instrument."""
    of_instrument = list_misreadings(model)
    setting = set[Hashable]()
    for mechanism in model.mechanisms:
        if mechanism.name == SETUP:
            setting.update(term.key for term in mechanism.terms)
    rules: dict[str, Callable[[Term], bool]] = {
        "nominal": lambda term: term.key in setting,
        "geometry": is_constant,
        "table": is_tabled,
        "whole": lambda term: True,
    }
    rule = rules[form]
    return lambda term: rule(term) and term.key not in of_instrument


def part_of(model: Model, keep: Callable[[Term], bool]) -> Model:
    """Return a model of some of its terms, in the same order."""
    mechanisms = []
    for mechanism in model.mechanisms:
        terms = tuple(filter(keep, mechanism.terms))
        if terms:
            own = replace(mechanism, terms=terms)
            mechanisms.append(own)
    return Model(tuple(mechanisms))


def refit_forms(split: Split, fitted: Fit, known: Sequence[Evaluation] = ()) -> Refits:
    """Refit a model that was fitted to a study's rows, for every form; models that stand among the
    `known` are not fitted again."""
    of_arm = [term for term in fitted.terms if not term.fixture]
    place = {term.key: k for k, term in enumerate(of_arm)}
    left = fitted.residuals(split.problem)
    corrected = bool(list_misreadings(fitted.model))
    if corrected:
        known = ()
        split = correct_measurements(split, fitted)
    arm = part_of(fitted.model, select_carried(fitted.model, "whole"))
    own = dict[frozenset[TermKey], Evaluation]()
    for evaluation in known:
        keys = frozenset(term.key for term in evaluation.fit.terms)
        own[keys] = evaluation
    moves = list_moves(fitted.model)
    best: Evaluation | None = None
    alone = dict[str, Refit]()
    for form in NESTED_FORMS:
        carries = select_carried(fitted.model, form)
        carried = part_of(fitted.model, carries)
        is_whole = len(carried.terms) == len(arm.terms)
        if is_whole and form != "nominal":
            break
        own_keys = {term.key for term in carried.terms}
        keys = frozenset(own_keys | moves)
        model = _part_with(fitted.model, keys)
        try:
            made = own.get(keys) or evaluate(split, model, model.names, start=fitted)
        except NotEstimable:
            continue
        if best is None or _cross_validation_error(made) <= _cross_validation_error(best):
            best = made
        alone[form] = _select_refit(best, own_keys, place)
    whole = _summarise_sides(split, left)
    mean_celsius = _find_mean_temperature(split, fitted.model)
    return Refits(alone, whole, mean_celsius, corrected)


def _summarise_sides(split: Split, left: Array) -> tuple[float | None, float | None]:
    """Summarise residuals (m, c) on either side of a split: rms [mm] of estimation, held out."""
    inside = split.estimation
    outside = ~inside
    outlying = split.outlying
    estimation = summarise_errors(left[inside], outlying[inside])
    held_out = summarise_errors(left[outside], outlying[outside])
    fitted_mm = estimation.rms_mm
    held_out_mm = held_out.rms_mm
    return fitted_mm, held_out_mm


def _find_mean_temperature(split: Split, model: Model) -> float | None:
    """Find the mean temperature of the rows that fit; None where a model does not look at it."""
    named = [list_sources(mechanism.names()) for mechanism in model.mechanisms]
    if not any(TEMPERATURE in names for names in named):
        return None
    data = split.problem.data
    warm = data.covariates.get(TEMPERATURE)
    if warm is None:
        return None
    used = warm[split.used]
    return float(used.mean())


def _part_with(model: Model, keys: Collection[Hashable]) -> Model:
    """Return a model of the terms with some keys, in the same order."""
    return part_of(model, lambda term: term.key in keys)


def list_moves(model: Model) -> set[TermKey]:
    """List the keys of the terms by which the instrument and the base move against each other."""
    return {
        term.key
        for mechanism in model.mechanisms
        if mechanism.name in INSTRUMENT_MOVES
        for term in mechanism.terms
    }


def _select_refit(
    made: Evaluation, carried: Collection[TermKey], place: Mapping[TermKey, int]
) -> Refit:
    """Select the terms of an evaluated model that a form carries; `place` has theirs in the
    calibration."""
    estimates = {}
    for term, value in zip(made.fit.terms, made.fit.theta.tolist(), strict=True):
        if term.key in carried and not term.fixture:
            estimates[place[term.key]] = value
    places = sorted(estimates)
    theta = np.array([estimates[k] for k in places])
    return Refit(tuple(places), theta, made.estimation.rms_mm, made.held_out.rms_mm)


def correct_measurements(split: Split, fitted: Fit) -> Split:
    """Take what the instrument measured wrongly, as a model has it, off the measurements. Rows whose
    reading is none, but zero, have nothing that it could be taken off: they are left out."""
    problem = split.problem.unweighted()
    arm = select_carried(fitted.model, "whole")
    theta = [
        value if arm(term) else 0.0 for term, value in zip(fitted.terms, fitted.theta, strict=True)
    ]
    without = residuals(problem, fitted.terms, np.array(theta))
    shift = without[:, :3] - residuals(problem, fitted.terms, fitted.theta)[:, :3]
    data = problem.data
    gauges = data.gauges
    outlying = split.outlying
    if gauges is not None:
        outlying = outlying | _find_zero_readings(gauges)
        is_length = gauges.of("wire", "ball-bar", "distance")
        length = np.where(is_length, gauges.length - shift[:, 0], gauges.length)
        gauges = replace(gauges, length=length)
        shift[is_length] = 0.0
    corrected = replace(data, position=data.position - shift, gauges=gauges)
    problem = replace(split.problem, data=corrected)
    folds = np.where(outlying, -1, split.folds)
    return replace(split, problem=problem, outlying=outlying, folds=folds)


def _find_zero_readings(gauges: Gauges) -> Mask:
    """Mask (m,) the rows that read zero by what they are: touched planes and points, and bars whose
    length is not known."""
    is_bar = gauges.of("ball-bar")
    length = gauges.length
    has_none = np.isnan(length)
    is_open = is_bar & has_none
    is_touched = gauges.of("plane", "same-point")
    return np.asarray(is_open | is_touched)


def _cross_validation_error(made: Evaluation) -> float:
    error = made.cv_rms_mm
    if error is None:
        return np.inf
    if not np.isfinite(error):
        return np.inf
    return error


# -- in the file
# ---------------------------------------------------------------------------------------------------------------


def refits_record(refits: Refits, symbols: Sequence[str]) -> dict[str, Any]:
    """Return refits as JSON values; `symbols` of the calibration's terms."""
    return {
        "says": "terms that a form can carry, fitted without the others; rms lengths of what is left",
        "whole": {"estimation_rms_mm": refits.whole[0], "held_out_rms_mm": refits.whole[1]},
        "temperature_C": refits.mean_celsius,
        **({"corrected": True} if refits.corrected else {}),
        "alone": {
            form: {
                "estimates": [
                    {"term": k, "symbol": symbols[k], "value": float(v)}
                    for k, v in zip(r.terms, r.theta, strict=True)
                ],
                "estimation_rms_mm": r.estimation_rms_mm,
                "held_out_rms_mm": r.held_out_rms_mm,
            }
            for form, r in refits.alone.items()
        },
    }


def refits_of(record: RefitsRecord, model: Model) -> Refits | None:
    """Return the refits of a record; None where an earlier version fitted them to what an instrument
    measured wrongly. Raises ValueError where they are not of the model's terms."""
    if list_misreadings(model) and not record.corrected:
        return None
    alone = {}
    for form, stored in record.alone.items():
        alone[form] = _restore_refit(form, stored, model)
    whole = record.whole
    errors = (whole.estimation_rms_mm, whole.held_out_rms_mm)
    return Refits(alone, errors, record.mean_celsius, record.corrected)


def _restore_refit(form: str, record: RefitRecord, model: Model) -> Refit:
    estimates = record.estimates
    places = [estimate.term for estimate in estimates]
    distinct = set(places)
    count = len(model.terms)
    known = form in NESTED_FORMS
    belongs = distinct <= set(range(count))
    ordered = places == sorted(distinct)
    if not known or not belongs or not ordered:
        raise ValueError(f"what its refits carry alone ({form}) is not of its terms")
    carries = select_carried(model, form)
    terms = [model.terms[place] for place in places]
    stored = [estimate.symbol for estimate in estimates]
    symbols = [term.symbol for term in terms]
    if stored != symbols or not all(map(carries, terms)):
        raise ValueError(f"what its refits carry alone ({form}) are other terms")
    values = [estimate.value for estimate in estimates]
    return Refit(tuple(places), np.array(values), record.estimation_rms_mm, record.held_out_rms_mm)
