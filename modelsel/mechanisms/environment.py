"""What comes from temperature, time and the measuring instrument."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from itertools import combinations

import numpy as np

from .._typing import Array
from ..exceptions import write_percent
from ..measurements.campaign.late_names import is_temperature, name_late
from ..measurements.campaign.reference_temperature import REFERENCE, TEMPERATURE
from ..robot.kinematics import Robot
from ..robot.rigid import AXES
from .causes import Applied, Cause, Combined, Named, Number, shifted, sign
from .motors import drive_angle, drive_screws, name_drive
from .terms import Mechanism, Screw, Term

PROGRESS: Cause = Named(
    "progress"
)  # place in the order of motion, 0 to 1: every file has it, clock or not
STEP = {"t": (1e-3, 20.0), "r": (1e-6, 2e-2)}
# mm/°C: usual sizes of the same by a degree
SHIFT_BY_DEGREE = (1e-4, 0.2)
STEPS = tuple(
    round(0.005 * k, 3) for k in range(1, 200)
)  # naming keeps those that differ on the data
# names of mechanisms by which the instrument and the base move against each other
INSTRUMENT_MOVES = ("tracker-drift", "tracker-step", "fault:tracker-bumped")


def _along(robot: Robot, vector: Array, frame: int, cause: Cause) -> tuple[Screw, ...]:
    """Build the screws of a frame that shift it along a vector [mm] given in its axes, by the
    cause."""
    screws = []
    for a in range(3):
        length = float(vector[a])
        if abs(length) > 1e-6:
            size = Number(length, "mm")
            screw = Screw(frame, AXES[a], size * cause)
            screws.append(screw)
    return tuple(screws)


def temperature_rise(reference: float = REFERENCE, lag: int = 0) -> Cause:
    """Return the temperature, counted from the reference [°C]; with a lag [min] as a mass of this time
    constant has it."""
    name = name_late(lag) if lag else TEMPERATURE
    temperature = Named(name, "°C")
    return shifted(temperature, -reference)


def _name_temperature(lag: int) -> str:
    """Name the temperature that an effect follows, within a sentence."""
    return f"temperature, {lag} min late" if lag else "temperature"


def find_references(cause: Cause) -> frozenset[float]:
    """Find the temperatures [°C] from which a cause counts: none where it does not look at any."""
    match cause:
        case Combined("-", Named(name), Number(reference)) if is_temperature(name):
            return frozenset((reference,))
        case Combined("+", Named(name), Number(reference)) if is_temperature(name):
            return frozenset((-reference,))
        case Combined(_, left, right):
            return find_references(left) | find_references(right)
        case Applied(_, argument):
            return find_references(argument)
        case Named(name) if is_temperature(name):
            return frozenset((0.0,))
    return frozenset()


def growth_screws(
    robot: Robot, link: int, reference: float = REFERENCE, lag: int = 0
) -> tuple[Screw, ...]:
    """Build the screws that lengthen link `link`: from joint `link` to the next frame (0: from
    frame 0 to joint 1)."""
    before = robot.last
    if link < robot.n:
        before = robot.joints[link].before
    rotation = before[:3, :3]
    shift = before[:3, 3]
    length = rotation.T @ shift
    rise = temperature_rise(reference, lag)
    return _along(robot, length, link + 1, rise)


def growing_links(robot: Robot) -> tuple[int, ...]:
    """Find the links with a length, after joint 1."""
    links = range(1, robot.n + 1)
    return tuple(link for link in links if growth_screws(robot, link))


def thermal_growth(
    robot: Robot, link: int, lag: int = 0, *, reference: float = REFERENCE
) -> Mechanism:
    """One link lengthens with temperature, with a lag [min] late."""
    return Mechanism(
        f"thermal-growth:{link}",
        (Term(f"g{link}", growth_screws(robot, link, reference, lag), (1e-6, 1e-4), 1),),
        f"Link {link} grows with {_name_temperature(lag)}, counted from {reference:g} °C.",
        f"length of link {link} · (1 + g ({temperature_rise(reference, lag)}))",
        "ISO 230-3, thermal effects; ISO 1, 20 °C",
        usual_causes=("expansion of its material", "heat of a motor or a gear in it"),
    )


def thermal_expansion(robot: Robot, reference: float = REFERENCE) -> Mechanism | None:
    """The whole arm lengthens, one coefficient."""
    if not growing_links(robot) and not growth_screws(robot, 0):
        return None
    return late_expansion(robot, 0, reference=reference)


def late_expansion(robot: Robot, lag: int, *, reference: float = REFERENCE) -> Mechanism:
    """The whole arm lengthens, one coefficient, with a lag [min] late."""
    screws = tuple(s for k in range(robot.n + 1) for s in growth_screws(robot, k, reference, lag))
    return Mechanism(
        "thermal-expansion",
        (Term("g", screws, (1e-6, 1e-4), 1),),
        f"The whole arm grows with {_name_temperature(lag)}, counted from {reference:g} °C.",
        f"every length · (1 + g ({temperature_rise(reference, lag)}))",
        "ISO 230-3, thermal effects; ISO 1, 20 °C",
        usual_causes=(
            "expansion of its material",
            "instrument's scale that follows the temperature",
        ),
    )


def thermal_zero(
    robot: Robot, joint: int, lag: int = 0, *, reference: float = REFERENCE
) -> Mechanism:
    """A joint's zero wanders with temperature, with a lag [min] late."""
    rise = temperature_rise(reference, lag)
    term = Term(f"z{joint}", drive_screws(robot, joint, rise), (1e-7, 1e-3))
    return Mechanism(
        f"thermal-zero:{joint}",
        (term,),
        f"The zero of joint {joint} wanders with {_name_temperature(lag)}, counted from {reference:g} °C.",
        f"θ{joint} = q{joint} + z ({rise})",
        "ISO 230-3, thermal effects; ISO 1, 20 °C",
        usual_causes=(
            "heat of its motor or gear",
            "encoder's mount",
            "link that warms on one side",
        ),
    )


def thermal_shift(robot: Robot, lag: int = 0, *, reference: float = REFERENCE) -> Mechanism:
    """The target, or what holds it, shifts on the flange with temperature, with a lag [min] late, in a
    direction of its own."""
    rise = temperature_rise(reference, lag)
    temperature = _name_temperature(lag)
    terms = tuple(Term(f"s{a}", (Screw(robot.n + 1, a, rise),), SHIFT_BY_DEGREE) for a in AXES[:3])
    return Mechanism(
        "thermal-shift",
        terms,
        f"The target shifts on the flange with {temperature}, counted from {reference:g} °C.",
        f"target offset = s · ({rise})",
        "ISO 230-3, thermal effects; ISO 1, 20 °C",
        usual_causes=("expansion of its bracket or of the tool", "heat of a motor in the wrist"),
    )


@lru_cache(maxsize=4096)
def step_after(at: float) -> Cause:
    """Return a step, 0 before a moment of the campaign, 1 after it: its coefficient is the whole
    move."""
    return (sign(PROGRESS - at) + 1.0) / 2.0


def target_step(robot: Robot, at: float) -> Mechanism:
    """The target was moved on the flange (or the tool slipped) at some moment: its offset, by how
    much; the moment is scanned."""
    cause = step_after(at)
    return Mechanism(
        "target-step",
        tuple(Term(f"s{a}", (Screw(robot.n + 1, a, cause),), STEP["t"]) for a in AXES[:3]),
        f"The target stands elsewhere on the flange after {write_percent(at, 1)} of the campaign.",
        f"H_{robot.n + 1} = s · {cause}",
        "ISO 10360-10, laser trackers: stability of the target's nest",
        usual_causes=("reflector put back in its nest", "tool or nest that slipped or was knocked"),
    )


def zero_step(robot: Robot, joint: int, at: float) -> Mechanism:
    """A joint's zero is another one from some moment on, by how much; the moment is scanned."""
    cause = step_after(at)
    screws = drive_screws(robot, joint, cause)
    axis = screws[0].axis
    size = STEP[axis[0]]
    term = Term(f"z{joint}", screws, size)
    drive = name_drive(robot, joint)
    share = write_percent(at, 1)
    return Mechanism(
        f"zero-step:{joint}",
        (term,),
        f"The zero of {drive} is another one after {share} of the campaign.",
        f"{drive_angle(robot, joint)} + z · {cause}",
        "a step of a zero; ISO 9283, drift of the pose",
        usual_causes=(
            "collision",
            "belt or coupling that slipped",
            "encoder or brake that was moved, or set anew",
        ),
    )


def tracker_step(robot: Robot, at: float) -> Mechanism:
    """The tracker (or the base) was moved at some moment: all six, by how much; the moment is
    scanned."""
    cause = step_after(at)
    return Mechanism(
        "tracker-step",
        tuple(Term(f"j{a}", (Screw(1, a, cause),), STEP[a[0]]) for a in AXES),
        f"The instrument and the base stand differently relative to each other after {write_percent(at, 1)} of the campaign.",
        f"H_1 = j · {cause}",
        "ISO 10360-10, laser trackers: stability",
        usual_causes=(
            "instrument or its stand knocked or moved",
            "anchor bolts",
            "instrument started anew",
        ),
    )


def tracker_bumped(robot: Robot, at: float) -> Mechanism:
    """The same step, seen as a fault of the measurement: no measurement tells the two apart, so that
    its sentence says neither."""
    step = tracker_step(robot, at)
    return Mechanism(
        "fault:tracker-bumped",
        step.terms,
        step.sentence,
        step.equation,
        step.source,
        usual_causes=step.usual_causes,
    )


def _list_coordinates(robot: Robot) -> list[tuple[str, Cause]]:
    """List (axis of frame 1, coordinate of the nominal target along it): a scale about frame 0's
    origin."""
    coordinates = [Named(f"{name}_mm", "mm") for name in "xyz"]
    return turn_to_frame_1(robot, coordinates)


def turn_to_frame_1(robot: Robot, vector: Sequence[Cause]) -> list[tuple[str, Cause]]:
    """List (axis of frame 1, component along it) of a vector of frame 0."""
    rotation = robot.joints[0].before[:3, :3]
    out: list[tuple[str, Cause]] = []
    for axis, direction in zip(AXES[:3], rotation.T, strict=True):
        summands = list[Cause]()
        for coordinate, number in zip(vector, direction, strict=True):
            if abs(number) <= 1e-9:
                continue
            summand = coordinate
            if number != 1:
                summand = float(number) * coordinate
            summands.append(summand)
        if not summands:
            continue
        cause, *others = summands
        for summand in others:
            cause = cause + summand
        component = (axis, cause)
        out.append(component)
    return out


def tracker_scale(robot: Robot) -> Mechanism:
    """Distances measured too long in proportion (a scale about any point differs by a constant
    shift)."""
    return Mechanism(
        "tracker-scale",
        (
            Term(
                "σ",
                tuple(Screw(1, axis, cause) for axis, cause in _list_coordinates(robot)),
                (1e-7, 2e-3),
            ),
        ),
        "Measured lengths are too long in proportion.",
        "x = (1 + σ) x",
        "ISO 10360-10, laser trackers: scale",
        "Measured lengths are too short in proportion.",
        usual_causes=(
            "instrument's scale",
            "air temperature and pressure given to it",
            "arm that is warm",
        ),
    )


def tracker_axes(robot: Robot) -> Mechanism:
    """The instrument's axes have scales of their own, and are not square: what a symmetric matrix
    without a trace does to every position. What all lengths have in common, an arm of longer links
    has, too."""
    coordinates = _list_coordinates(robot)
    size = (1e-7, 2e-3)
    *stretching, (last, along_last) = coordinates
    shrunk = Screw(1, last, -1.0 * along_last)
    stretched = [
        Term(f"e{axis[1]}", (Screw(1, axis, cause), shrunk), size) for axis, cause in stretching
    ]
    skewed = []
    for (first, along_first), (second, along_second) in combinations(coordinates, 2):
        screws = (Screw(1, first, along_second), Screw(1, second, along_first))
        skew = Term(f"g{first[1]}{second[1]}", screws, size)
        skewed.append(skew)
    return Mechanism(
        "tracker-axes",
        (*stretched, *skewed),
        "The instrument's axes are not square, or have scales of their own.",
        "x = (1 + E) x, E symmetric, its trace 0",
        "ISO 10360-2, coordinate measuring machines: squareness and scales of the axes",
        usual_causes=(
            "camera's calibration",
            "squareness or scales of the measuring machine",
            "frame built from wrong reference points",
        ),
    )


def refraction(robot: Robot) -> Mechanism | None:
    """The beam bends down (or up) with the square of the distance, as the air's temperature changes
    with height."""
    if robot.gravity is None:
        return None
    up = -robot.joints[0].before[:3, :3].T @ np.array(robot.gravity)
    far = Named("range_mm", "mm")
    square = far * far
    screws = tuple(
        Screw(1, AXES[a], square if up[a] == 1 else float(up[a]) * square)
        for a in range(3)
        if abs(up[a]) > 1e-9
    )
    return Mechanism(
        "refraction",
        (Term("ρ", screws, (1e-12, 1e-7)),),
        "Measured heights err with the square of the distance.",
        "height error = ρ · range²",
        "Estler et al. 2002, large-scale metrology",
        usual_causes=("air whose temperature changes with the height",),
    )
