"""A finding's own shape that changes with a covariate: play that grows with the load, a gear that errs
more as it gets warm.

Beside a finding that changes along the campaign they stand in the place of time: what changed
meanwhile may be a covariate that was written down."""

from __future__ import annotations

from collections.abc import Iterator

from ..fitting.problem import Problem
from ..mechanisms.causes import Cause, Named, cos, q, sin
from ..mechanisms.terms import Mechanism
from .changing_shapes import MOST_TERMS, change
from .distinct_places import Place
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
        functions = _list_functions(problem, frame, own)
        shapes = _build_products(places[0], functions, scaled)
        if own == f"approach{frame}" and has_shape(problem, name):
            shapes.append(build_free(problem, places, name, (Named(own),)))
        if has_shape(problem, own) and has_shape(problem, name):
            drivers = frozenset((own, name))
            shapes += generate_shapes(problem, {places[0]: drivers})
        yield shapes


def generate_wave_products(problem: Problem, found: Mechanism) -> Iterator[Mechanism]:
    """Generate a joint's wave once a turn times a covariate, alone and beside the wave. None for a
    finding that does not move one joint with its own reading and a covariate."""
    places = list(found.names_by_place())
    frame, _ = places[0]
    own = f"q{frame}"
    others = found.names() - {own}
    if len(places) != 1 or len(others) != 1 or others == found.names():
        return
    (name,) = others
    if name in list_varying(problem):
        scaled = scale_driver(problem, name)
        yield from _build_products(places[0], _list_functions(problem, frame, own), scaled)


def _list_functions(problem: Problem, frame: int, own: str) -> list[Cause]:
    """List the functions of a driver that a factor may change: of a turning joint's own angle its wave
    once a turn."""
    unit = problem.names()[own]
    if own != f"q{frame}" or unit != "rad":
        return [Named(own, unit)]
    angle = q(frame)
    return [sin(angle), cos(angle)]


def _build_products(place: Place, functions: list[Cause], factor: Cause) -> list[Mechanism]:
    """Build functions times a factor at a place, alone and beside the functions."""
    products = [function * factor for function in functions]
    return [build_cell(place, tuple(products)), build_cell(place, (*functions, *products))]
