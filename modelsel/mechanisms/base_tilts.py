"""A base that yields to the moment of the arm's weight: with the masses that are declared (or unit ones), with the
payload besides, or with masses that are not known."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from ..robot.gravity import declares_masses, declares_masses_beyond, loads_base
from ..robot.kinematics import Robot
from .beams import name_moments
from .bodies import list_bodies, list_main_bodies, list_tilting
from .compliance import DECLARED, HEAVY, UNKNOWN, WITH_PAYLOAD
from .gravity_effects import (
    NAMES,
    UNITS,
    YIELDING_BASE,
    base_screws,
    list_base_loads,
    list_level_axes,
)
from .terms import Mechanism, Screw, Term

TILT = (1e-8, 1e-4)
# masses that are not known, at the main joints alone: one compliance for all directions, or one for each axis
OF_MAIN, OF_MAIN_BY_AXIS = 3, 4
# the base as the link before joint 1
GROUND = 0
# cosine of an axis that counts as upright
UPRIGHT = 0.999
SOURCE = "Whitney, Lozinski & Rourke 1986"


def list_tilts(robot: Robot) -> tuple[int, ...]:
    """List the loads that the base may tilt with: the arm's weight, where masses are declared that with the
    payload's, and where not all of them are, that of masses that are not known; none where the weight does
    not tip it."""
    if not loads_base(robot):
        return ()
    loads = [DECLARED]
    if declares_masses(robot):
        loads.append(WITH_PAYLOAD)
    if not declares_masses_beyond(robot, 1):
        loads += _list_unknown(robot)
    return tuple(loads)


def _list_unknown(robot: Robot) -> list[int]:
    """List the ways in which a base may tilt under masses that are not known; none below a slide, whose frame has no
    moment along it."""
    if robot.prismatic[0]:
        return []
    each = _list_bodies(robot, UNKNOWN)
    main = _list_bodies(robot, OF_MAIN)
    if not main:
        return []
    if main == each:
        return [OF_MAIN, OF_MAIN_BY_AXIS]
    return [UNKNOWN, OF_MAIN, OF_MAIN_BY_AXIS]


def _list_bodies(robot: Robot, load: int) -> tuple[int, ...]:
    """List the frames of masses that are not known and tip the base: at every joint, or at the main ones."""
    list_loads = list_bodies if load == UNKNOWN else list_main_bodies
    bodies = list_loads(robot, GROUND)
    return list_tilting(robot, GROUND + 1, bodies)


def base_tilt(robot: Robot, load: int) -> Mechanism:
    """The foundation yields to the arm's moment about the two horizontal axes of frame 0 (`load`: one of
    `list_tilts`)."""
    of_both = load == WITH_PAYLOAD
    if of_both or load == DECLARED:
        return _tilt_by_all(robot, of_both)
    bodies = _list_bodies(robot, load)
    by_axis = load == OF_MAIN_BY_AXIS
    terms = list(_list_terms(robot, bodies, by_axis))
    frames = ", ".join(map(str, bodies))
    loads = f", of masses that are not known at frames {frames},"
    return _build(terms, "", loads)


def _tilt_by_all(robot: Robot, of_both: bool) -> Mechanism:
    """Build the tilt of a base under all masses together, with the payload's or not."""
    terms = []
    axes = list_level_axes(robot)
    loads = list_base_loads(robot)
    for axis, (own, held) in zip(axes, loads.items(), strict=True):
        moment = own
        if of_both:
            moment = own + held
        direction = UNITS[axis]
        screws = base_screws(robot, direction, moment)
        symbol = f"k{NAMES[axis]}"
        term = Term(symbol, screws, TILT, 1)
        terms.append(term)
    payload = " and of the payload, with the masses as declared" if of_both else ""
    return _build(terms, payload, payload)


def _build(terms: Sequence[Term], besides: str, loads: str) -> Mechanism:
    return Mechanism(
        "base-tilt",
        tuple(terms),
        f"The base tilts in proportion to the moment of the arm's weight{besides}.",
        f"rotation of frame 0 = k · moment of the weight{loads} about it",
        SOURCE,
        usual_causes=YIELDING_BASE,
    )


def _list_terms(robot: Robot, bodies: Sequence[int], by_axis: bool) -> Iterator[Term]:
    """List the terms of a base that tilts under masses that are not known: one for each mass, or for each
    mass and axis."""
    for body in bodies:
        every: list[Screw] = []
        for axis, screws in _list_tilts(robot, body):
            every += screws
            if by_axis:
                yield Term(f"k{axis}m{body}", screws, HEAVY, 1)
        if not by_axis:
            screws = tuple(every)
            yield Term(f"km{body}", screws, HEAVY, 1)


def _list_tilts(robot: Robot, body: int) -> Iterator[tuple[str, tuple[Screw, ...]]]:
    """List the turns of the base by 1 kg at a body, about each axis of frame 1 that is not upright."""
    first = robot.joints[0]
    axes = first.before[:3, :3].T
    gravity = robot.gravity or (0.0, 0.0, 0.0)
    upright = np.abs(axes @ gravity)
    moments = name_moments(robot, GROUND + 1, body)
    for axis, direction, share in zip(NAMES, axes, upright, strict=True):
        moment = moments.get(axis)
        if moment is None or share > UPRIGHT:
            continue
        screws = base_screws(robot, direction, moment)
        yield axis, screws
