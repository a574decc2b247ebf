"""Uncertainty of a study's chosen model: standard errors, correlations, significance, and the
choice of what is sampled."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np

from .._progress import keep_silent
from .._random import generator
from .._typing import Say
from ..exceptions import count_words, sentence_list
from ..fitting.design import Model
from ..fitting.least_squares import Fit
from ..fitting.noise import Instrument
from ..fitting.problem import Problem
from ..mechanisms.registry import Registry
from ..notices import Note
from ..selection.evaluation import Split
from .log_posterior import TAIL, LogPosterior
from .nuisance import Constant, assign_components, list_constants, merge_components
from .parameters import (
    Correlation,
    Parameter,
    add_posterior,
    bootstrap_parameters,
    correlate_parameters,
    describe_parameters,
    label_terms,
    mask_free_functions,
    measure_motions,
    note_differences,
)
from .posterior import choose_draw_count, linear_posterior, summarise_importance, weight_draws
from .sampler import Keeper, Sampling, sample_posterior
from .sampling_options import DEFAULT_SAMPLING, SamplingOptions
from .significance import Significance, assess_significance

# coefficients that are sampled at most; the others are integrated out
MAX_SAMPLED = {"default": 24, "all": 64}
# cost of a row with its orientation over that of a position
POSE_COST = 4
# integrated coefficients up to which several noise scales are told apart
MAX_INTEGRATED = 80


@dataclass(frozen=True, eq=False)
class Confidence:
    """Uncertainty of the chosen model.

    parameters: every estimable parameter with its standard errors and interval.
    correlation: of the estimable parameters.
    significance: what each mechanism contributes.
    sampling: the chain; None where nothing was sampled.
    lasting: whether the residuals of a group are correlated.
    """

    parameters: tuple[Parameter, ...]
    correlation: Correlation
    significance: tuple[Significance, ...]
    sampling: Sampling | None = None
    lasting: bool = False

    def __repr__(self) -> str:
        count = len(self.parameters)
        parameters = count_words(count, "parameter")
        sampled = "sampled"
        if self.sampling is None:
            sampled = "not sampled"
        return f"Uncertainty of {parameters}, {sampled}"

    @property
    def notes(self) -> tuple[Note, ...]:
        """What the user should know."""
        notes = list(note_differences(self.parameters))
        if self.lasting:
            notes.append(
                Note(
                    "residuals-together",
                    "The residuals of a group are correlated: errors last from one configuration to "
                    "the next. Signs are drawn for whole groups, and the parameters' intervals are "
                    "those of whole groups; posterior, F tests and the gain's interval count "
                    "configurations as independent and are too narrow.",
                )
            )
        if self.sampling is not None and not self.sampling.converged:
            chain = self.sampling
            notes.append(
                Note(
                    "unconverged",
                    f"The chain has not converged after {chain.steps:,} steps (autocorrelation time "
                    f"{chain.tau.max():.0f}, R-hat {chain.r_hat.max():.3f}): none of its numbers "
                    "are quoted.",
                )
            )
        return tuple(notes)

    def to_dict(self) -> dict[str, Any]:
        """Return the result file's entries."""
        return {
            "sampling": None if self.sampling is None else self.sampling.to_dict(),
            "parameters": [_write_known(p) for p in self.parameters],
            "correlation": {
                "symbols": list(self.correlation.symbols),
                "matrix": self.correlation.matrix,
                "pairs": [asdict(p) for p in self.correlation.pairs],
                "clusters": [list(c) for c in self.correlation.clusters],
            },
            "significance": [_write_known(s) for s in self.significance],
        }


def _write_known(one: Parameter | Significance) -> dict[str, Any]:
    """Write a record's values, without those of turning where no orientation was measured."""
    values = asdict(one)
    if one.max_mrad is None:
        return {key: value for key, value in values.items() if not key.endswith("_mrad")}
    return values


def assess_confidence(split: Split, fitted: Fit, names: Sequence[str], seed: int) -> Confidence:
    """Assess everything that needs no sampling.

    `names`: what the report calls the mechanisms of the model. Empty where the model has no
    estimable parameter."""
    if not fitted.rank:
        return Confidence((), Correlation((), np.zeros((0, 0)), (), ()), ())
    boot = bootstrap_parameters(split, fitted, generator(seed, "bootstrap"))
    return Confidence(
        describe_parameters(split, fitted, boot),
        correlate_parameters(fitted),
        assess_significance(split, fitted, names, boot, generator(seed, "halves")),
        lasting=boot.grouped,
    )


def sample_confidence(
    confidence: Confidence,
    split: Split,
    log_posterior: LogPosterior | None,
    seed: int,
    say: Say = keep_silent,
    keeper: Keeper | None = None,
    options: SamplingOptions = DEFAULT_SAMPLING,
) -> Confidence:
    """Add the sampled posterior; unchanged where there is nothing to sample (None)."""
    if log_posterior is None:
        return confidence
    fitted = log_posterior.fitted
    training = split.training
    rng = generator(seed, "sampling")
    draws = linear_posterior(fitted).draw(rng, choose_draw_count(training))
    draws = weight_draws(training, fitted, draws)
    chain = sample_posterior(
        log_posterior,
        summarise_importance(draws),
        describe_sampling(log_posterior),
        rng,
        say=say,
        keeper=keeper,
        options=options,
    )
    if not chain.converged:
        importance = summarise_importance(draws, is_sampled=False)
        chain = replace(chain, importance=importance)
    parameters = add_posterior(confidence.parameters, fitted, draws, chain)
    return replace(confidence, sampling=chain, parameters=parameters)


def build_log_posterior(
    split: Split,
    fitted: Fit,
    base: Model,
    registry: Registry,
    *,
    over: str = "default",
    instrument: Instrument | None = None,
    options: SamplingOptions = DEFAULT_SAMPLING,
) -> LogPosterior | None:
    """Choose what is sampled of a fit; None where no parameter is estimable or no degree of freedom
    is left.

    base: the study's base model, whose effects are not named.
    over: "default": the coefficients of the named effects, every noise scale, the tail and inner
        constants, with the other coefficients integrated out. Where nothing is named: the
        coefficients that the data determine better than their usual size does, and the scales under
        normal noise (a Student-t takes what is left unnamed for outliers, and a different part of it
        in every corner of its density). "all": every coefficient, under normal noise too.
    instrument: its noise along and across the beam is told apart; None where a floor is stated.

    At most MAX_SAMPLED coefficients are sampled, those that move the target most; free functions
    are always integrated out. So are, by default, coefficients that usual sizes hold rather than the
    data: over ranges so wide the exact chain bends by far more than the noise, and no walker follows
    (of a gantry's 21 coefficients, autocorrelation times of 8,000 steps). Where the rows are too many
    for the chain to be evaluated at every step, its QR-reduced linear form is sampled, with normal
    noise of one scale."""
    if not fitted.rank or fitted.freedom < 1:
        return None
    training = split.training
    sampled, named = _choose_coefficients(split, fitted, base, over)
    count = len(sampled)
    cost = _walk_cost(training, count, options)
    exact = cost <= options.max_evaluations
    integrated = fitted.found.rank - count
    several = exact and integrated <= MAX_INTEGRATED
    noise = assign_components(training, instrument)
    if noise.count > 1 and not several:
        noise = merge_components(noise)
    # rows that are no points have no three numbers each
    points = training.data.gauges is None
    tail = exact and over == "default" and named and points
    constants: tuple[Constant, ...] = ()
    if tail:
        constants = list_constants(training, fitted.model, registry)
    labels = label_terms(fitted.model)
    names = [labels[k] for k in sampled]
    units = [fitted.terms[k].unit for k in sampled]
    names += noise.names
    units += noise.units
    others = [TAIL] if tail else []
    others += [constant.name for constant in constants]
    names += others
    units += ["1"] * len(others)
    return LogPosterior(fitted, noise, sampled, tuple(names), tuple(units), tail, constants, exact)


def _choose_coefficients(
    split: Split, fitted: Fit, base: Model, over: str
) -> tuple[tuple[int, ...], bool]:
    """Choose the coefficients to sample, as term indices, and say whether any effect is named."""
    inside = mask_free_functions(fitted.model)
    known = {t.key for t in base.terms}
    plain = []
    named = []
    for k in fitted.found.kept:
        if inside[k]:
            continue
        plain.append(k)
        term = fitted.terms[k]
        if term.key not in known:
            named.append(k)
    leaning = fitted.leaning
    wanted = named
    if not named:
        wanted = [k for k in plain if k not in leaning] or plain
    if over == "all":
        wanted = plain
    mean = measure_motions(split, fitted).mean_mm
    ordered = sorted(wanted, key=lambda k: -mean[k])
    limit = MAX_SAMPLED[over]
    strongest = sorted(ordered[:limit])
    return tuple(strongest), bool(named)


def _walk_cost(training: Problem, sampled: int, options: SamplingOptions) -> int:
    """Compute the cost of one step of all walkers, in rows."""
    names = sampled + 2
    wanted = options.walkers_per_name * names
    walkers = max(options.min_walkers, wanted)
    rows = len(training)
    row_cost = 1
    if training.components == 6:
        row_cost = POSE_COST
    return row_cost * walkers * rows


def describe_sampling(log_posterior: LogPosterior) -> str:
    """Describe what was sampled and what was not, in a sentence or two."""
    count = len(log_posterior.sampled)
    rest = log_posterior.fitted.found.rank - count
    parts = [f"{count} coefficient{'s' * (count != 1)}", *log_posterior.noise.names]
    if log_posterior.tail:
        parts.append(TAIL)
    parts += [constant.name for constant in log_posterior.constants]
    sampled = sentence_list(parts)
    integrated = ""
    if rest:
        plural = "s are" if rest != 1 else " is"
        integrated = f"; {rest} further coefficient{plural} integrated out"
    if log_posterior.exact:
        return f"emcee samples {sampled} on the exact chain{integrated}."
    return (
        f"emcee samples {sampled} on the chain linear about the optimum, reduced by QR{integrated}: to evaluate "
        f"the chain itself at every step, of {len(log_posterior.noise.problem):,} rows, would take too long, and "
        "the importance weights say what that costs."
    )
