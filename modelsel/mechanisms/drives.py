"""Drives: uneven gears, encoders and bearings, couplings, backlash and settling. Every one exists
once a joint."""

from __future__ import annotations

from collections.abc import Sequence

from ..exceptions import sentence_list
from ..robot.kinematics import Robot
from .causes import Cause, Named, cos, q, sin
from .motors import drive_angle, drive_screws, joint_axis, motor_reading, name_drive
from .terms import Mechanism, Screw, Term

# rad at the joint: usual size of a wave
RUNOUT = (5e-6, 3e-3)
# rad/rad: usual size of a scale error
SCALE = (1e-6, 1e-2)
# parts that usually make a joint turn unevenly, some waves a turn
RIPPLING_PARTS = (
    "gear teeth",
    "strain-wave gear",
    "encoder or motor that errs once a turn of its own",
)
# waves a turn that gear ripple is scanned over
WAVES = tuple(range(3, 61))
# and higher ones, which are screened: two a turn of its motor, by strain-wave gears of up to 165 to 1
HIGH_WAVES = tuple(range(61, 331))


def list_waves(robot: Robot, joint: int, ratios: Sequence[float] = ()) -> tuple[float, ...]:
    """List the waves a turn that a joint's gear ripple is scanned over in every search: with the ratios of the
    gears also one and two a turn of its motor. For HIGH_WAVES the residual is only screened."""
    waves = list[float](WAVES)
    if ratios:
        ratio = ratios[joint - 1]
        for count in (ratio, 2 * ratio):
            is_new = count not in waves
            if count > 0 and is_new:
                waves.append(count)
    return tuple(waves)


def revolute_joints(robot: Robot) -> tuple[int, ...]:
    """List the joints that turn."""
    numbers = []
    for j, joint in enumerate(robot.joints, 1):
        if not joint.prismatic:
            numbers.append(j)
    return tuple(numbers)


def all_joints(robot: Robot) -> tuple[int, ...]:
    """List every joint."""
    joints = range(1, robot.n + 1)
    return tuple(joints)


def wave_terms(joint: int, count: float, axis: str, symbol: str) -> tuple[Term, Term]:
    """Build a wave of unknown phase: sine and cosine of `count` times the joint's angle at one
    place of its frame."""
    angle = scale_angle(count, q(joint))
    sine = Screw(joint, axis, sin(angle))
    cosine = Screw(joint, axis, cos(angle))
    return (Term(f"{symbol}s", (sine,), RUNOUT), Term(f"{symbol}c", (cosine,), RUNOUT))


def _drive_waves(robot: Robot, joint: int, count: float, symbol: str) -> tuple[Term, Term]:
    """Build a wave of unknown phase by which a drive stands off: `count` to a turn of what its
    encoder reads."""
    angle = scale_angle(count, motor_reading(robot, joint))
    sine = drive_screws(robot, joint, sin(angle))
    cosine = drive_screws(robot, joint, cos(angle))
    return (Term(f"{symbol}s", sine, RUNOUT), Term(f"{symbol}c", cosine, RUNOUT))


def scale_angle(count: float, angle: Cause) -> Cause:
    """Return an angle times a number, or the angle itself where that is 1."""
    return angle if count == 1 else float(count) * angle


def _begin(robot: Robot, joint: int) -> str:
    """Begin a sentence with a drive's name."""
    drive = name_drive(robot, joint)
    return drive.capitalize()


def gear_eccentricity(robot: Robot, joint: int) -> Mechanism:
    """The output gear turns about a point beside its centre: once a turn."""
    angle = motor_reading(robot, joint)
    return Mechanism(
        f"gear-eccentricity:{joint}",
        _drive_waves(robot, joint, 1, f"e{joint}"),
        f"{_begin(robot, joint)} turns unevenly, one wave a turn.",
        f"{drive_angle(robot, joint)} + es sin({angle}) + ec cos({angle})",
        "Whitney, Lozinski & Rourke 1986",
        usual_causes=("gear or shaft out of centre", "encoder disk out of centre"),
    )


def encoder_eccentricity(robot: Robot, joint: int) -> Mechanism:
    """What two reading heads leave of a disk's eccentricity, and an oval ring: twice a turn."""
    angle = motor_reading(robot, joint)
    return Mechanism(
        f"encoder-eccentricity:{joint}",
        _drive_waves(robot, joint, 2, f"d{joint}"),
        f"{_begin(robot, joint)} turns unevenly, two waves a turn.",
        f"{drive_angle(robot, joint)} + ds sin(2 {angle}) + dc cos(2 {angle})",
        "Lopez-Rubio et al. 2010, encoder errors",
        usual_causes=(
            "oval encoder ring",
            "off-centre encoder disk with two heads",
            "oval gear or bearing",
            "universal joint",
        ),
    )


def gear_ripple(robot: Robot, joint: int, waves: float) -> Mechanism:
    """Tooth mesh and strain-wave gears: some tens of waves a turn, or hundreds; the number is scanned."""
    angle = motor_reading(robot, joint)
    count = f"{waves:g}"
    return Mechanism(
        f"gear-ripple:{joint}",
        _drive_waves(robot, joint, waves, f"r{joint}"),
        f"{_begin(robot, joint)} turns unevenly, {count} waves a turn.",
        f"{drive_angle(robot, joint)} + rs sin({count} {angle}) + rc cos({count} {angle})",
        "Tuttle & Seering 1996, harmonic-drive gear transmission",
        usual_causes=RIPPLING_PARTS,
    )


def encoder_scale(robot: Robot, joint: int) -> Mechanism:
    """The joint moves a little more or less than its encoder counts."""
    reading = motor_reading(robot, joint)
    screws = drive_screws(robot, joint, reading)
    return Mechanism(
        f"encoder-scale:{joint}",
        (Term(f"s{joint}", screws, SCALE),),
        f"{_begin(robot, joint)} moves more than its reading says, in proportion.",
        f"θ{joint} = (1 + s) {reading}",
        "Whitney, Lozinski & Rourke 1986",
        f"{_begin(robot, joint)} moves less than its reading says, in proportion.",
        usual_causes=(
            "gear ratio or encoder count in the controller",
            "slipping belt",
            "scale or screw of a slide",
        ),
    )


def slide_scales(robot: Robot) -> Mechanism | None:
    """All slides of a gantry move more or less than they read by one share, as scales and racks of one
    maker or one temperature do."""
    slides = [j for j, joint in enumerate(robot.joints, 1) if joint.prismatic]
    if len(slides) < 2:
        return None
    screws = tuple(Screw(j, "tz", q(j, "mm")) for j in slides)
    listed = sentence_list([str(j) for j in slides])
    return Mechanism(
        "slide-scales",
        (Term("s", screws, SCALE),),
        f"Slides {listed} move more than they read, by the same share.",
        "d = (1 + s) q of every slide",
        "ISO 230-2, linear axes at another temperature",
        f"Slides {listed} move less than they read, by the same share.",
        usual_causes=(
            "scales or racks of slides at another temperature",
            "unit or compensation of slides in the controller",
        ),
    )


# Couplings: a joint that turns because another one does.

COUPLING = (1e-5, 1e-2)  # rad/rad


def wrist_joints(robot: Robot) -> tuple[int, ...]:
    """List the last two joints of an arm with three revolute wrist joints."""
    if robot.n < 5:
        return ()
    wrist = robot.joints[-3:]
    slides = [joint.prismatic for joint in wrist]
    if any(slides):
        return ()
    return (robot.n - 1, robot.n)


def wrist_coupling(robot: Robot, joint: int) -> Mechanism:
    """The wrist's drives run through each other: the last joint but one turns with the one before,
    the last with both."""
    name = f"wrist-coupling:{joint}"
    drivers = range(robot.n - 2, joint)
    terms = list[Term]()
    for d in drivers:
        screw = Screw(joint, "rz", q(d))
        term = Term(f"w{joint}{d}", (screw,), COUPLING)
        terms.append(term)
    joints = " and ".join(f"joint {d}" for d in drivers)
    readings = " + ".join(f"w{joint}{d} q{d}" for d in drivers)
    sentence = f"Joint {joint} turns with {joints}."
    equation = f"θ{joint} = q{joint} + {readings}"
    return Mechanism(
        name,
        tuple(terms),
        sentence,
        equation,
        "Whitney, Lozinski & Rourke 1986; the reference, non-geometric errors",
        usual_causes=(
            "wrist drives that run through each other",
            "coupling ratio in the controller",
            "cable or hose",
        ),
    )


# What depends on how a configuration was reached: play in gears, readings taken too early.


def approach_backlash(robot: Robot, joint: int) -> Mechanism:
    """Play or friction leaves the joint short of its reading, on the side it came from."""
    return Mechanism(
        f"approach-backlash:{joint}",
        (_side(robot, joint, f"k{joint}", -1),),
        f"{_begin(robot, joint)} stops short of its reading, on the side that it came from.",
        f"{drive_angle(robot, joint)} + k · direction of {name_drive(robot, joint)}'s last motion, k < 0",
        "Slamani, Nubiola & Bonev 2012, backlash of robots",
        usual_causes=(
            "backlash of the gear",
            "friction with a drive that winds up",
            "play of a key or a coupling",
        ),
    )


def overshoot(robot: Robot, joint: int) -> Mechanism:
    """The joint rests past its reading, in the direction in which it moved: no play leaves it
    there."""
    return Mechanism(
        f"overshoot:{joint}",
        (_side(robot, joint, f"o{joint}", 1),),
        f"{_begin(robot, joint)} rests past its reading, in the direction of its last motion, where play would leave it short.",
        f"{drive_angle(robot, joint)} + o · direction of {name_drive(robot, joint)}'s last motion, o > 0",
        "Slamani, Nubiola & Bonev 2012, backlash of robots; the sign is that of an overshoot",
        usual_causes=(
            "servo that overshoots",
            "friction compensation that is too strong",
            "directions of approach with the wrong sign",
        ),
    )


def _side(robot: Robot, joint: int, symbol: str, sign: int) -> Term:
    """Build a turn (or shift) of a drive by the direction of its last motion."""
    axis = joint_axis(robot, joint)
    size = (2e-6, 5e-3)
    if axis == "tz":
        size = (1e-3, 2.0)
    direction = Named(f"approach{joint}")
    return Term(symbol, drive_screws(robot, joint, direction), size, sign)


def _last_move(robot: Robot, joint: int) -> tuple[Screw, ...]:
    """Build a drive's own motion, by the size and direction of its last move."""
    unit = robot.unit(joint)
    direction = Named(f"approach{joint}")
    size = Named(f"move{joint}", unit)
    return drive_screws(robot, joint, direction * size)


def read_too_early(robot: Robot) -> Mechanism:
    """Every joint was read, or the target measured, before the arm stood still: one lag, a share of each
    joint's last move. It is positive where the readings are too early, negative where the positions
    are: neither is rarer."""
    screws = tuple(screw for j in all_joints(robot) for screw in _last_move(robot, j))
    return Mechanism(
        "fault:read-too-early",
        (Term("lag", screws, (1e-6, 5e-2)),),
        "A fault of the data: all joints stand past their readings by the same share of their last moves.",
        "θ = q + lag · last move, all joints alike",
        "ISO 9283, position stabilisation time",
        "A fault of the data: all joints are short of their readings by the same share of their last moves, as when "
        "targets are measured before the arm stands still.",
        ("arm that was not yet still when joints were read or targets measured",),
    )


def time_offset(robot: Robot) -> Mechanism:
    """Positions and readings belong to moments that are apart by one time, all joints alike, in a
    motion that goes on: positive where the positions are the later ones."""
    screws = list[Screw]()
    for j in all_joints(robot):
        unit = robot.unit(j)
        speed = Named(f"rate{j}", f"{unit}/s")
        screws += drive_screws(robot, j, speed)
    term = Term("delay", tuple(screws), (1e-5, 1.0))
    begin = "A fault of the data: every position belongs to"
    return Mechanism(
        "fault:time-offset",
        (term,),
        f"{begin} a later moment than the joint readings beside it, by the same time in all rows.",
        "θ = q + delay · speed, all joints alike",
        "latency of instruments in motion; ISO 9283, path accuracy",
        f"{begin} an earlier moment than the joint readings beside it, by the same time in all rows.",
        (
            "latency of the instrument or of the readings",
            "clocks that are not the same",
            "following error of all servos, where readings are commanded",
        ),
    )


# a mechanism that only a campaign measured in motion may show
SERVO_LAG = "servo-lag"


def servo_lag(robot: Robot, joint: int) -> Mechanism:
    """In a motion that goes on a joint is behind its reading by what it moves in a short time: a
    position servo follows its command with an error in proportion to the speed. One that is measured
    late, or whose speed is fed forward too strongly, is ahead."""
    speed = Named(f"rate{joint}", f"{robot.unit(joint)}/s")
    term = Term(f"l{joint}", drive_screws(robot, joint, speed), (1e-5, 1e-1), -1)
    return Mechanism(
        f"{SERVO_LAG}:{joint}",
        (term,),
        f"{_begin(robot, joint)} is behind its reading in motion, in proportion to its speed.",
        f"{drive_angle(robot, joint)} + l · speed of {name_drive(robot, joint)}, l < 0",
        "following error of position servos; ISO 9283, path accuracy",
        f"{_begin(robot, joint)} is ahead of its reading in motion, in proportion to its speed.",
        usual_causes=(
            "following error of its servo, where readings are commanded",
            "delay of its encoder or of a filter",
        ),
    )


def settling(robot: Robot, joint: int) -> Mechanism:
    """Joints read (or the target measured) before the arm stood still: a share of the last move is
    still missing."""
    return Mechanism(
        f"settle:{joint}",
        (Term(f"m{joint}", _last_move(robot, joint), (1e-6, 1e-2), -1),),
        f"{_begin(robot, joint)} is short of its reading by a share of its last move.",
        f"{drive_angle(robot, joint)} + m · last move of {name_drive(robot, joint)}",
        "ISO 9283, position stabilisation time",
        f"{_begin(robot, joint)} is past its reading by a share of its last move, as when it is read too early or swings past.",
        ("target measured before the arm stood still", "creep of a belt or a gear"),
    )
