"""Every estimable parameter with three standard errors, from least squares, the posture bootstrap and
the posterior; and the correlations of the parameters."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from .._linalg import connected_components
from .._typing import Array, Mask
from ..diagnosis.residual_tests import GROUP_LEVEL, compute_group_p
from ..fitting.design import Model, blocks
from ..fitting.least_squares import Fit
from ..mechanisms.causes import Bump
from ..notices import Note
from ..selection.cross_validation import fold_by_unit
from ..selection.evaluation import Split
from .bootstrap import Bootstrap, run_bootstrap
from .posterior import Draws
from .sampler import Sampling

# ratio of standard errors beyond which they differ
MAX_RATIO = 1.5
# standard deviations of the bootstrap's own uncertainty: among hundreds of parameters none by
# chance
MAX_DEVIATION = 3.5
# quantile of the two-sided 95 % interval
UPPER = 0.975
# parameters that a warning names
MAX_NAMED = 6
# correlation beyond which the data determine two parameters only together
STRONG = 0.9


@dataclass(frozen=True)
class Parameter:
    """One estimate.

    symbol, mechanism, unit: what it is.
    estimate: its value.
    standard_error, bootstrap_error, posterior_error: three standard errors; the last is None where
        nothing was sampled.
    low, high: 95 % interval.
    mean_mm, max_mm: displacement it causes over the measured configurations.
    configurations: how many configurations (or groups) it rests on.
    differ: whether the standard errors differ.
    """

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


def describe_parameters(split: Split, fitted: Fit, boot: Bootstrap) -> tuple[Parameter, ...]:
    """Describe every estimable parameter of a fit, in the model's order.

    The posterior's errors come later (`add_posterior`). An interval is a t of the larger of least
    squares' and the bootstrap's standard error, of as many degrees of freedom as postures (groups,
    where errors last within them) determine the estimate, less one (Carter, Schnepel & Steigerwald
    2017): rows of a posture may share an error, and no test of the residual would see it."""
    from scipy.special import stdtrit

    error = fitted.standard_errors
    quantile = stdtrit(np.maximum(boot.units - 1, 1), UPPER)
    half_width = quantile * np.maximum(boot.errors, error)
    mean, largest = compute_displacement(split, fitted)
    labels = label_terms(fitted.model)
    owners = list_owners(fitted.model)
    parameters = []
    for k in fitted.found.kept:
        errors = (float(error[k]), float(boot.errors[k]))
        units = float(boot.units[k])
        parameters.append(
            Parameter(
                symbol=labels[k],
                mechanism=owners[k],
                unit=fitted.terms[k].unit,
                estimate=float(fitted.theta[k]),
                standard_error=errors[0],
                bootstrap_error=errors[1],
                posterior_error=None,
                low=float(fitted.theta[k] - half_width[k]),
                high=float(fitted.theta[k] + half_width[k]),
                mean_mm=float(mean[k]),
                max_mm=float(largest[k]),
                configurations=units,
                differ=_differ(errors, units),
            )
        )
    return tuple(parameters)


def bootstrap_parameters(split: Split, fitted: Fit, rng: np.random.Generator) -> Bootstrap:
    """Bootstrap the training rows; the units are whole groups where the residuals of a group are
    correlated."""
    training = split.training()
    residual = fitted.residuals(training)
    grouped = compute_group_p(training.data, residual[:, :3], rng) <= GROUP_LEVEL
    unit = training.data.group if grouped else training.data.block
    parts = fold_by_unit(training, fitted.terms, unit, fitted.at())
    return replace(run_bootstrap(parts, fitted, rng), grouped=grouped)


def _differ(errors: Sequence[float], configurations: float) -> bool:
    """Whether standard errors differ by more than MAX_RATIO, and by more than the bootstrap's own
    chance: the logarithm of one that rests on n configurations has a standard deviation of
    1/√(2n)."""
    chance = float(np.exp(MAX_DEVIATION / np.sqrt(2 * configurations)))
    return max(errors) > max(MAX_RATIO, chance) * min(errors)


def compute_displacement(split: Split, fitted: Fit) -> tuple[Array, Array]:
    """Compute the (mean, largest) displacement (p,) [mm] of the target that each parameter causes.

    Over all measured configurations without outliers, held out or not: the workspace as it was
    measured. Linear about the optimum."""
    problem = split.problem.take(~split.outlying).unweighted()
    total = np.zeros(len(fitted.theta))
    largest = np.zeros(len(fitted.theta))
    for _, columns, _ in blocks(problem, fitted.terms, fitted.at()):
        length = np.linalg.norm(columns[:, :3], axis=1)
        size = length * np.abs(fitted.theta)[:, None]
        total += size.sum(1)
        largest = np.maximum(largest, size.max(1))
    return total / len(problem), largest


def add_posterior(
    parameters: Sequence[Parameter], fitted: Fit, draws: Draws, sampling: Sampling
) -> tuple[Parameter, ...]:
    """Add the posterior's standard deviations: emcee's where it sampled the parameter and converged,
    else those of the closed-form draws weighted on the exact chain."""
    labels = label_terms(fitted.model)
    spread = {labels[k]: float(draws.spread[k]) for k in fitted.found.kept}
    if sampling.converged:
        chain = zip(sampling.names, sampling.spread, strict=True)
        spread |= {name: float(value) for name, value in chain if name in spread}
    described = []
    for parameter in parameters:
        error = spread[parameter.symbol]
        errors = (parameter.standard_error, parameter.bootstrap_error, error)
        differ = _differ(errors, parameter.configurations)
        described.append(replace(parameter, posterior_error=error, differ=differ))
    return tuple(described)


def note_differences(parameters: Sequence[Parameter]) -> tuple[Note, ...]:
    """Warn of the parameters whose standard errors differ."""
    named = [f"{p.symbol} ({p.mechanism})" for p in parameters if p.differ]
    if not named:
        return ()
    shown = ", ".join(named[:MAX_NAMED])
    if len(named) > MAX_NAMED:
        shown += f" and {len(named) - MAX_NAMED} more"
    return (
        Note(
            "errors-differ",
            f"The standard errors of {shown} differ between least squares, configuration bootstrap "
            "and posterior: the noise is not the same everywhere, or a systematic error remains; "
            "believe the largest.",
        ),
    )


@dataclass(frozen=True)
class Pair:
    """Two parameters of strong correlation r, and what that means."""

    a: str
    b: str
    r: float
    sentence: str


@dataclass(frozen=True, eq=False)
class Correlation:
    """Correlation of the estimable parameters, without the coefficients of free functions.

    symbols: names of the parameters.
    matrix: correlation matrix.
    pairs: pairs with |r| above 0.9, strongest first.
    clusters: groups of parameters that such pairs connect.
    """

    symbols: tuple[str, ...]
    matrix: Array = field(repr=False)
    pairs: tuple[Pair, ...]
    clusters: tuple[tuple[str, ...], ...]


def label_terms(model: Model) -> tuple[str, ...]:
    """Label every term uniquely: by its symbol; where two terms share one, with the mechanism, and
    with a number where a mechanism is in the model with several constants."""
    symbols = [t.symbol for t in model.terms]
    labels = []
    for symbol, owner in zip(symbols, list_owners(model), strict=True):
        labels.append(symbol if symbols.count(symbol) == 1 else f"{symbol} of {owner}")
    numbered = []
    for k, label in enumerate(labels):
        if labels.count(label) == 1:
            numbered.append(label)
        else:
            numbered.append(f"{label} ({labels[:k].count(label) + 1})")
    return tuple(numbered)


def list_owners(model: Model) -> tuple[str, ...]:
    """Return, for every term, the name of the mechanism that brings it first."""
    first: dict[object, str] = {}
    for mechanism in model.mechanisms:
        for term in mechanism.terms:
            first.setdefault(term.key, mechanism.name)
    return tuple(first[term.key] for term in model.terms)


def mask_free_functions(model: Model) -> Mask:
    """Mask (p,) of the coefficients of free functions."""
    return np.array(
        [bool(t.screws) and isinstance(t.screws[0].cause, Bump) for t in model.terms], dtype=bool
    )


def correlate_parameters(fitted: Fit) -> Correlation:
    """Compute the correlation matrix of the fitted parameters, its strong pairs and clusters."""
    inside = mask_free_functions(fitted.model)
    index = [k for k in fitted.found.kept if not inside[k]]
    factor = fitted.factor[index]
    unit = factor / np.linalg.norm(factor, axis=1)[:, None]
    matrix = np.clip(unit @ unit.T, -1, 1)
    labels = label_terms(fitted.model)
    names = tuple(labels[k] for k in index)
    # parameters that rest on their prior are reported as not determined
    determined = np.array([k not in fitted.leaning for k in index], dtype=bool)
    joined = _find_strong(matrix, determined)
    pairs = tuple(_describe_pair(names[j], names[i], float(matrix[i, j])) for i, j in joined)
    return Correlation(names, matrix, pairs, _cluster(names, joined))


def _find_strong(matrix: Array, determined: Mask) -> list[tuple[int, int]]:
    """Pairs (i, j), j < i, of determined parameters with a strong correlation, strongest first."""
    strong = np.tril(np.abs(matrix) > STRONG, -1) & np.logical_and.outer(determined, determined)
    pairs = [(int(i), int(j)) for i, j in np.argwhere(strong)]
    return sorted(pairs, key=lambda pair: -abs(matrix[pair]))


def _describe_pair(a: str, b: str, r: float) -> Pair:
    """Describe what a strong correlation means."""
    if r > 0:
        relation, combination = f"{a} and {b} rise and fall together", "difference"
    else:
        relation, combination = f"{a} rises as {b} falls", "sum"
    sentence = (
        f"{relation} ({r:.3f}): the data determine their {combination} well, each alone poorly."
    )
    return Pair(a, b, r, sentence)


def _cluster(
    names: Sequence[str], joined: Sequence[tuple[int, int]]
) -> tuple[tuple[str, ...], ...]:
    """Groups of names that the pairs connect, each in the names' order."""
    component = connected_components(len(names), np.array(joined, dtype=np.intp))
    members: dict[int, list[str]] = {}
    for name, label in zip(names, component.tolist(), strict=True):
        members.setdefault(label, []).append(name)
    return tuple(tuple(group) for group in members.values() if len(group) > 1)
