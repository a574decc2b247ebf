"""Every estimable parameter with three standard errors, from least squares, the posture bootstrap and
the posterior; and the correlations of the parameters."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np

from .._linalg import connected_components
from .._short_numbers import round_numbers
from .._typing import Array, Mask
from ..diagnosis.inference.residual_tests import find_together
from ..exceptions import number_repeated, write_numbered
from ..fitting.design import Model, blocks
from ..fitting.least_squares import Fit
from ..mechanisms.causes import find_bump
from ..notices import Note
from ..selection.cross_validation import fold_by_unit
from ..selection.evaluation import Split
from .bootstrap import Bootstrap, run_bootstrap
from .motion_sums import MILLIRADIAN
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
    max_mrad: how far it turns the target at most; None where no orientation was measured.
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
    max_mrad: float | None = None


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
    mean, largest, turns = measure_motions(split, fitted)
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
                max_mrad=None if turns is None else float(turns[k]),
            )
        )
    return tuple(parameters)


def bootstrap_parameters(split: Split, fitted: Fit, rng: np.random.Generator) -> Bootstrap:
    """Bootstrap the training rows; the units are whole groups where the residuals of a group are
    correlated."""
    training = split.training
    data = training.data
    residual = fitted.residuals(training)
    positions = residual[:, :3]
    together = find_together(data, positions, rng)
    unit = data.block if together is None else together
    at = fitted.at()
    parts = fold_by_unit(training, fitted.terms, unit, at)
    boot = run_bootstrap(parts, fitted, rng)
    return replace(boot, grouped=together is not None)


def _differ(errors: Sequence[float], configurations: float) -> bool:
    """Whether standard errors differ by more than MAX_RATIO, and by more than the bootstrap's own
    chance: the logarithm of one that rests on n configurations has a standard deviation of
    1/√(2n)."""
    root = np.sqrt(2 * configurations)
    log_chance = MAX_DEVIATION / root
    chance = np.exp(log_chance)
    ratio = max(MAX_RATIO, float(chance))
    smallest = min(errors)
    largest = max(errors)
    limit = ratio * smallest
    return largest > limit


class ParameterMotions(NamedTuple):
    """The mean and the largest displacement (p,) [mm] of the target that each parameter causes, and how
    far it turns the target at most (p,) [mrad]; None where no orientation was measured."""

    mean_mm: Array
    max_mm: Array
    max_mrad: Array | None


def measure_motions(split: Split, fitted: Fit) -> ParameterMotions:
    """Measure how far each parameter (p,) moves and turns the target.

    Over all measured configurations without outliers, held out or not: the workspace as it was
    measured. Linear about the optimum."""
    good = ~split.outlying
    problem = split.problem.take(good)
    problem = problem.unweighted()
    rows = len(problem)
    theta = fitted.theta
    amount = np.abs(theta)
    amount = amount[:, None]
    count = len(theta)
    total = np.zeros(count)
    largest = np.zeros(count)
    turned = np.zeros(count)
    # the columns are displacements, and turns, per unit of a parameter
    at = fitted.at()
    for _, columns, _ in blocks(problem, fitted.terms, at):
        positions = columns[:, :3]
        length = np.linalg.norm(positions, axis=1)
        size = length * amount
        block_largest = size.max(1)
        total += size.sum(1)
        largest = np.maximum(largest, block_largest)
        rotations = columns[:, 3:]
        angle = np.linalg.norm(rotations, axis=1)
        turn = angle * amount
        block_turned = turn.max(1)
        turned = np.maximum(turned, block_turned)
    mean = total / rows
    if problem.components == 3:
        return ParameterMotions(mean, largest, None)
    turned_mrad = turned / MILLIRADIAN
    return ParameterMotions(mean, largest, turned_mrad)


def add_posterior(
    parameters: Sequence[Parameter], fitted: Fit, draws: Draws, sampling: Sampling
) -> tuple[Parameter, ...]:
    """Add the posterior's standard deviations: emcee's where it sampled the parameter and converged,
    else those of the closed-form draws weighted on the exact chain."""
    labels = label_terms(fitted.model)
    spread = {}
    for k in fitted.found.kept:
        name = labels[k]
        spread[name] = float(draws.spread[k])
    if sampling.converged:
        chain = zip(sampling.names, sampling.spread, strict=True)
        for name, value in chain:
            if name in spread:
                spread[name] = float(value)
    described = []
    for parameter in parameters:
        error = spread[parameter.symbol]
        errors = (parameter.standard_error, parameter.bootstrap_error, error)
        differ = _differ(errors, parameter.configurations)
        changed = replace(parameter, posterior_error=error, differ=differ)
        described.append(changed)
    return tuple(described)


def _name_parameter(parameter: Parameter) -> str:
    """Name a parameter with its mechanism, once."""
    owner = round_numbers(parameter.mechanism)
    symbol = parameter.symbol
    if f" of {owner}" in symbol:
        return symbol
    return f"{symbol} ({owner})"


def note_differences(parameters: Sequence[Parameter]) -> tuple[Note, ...]:
    """Warn of the parameters whose standard errors differ."""
    named = [_name_parameter(p) for p in parameters if p.differ]
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
            "rely on the largest.",
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
    owners = list_owners(model)
    labels = []
    for symbol, owner in zip(symbols, owners, strict=True):
        label = symbol
        if symbols.count(symbol) > 1:
            label = f"{symbol} of {round_numbers(owner)}"
        labels.append(label)
    numbers = number_repeated(labels)
    numbered = map(write_numbered, labels, numbers)
    return tuple(numbered)


def list_owners(model: Model) -> tuple[str, ...]:
    """Return, for every term, the name of the mechanism that brings it first."""
    first: dict[object, str] = {}
    for mechanism in model.mechanisms:
        for term in mechanism.terms:
            first.setdefault(term.key, mechanism.name)
    owners = []
    for term in model.terms:
        owner = first[term.key]
        owners.append(owner)
    return tuple(owners)


def mask_free_functions(model: Model) -> Mask:
    """Mask (p,) of the coefficients of free functions, alone or times another cause: none says
    anything alone."""
    inside = []
    for term in model.terms:
        causes = [screw.cause for screw in term.screws[:1]]
        is_free = any(find_bump(cause) is not None for cause in causes)
        inside.append(is_free)
    return np.array(inside, dtype=bool)


def correlate_parameters(fitted: Fit) -> Correlation:
    """Compute the correlation matrix of the fitted parameters, its strong pairs and clusters."""
    model = fitted.model
    # free functions have no coefficient of their own to compare
    inside = mask_free_functions(model)
    index = [k for k in fitted.found.kept if not inside[k]]
    factor = fitted.factor[index]
    length = np.linalg.norm(factor, axis=1)
    unit = factor / length[:, None]
    matrix = np.clip(unit @ unit.T, -1, 1)
    labels = label_terms(model)
    names = tuple(labels[k] for k in index)
    # parameters that rest on their prior are reported as not determined
    leaning = fitted.leaning
    determined = np.array([k not in leaning for k in index], dtype=bool)
    joined = _find_strong(matrix, determined)
    pairs = []
    for i, j in joined:
        r = float(matrix[i, j])
        pair = _describe_pair(names[j], names[i], r)
        pairs.append(pair)
    clusters = _cluster(names, joined)
    return Correlation(names, matrix, tuple(pairs), clusters)


def _find_strong(matrix: Array, determined: Mask) -> list[tuple[int, int]]:
    """Find the pairs (i, j), j < i, of determined parameters with a strong correlation, strongest
    first."""
    size = np.abs(matrix)
    below = np.tril(size > STRONG, -1)
    both = np.logical_and.outer(determined, determined)
    strong = below & both
    pairs = []
    for i, j in np.argwhere(strong):
        pair = (int(i), int(j))
        pairs.append(pair)
    return sorted(pairs, key=lambda pair: -abs(matrix[pair]))


def _describe_pair(a: str, b: str, r: float) -> Pair:
    """Describe what a strong correlation means."""
    relation = f"{a} and {b} rise and fall together" if r > 0 else f"{a} rises as {b} falls"
    sentence = (
        f"{relation} ({r:.3f}): the data determine one combination of them well, but neither alone."
    )
    return Pair(a, b, r, sentence)


def _cluster(
    names: Sequence[str], joined: Sequence[tuple[int, int]]
) -> tuple[tuple[str, ...], ...]:
    """Group the names that the pairs connect, each group in the names' order."""
    count = len(names)
    edges = np.array(joined, dtype=np.intp)
    component = connected_components(count, edges)
    labels = component.tolist()
    members: dict[int, list[str]] = {}
    for name, label in zip(names, labels, strict=True):
        group = members.setdefault(label, [])
        group.append(name)
    clusters = []
    for group in members.values():
        if len(group) > 1:
            cluster = tuple(group)
            clusters.append(cluster)
    return tuple(clusters)
