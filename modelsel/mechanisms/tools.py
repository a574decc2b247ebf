"""What a tool or a gripper does on the flange: under its own weight and under a payload.

The flange's axis is that of the last joint, along whichever axis of the flange's frame it lies: along z by
convention, and along x of the last link of many URDF files."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import numpy as np

from .._typing import Array
from ..robot.gravity import find_gravity_joints
from ..robot.kinematics import Robot, find_flange_axis
from ..robot.rigid import AXES
from .bending import BENDING_PARTS, OF_ONE_KG, PLACE, PULL, cross, turn_target
from .causes import ONE, Cause, Named, sign
from .compliance import PAYLOAD
from .terms import Mechanism, Screw, Term

TOOL_DROOP = "tool-droop"
# mm: usual sizes of what a tool or a gripper yields
YIELD = (1e-3, 2.0)
# mm/kg: the same by a payload
YIELD_BY_LOAD = (1e-4, 1.0)
# rad/(N m) times the kg of a tool
TURN_BY_TOOL = (1e-8, 1e-2)
TOOL_PARTS = ("gripper or its fingers", "tool changer that yields", "loose target nest")
CANTILEVER = "cantilever beam; ISO 230-1, stiffness of spindles"
# share of a direction below which it has no part along an axis
NOTHING = 1e-9


def tool_droop(robot: Robot) -> Mechanism | None:
    """The tool bends sideways as gravity pulls across it: the target shifts with the gravity across
    the flange."""
    if not find_gravity_joints(robot):
        return None
    screws = _shift_by_pull(robot, _project_across(robot))
    return Mechanism(
        TOOL_DROOP,
        (Term("g", screws, YIELD, 1),),
        "The target shifts across the flange in proportion to the gravity across it.",
        "target offset = g · gravity direction across the flange axis",
        CANTILEVER,
        usual_causes=("tool that bends", "flange or tool changer that yields", "loose target nest"),
    )


def tool_bending(robot: Robot) -> Mechanism | None:
    """The tool turns where it is bolted on, or all along, in proportion to the moment of its weight there: of
    a target along the flange's axis this is `tool_droop`, of one aside it shifts along the axis, too."""
    if not find_gravity_joints(robot):
        return None
    moment = cross(PLACE, PULL)
    screws = turn_target(robot.n + 1, moment, OF_ONE_KG, load=ONE)
    return Mechanism(
        TOOL_DROOP,
        (Term("b", screws, TURN_BY_TOOL, 1),),
        "The target turns with its tool about the flange, in proportion to the moment of the tool's weight.",
        "rotation of the flange = b · moment of 1 kg at the target",
        CANTILEVER,
        usual_causes=("tool that bends", *BENDING_PARTS[:2]),
    )


def is_bending(mechanism: Mechanism) -> bool:
    """Return whether a mechanism is a tool that turns under its weight."""
    if mechanism.stem != TOOL_DROOP:
        return False
    screw = mechanism.terms[0].screws[0]
    return screw.axis.startswith("r")


def tool_stretch(robot: Robot) -> Mechanism | None:
    """The tool yields along the flange's axis: the target shifts with the gravity along it."""
    if robot.gravity is None:
        return None
    screws = _shift_by_pull(robot, _project_along(robot))
    return Mechanism(
        "tool-stretch",
        (Term("a", screws, YIELD, 1),),
        "The target shifts along the flange's axis in proportion to the gravity along it.",
        "target offset = a · gravity direction along the flange axis",
        "spring along its axis; ISO 230-1, stiffness of spindles",
        usual_causes=("spring or buffer in the tool", *TOOL_PARTS[1:]),
    )


def tool_play(robot: Robot) -> Mechanism | None:
    """The tool has play along the flange's axis: the target falls to the side that gravity pulls
    to."""
    if robot.gravity is None:
        return None
    screws = build_fall_screws(robot.n + 1, find_flange_axis(robot))
    return Mechanism(
        "tool-play",
        (Term("b", screws, YIELD, 1),),
        "The target falls from one side to the other along the flange's axis as gravity along it "
        "changes sign.",
        "target offset = b · sign of the gravity direction along the flange axis",
        "play along an axis; ISO 230-1, axial play",
        usual_causes=("tool changer with play", "tool that is not drawn tight"),
    )


def payload_droop(robot: Robot) -> Mechanism | None:
    """What holds the payload yields: the target shifts with the payload and the gravity in the
    flange, across it and along it."""
    if robot.gravity is None:
        return None
    payload = Named(PAYLOAD, "kg")
    terms = []
    for symbol, project in (("g", _project_across), ("a", _project_along)):
        screws = _shift_by_pull(robot, project(robot), payload)
        term = Term(f"{symbol}p", screws, YIELD_BY_LOAD, 1)
        terms.append(term)
    return Mechanism(
        "payload-droop",
        tuple(terms),
        "The target shifts on the flange in proportion to the payload, the way gravity pulls.",
        "target offset = payload_kg · (g across, a along) · gravity direction in the flange",
        CANTILEVER,
        usual_causes=TOOL_PARTS,
    )


def payload_shift(robot: Robot) -> Mechanism:
    """The target stands elsewhere on the flange with another payload, whatever way gravity pulls."""
    payload = Named(PAYLOAD, "kg")
    frame = robot.n + 1
    terms = tuple(Term(f"s{a}", (Screw(frame, a, payload),), YIELD_BY_LOAD) for a in AXES[:3])
    return Mechanism(
        "payload-shift",
        terms,
        "The target shifts on the flange in proportion to the payload, in a direction of its own.",
        "target offset = s · payload_kg",
        "a shift of the tool's frame; ISO 9283, drift of the pose",
        usual_causes=(
            "another gripper or tool with the payload, its target mounted elsewhere",
            "gripper that is closed on the payload",
        ),
    )


def build_fall_screws(flange: int, line: Array) -> tuple[Screw, ...]:
    """Build the screws that let the target fall to either side along a line (3,) of the flange's frame."""
    shares = []
    for share in line:
        rounded = float(f"{share:.6g}")
        shares.append(rounded if abs(share) > NOTHING else 0.0)
    pull = _weigh_pull(shares)
    side = sign(pull)
    causes = {}
    for k, share in enumerate(shares):
        if share:
            causes[k] = _scale(share, side)
    return _shift(flange, causes)


def _project_along(robot: Robot) -> Array:
    """Return the projection (3, 3) onto the flange's axis."""
    axis = find_flange_axis(robot)
    return np.outer(axis, axis)


def _project_across(robot: Robot) -> Array:
    """Return the projection (3, 3) onto the plane across the flange's axis."""
    whole = np.eye(3)
    along = _project_along(robot)
    return whole - along


def _shift_by_pull(robot: Robot, matrix: Array, load: Cause | None = None) -> tuple[Screw, ...]:
    """Build the screws that shift the target by a matrix (3, 3) times the direction of gravity in the flange's
    frame, times a load where there is one."""
    causes = {}
    for k, weights in enumerate(matrix):
        if weights.any():
            pull = _weigh_pull(weights)
            causes[k] = pull if load is None else load * pull
    return _shift(robot.n + 1, causes)


def _shift(flange: int, causes: Mapping[int, Cause]) -> tuple[Screw, ...]:
    """Build the screws that shift the target on the flange along axes (0 to 2), each by its cause."""
    return tuple(Screw(flange, AXES[k], cause) for k, cause in causes.items())


def _weigh_pull(weights: Iterable[float]) -> Cause:
    """Build the sum of the components of gravity's direction in the flange's frame, by weights (3,)."""
    parts = []
    for weight, axis in zip(weights, "xyz", strict=True):
        pull = Named(f"down_{axis}")
        if weight:
            part = _scale(weight, pull)
            parts.append(part)
    total, *others = parts
    for part in others:
        total = total + part
    return total


def _scale(weight: float, cause: Cause) -> Cause:
    """Build a number times a cause."""
    if weight == 1.0:
        return cause
    return float(weight) * cause
