"""What gravity does: twist of the arm's two great joints, backlash that it takes up, tilt of the
base."""

from __future__ import annotations

import numpy as np

from .._typing import Array
from ..robot.gravity import ArmPair, declares_masses, find_arm_pair, loads_base
from ..robot.kinematics import Robot
from ..robot.rigid import AXES
from .bending import OF_ONE_KG
from .causes import Cause, Named, Number, cos, q, shifted, sign
from .compliance import OF_BOTH, PAYLOAD, WINDING_PARTS, whole_torque
from .motors import drive_angle, drive_screws, knows_held_masses, motor_torque, name_drive
from .terms import Mechanism, Screw, Term

PAPER = "Chen & Chao 1987, positioning error analysis of robots with rotary joints, Eq. 6-7"
TWIST = (2e-5, 1e-2)  # rad at full lever: 10 N m … 1 kN m over 1e5 … 1e6 N m/rad
# what may decide the side on which gravity holds a joint: its torque, the lever of the forearm, or the
# torque with the payload's
BY_TORQUE, BY_FOREARM, BY_WHOLE = 0, 1, 2
BACKLASH = (2e-5, 2e-3)  # rad
# rad to either side, and directions of the edges [degrees], which are at right angles
ROCKING = (2e-6, 5e-3)
EDGES = tuple(5.0 * k for k in range(18))
# parts that usually make a base rock
ROCKING_BASE = ("loose anchor bolts", "foot that does not stand", "base plate that is not flat")
# parts that usually make a base tilt
YIELDING_BASE = ("floor or pedestal", "anchor bolts", "bearing of joint 1")
UNITS = np.eye(3)
NAMES = "xyz"


def upper_arm_lever(pair: ArmPair) -> Cause:
    """Return the lever of the upper arm: cos(q2) on the paper's arm."""
    angle = q(pair.upper)
    phase = pair.near_phase
    return cos(shifted(angle, phase))


def forearm_lever(pair: ArmPair) -> Cause:
    """Return the lever of the forearm: cos(q2+q3) on the paper's arm."""
    upper = q(pair.upper)
    fore = q(pair.fore)
    angle = upper - fore
    if pair.parallel > 0:
        angle = upper + fore
    angle = shifted(angle, pair.far_phase)
    return cos(angle)


def joint2_twist(robot: Robot) -> Mechanism | None:
    """h1, h2: the shoulder drive winds up under forearm and upper arm."""
    if (pair := find_arm_pair(robot)) is None:
        return None
    j = pair.upper
    return Mechanism(
        "joint2-twist",
        (
            Term("h1", drive_screws(robot, j, forearm_lever(pair)), TWIST, pair.far_sign),
            Term("h2", drive_screws(robot, j, upper_arm_lever(pair)), TWIST, pair.near_sign),
        ),
        f"{name_drive(robot, j).capitalize()} winds up under the weight of the upper arm and the forearm.",
        f"{drive_angle(robot, j)} + h1 {forearm_lever(pair)} + h2 {upper_arm_lever(pair)}",
        PAPER,
        usual_causes=WINDING_PARTS,
    )


def joint3_twist(robot: Robot) -> Mechanism | None:
    """h3: the elbow drive winds up under the forearm."""
    if (pair := find_arm_pair(robot)) is None:
        return None
    j = pair.fore
    sign_here = pair.far_sign * pair.parallel  # the elbow's own axis may point the other way
    return Mechanism(
        "joint3-twist",
        (Term("h3", drive_screws(robot, j, forearm_lever(pair)), TWIST, sign_here),),
        f"{name_drive(robot, j).capitalize()} winds up under the weight of the forearm.",
        f"{drive_angle(robot, j)} + h3 {forearm_lever(pair)}",
        PAPER,
        usual_causes=WINDING_PARTS,
    )


def gravity_twist(robot: Robot) -> Mechanism | None:
    """h1, h2, h3 together."""
    shoulder, elbow = joint2_twist(robot), joint3_twist(robot)
    if shoulder is None or elbow is None:
        return None
    return Mechanism(
        "gravity-twist",
        shoulder.terms + elbow.terms,
        "Shoulder and elbow wind up together under the arm's weight.",
        f"{shoulder.equation}; {elbow.equation}",
        PAPER,
        usual_causes=WINDING_PARTS,
    )


def list_sides(robot: Robot, joint: int) -> tuple[int, ...]:
    """List what may decide the side on which gravity holds a joint: its torque, and of the elbow the
    paper's lever of the forearm; where no masses are declared, that alone, and where all are that it
    holds, the torque with the payload's, too."""
    pair = find_arm_pair(robot)
    of_both = (BY_WHOLE,) if knows_held_masses(robot, joint) else ()
    if pair is None or joint != pair.fore:
        return (BY_TORQUE, *of_both)
    if declares_masses(robot):
        return (BY_TORQUE, BY_FOREARM, *of_both)
    return (BY_FOREARM,)


def backlash(robot: Robot, joint: int, side: int) -> Mechanism:
    """Gravity holds the gear on one flank and changes it where its torque changes sign; joint 3 is
    the paper's h4.

    Play yields to the torque as a spring does, so that h4 has the sign of a compliance: with the
    torque itself as cause, plus. On the paper's own arm, where the lever cos(q2+q3) is against the
    torque, the paper calls either sign backlash (its Table 3 has h3 = -1.686 and h4 = +0.235 mrad);
    there the sentence says which of them was found. `side`: one of `list_sides`."""
    pair, direction = find_arm_pair(robot), 1
    drive, of_what = name_drive(robot, joint), ""
    cause = sign(motor_torque(robot, joint))
    if side == BY_FOREARM and pair is not None:
        cause, direction = sign(forearm_lever(pair)), pair.far_sign * pair.parallel
    if side == BY_WHOLE:
        cause, of_what = sign(whole_torque(robot, joint)), OF_BOTH
    against = (
        f"{drive.capitalize()} steps against gravity where its torque changes sign: play would give way to gravity, so "
        "something else is the cause, such as a nonlinear spring."
    )
    return Mechanism(
        f"backlash:{joint}",
        (Term(f"h4[{joint}]", drive_screws(robot, joint, cause), BACKLASH, direction),),
        f"{drive.capitalize()} steps where its gravity torque{of_what} changes sign, to the side that gravity pulls.",
        f"{drive_angle(robot, joint)} + h4 {cause}",
        PAPER,
        against if direction < 0 else "",
        ("backlash of the gear", "play of a key or a coupling"),
    )


def base_screws(robot: Robot, direction: Array, cause: Cause) -> tuple[Screw, ...]:
    """Build the screws of frame 1 that together turn the arm about a direction (3,) of frame 0
    through its origin, by the cause."""
    before = robot.joints[0].before
    R = before[:3, :3]
    turn = R.T @ direction
    origin = before[:3, 3]
    lever = np.cross(direction, origin)
    shift = R.T @ lever
    numbers = list[tuple[str, Number]]()
    for place, angle in zip(AXES[3:], turn, strict=True):
        if abs(angle) > 1e-12:
            number = Number(float(angle))
            numbers.append((place, number))
    for place, length in zip(AXES[:3], shift, strict=True):
        if abs(length) > 1e-9:
            number = Number(float(length), "mm")
            numbers.append((place, number))
    one = Number(1.0)
    screws = []
    for place, number in numbers:
        share = cause
        if number != one:
            share = number * cause
        screw = Screw(1, place, share)
        screws.append(screw)
    return tuple(screws)


def list_level_axes(robot: Robot) -> list[int]:
    """List the axes 0, 1, 2 of frame 0 about which weight has a moment."""
    gravity = robot.gravity or (0, 0, 0)
    level = []
    for axis, share in enumerate(gravity):
        if abs(share) < 0.999:
            level.append(axis)
    return level


def base_moment(axis: int) -> Cause:
    """Return the moment of the arm's weight about axis 0, 1, 2 of frame 0."""
    name = NAMES[axis]
    return Named(f"moment_{name}", "N m")


def list_base_loads(robot: Robot) -> dict[Cause, Cause]:
    """List the moments [N m] of the arm's weight about the level axes of frame 0, each with that of the
    payload."""
    loads: dict[Cause, Cause] = {}
    for axis in list_level_axes(robot):
        own = base_moment(axis)
        held = _payload_moment(robot, axis)
        loads[own] = OF_ONE_KG * held
    return loads


def list_edges(robot: Robot) -> tuple[float, ...]:
    """List the directions [degrees] of a base's edges that rocking is scanned over; none where
    the weight does not tip it."""
    return EDGES if loads_base(robot) else ()


def base_rocking(robot: Robot, degrees: float) -> Mechanism:
    """A base that is not held fast lies on one of two sides about each of two horizontal edges at
    right angles, as the arm's weight tips it; the direction of the edges is scanned, from the first
    horizontal axis of frame 0."""
    first, second, *_ = list_level_axes(robot)
    edges = _list_edges_across(degrees)
    terms = []
    for number, (share, other_share) in enumerate(edges, 1):
        direction = share * UNITS[first] + other_share * UNITS[second]
        one = base_moment(first)
        other = base_moment(second)
        moment = _add_shares(share, one, other_share, other)
        screws = base_screws(robot, direction, sign(moment))
        term = Term(f"r{number}", screws, ROCKING, 1)
        terms.append(term)
    name = NAMES[first]
    words = f"edges along {name} and {NAMES[second]}"
    if degrees:
        right = degrees + 90
        words = f"edges at {degrees:g}° and {right:g}° to {name}"
    return Mechanism(
        "base-rocking",
        tuple(terms),
        f"The base rocks about {words}: it tips over where the moment of the arm's weight about "
        "them changes sign.",
        "rotation of frame 0 about an edge = r · sign of the moment of the weight about it",
        "a body on two supports; Whitney, Lozinski & Rourke 1986, for a base that yields",
        usual_causes=ROCKING_BASE,
    )


def _list_edges_across(degrees: float) -> tuple[tuple[float, float], tuple[float, float]]:
    """List the shares of two axes in each of two edges at right angles."""
    if degrees == 0:
        return (1.0, 0.0), (0.0, 1.0)
    angle = np.radians(degrees)
    cosine = float(np.cos(angle))
    sine = float(np.sin(angle))
    return (cosine, sine), (-sine, cosine)


def _add_shares(share: float, one: Cause, other_share: float, other: Cause) -> Cause:
    """Add shares of two causes; one with none is left out."""
    if other_share == 0:
        return one
    if share == 0:
        return other
    own = share * one
    rest = other_share * other
    return own + rest


def _payload_moment(robot: Robot, axis: int) -> Cause:
    """Build the payload times its lever about a level axis 0, 1, 2 of frame 0 [kg mm]."""
    down = robot.gravity or (0, 0, 0)
    j = (axis + 1) % 3
    k = (axis + 2) % 3
    # lever x down
    levers = list[Cause]()
    for along, weight in ((j, down[k]), (k, -down[j])):
        name = NAMES[along]
        where: Cause = Named(f"load_{name}_mm", "mm")
        if abs(weight) <= 1e-9:
            continue
        if weight != 1:
            where = weight * where
        levers.append(where)
    lever, *others = levers
    for other in others:
        lever = lever + other
    payload = Named(PAYLOAD, "kg")
    return payload * lever


def payload_tilt(robot: Robot) -> Mechanism | None:
    """The foundation yields to the payload's moment about the horizontal axes of frame 0: kilograms
    times lever of the target."""
    if robot.gravity is None:
        return None
    size = (1e-10, 1e-6)
    terms = []
    for axis in list_level_axes(robot):
        moment = _payload_moment(robot, axis)
        screws = base_screws(robot, UNITS[axis], moment)
        terms.append(Term(f"p{NAMES[axis]}", screws, size, 1))
    return Mechanism(
        "payload-tilt",
        tuple(terms),
        "The base tilts in proportion to the moment of the payload.",
        "rotation of frame 0 = p · payload_kg · horizontal lever of the target",
        "Whitney, Lozinski & Rourke 1986",
        usual_causes=YIELDING_BASE,
    )
