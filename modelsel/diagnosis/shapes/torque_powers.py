"""Functions of the gravity torque about a joint: its powers, as a spring that hardens or softens has
them, or a contact that closes, and a lost motion that grows with it, as friction does. They are told as
what they are, without a cause."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from ...fitting.problem import Problem
from ...mechanisms.causes import Applied, Cause, Named, Number, torque
from ...mechanisms.compliance import OF_BOTH, PAYLOAD
from ...mechanisms.motors import (
    drive_screws,
    find_gravity_motors,
    joint_axis,
    motor_torque,
    name_drive,
)
from ...mechanisms.terms import Mechanism, Term
from .unregistered import build_cell
from .whole_torques import find_load

# the power of which an error is looked for everywhere; the others stand beside a finding
SQUARE = "2"


def build_powers(problem: Problem, joint: int, load: Cause | None = None) -> dict[str, Mechanism]:
    """Build a joint's motions with powers of its torque over the typical one, by the power. `load`: one
    of `list_torques`, by default of the arm's own weight."""
    share = scale_torque(problem, joint, load)
    if share is None:
        return {}
    size = Applied("abs", share)
    root = Applied("root", share)
    powers = {
        "0.5": root,
        "1.5": size * root,
        SQUARE: size * share,
        "2.5": size * size * root,
        "3": size * size * share,
    }
    place = joint, joint_axis(problem.robot, joint)
    built = {}
    for power, cause in powers.items():
        words = f"{name_load(joint, load)} to the power {power}"
        of_both = OF_BOTH if load is not None and PAYLOAD in load.names() else ""
        sentence = (
            f"Joint {joint} yields with the gravity torque about it{of_both} to the power {power}"
        )
        built[power] = build_cell(place, (cause,), words, sentence)
    return built


def name_load(joint: int, load: Cause | None) -> str:
    """Name the torque about a joint, of the arm's own weight or with the payload's."""
    name = f"torque{joint}"
    if load is None:
        return name
    names = load.names()
    if PAYLOAD in names:
        return f"{name} with the payload"
    return name


def scale_torque(problem: Problem, joint: int, load: Cause | None = None) -> Cause | None:
    """A joint's torque over the typical one; None where there is none. `load`: as of `build_powers`."""
    if load is None:
        load = torque(joint)
    values = np.asarray(load.of(problem.state))
    size = np.abs(values)
    mean = size.mean()
    typical = float(f"{mean:.4g}")
    if not typical:
        return None
    return load / Number(typical, load.unit)


def generate_loaded(problem: Problem, motor: int) -> Iterator[Mechanism]:
    """Generate a drive's motion with the direction that it came from, more or less with the torque that it
    holds; none for a drive without load."""
    robot = problem.robot
    if motor not in find_gravity_motors(robot):
        return
    load = motor_torque(robot, motor)
    share = scale_torque(problem, motor, load)
    if share is None:
        return
    name = f"approach{motor}"
    drive = name_drive(robot, motor)
    axis = joint_axis(robot, motor)
    direction = Named(name)
    loaded = direction * Applied("abs", share)
    words = f"{name} and its product with the size of {load}"
    turns = [drive_screws(robot, motor, cause) for cause in (direction, loaded)]
    terms = tuple(Term(f"m{k}", screws) for k, screws in enumerate(turns, 1))
    sentence = (
        f"{drive.capitalize()} stops beside its reading, on a side that depends on where it came from, by "
        "more or less with the gravity torque about it"
    )
    yield Mechanism(f"{motor} {axis} {words}", terms, sentence)


def generate_powers(problem: Problem, found: Mechanism) -> Iterator[Mechanism]:
    """Generate powers of the torque about a joint that moves with it. None for any other finding."""
    places = list(found.names_by_place())
    joint, axis = places[0]
    if len(places) > 1 or joint > problem.robot.n:
        return
    load = find_load(problem.robot, joint, found.names())
    if axis == joint_axis(problem.robot, joint) and load is not None:
        yield from build_powers(problem, joint, load).values()
