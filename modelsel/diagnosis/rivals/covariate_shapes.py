"""A finding's own shape that changes with a covariate: play that grows with the load, a gear that errs
more as it gets warm.

Beside a finding that changes along the campaign they stand in the place of time: what changed
meanwhile may be a covariate that was written down."""

from __future__ import annotations

from collections.abc import Collection, Iterator

from ...fitting.problem import Problem
from ...mechanisms.causes import Cause, Named, cos, q, sin
from ...mechanisms.terms import Mechanism
from ..shapes.distinct_places import Place
from ..shapes.driver_functions import IN_TIME, list_varying, scale_driver
from ..shapes.unregistered import build_cell
from .changing_shapes import MOST_TERMS, change
from .free_functions import build_free, generate_shapes, has_shape


def generate_by_covariates(problem: Problem, found: Mechanism) -> Iterator[Mechanism]:
    """Generate a finding's shape with that shape times each covariate. None for a finding that depends
    on a covariate or on time already."""
    covariates = list_varying(problem)
    excluded = IN_TIME.union(covariates)
    known = found.names() & excluded
    count = len(found.terms)
    if known or count > MOST_TERMS:
        return
    for name in covariates:
        driver = scale_driver(problem, name)
        yield change(found, driver)


def generate_instead_of_time(problem: Problem, found: Mechanism) -> Iterator[list[Mechanism]]:
    """Generate what moves one place with something else and the course of the campaign, with a covariate
    in the place of time; those of one covariate together. None for any other finding."""
    place, others = _find_place(found, IN_TIME)
    if place is None:
        return
    (own,) = others
    for name in list_varying(problem):
        if name == own:
            continue
        shapes = _build_products(problem, place, own, name)
        if has_shape(problem, name):
            shapes += _build_free_shapes(problem, place, own, name)
        yield shapes


def _find_place(found: Mechanism, names: Collection[str]) -> tuple[Place | None, frozenset[str]]:
    """Find the one place of a finding that depends on some names and one more, and that one; None for
    any other finding."""
    drivers = found.names()
    others = drivers.difference(names)
    places = list(found.names_by_place())
    is_one = len(places) == 1 and len(others) == 1
    if not is_one or others == drivers:
        return None, others
    return places[0], others


def _build_free_shapes(problem: Problem, place: Place, own: str, name: str) -> list[Mechanism]:
    """Build free functions of a driver that a place has and a covariate."""
    frame, _ = place
    if has_shape(problem, own):
        drivers = frozenset((own, name))
        both = {place: drivers}
        return list(generate_shapes(problem, both))
    if own != f"approach{frame}":
        return []
    side = Named(own)
    free = build_free(problem, [place], name, [side])
    return [free]


def generate_wave_products(problem: Problem, found: Mechanism) -> Iterator[Mechanism]:
    """Generate a joint's wave once a turn times a covariate, alone and beside the wave. None for a
    finding that does not move one joint with its own reading and a covariate."""
    first = found.terms[0].screws[0]
    own = f"q{first.frame}"
    place, others = _find_place(found, (own,))
    if place is None:
        return
    (name,) = others
    varying = list_varying(problem)
    if name in varying:
        yield from _build_products(problem, place, own, name)


def _list_functions(problem: Problem, frame: int, own: str) -> list[Cause]:
    """List the functions of a driver that a factor may change: of a turning joint's own angle its wave
    once a turn."""
    unit = problem.names()[own]
    if own != f"q{frame}" or unit != "rad":
        return [Named(own, unit)]
    angle = q(frame)
    sine = sin(angle)
    cosine = cos(angle)
    return [sine, cosine]


def _build_products(problem: Problem, place: Place, own: str, name: str) -> list[Mechanism]:
    """Build functions of a driver at a place times a covariate, alone and beside the functions."""
    frame, _ = place
    factor = scale_driver(problem, name)
    functions = _list_functions(problem, frame, own)
    products = []
    for function in functions:
        product = function * factor
        products.append(product)
    every = [*functions, *products]
    alone = build_cell(place, tuple(products))
    beside = build_cell(place, tuple(every))
    return [alone, beside]
