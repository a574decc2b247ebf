"""Distortions of what an instrument measures, smooth in where the target is.

A camera's lens, or the calibration of several cameras, errs smoothly over the volume that is measured,
and not as the angles and distances of a laser tracker do. Such a field stands against an error of the
instrument that was found."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import reduce
from itertools import combinations_with_replacement
from operator import mul

import numpy as np

from ...fitting.problem import Problem
from ...measurements.campaign.state_names import is_where_target_is
from ...mechanisms.causes import Cause, cos, sin
from ...mechanisms.instrument import FAR, FIELDS, RADIAL, ZENITH, shift_across_axis
from ...mechanisms.terms import Mechanism, Screw, Term
from ...robot.kinematics import Robot
from ..shapes.driver_functions import scale_driver

# angle to its axis up to which a camera sees [rad]
WIDEST = np.pi / 3
PLACES = ("x_mm", "y_mm", "z_mm")
AXES = ("tx", "ty", "tz")


def is_seen_wrongly(found: Mechanism) -> bool:
    """Return whether a mechanism shifts what is measured by where the target is, and by nothing else."""
    shifts = {(1, axis) for axis in AXES}
    by_place = found.names_by_place()
    names = found.names()
    return bool(names) and by_place.keys() <= shifts and all(map(is_where_target_is, names))


def generate_distortions(problem: Problem, found: Mechanism) -> Iterator[Mechanism]:
    """Generate distortions of all three coordinates in place of an error of the instrument that follows
    from where the target is; none for any other finding."""
    if not is_seen_wrongly(found):
        return
    if _is_in_front(problem):
        yield _build_lens(problem.robot)
    scaled = [scale_driver(problem, name) for name in PLACES]
    monomials: list[Cause] = list(scaled)
    for degree, name in FIELDS.items():
        monomials += _multiply(scaled, degree)
        yield _build_field(name, monomials)


def _is_in_front(problem: Problem) -> bool:
    """Return whether all targets are in front of a camera that looks along the z axis of its frame."""
    if not problem.stands_apart:
        return False
    zenith = problem.state.value("beam_zenith")
    nadir = np.pi - zenith
    aside = np.minimum(zenith, nadir)
    widest = aside.max()
    return bool(widest < WIDEST)


def _build_lens(robot: Robot) -> Mechanism:
    """Build the radial distortion of a lens: what is seen at an angle θ to its axis is shifted from that,
    in proportion to the third and fifth powers of tan θ (Brown 1971, Photogramm. Eng. 37, 855)."""
    terms = []
    sine, cosine = sin(ZENITH), cos(ZENITH)
    amount = FAR * sine
    for number in (1, 2):
        tangent = sine / cosine
        amount = amount * tangent * tangent
        outwards = shift_across_axis(robot, amount)
        term = Term(f"k{number}", outwards)
        terms.append(term)
    return Mechanism(
        RADIAL,
        tuple(terms),
        "The instrument measures wrongly, as a lens does that distorts.",
        usual_causes=("lens of a camera",),
    )


def _multiply(coordinates: Sequence[Cause], degree: int) -> Iterator[Cause]:
    """Multiply so many coordinates in every way."""
    for factors in combinations_with_replacement(coordinates, degree):
        yield reduce(mul, factors)


def _build_field(name: str, monomials: Sequence[Cause]) -> Mechanism:
    """Build a polynomial of where the target is, with coefficients of its own for every coordinate."""
    terms = []
    for axis in AXES:
        for number, monomial in enumerate(monomials, 1):
            screw = Screw(1, axis, monomial)
            term = Term(f"{axis[1]}{number}", (screw,))
            terms.append(term)
    return Mechanism(
        name,
        tuple(terms),
        "The instrument measures wrongly, by a smooth function of where the target is.",
        usual_causes=("lens of a camera", "calibration of several cameras to one another"),
    )
