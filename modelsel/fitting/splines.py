"""Free functions are smooth: neighbouring coefficients of a spline go together, far ones do not.

Prior of a spline's coefficients: variance times the Matérn 3/2 correlation of their centres, at a
length of LENGTH knots (Rasmussen & Williams 2006, eq. 4.17). A penalised spline by another name;
its variance is found from the data."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from .._typing import Array, Index
from ..mechanisms.causes import Bump, Cause, factors
from ..mechanisms.terms import Term

LENGTH = 3.0  # knots over which a free function keeps its value, roughly
JITTER = 1e-6


def spline(term: Term) -> tuple[Bump, tuple[object, ...]] | None:
    """(the spline that a term is a coefficient of, what else it is: place, variable, width, other
    factors), or None."""
    if len(term.screws) != 1:
        return None
    parts = factors(term.screws[0].cause)
    bump = next((p for p in parts if isinstance(p, Bump)), None)
    if bump is None:
        return None
    others: tuple[Cause, ...] = tuple(p for p in parts if p is not bump)
    return bump, (term.screws[0].frame, term.screws[0].axis, bump.name, bump.width, others)


def splines(terms: Sequence[Term]) -> list[tuple[Index, Array]]:
    """(indices of the terms of one free function at one place, lower root (k, k) of their prior
    correlation), each."""
    own: dict[tuple[object, ...], list[int]] = {}
    centre = np.zeros(len(terms))
    for k, term in enumerate(terms):
        if (found := spline(term)) is not None:
            own.setdefault(found[1], []).append(k)
            centre[k] = found[0].centre / found[0].width
    out = []
    for members in own.values():
        index = np.array(members, dtype=np.intp)
        apart = np.sqrt(3) / LENGTH * np.abs(centre[index, None] - centre[index])
        out.append(
            (index, np.linalg.cholesky((1 + apart) * np.exp(-apart) + JITTER * np.eye(len(index))))
        )
    return out


def penalty(terms: Sequence[Term], precision: Array) -> Array:
    """(k, p) rows whose product with theta is to be nought, in units of the noise: the prior of
    terms with a `precision` (p,) [1/variance], correlated within a free function, alone
    otherwise."""
    out = np.diag(np.sqrt(precision))
    for index, root in splines(terms):
        if precision[index].any():
            out[np.ix_(index, index)] = np.sqrt(precision[index])[:, None] * np.linalg.inv(root)
    return out[precision > 0]
