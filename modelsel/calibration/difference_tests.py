"""Tests of a difference of parameters: one by one, corrected for their number, and of all together, which
sees what parameters that the data hardly tell apart share."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from .._linalg import orthonormal_basis
from .._typing import Array, Index
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


def test_parameters(space: CommonSpace, tested: Index) -> Array:
    """Test every representative: p-values, not corrected for their number."""
    differences = space.difference[tested]
    errors = space.standard_errors[tested]
    z = differences / errors
    p_values = [two_sided_p(value) for value in z.tolist()]
    return np.array(p_values)


def test_together(space: CommonSpace, tested: Index) -> float:
    """Test all representatives together: p of their χ²; 1 where there are none."""
    from scipy.special import chdtrc

    factor = space.difference_factor[tested]
    lengths = np.linalg.norm(factor, axis=1)
    scaled = factor / lengths[:, None]
    basis = orthonormal_basis(scaled)
    if not basis.size:
        return 1.0
    within = basis.T @ (space.difference[tested] / lengths)
    covariance = basis.T @ scaled @ scaled.T @ basis
    chi2 = float(within @ np.linalg.solve(covariance, within))
    return float(chdtrc(basis.shape[1], chi2))


def open_names(space: CommonSpace, motions: Motions) -> CommonSpace:
    """Leave open how the geometry of two campaigns differs because one of them alone has a mechanism, or gives it
    another name: what the geometry follows of it stands in the mechanism there, in the geometry here."""
    geometry = [k for k, place in enumerate(space.kept) if _is_followed(space, int(place))]
    columns = motions.X.reshape(-1, len(space.terms))
    of_geometry = columns[:, space.kept[geometry]]
    named = [motions.locate_mechanisms(k) for k in range(2)]
    directions = []
    for k, other in ((0, named[1]), (1, named[0])):
        for name, places in named[k].items():
            if name in other:
                continue
            followed, *_ = np.linalg.lstsq(of_geometry, motions.whole(k, places), rcond=None)
            direction = np.zeros(len(space.kept))
            direction[geometry] = followed
            directions.append(direction)
    if not directions:
        return space
    return replace(space, open_directions=np.column_stack(directions))


def _is_followed(space: CommonSpace, place: int) -> bool:
    """Whether a term is of the geometry or the set-up."""
    term = space.terms[place]
    return term in space.placing or space.owner.get(term.key) in GEOMETRY_NAMES
