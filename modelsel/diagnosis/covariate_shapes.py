"""A finding's own shape that changes with a covariate: play that grows with the load, a gear that errs
more as it gets warm.

Beside a finding that changes along the campaign they stand in the place of time: what changed
meanwhile may be a covariate that was written down."""

from __future__ import annotations

from collections.abc import Iterator

from ..fitting.problem import Problem
from ..mechanisms.causes import ONE, Cause, Named, cos, q, sin
from ..mechanisms.terms import Mechanism
from .changing_shapes import MOST_TERMS, change
from .driver_functions import IN_TIME, list_varying, scale_driver
from .free_functions import build_free, generate_shapes, has_shape
from .unregistered import build_cell


def generate_by_covariates(problem: Problem, found: Mechanism) -> Iterator[Mechanism]:
    """Generate a finding's shape with that shape times each covariate. None for a finding that depends
    on a covariate or on time already."""
    covariates = list_varying(problem)
    known = found.names() & (IN_TIME | set(covariates))
    if len(found.terms) > MOST_TERMS or known:
        return
    for name in covariates:
        yield change(found, scale_driver(problem, name))


def generate_instead_of_time(problem: Problem, found: Mechanism) -> Iterator[list[Mechanism]]:
    """Generate what moves one place with something else and the course of the campaign, with a covariate
    in the place of time; those of one covariate together. None for any other finding."""
    places = list(found.names_by_place())
    others = found.names() - IN_TIME
    if len(places) != 1 or len(others) != 1 or others == found.names():
        return
    (own,) = others
    frame, _ = places[0]
    for name in list_varying(problem):
        if name == own:
            continue
        scaled = scale_driver(problem, name)
        shapes = [build_cell(places[0], _list_products(frame, own, scaled))]
        if own == f"approach{frame}" and has_shape(problem, name):
            shapes.append(build_free(problem, places, name, (Named(own),)))
        if has_shape(problem, own) and has_shape(problem, name):
            drivers = frozenset((own, name))
            shapes += generate_shapes(problem, {places[0]: drivers})
        yield shapes


def _list_products(frame: int, own: str, factor: Cause) -> tuple[Cause, ...]:
    """List a driver, of a reading its wave once a turn, and the same times a factor."""
    causes: tuple[Cause, ...] = (Named(own),)
    if own == f"q{frame}":
        angle = q(frame)
        causes = (sin(angle), cos(angle))
    return tuple(one if by == ONE else one * by for by in (ONE, factor) for one in causes)
