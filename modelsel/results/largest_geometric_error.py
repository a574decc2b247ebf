"""The one error of the geometry that explains most of what the whole geometry does, such as a zero that a new
motor has moved: fitted whole, the geometry spreads it over parameters that the data hardly tell apart."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from .._linalg import TINY
from .._typing import Array
from ..exceptions import choice_list, write_percent, write_rounded
from ..fitting.least_squares import Fit
from ..mechanisms.terms import Term
from ..robot.kinematics import Robot

GEOMETRIC = "geometric"
# directions of a geometry in which one stands out, and share of its squares from which one error is told
LEAST_RANK, LEAST_SHARE = 10, 0.75
# odds against another error below which it may be that one
CLEAR_ODDS = 20.0
# share of a column's length that must be left beyond the set-up's for it to be told, and for it to be there
LEAST_OWN, OWN_SHARE = 1e-2, 1e-6


class _Geometry(NamedTuple):
    """The geometry of a fit beyond everything else: its `terms`, their `columns` (k, g), the `response` (k,),
    and the `rank` of the columns."""

    terms: Sequence[Term]
    columns: Array
    response: Array
    rank: int


def describe_largest_error(fit: Fit, robot: Robot) -> str | None:
    """Describe the one error of a fit's geometry that takes most of what the whole geometry explains, and which
    others it may be instead; None where no error does, or the model has no geometry. Of several, the zero of a joint
    is told first, as a motor that was changed moves that alone.

    The other errors of the geometry are taken as drawn from one normal distribution of unknown size: the odds of
    two errors are those of the squares that they leave, to the power of half of the directions that are left (the
    marginal likelihood of a normal sample over its scale, Box & Tiao 1973, section 2.4)."""
    geometry = _reduce(fit)
    if geometry is None:
        return None
    lengths = np.linalg.norm(geometry.columns, axis=0)
    along = geometry.response @ geometry.columns / lengths
    explained = np.square(along)
    basis = _span(geometry.columns)
    together = float(np.square(geometry.response @ basis).sum())
    directions = geometry.rank - 1
    left = together - explained
    limit = left.min() * CLEAR_ODDS ** (2 / directions)
    # the strongest first
    possible = [k for k in np.argsort(left, kind="stable").tolist() if left[k] <= limit]
    zeros = [k for k in possible if _is_zero(geometry.terms[k], robot)]
    told = zeros[0] if zeros else possible[0]
    share = float(explained[told]) / max(together, TINY)
    if share < LEAST_SHARE:
        return None
    term = geometry.terms[told]
    size = write_rounded(float(along[told] / lengths[told]) * (1e3 if _turns(term) else 1.0), 2)
    sentence = (
        f"One error takes {write_percent(share)} of what the geometry explains: {_name_error(term, robot)} by about "
        f"{size} {'mrad' if _turns(term) else 'mm'} ({term.symbol})."
    )
    others = [geometry.terms[k] for k in possible if k != told]
    if not others:
        return sentence
    names = [f"{_name_error(other, robot)} ({other.symbol})" for other in others]
    return f"{sentence} It may also be that {choice_list(names)}."


def _reduce(fit: Fit) -> _Geometry | None:
    """Reduce a fit's rows to its geometry, without what finds tracker and target; None where that is little."""
    others = [m for m in fit.model.mechanisms if m.name != GEOMETRIC]
    found_otherwise = {term.key for mechanism in others for term in mechanism.terms}
    is_geometry = np.array([term.key not in found_otherwise for term in fit.terms])
    triangle = fit.reduction.R
    columns = triangle[:, :-1]
    response = triangle[:, -1] + columns @ fit.theta
    basis = _span(columns[:, ~is_geometry])
    own = columns[:, is_geometry]
    beyond = own - basis @ (basis.T @ own)
    left = response - basis @ (basis.T @ response)
    is_own = np.linalg.norm(beyond, axis=0) > LEAST_OWN * np.linalg.norm(own, axis=0)
    beyond = beyond[:, is_own]
    rank = _span(beyond).shape[1]
    if rank < LEAST_RANK:
        return None
    terms = [fit.terms[k] for k in np.flatnonzero(is_geometry)[is_own]]
    return _Geometry(terms, beyond, left, rank)


def _span(columns: Array) -> Array:
    """Return an orthonormal basis (k, r) of what columns (k, n) span, each counted in its own unit."""
    lengths = np.linalg.norm(columns, axis=0)
    is_there = lengths > 0
    scaled = columns[:, is_there] / lengths[is_there]
    vectors, values, _ = np.linalg.svd(scaled, full_matrices=False)
    return np.asarray(vectors[:, values > OWN_SHARE * values.max(initial=0.0)])


def _turns(term: Term) -> bool:
    """Whether an error of the geometry turns a frame, else it shifts one."""
    return term.screws[0].axis[0] == "r"


def _is_zero(term: Term, robot: Robot) -> bool:
    """Whether an error of the geometry is that of a joint's zero."""
    (screw,) = term.screws
    if screw.frame > robot.n:
        return False
    return screw.axis == ("tz" if robot.prismatic[screw.frame - 1] else "rz")


def _name_error(term: Term, robot: Robot) -> str:
    """Name what an error of the geometry moves, and how."""
    (screw,) = term.screws
    if _is_zero(term, robot):
        return f"the zero of joint {screw.frame} is off"
    place = "the target" if screw.frame > robot.n else f"frame {screw.frame}"
    moved = "turned about" if _turns(term) else "off along"
    return f"{place} is {moved} {screw.axis[1]}"
