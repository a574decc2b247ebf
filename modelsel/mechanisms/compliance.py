"""What yields under weight: drives, bearings and springs; with the arm's own masses or with a payload."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from ..measurements.campaign.state_names import StateKind, state_kind
from ..robot.gravity import declares_masses, declares_masses_beyond, find_arm_pair
from ..robot.kinematics import Robot, find_flange_axis
from .beams import weight_moment
from .bodies import list_main_bodies, list_tilting
from .causes import Cause, Named, q, shifted, sin
from .motors import (
    drive_angle,
    drive_screws,
    is_coupled,
    knows_held_masses,
    motor_torque,
    moved_joints,
    name_drive,
)
from .terms import Mechanism, Screw, Term

# rad/(N m): usual size of a compliance
COMPLIANCE = (1e-8, 1e-3)
# rad/(N m) times some kg: of a compliance with an unknown mass
HEAVY = (1e-8, 1e-3)
# what is known of the weight that a drive holds: the masses that are declared (or unit ones); none of
# them, so that each is a term; those that are declared, and the payload besides
DECLARED, UNKNOWN, WITH_PAYLOAD = 0, 1, 2
PAYLOAD_DEFLECTION = "payload-deflection"
# what is known of where a payload hangs: at the target (at the mean of several) or where the robot says, or
# nothing
AT_TARGET, ANYWHERE = 0, 1
# the axes of a joint's frame across its own
ACROSS = "xy"
# kinds of what the arm's own masses load
OWN_WEIGHT = {StateKind.TORQUE, StateKind.BENDING, StateKind.BASE_MOMENT}
# kinds of what 1 kg loads
OF_ONE_KG = {StateKind.UNIT_TORQUE, StateKind.UNIT_BENDING}
# by which shoulder and elbow yield to the arm's weight, too
TWISTS = ("joint2-twist", "joint3-twist", "gravity-twist")
# the column of the payload's mass
PAYLOAD = "payload_kg"
# what is said of a torque of both
OF_BOTH = ", of the arm's weight and of the payload,"
# what a spring under both adds
AS_DECLARED = " with the masses as declared"
SOURCE = "Klimchik, Furet, Caro & Pashkevich 2015, elastostatic calibration"
# parts that usually make a joint wind up
WINDING_PARTS = ("compliant gear or shaft", "belt", "soft servo")


def later_frames(robot: Robot, frame: int) -> range:
    """List the later frames where a mass may sit."""
    return range(frame + 1, robot.n + 2)


def joint_compliance(robot: Robot, joint: int, masses: int) -> Mechanism:
    """The drive winds up in proportion to the gravity torque: of the declared (or unit) masses, of
    unknown ones, a term each, or of the declared ones and the payload, one stiffness for both.
    `masses`: one of `mass_choices`."""
    drive = name_drive(robot, joint)
    of_what, load = "", f"gravity torque about {drive}"
    if masses == UNKNOWN:
        terms = tuple(
            Term(
                f"c{joint}m{k}", drive_screws(robot, joint, motor_torque(robot, joint, k)), HEAVY, 1
            )
            for k in later_frames(robot, min(moved_joints(robot, joint)))
        )
    else:
        cause = motor_torque(robot, joint)
        if masses == WITH_PAYLOAD:
            cause = whole_torque(robot, joint)
            of_what = f"{OF_BOTH}{AS_DECLARED}"
            load = f"({load} + payload_kg · torque of 1 kg {say_place(robot)})"
        terms = (Term(f"c{joint}", drive_screws(robot, joint, cause), COMPLIANCE, 1),)
    return Mechanism(
        f"joint-compliance:{joint}",
        terms,
        f"{drive.capitalize()} winds up in proportion to its gravity torque{of_what}.",
        f"{drive_angle(robot, joint)} + c · {load}",
        SOURCE,
        usual_causes=WINDING_PARTS,
    )


def say_place(robot: Robot) -> str:
    """Say where a payload hangs: at the target, unless the robot says where."""
    return "at the target" if robot.payload_at_mm is None else "where the payload hangs"


def payload_torque(robot: Robot, joint: int) -> Cause:
    """Build the torque [N m] that a drive holds of the payload."""
    payload = Named(PAYLOAD, "kg")
    target = robot.n + 1
    of_one_kg = motor_torque(robot, joint, target)
    return payload * of_one_kg


def whole_torque(robot: Robot, joint: int) -> Cause:
    """Build the torque [N m] that a drive holds of the arm's own masses and of the payload."""
    own = motor_torque(robot, joint)
    held = payload_torque(robot, joint)
    return own + held


def needs_both_loads(mechanism: Mechanism) -> bool:
    """Return whether a mechanism depends on the torque of the arm's own weight and on the payload."""
    names = mechanism.names()
    if PAYLOAD not in names:
        return False
    kinds = {state_kind(name) for name in names}
    return bool(kinds & OWN_WEIGHT)


def yields_to_weight(mechanism: Mechanism) -> bool:
    """Return whether a mechanism is one by which the arm yields to its own weight, and to no payload."""
    names = mechanism.names()
    if PAYLOAD in names:
        return False
    kinds = {state_kind(name) for name in names}
    by_masses = kinds & (OWN_WEIGHT | OF_ONE_KG)
    return bool(by_masses) or mechanism.stem in TWISTS


def has_known_masses(mechanism: Mechanism) -> bool:
    """Return whether a mechanism depends on no mass that is a number of its own."""
    names = mechanism.names()
    kinds = {state_kind(name) for name in names}
    return PAYLOAD in names or not kinds & OF_ONE_KG


def mass_choices(robot: Robot, joint: int) -> tuple[int, ...]:
    """List the choices of masses: known ones, then unknown ones, where several bodies hang on the
    joint or the file's masses leave out what the flange holds; with the payload where those of all
    links that the drive holds are declared."""
    if knows_held_masses(robot, joint):
        return (DECLARED, UNKNOWN, WITH_PAYLOAD)
    if joint < robot.n or declares_masses(robot):
        return (DECLARED, UNKNOWN)
    return (DECLARED,)


def list_bearing_loads(robot: Robot, joint: int) -> tuple[int, ...]:
    """List what is known of the masses that load a bearing across its axis: all, or those at the ends of the
    arm's main links where not all beyond it are declared."""
    known = (DECLARED,)
    if declares_masses_beyond(robot, joint):
        return known
    tilting = _list_tilting_main(robot, joint)
    return (DECLARED, UNKNOWN) if tilting else known


def lateral_compliance(robot: Robot, joint: int, masses: int = DECLARED) -> Mechanism:
    """The bearing yields across the axis: under the declared (or unit) masses, about each axis by a number of
    its own, or under unknown ones, a term each, about both alike."""
    loads = f"the weight about x, y of frame {joint}"
    if masses == DECLARED:
        terms = [Term(f"l{joint}{axis}", (_tilt(joint, axis),), COMPLIANCE, 1) for axis in ACROSS]
    else:
        bodies = _list_tilting_main(robot, joint)
        terms = list(_tilt_by_each(joint, bodies))
        frames = ", ".join(map(str, bodies))
        loads = f"{loads}, of masses that are not known at frames {frames}"
    return Mechanism(
        f"lateral-compliance:{joint}",
        tuple(terms),
        f"The axis of joint {joint} tilts in proportion to the moment of the weight across it.",
        f"α{joint}, β{joint} = l · moment of {loads}",
        SOURCE,
        usual_causes=("compliant bearing", "compliant housing or link before it"),
    )


def _list_tilting_main(robot: Robot, joint: int) -> tuple[int, ...]:
    """List the ends of the arm's main links beyond a joint where a weight tilts its axis."""
    main = list_main_bodies(robot, joint - 1)
    return list_tilting(robot, joint, main)


def _tilt_by_each(joint: int, bodies: Sequence[int]) -> Iterator[Term]:
    """List the terms of a bearing that tilts under masses that are not known, with the moments of each."""
    for body in bodies:
        screws = tuple(_tilt(joint, axis, body) for axis in ACROSS)
        symbol = f"l{joint}m{body}"
        yield Term(symbol, screws, HEAVY, 1)


def _tilt(joint: int, axis: str, body: int | None = None) -> Screw:
    """Build the screw that tilts a joint's axis about x or y by the moment of the weight, or of 1 kg at a
    body."""
    moment = weight_moment(joint, axis, body)
    return Screw(joint, f"r{axis}", moment)


def list_hangs(robot: Robot, joint: int) -> tuple[int, ...]:
    """List what may be known of where a payload hangs that winds up a drive. Anywhere, unless the robot says
    where, it has two numbers for a drive that turns the flange alone, about one of its axes: the torque
    then follows from the direction of gravity in the flange."""
    known = (AT_TARGET,)
    if joint < robot.n or robot.prismatic[-1]:
        return known
    if is_coupled(robot, joint) or robot.payload_at_mm is not None:
        return known
    across = _list_across(robot)
    if len(across) != 2:
        return known
    return AT_TARGET, ANYWHERE


def _list_across(robot: Robot) -> list[str]:
    """List the flange's axes that the last joint's axis has no part along."""
    parts = find_flange_axis(robot)
    return [axis for axis, part in zip("xyz", parts, strict=True) if not part]


def payload_deflection(robot: Robot, joint: int, hang: int = AT_TARGET) -> Mechanism:
    """The drive winds up under the payload, at the target or anywhere (`hang`: one of `list_hangs`); its mass is
    the column payload_kg."""
    if hang == AT_TARGET:
        of_what = f"1 kg {say_place(robot)}"
        cause = payload_torque(robot, joint)
        terms = [_wind_up(robot, joint, "", cause, COMPLIANCE, 1)]
    else:
        of_what = "1 kg where the payload hangs"
        payload = Named(PAYLOAD, "kg")
        causes = {axis: payload * Named(f"down_{axis}") for axis in _list_across(robot)}
        terms = [_wind_up(robot, joint, axis, causes[axis], HEAVY) for axis in causes]
    return Mechanism(
        f"{PAYLOAD_DEFLECTION}:{joint}",
        tuple(terms),
        f"{name_drive(robot, joint).capitalize()} winds up in proportion to the torque of the payload.",
        f"{drive_angle(robot, joint)} + p · payload_kg · torque of {of_what}",
        SOURCE,
        usual_causes=WINDING_PARTS,
    )


def _wind_up(
    robot: Robot, joint: int, axis: str, cause: Cause, sizes: tuple[float, float], sign: int = 0
) -> Term:
    """Build the term of a drive that winds up under a payload."""
    symbol = f"p{joint}{axis}"
    screws = drive_screws(robot, joint, cause)
    return Term(symbol, screws, sizes, sign)


def counterbalance(robot: Robot) -> Mechanism | None:
    """A spring that balances the shoulder: torque ∝ sine of its angle, and of twice the angle where
    the spring is short."""
    if (pair := find_arm_pair(robot)) is None:
        return None
    angle, j = shifted(q(pair.upper), pair.near_phase), pair.upper
    return Mechanism(
        "counterbalance",
        (
            Term("u1", drive_screws(robot, j, sin(angle)), (1e-5, 1e-2)),
            Term("u2", drive_screws(robot, j, sin(2.0 * angle)), (1e-5, 1e-2)),
        ),
        f"Joint {j} turns with the sine of its angle from level and of twice that angle.",
        f"θ{j} = q{j} + u1 {sin(angle)} + u2 {sin(2.0 * angle)}",
        "Klimchik, Caro, Wu, Pashkevich & Furet 2013, gravity compensators",
        usual_causes=("counterbalance that does not match the weight",),
    )
