"""Which parameters the data tell only together: the correlation matrix, clusters, and the worst pairs in words."""
from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from .._typing import Array
from ..fitting.design import Model
from ..fitting.least_squares import Fit
from ..mechanisms.causes import Bump

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
    """Of the estimable parameters (the coefficients of free functions apart): names, matrix, pairs above 0.9, strongest first,
    and the clusters that such pairs join."""

    symbols: tuple[str, ...]
    matrix: Array = field(repr=False)
    pairs: tuple[Pair, ...]
    clusters: tuple[tuple[str, ...], ...]


def labels(model: Model) -> tuple[str, ...]:
    """A name of its own for every term: its symbol; where two terms share one, the mechanism is added, and a number where a
    mechanism is in the model with several constants."""
    symbols = [t.symbol for t in model.terms]
    longer = [s if symbols.count(s) == 1 else f"{s} of {owner}" for s, owner in zip(symbols, owners(model), strict=True)]
    return tuple(s if longer.count(s) == 1 else f"{s} ({longer[:k].count(s) + 1})" for k, s in enumerate(longer))


def owners(model: Model) -> tuple[str, ...]:
    """The name of the mechanism that brings each term first."""
    first: dict[object, str] = {}
    for m in model.mechanisms:
        for t in m.terms:
            first.setdefault(t.screws, m.name)
    return tuple(first[t.screws] for t in model.terms)


def free(model: Model) -> Array:
    """(p,) mask of the coefficients of free functions."""
    return np.array([isinstance(t.screws[0].cause, Bump) for t in model.terms], dtype=bool)


def correlation(fitted: Fit) -> Correlation:
    """Of a fit."""
    inside = free(fitted.model)
    index = [k for k in fitted.found.kept if not inside[k]]
    factor = fitted.factor[index]
    unit = factor / np.linalg.norm(factor, axis=1)[:, None]
    matrix = np.clip(unit @ unit.T, -1, 1)
    every = labels(fitted.model)
    names = [every[k] for k in index]
    known = [k not in fitted.leaning for k in index]            # of the others it is said that the data do not tell them
    strong = [(i, j) for i in range(len(index)) for j in range(i) if known[i] and known[j] and abs(matrix[i, j]) > STRONG]
    strong.sort(key=lambda pair: -abs(matrix[pair]))
    pairs = tuple(Pair(names[j], names[i], float(matrix[i, j]), _sentence(names[j], names[i], float(matrix[i, j])))
                  for i, j in strong)
    return Correlation(tuple(names), matrix, pairs, clusters(names, strong))


def _sentence(a: str, b: str, r: float) -> str:
    """What a strong correlation means."""
    if r > 0:
        return f"{a} and {b} rise and fall together ({r:.3f}): the data tell their difference well, each alone poorly."
    return f"{a} rises as {b} falls ({r:.3f}): the data tell their sum well, each alone poorly."


def clusters(names: Sequence[str], joined: Sequence[tuple[int, int]]) -> tuple[tuple[str, ...], ...]:
    """Groups that the pairs join, each in the names' order."""
    group = list(range(len(names)))
    for i, j in joined:
        old, new = max(group[i], group[j]), min(group[i], group[j])
        group = [new if g == old else g for g in group]
    members: dict[int, list[str]] = {}
    for name, g in zip(names, group, strict=True):
        members.setdefault(g, []).append(name)
    return tuple(tuple(m) for m in members.values() if len(m) > 1)
