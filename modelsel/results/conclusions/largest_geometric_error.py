"""The one error of the geometry that explains most of what the whole geometry does, such as a zero that a new
motor has moved: fitted whole, the geometry spreads it over parameters that the data hardly tell apart."""

from __future__ import annotations

from collections.abc import Hashable, Sequence
from typing import NamedTuple

import numpy as np

from ..._linalg import TINY, orthonormal_basis, project_out
from ..._typing import Array, Mask
from ...exceptions import choice_list, write_percent, write_rounded
from ...fitting.least_squares import Fit
from ...mechanisms.terms import Term
from ...robot.kinematics import Robot

GEOMETRIC = "geometric"
# directions of a geometry in which one stands out, and share of its squares from which one error is told
LEAST_RANK, LEAST_SHARE = 10, 0.75
# odds against another error below which it may be that one
CLEAR_ODDS = 20.0
# share of a column's length that must be left beyond the set-up's for it to be told
LEAST_OWN = 1e-2


class _Geometry(NamedTuple):
    """The geometry of a fit beyond everything else: its `terms`, their `columns` (k, g), the `response` (k,),
    and the `rank` of the columns."""

    terms: Sequence[Term]
    columns: Array
    response: Array
    rank: int

    @property
    def lengths(self) -> Array:
        """Lengths (g,) of the columns."""
        return np.asarray(np.linalg.norm(self.columns, axis=0))

    @property
    def along(self) -> Array:
        """The response along each column (g,)."""
        products = self.response @ self.columns
        return np.asarray(products / self.lengths)

    @property
    def sizes(self) -> Array:
        """The size (g,) of each error, taken alone."""
        return np.asarray(self.along / self.lengths)


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
    explained = np.square(geometry.along)
    basis = orthonormal_basis(geometry.columns)
    within = geometry.response @ basis
    together = float(within @ within)
    left = np.maximum(together - explained, 0.0)
    possible = _list_possible(left, geometry.rank)
    zeros = [k for k in possible if _is_zero(geometry.terms[k], robot)]
    told, *_ = [*zeros, *possible]
    share = float(explained[told]) / max(together, TINY)
    if share < LEAST_SHARE:
        return None
    term = geometry.terms[told]
    size = _write_size(term, float(geometry.sizes[told]))
    percent = write_percent(share)
    name = _name_error(term, robot)
    sentence = f"One error takes {percent} of what the geometry explains: {name} by about {size} ({term.symbol})."
    others = [geometry.terms[k] for k in possible if k != told]
    if not others:
        return sentence
    names = [f"{_name_error(other, robot)} ({other.symbol})" for other in others]
    return f"{sentence} It may also be that {choice_list(names)}."


def _list_possible(left: Array, rank: int) -> list[int]:
    """List the errors that it may be by what each leaves (g,) of the squares, the likeliest first."""
    directions = rank - 1
    limit = left.min() * CLEAR_ODDS ** (2 / directions)
    order = np.argsort(left, kind="stable")
    possible: list[int] = order[left[order] <= limit].tolist()
    return possible


def _write_size(term: Term, size: float) -> str:
    """Write the size [mm, rad] of an error of the geometry, of which two digits are known at most."""
    if _turns(term):
        mrad = write_rounded(1e3 * size, 2)
        return f"{mrad} mrad"
    mm = write_rounded(size, 2)
    return f"{mm} mm"


def _reduce(fit: Fit) -> _Geometry | None:
    """Reduce a fit's rows to its geometry, without what finds tracker and target; None where that is little."""
    is_geometry = _mark_geometry(fit)
    triangle = fit.reduction.R
    columns = triangle[:, :-1]
    response = triangle[:, -1] + columns @ fit.theta
    basis = orthonormal_basis(columns[:, ~is_geometry])
    own = columns[:, is_geometry]
    beyond = project_out(own, basis)
    left = project_out(response, basis)
    whole = np.linalg.norm(own, axis=0)
    lengths = np.linalg.norm(beyond, axis=0)
    is_own = lengths > LEAST_OWN * whole
    seen = beyond[:, is_own]
    rank = orthonormal_basis(seen).shape[1]
    if rank < LEAST_RANK:
        return None
    places = np.flatnonzero(is_geometry)[is_own]
    terms = [fit.terms[place] for place in places]
    return _Geometry(terms, seen, left, rank)


def _mark_geometry(fit: Fit) -> Mask:
    """Mark (p,) the terms of the geometry that no other mechanism has, such as what finds the tracker."""
    others = set[Hashable]()
    for mechanism in fit.model.mechanisms:
        if mechanism.name != GEOMETRIC:
            others |= {term.key for term in mechanism.terms}
    marks = [term.key not in others for term in fit.terms]
    return np.array(marks, dtype=bool)


def _turns(term: Term) -> bool:
    """Whether an error of the geometry turns a frame, else it shifts one."""
    (screw,) = term.screws
    kind = screw.axis[0]
    return kind == "r"


def _is_zero(term: Term, robot: Robot) -> bool:
    """Whether an error of the geometry is that of a joint's zero."""
    (screw,) = term.screws
    frame = screw.frame
    if frame > robot.n:
        return False
    slides = robot.prismatic[frame - 1]
    own = "tz" if slides else "rz"
    return screw.axis == own


def _name_error(term: Term, robot: Robot) -> str:
    """Name what an error of the geometry moves, and how."""
    (screw,) = term.screws
    frame = screw.frame
    axis = screw.axis[1]
    if _is_zero(term, robot):
        return f"the zero of joint {frame} is off"
    place = f"frame {frame}"
    if frame > robot.n:
        place = "the target"
    moved = "turned about" if _turns(term) else "off along"
    return f"{place} is {moved} {axis}"
