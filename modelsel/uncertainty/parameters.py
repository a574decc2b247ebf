"""Every estimable parameter with three answers side by side: analytic, posture bootstrap,
posterior."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from .._typing import Array
from ..diagnosis.residual_tests import LASTING, together
from ..fitting.design import Model, blocks
from ..fitting.least_squares import Fit
from ..mechanisms.causes import Bump
from ..notices import Note
from ..selection.cross_validation import by_unit
from ..selection.evaluation import Split
from .bootstrap import Bootstrap, bootstrap
from .posterior import Draws
from .sampler import Sampling

RATIO = 1.5  # between two of the three answers
# standard deviations of the bootstrap's own uncertainty: among hundreds of parameters none by
# chance
CHANCE = 3.5


@dataclass(frozen=True)
class Parameter:
    """One estimate: standard errors from least squares, bootstrap and posterior (None: not
    sampled), its 95 % interval, the displacement it causes (mean and worst over the measured
    configurations), how many configurations it rests on, and whether the three answers differ."""

    symbol: str
    mechanism: str
    unit: str
    estimate: float
    standard_error: float
    bootstrap_error: float
    posterior_error: float | None
    low: float
    high: float
    mean_mm: float
    max_mm: float
    configurations: float
    differ: bool


def parameters(split: Split, fitted: Fit, boot: Bootstrap) -> tuple[Parameter, ...]:
    """Every estimable parameter of a fit, in the model's order; the posterior's answers come later
    (`with_posterior`).

    An interval is a t of the larger of least squares' and the bootstrap's standard error, of as
    many degrees of freedom as postures (groups, where errors last within them) bear the estimate,
    less one (Carter, Schnepel & Steigerwald 2017): rows of a posture may share an error, and no
    test of the residual would see it."""
    from scipy.special import stdtrit

    half = stdtrit(np.maximum(boot.units - 1, 1), 0.975) * np.maximum(
        boot.errors, fitted.standard_errors
    )
    low, high = fitted.theta - half, fitted.theta + half
    mean, worst = displacement(split, fitted)
    error, names, owner = fitted.standard_errors, labels(fitted.model), owners(fitted.model)
    out = []
    for k in fitted.found.kept:
        analytic, again, rests = float(error[k]), float(boot.errors[k]), float(boot.units[k])
        out.append(
            Parameter(
                names[k],
                owner[k],
                fitted.terms[k].unit,
                float(fitted.theta[k]),
                analytic,
                again,
                None,
                float(low[k]),
                float(high[k]),
                float(mean[k]),
                float(worst[k]),
                rests,
                _differ((analytic, again), rests),
            )
        )
    return tuple(out)


def resampled(split: Split, fitted: Fit, rng: np.random.Generator) -> Bootstrap:
    """The bootstrap of the training rows; whole groups are its units where what is left goes
    together within them."""
    training = split.training()
    residual = fitted.residuals(training)
    grouped = together(training.data, residual[:, :3], rng) <= LASTING
    unit = training.data.group if grouped else training.data.block
    boot = bootstrap(by_unit(training, fitted.terms, unit, fitted.at()), fitted, rng)
    return replace(boot, grouped=grouped)


def _differ(errors: Sequence[float], configurations: float) -> bool:
    """Whether standard errors differ by more than RATIO, and by more than the bootstrap's own
    chance: the logarithm of one that rests on n configurations has a standard deviation of
    1/√(2n)."""
    return max(errors) > max(RATIO, float(np.exp(CHANCE / np.sqrt(2 * configurations)))) * min(
        errors
    )


def displacement(split: Split, fitted: Fit) -> tuple[Array, Array]:
    """(mean, worst) (p,) displacement [mm] of the target that each parameter causes, over all
    measured configurations, held out or not: the workspace as it was measured. Linear about the
    optimum."""
    problem = split.problem.take(~split.outlying)
    total, worst = np.zeros(len(fitted.theta)), np.zeros(len(fitted.theta))
    for _, columns, _ in blocks(problem.unweighted(), fitted.terms, fitted.at()):
        size = np.linalg.norm(columns[:, :3], axis=1) * np.abs(fitted.theta)[:, None]
        total += size.sum(1)
        worst = np.maximum(worst, size.max(1))
    return total / len(problem), worst


def with_posterior(
    found: Sequence[Parameter], fitted: Fit, draws: Draws, sampling: Sampling
) -> tuple[Parameter, ...]:
    """With the posterior's standard deviations: emcee's where it sampled the parameter and
    converged, else of the closed-form draws weighted on the exact chain."""
    spread = dict(
        zip(
            [labels(fitted.model)[k] for k in fitted.found.kept],
            draws.spread[list(fitted.found.kept)],
            strict=True,
        )
    )
    if sampling.converged:
        spread |= {
            n: s for n, s in zip(sampling.names, sampling.spread, strict=True) if n in spread
        }
    return tuple(
        replace(
            one,
            posterior_error=float(spread[one.symbol]),
            differ=_differ(
                (one.standard_error, one.bootstrap_error, float(spread[one.symbol])),
                one.configurations,
            ),
        )
        for one in found
    )


def difference_notes(found: Sequence[Parameter]) -> tuple[Note, ...]:
    """A warning that names the parameters whose answers differ."""
    named = [f"{p.symbol} ({p.mechanism})" for p in found if p.differ]
    if not named:
        return ()
    shown = ", ".join(named[:6]) + (f" and {len(named) - 6} more" if len(named) > 6 else "")
    return (
        Note(
            "errors-differ",
            f"The standard errors of {shown} differ between least squares, configuration bootstrap and "
            "posterior: the noise is not the same everywhere, or something systematic is left; believe the "
            "largest.",
        ),
    )


# Which parameters the data tell only together: the correlation matrix, clusters, and the worst
# pairs in words.

STRONG = 0.9


@dataclass(frozen=True)
class Pair:
    """Two parameters of strong correlation r."""

    a: str
    b: str
    r: float
    sentence: str


@dataclass(frozen=True, eq=False)
class Correlation:
    """Of the estimable parameters (the coefficients of free functions apart): names, matrix, pairs
    above 0.9, strongest first, and the clusters that such pairs join."""

    symbols: tuple[str, ...]
    matrix: Array = field(repr=False)
    pairs: tuple[Pair, ...]
    clusters: tuple[tuple[str, ...], ...]


def labels(model: Model) -> tuple[str, ...]:
    """A name of its own for every term: its symbol; where two terms share one, the mechanism is
    added, and a number where a mechanism is in the model with several constants."""
    symbols = [t.symbol for t in model.terms]
    longer = [
        s if symbols.count(s) == 1 else f"{s} of {owner}"
        for s, owner in zip(symbols, owners(model), strict=True)
    ]
    return tuple(
        s if longer.count(s) == 1 else f"{s} ({longer[:k].count(s) + 1})"
        for k, s in enumerate(longer)
    )


def owners(model: Model) -> tuple[str, ...]:
    """The name of the mechanism that brings each term first."""
    first: dict[object, str] = {}
    for m in model.mechanisms:
        for t in m.terms:
            first.setdefault(t.key, m.name)
    return tuple(first[t.key] for t in model.terms)


def free(model: Model) -> Array:
    """(p,) mask of the coefficients of free functions."""
    return np.array(
        [
            bool(t.screws) and bool(t.screws) and isinstance(t.screws[0].cause, Bump)
            for t in model.terms
        ],
        dtype=bool,
    )


def correlation(fitted: Fit) -> Correlation:
    """Of a fit."""
    inside = free(fitted.model)
    index = [k for k in fitted.found.kept if not inside[k]]
    factor = fitted.factor[index]
    unit = factor / np.linalg.norm(factor, axis=1)[:, None]
    matrix = np.clip(unit @ unit.T, -1, 1)
    every = labels(fitted.model)
    names = [every[k] for k in index]
    known = [
        k not in fitted.leaning for k in index
    ]  # of the others it is said that the data do not tell them
    strong = [
        (i, j)
        for i in range(len(index))
        for j in range(i)
        if known[i] and known[j] and abs(matrix[i, j]) > STRONG
    ]
    strong.sort(key=lambda pair: -abs(matrix[pair]))
    pairs = tuple(
        Pair(
            names[j],
            names[i],
            float(matrix[i, j]),
            _sentence(names[j], names[i], float(matrix[i, j])),
        )
        for i, j in strong
    )
    return Correlation(tuple(names), matrix, pairs, clusters(names, strong))


def _sentence(a: str, b: str, r: float) -> str:
    """What a strong correlation means."""
    if r > 0:
        return f"{a} and {b} rise and fall together ({r:.3f}): the data tell their difference well, each alone poorly."
    return f"{a} rises as {b} falls ({r:.3f}): the data tell their sum well, each alone poorly."


def clusters(
    names: Sequence[str], joined: Sequence[tuple[int, int]]
) -> tuple[tuple[str, ...], ...]:
    """Groups that the pairs join, each in the names' order."""
    group = list(range(len(names)))
    for i, j in joined:
        old, new = max(group[i], group[j]), min(group[i], group[j])
        group = [new if g == old else g for g in group]
    members: dict[int, list[str]] = {}
    for name, g in zip(names, group, strict=True):
        members.setdefault(g, []).append(name)
    return tuple(tuple(m) for m in members.values() if len(m) > 1)
