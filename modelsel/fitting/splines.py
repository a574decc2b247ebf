"""Free functions are smooth: neighbouring coefficients of a spline go together, far ones do not.

Prior of a spline's coefficients: variance times the Matérn 3/2 correlation of their centres, at a
length of LENGTH knots (Rasmussen & Williams 2006, eq. 4.17). A penalised spline by another name;
its variance is found from the data."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from .._typing import Array, Index
from ..mechanisms.causes import Bump, Cause, factors, find_bump
from ..mechanisms.terms import Term

LENGTH = 3.0  # knots over which a free function keeps its value, roughly
REMEMBERED = 16  # tuples of terms whose groups are kept: the models in play
JITTER = 1e-6  # added to the diagonal, so that the correlation has a root


def spline(term: Term) -> tuple[Bump, tuple[object, ...]] | None:
    """Return (the spline that a term is a coefficient of, what else it is: place, variable, width,
    other factors), or None."""
    if len(term.screws) != 1:
        return None
    screw = term.screws[0]
    bump = find_bump(screw.cause)
    if bump is None:
        return None
    others: tuple[Cause, ...] = tuple(p for p in factors(screw.cause) if p is not bump)
    return bump, (screw.frame, screw.axis, bump.name, bump.width, others)


def spline_groups(terms: Sequence[Term]) -> list[tuple[Index, Array]]:
    """Return, for each free function at one place, (indices of its terms, lower root (k, k) of
    their prior correlation)."""
    return [(group.terms, group.root) for group in _groups(tuple(terms))]


class _Group(NamedTuple):
    """A free function at one place: its `terms` by their indices, the lower root (k, k) of their
    prior correlation, and that root's inverse."""

    terms: Index
    root: Array
    inverse: Array


@lru_cache(maxsize=REMEMBERED)
def _groups(terms: tuple[Term, ...]) -> list[_Group]:
    """Group the terms of free functions."""
    groups: dict[tuple[object, ...], list[int]] = {}
    centre = np.zeros(len(terms))  # in knots
    for k, term in enumerate(terms):
        known = spline(term)
        if known is not None:
            bump, identity = known
            groups.setdefault(identity, []).append(k)
            centre[k] = bump.centre / bump.width
    out = []
    for group in groups.values():
        root = _root(centre[group])
        out.append(_Group(np.array(group, dtype=np.intp), root, np.asarray(np.linalg.inv(root))))
    return out


def _root(centre: Array) -> Array:
    """Lower root of the Matérn 3/2 correlation of coefficients centred at `centre` (k,) knots."""
    difference = centre[:, None] - centre
    scale = np.sqrt(3) / LENGTH
    span = np.abs(difference)
    distance = scale * span
    polynomial = 1 + distance
    decay = np.exp(-distance)
    correlation = polynomial * decay
    count = len(centre)
    identity = np.eye(count)
    jitter = JITTER * identity
    regular = correlation + jitter
    root: Array = np.linalg.cholesky(regular)
    return root


def penalty(terms: Sequence[Term], precision: Array) -> Array:
    """Return rows (k, p) whose product with theta is to be zero, in units of the noise: the prior
    of terms with a `precision` (p,) [1/variance], correlated within a free function, alone
    otherwise."""
    roots = np.sqrt(precision)
    out = np.diag(roots)
    for index, _, inverse in _groups(tuple(terms)):
        if precision[index].any():
            out[np.ix_(index, index)] = roots[index][:, None] * inverse
    is_held = precision > 0
    return out[is_held]
