"""A base that yields to the moment of the arm's weight: with the masses that are declared (or unit ones), with the
payload besides, or with masses that are not known."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from ..robot.gravity import declares_masses, declares_masses_beyond, loads_base
from ..robot.kinematics import Robot
from .beams import name_moments
from .bodies import list_bodies, list_main_bodies
from .causes import Cause
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
    """List the ways in which a base may tilt under masses that are not known."""
    each = list_bodies(robot, GROUND)
    main = list_main_bodies(robot, GROUND)
    if not main:
        return []
    if main == each:
        return [OF_MAIN, OF_MAIN_BY_AXIS]
    return [UNKNOWN, OF_MAIN, OF_MAIN_BY_AXIS]


def base_tilt(robot: Robot, load: int) -> Mechanism:
    """The foundation yields to the arm's moment about the two horizontal axes of frame 0 (`load`: one of
    `list_tilts`)."""
    if load in (DECLARED, WITH_PAYLOAD):
        return _tilt_by_all(robot, of_both=load == WITH_PAYLOAD)
    bodies = list_bodies(robot, GROUND) if load == UNKNOWN else list_main_bodies(robot, GROUND)
    terms = list(_list_terms(robot, bodies, by_axis=load == OF_MAIN_BY_AXIS))
    frames = ", ".join(map(str, bodies))
    return _build(terms, "", f", of masses that are not known at frames {frames},")


def _tilt_by_all(robot: Robot, of_both: bool) -> Mechanism:
    """Build the tilt of a base under all masses together, with the payload's or not."""
    terms = []
    for axis, (own, held) in zip(
        list_level_axes(robot), list_base_loads(robot).items(), strict=True
    ):
        moment = own + held if of_both else own
        screws = base_screws(robot, UNITS[axis], moment)
        terms.append(Term(f"k{NAMES[axis]}", screws, TILT, 1))
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
    turn = robot.joints[0].before[:3, :3]
    for body in bodies:
        tilts: list[tuple[str, tuple[Screw, ...]]] = []
        for axis, moment in _list_moments(robot, body).items():
            direction = turn[:, NAMES.index(axis)]
            tilts.append((axis, base_screws(robot, direction, moment)))
        if by_axis:
            for axis, screws in tilts:
                yield Term(f"k{axis}m{body}", screws, HEAVY, 1)
        else:
            every = tuple(screw for _, screws in tilts for screw in screws)
            yield Term(f"km{body}", every, HEAVY, 1)


def _list_moments(robot: Robot, body: int) -> dict[str, Cause]:
    """List the moments of 1 kg at a body about the axes of frame 1 that are not upright."""
    upright = robot.joints[0].before[:3, :3].T @ (robot.gravity or (0.0, 0.0, 0.0))
    moments = name_moments(robot, GROUND + 1, body)
    return {
        axis: moment for axis, moment in moments.items() if abs(upright[NAMES.index(axis)]) < 0.999
    }
