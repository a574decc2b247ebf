"""The best robot that a form can carry: what it has no place for is left out, and the rest fitted
to the same rows without it.

A geometry fitted beside other effects is the geometry of an arm without them, which nobody has:
alone it may be worse than the drawing. A refit that does not predict better than something simpler,
by cross-validation, gives way to it."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from .._typing import Array
from ..exceptions import NotEstimable
from ..fitting.design import Model
from ..fitting.least_squares import Fit
from ..measurements.reference_temperature import TEMPERATURE
from ..mechanisms.geometry import SETUP
from ..mechanisms.terms import Term
from ..selection.evaluation import Evaluation, Split, evaluate, summarise_errors
from .schema import RefitRecord, RefitsRecord

PLACEMENT_NAMES = frozenset(
    ("target", "group", "feature")
)  # names that are fixed where a robot description is written
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
    `mean_celsius` of the rows that fit, where the model looks at it."""

    alone: Mapping[str, Refit]
    whole: tuple[float | None, float | None]
    mean_celsius: float | None

    def nominal(self, form: str) -> bool:
        """Whether the best robot that a form can carry is the nominal one."""
        some = [self.alone[name].terms for name in ("nominal", form) if name in self.alone]
        return len(some) == 2 and some[0] == some[1]

    def errors(self, form: str) -> tuple[str, float, float, float] | None:
        """(which rows, rms [mm] of the nominal arm, of what is carried ("whole": everything), of
        the whole model); None where one of them is not known."""
        some = {
            name: (r.estimation_rms_mm, r.held_out_rms_mm) for name, r in self.alone.items()
        } | {"whole": self.whole}
        if "nominal" not in some or form not in some:
            return None
        for side, rows in ((1, "held out"), (0, "on the rows that were fitted")):
            nominal, own, whole = (some[name][side] for name in ("nominal", form, "whole"))
            if nominal is not None and own is not None and whole is not None:
                return rows, nominal, own, whole
        return None


def is_constant(term: Term) -> bool:
    """Whether a term is part of the geometry: it does not change with the state."""
    return all(s.cause.names() <= PLACEMENT_NAMES for s in term.screws)


def is_tabled(term: Term) -> bool:
    """Whether a table can hold a term: each of its screws hangs on two values at most."""
    return all(len(s.cause.names() - PLACEMENT_NAMES) <= MAX_TABLE_NAMES for s in term.screws)


def select_carried(model: Model, form: str) -> Callable[[Term], bool]:
    """Whether "nominal", "geometry", "table" or "whole" carries a term of a model."""
    setting = {t.key for m in model.mechanisms if m.name == SETUP for t in m.terms}
    rules: dict[str, Callable[[Term], bool]] = {
        "nominal": lambda t: t.key in setting,
        "geometry": is_constant,
        "table": is_tabled,
        "whole": lambda t: True,
    }
    return rules[form]


def part_of(model: Model, keep: Callable[[Term], bool]) -> Model:
    """A model of some of its terms, in the same order."""
    own = (replace(m, terms=tuple(t for t in m.terms if keep(t))) for m in model.mechanisms)
    return Model(tuple(m for m in own if m.terms))


def refit_forms(split: Split, fitted: Fit, known: Sequence[Evaluation] = ()) -> Refits:
    """The refits of a model that was fitted to a study's rows; models that stand among the `known`
    are not fitted again."""
    place = {t.key: k for k, t in enumerate(t for t in fitted.terms if not t.fixture)}
    own = {frozenset(t.key for t in r.fit.terms): r for r in known}
    best: Evaluation | None = None
    alone = dict[str, Refit]()
    for form in NESTED_FORMS:
        model = part_of(fitted.model, select_carried(fitted.model, form))
        if len(model.terms) == len(fitted.terms) and form != "nominal":
            break
        try:
            made = own.get(frozenset(t.key for t in model.terms)) or evaluate(
                split, model, model.names, start=fitted
            )
        except NotEstimable:
            continue
        best = (
            made
            if best is None or _cross_validation_error(made) <= _cross_validation_error(best)
            else best
        )
        some = [k for k, t in enumerate(best.fit.terms) if not t.fixture]
        places = np.array([place[best.fit.terms[k].key] for k in some], dtype=np.intp)
        order = np.argsort(places)
        alone[form] = Refit(
            tuple(places[order].tolist()),
            best.fit.theta[some][order],
            best.estimation.rms_mm,
            best.held_out.rms_mm,
        )
    left, side = fitted.residuals(split.problem), split.estimation
    whole = (
        summarise_errors(left[side], split.outlying[side]).rms_mm,
        summarise_errors(left[~side], split.outlying[~side]).rms_mm,
    )
    warm = (
        split.problem.data.covariates.get(TEMPERATURE)
        if any(TEMPERATURE in m.names() for m in fitted.model.mechanisms)
        else None
    )
    return Refits(alone, whole, None if warm is None else float(warm[split.used].mean()))


def _cross_validation_error(made: Evaluation) -> float:
    return np.inf if made.cv_rms_mm is None or not np.isfinite(made.cv_rms_mm) else made.cv_rms_mm


# -- in the file
# ---------------------------------------------------------------------------------------------------------------


def refits_record(refits: Refits, symbols: Sequence[str]) -> dict[str, Any]:
    """As JSON values; `symbols` of the calibration's terms."""
    return {
        "says": "terms that a form can carry, fitted without the others; rms lengths of what is left",
        "whole": {"estimation_rms_mm": refits.whole[0], "held_out_rms_mm": refits.whole[1]},
        "temperature_C": refits.mean_celsius,
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


def refits_of(record: RefitsRecord, model: Model) -> Refits:
    """Return the refits of a record. Raises ValueError where they are not of the model's terms."""
    alone = {form: _restore_refit(form, refit, model) for form, refit in record.alone.items()}
    whole = record.whole.estimation_rms_mm, record.whole.held_out_rms_mm
    return Refits(alone, whole, record.mean_celsius)


def _restore_refit(form: str, record: RefitRecord, model: Model) -> Refit:
    places = [estimate.term for estimate in record.estimates]
    known = form in NESTED_FORMS and set(places) <= set(range(len(model.terms)))
    if not known or places != sorted(set(places)):
        raise ValueError(f"what its refits carry alone ({form}) is not of its terms")
    carries = select_carried(model, form)
    terms = [model.terms[place] for place in places]
    symbols = [estimate.symbol for estimate in record.estimates]
    if symbols != [term.symbol for term in terms] or not all(map(carries, terms)):
        raise ValueError(f"what its refits carry alone ({form}) are other terms")
    theta = np.array([estimate.value for estimate in record.estimates])
    return Refit(tuple(places), theta, record.estimation_rms_mm, record.held_out_rms_mm)
