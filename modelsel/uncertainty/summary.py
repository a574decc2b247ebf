"""How sure a study is of its chosen model: what is sampled and how, and everything that stands
beside it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np

from .._random import generator
from .._typing import Say
from ..exceptions import sentence_list
from ..fitting.design import Model
from ..fitting.least_squares import Fit
from ..fitting.noise import Instrument
from ..mechanisms.registry import Registry
from ..notices import Note
from ..selection.evaluation import Split
from .log_posterior import TAIL, LogPosterior
from .nuisance import components, constants, single
from .parameters import (
    Correlation,
    Parameter,
    correlation,
    difference_notes,
    displacement,
    free,
    labels,
    parameters,
    resampled,
    with_posterior,
)
from .posterior import draws_for, importance, posterior, weighted
from .sampler import PER_NAME, WALKERS, Keeper, Sampling, sample
from .significance import Significance, significance

MOST = {"default": 24, "all": 64}  # coefficients that are sampled; the others are integrated out
ROWS = 9_000  # walkers x rows a step, up to which the chain itself is evaluated
POSE = 4  # how much dearer a row with its orientation is
WIDE = 80  # integrated coefficients up to which several noise scales are told apart


@dataclass(frozen=True, eq=False)
class Confidence:
    """Three answers for every parameter, their correlations, what each mechanism matters, the chain
    (None: not sampled), and whether what is left goes together within groups."""

    parameters: tuple[Parameter, ...]
    correlation: Correlation
    significance: tuple[Significance, ...]
    sampling: Sampling | None = None
    lasting: bool = False

    @property
    def notes(self) -> tuple[Note, ...]:
        """What the user should know."""
        out = difference_notes(self.parameters)
        if self.lasting:
            out += (
                Note(
                    "residuals-together",
                    "What is left goes together within groups: errors last from one configuration to "
                    "the next. Signs are drawn for whole groups, and the parameters' intervals are those of whole groups; "
                    "posterior, F tests and the gain's interval count configurations as independent and are too sure.",
                ),
            )
        if self.sampling is not None and not self.sampling.converged:
            s = self.sampling
            out += (
                Note(
                    "unconverged",
                    f"The chain has not converged after {s.steps:,} steps (autocorrelation time "
                    f"{s.tau.max():.0f}, R-hat {s.r_hat.max():.3f}): nothing of it is quoted.",
                ),
            )
        return out

    def to_dict(self) -> dict[str, Any]:
        """The result file's entries."""
        return {
            "sampling": None if self.sampling is None else self.sampling.to_dict(),
            "parameters": [asdict(p) for p in self.parameters],
            "correlation": {
                "symbols": list(self.correlation.symbols),
                "matrix": self.correlation.matrix,
                "pairs": [asdict(p) for p in self.correlation.pairs],
                "clusters": [list(c) for c in self.correlation.clusters],
            },
            "significance": [asdict(s) for s in self.significance],
        }


def confidence(split: Split, fitted: Fit, names: Sequence[str], seed: int) -> Confidence:
    """What needs no sampling; cheap. `names`: what the report calls the mechanisms of the model.
    Empty where it has no estimable parameter."""
    if not fitted.rank:
        return Confidence((), Correlation((), np.zeros((0, 0)), (), ()), ())
    boot = resampled(split, fitted, generator(seed, "bootstrap"))
    return Confidence(
        parameters(split, fitted, boot),
        correlation(fitted),
        significance(split, fitted, names, boot, generator(seed, "halves")),
        lasting=boot.grouped,
    )


@dataclass(frozen=True, eq=False)
class Request:
    """What a study asks of the sampling: its base model, over what, the instrument, whether a floor
    is stated, the registry."""

    base: Model
    over: str
    instrument: Instrument | None
    stated: bool
    registry: Registry


def sampled(
    found: Confidence,
    split: Split,
    fitted: Fit,
    request: Request,
    seed: int,
    say: Say = lambda _: None,
    keeper: Keeper | None = None,
) -> Confidence:
    """With the posterior sampled; unchanged where there is no estimable parameter or no degree of
    freedom left."""
    if not fitted.rank or fitted.freedom < 1:
        return found
    training, rng = split.training(), generator(seed, "sampling")
    known = posterior(fitted)
    draws = weighted(training, fitted, known.draw(rng, draws_for(training)))
    target = target_of(split, fitted, request)
    chain = sample(target, importance(draws), described(target), rng, say=say, keeper=keeper)
    return replace(
        found, sampling=chain, parameters=with_posterior(found.parameters, fitted, draws, chain)
    )


def target_of(split: Split, fitted: Fit, request: Request) -> LogPosterior:
    """What is sampled: by default the coefficients of the named effects, every noise scale, the
    tail and inner constants, with the other coefficients integrated out; over "all", and where
    nothing is named, every coefficient and the scales under normal noise (a Student-t takes what is
    left unnamed for outliers, and a different part of it in every corner of its density). At most
    MOST coefficients, those that move the target most; free functions are always integrated out.
    Where the rows are too many for the chain to be evaluated at every step, the QR-reduced linear
    form stands in for it, with normal noise of one scale."""
    training = split.training()
    inside = free(fitted.model)
    base = {t.key for t in request.base.terms}
    plain = [k for k in fitted.found.kept if not inside[k]]
    named = [k for k in plain if fitted.terms[k].key not in base]
    wanted = plain if request.over == "all" or not named else named
    mean, _ = displacement(split, fitted)
    most = MOST[request.over]
    chosen = tuple(sorted(sorted(wanted, key=lambda k: -mean[k])[:most]))
    dear = POSE if training.components == 6 else 1
    exact = dear * max(WALKERS, PER_NAME * (len(chosen) + 2)) * len(training) <= ROWS
    noise = components(training, request.instrument, request.stated)
    if noise.count > 1 and (not exact or fitted.found.rank - len(chosen) > WIDE):
        noise = single(noise)
    tail = bool(
        exact and request.over == "default" and named and training.data.gauges is None
    )  # rows have three numbers each
    inner = constants(training, fitted.model, request.registry) if tail else ()
    names = labels(fitted.model)
    return LogPosterior(
        fitted,
        noise,
        chosen,
        (
            *(names[k] for k in chosen),
            *noise.names,
            *((TAIL,) if tail else ()),
            *(c.name for c in inner),
        ),
        (
            *(fitted.terms[k].unit for k in chosen),
            *noise.units,
            *(("1",) if tail else ()),
            *("1" for _ in inner),
        ),
        tail,
        inner,
        exact,
    )


def described(log_posterior: LogPosterior) -> str:
    """What was sampled and what was not, in a sentence or two."""
    k, rest = (
        len(log_posterior.sampled),
        log_posterior.fitted.found.rank - len(log_posterior.sampled),
    )
    parts = [
        f"{k} coefficient{'s' * (k != 1)}",
        *log_posterior.noise.names,
        *((TAIL,) if log_posterior.tail else ()),
        *(c.name for c in log_posterior.constants),
    ]
    what = sentence_list(parts)
    gone = (
        f"; {rest} further coefficient{'s are' if rest != 1 else ' is'} integrated out"
        if rest
        else ""
    )
    if log_posterior.exact:
        return f"emcee samples {what} on the exact chain{gone}."
    return (
        f"emcee samples {what} on the chain linear about the optimum, reduced by QR{gone}: {len(log_posterior.noise.problem):,} rows "
        "are too many to evaluate the chain itself at every step, and the importance weights say what that costs."
    )
