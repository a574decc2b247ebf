"""Tests of a difference of parameters: one by one, corrected for their number, and of all together, which
sees what parameters that the data hardly tell apart share."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..._linalg import orthonormal_basis
from ..._typing import Array, Index
from .common_space import CommonSpace
from .mechanism_changes import GEOMETRY_NAMES, Motions, two_sided_p

# that chance alone gives a difference of all parameters together, which is asked beside each of them
SIGNIFICANCE_TOGETHER = 0.01


def correct_holm(p: Array) -> Array:
    """Correct p-values (k,) for their number, step down (Holm 1979)."""
    count = len(p)
    order = np.argsort(p, kind="stable")
    ordered = p[order]
    remaining = np.arange(count, 0, -1)
    products = ordered * remaining
    stepped = np.maximum.accumulate(products)
    capped = np.minimum(stepped, 1.0)
    out = np.empty(count)
    out[order] = capped
    return out


def compute_p_of_each(space: CommonSpace, tested: Index) -> Array:
    """Compute the p-value of every representative, not corrected for their number."""
    differences = space.difference[tested]
    errors = space.standard_errors[tested]
    z = differences / errors
    p = []
    for value in z.tolist():
        chance = two_sided_p(value)
        p.append(chance)
    return np.array(p)


def compute_p_together(space: CommonSpace, tested: Index) -> float:
    """Compute the p-value of all representatives together, of their χ²; 1 where there are none."""
    from scipy.special import chdtrc

    factor = space.difference_factor[tested]
    lengths = np.linalg.norm(factor, axis=1)
    scaled = factor / lengths[:, None]
    basis = orthonormal_basis(scaled)
    rank = basis.shape[1]
    if not rank:
        return 1.0
    difference = space.difference[tested]
    within = basis.T @ (difference / lengths)
    own = basis.T @ scaled
    covariance = own @ own.T
    solved = np.linalg.solve(covariance, within)
    chi2 = float(within @ solved)
    return float(chdtrc(rank, chi2))


def open_names(space: CommonSpace, motions: Motions) -> CommonSpace:
    """Leave open how the geometry of two campaigns differs because one of them alone has a mechanism, or gives it
    another name: what the geometry follows of it stands in the mechanism there, in the geometry here."""
    is_geometry = np.array([_is_of_geometry(space, place) for place in space.kept.tolist()])
    count = len(space.terms)
    columns = motions.X.reshape(-1, count)
    of_geometry = columns[:, space.kept[is_geometry]]
    directions = []
    for campaign, places in _list_own(motions):
        motion = motions.whole(campaign, places)
        followed, *_ = np.linalg.lstsq(of_geometry, motion, rcond=None)
        direction = np.zeros(len(is_geometry))
        direction[is_geometry] = followed
        directions.append(direction)
    if not directions:
        return space
    open_directions = np.column_stack(directions)
    return replace(space, open_directions=open_directions)


def _list_own(motions: Motions) -> list[tuple[int, list[int]]]:
    """List what one campaign alone has, or calls so: its number, and the places of the terms."""
    named = [motions.locate_mechanisms(k) for k in range(2)]
    own = []
    for campaign, other in ((0, 1), (1, 0)):
        for name, places in named[campaign].items():
            if name not in named[other]:
                entry = campaign, places
                own.append(entry)
    return own


def _is_of_geometry(space: CommonSpace, place: int) -> bool:
    """Whether a term is of the geometry or the set-up."""
    term = space.terms[place]
    if term in space.placing:
        return True
    owner = space.owner.get(term.key)
    return owner in GEOMETRY_NAMES
