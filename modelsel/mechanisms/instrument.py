"""Errors of an instrument that measures a distance and two angles: a laser tracker, a total station.

Its upright axis is the z axis of its frame. An error of an angle shifts what is measured across the
beam, in proportion to the distance; one of the beam's place shifts it alike everywhere."""

from __future__ import annotations

from itertools import combinations_with_replacement

from ..robot.kinematics import Robot
from .causes import Cause, Named, Number, cos, sin
from .environment import turn_to_frame_1
from .terms import Mechanism, Screw, Term, terms_of

ANGLE = (1e-6, 1e-3)  # rad
OFFSET = (1e-3, 5.0)  # mm
AZIMUTH: Cause = Named("beam_azimuth", "rad")
ZENITH: Cause = Named("beam_zenith", "rad")
FAR: Cause = Named("range_mm", "mm")
MODELS = "Hughes et al. 2011 and Muralikrishnan et al. 2009, error models of laser trackers"
# errors that are smooth over the volume that is measured, which are not registered: of a lens, and
# polynomials
RADIAL = "radial lens distortion"
FIELDS = {2: "quadratic field distortion", 3: "cubic field distortion"}
# names, without joint, of errors of what measures, which the arm does not have
MISREADINGS = (
    RADIAL,
    *FIELDS.values(),
    "tracker-scale",
    "tracker-axes",
    "tracker-range",
    "tracker-azimuth",
    "tracker-zenith",
    "tracker-index",
    "tracker-transit",
    "tracker-collimation",
    "tracker-offset",
    "tracker-errors",
    "reflector-incidence",
    "refraction",
)
# errors a turn of a circle that is not centred, and of one that is not round
WAVES = (1, 2)
# degrees of the polynomial by which a distance follows the side that the beam meets
DEGREES = (1, 2)


def _shift(robot: Robot, direction: str, amount: Cause | None = None) -> tuple[Screw, ...]:
    """Build the screws that shift all targets along a direction of each row by an amount [mm], by
    1 mm where none is given."""
    components = [Named(f"{direction}_{axis}") for axis in "xyz"]
    screws = []
    for axis, component in turn_to_frame_1(robot, components):
        cause = component
        if amount is not None:
            cause = amount * component
        screws.append(Screw(1, axis, cause))
    return tuple(screws)


def shift_across_axis(robot: Robot, amount: Cause) -> tuple[Screw, ...]:
    """Build the screws that shift all targets away from the z axis of the instrument's frame, across
    it, by an amount [mm]."""
    along = amount * sin(ZENITH)
    down = amount * cos(ZENITH) * Number(-1.0)
    return (*_shift(robot, "beam", along), *_shift(robot, "beam_rise", down))


def _multiply(count: float, angle: Cause) -> Cause:
    return angle if count == 1 else count * angle


def tracker_range(robot: Robot) -> Mechanism:
    """Distances from the instrument measured too long by a constant: the target seems farther along
    the beam."""
    return Mechanism(
        "tracker-range",
        (Term("ρ0", _shift(robot, "beam"), (1e-3, 20.0)),),
        "Distances from the instrument are too long by the same amount everywhere.",
        "x = x + ρ0 · direction of the beam",
        "ISO 10360-10, laser trackers: distances; offset of the reflector",
        "Distances from the instrument are too short by the same amount everywhere.",
        usual_causes=(
            "offset of another reflector given to the instrument",
            "zero of its distance meter",
            "instrument that stands elsewhere than assumed",
        ),
    )


def tracker_azimuth(robot: Robot, count: float) -> Mechanism:
    """The circle of the horizontal angle is not centred, or not round: the angle errs once, or twice
    a turn."""
    level = FAR * sin(ZENITH)
    angle = _multiply(count, AZIMUTH)
    cosine = _shift(robot, "beam_aside", level * cos(angle))
    sine = _shift(robot, "beam_aside", level * sin(angle))
    return Mechanism(
        "tracker-azimuth",
        (Term("hc", cosine, ANGLE), Term("hs", sine, ANGLE)),
        "The instrument's horizontal angle errs in waves of itself.",
        f"azimuth + hc {cos(angle)} + hs {sin(angle)}",
        MODELS,
        usual_causes=("encoder of the instrument's upright axis that is eccentric or oval",),
    )


def tracker_zenith(robot: Robot, count: float) -> Mechanism:
    """The circle of the vertical angle is not centred, or not round: the angle errs once, or twice a
    turn."""
    angle = _multiply(count, ZENITH)
    cosine = _shift(robot, "beam_rise", FAR * cos(angle))
    sine = _shift(robot, "beam_rise", FAR * sin(angle))
    return Mechanism(
        "tracker-zenith",
        (Term("vc", cosine, ANGLE), Term("vs", sine, ANGLE)),
        "The instrument's vertical angle errs in waves of itself.",
        f"elevation + vc {cos(angle)} + vs {sin(angle)}",
        MODELS,
        usual_causes=("encoder of the instrument's level axis that is eccentric or oval",),
    )


def tracker_index(robot: Robot) -> Mechanism:
    """The vertical angle does not count from the upright axis."""
    return Mechanism(
        "tracker-index",
        (Term("v0", _shift(robot, "beam_rise", FAR), ANGLE),),
        "The instrument's vertical angle is off by the same amount everywhere.",
        "elevation + v0",
        MODELS,
        usual_causes=("index of the encoder of the instrument's level axis",),
    )


def tracker_transit(robot: Robot) -> Mechanism:
    """The axis about which the head tilts is not level: a raised beam points aside."""
    height = FAR * cos(ZENITH)
    return Mechanism(
        "tracker-transit",
        (Term("i", _shift(robot, "beam_aside", height), ANGLE),),
        "The instrument's two axes are not at right angles.",
        "azimuth + i / tan(zenith)",
        MODELS,
        usual_causes=("level axis of the instrument that is tilted", "head that was knocked"),
    )


def tracker_collimation(robot: Robot) -> Mechanism:
    """The beam does not leave at right angles to the axis about which the head tilts."""
    return Mechanism(
        "tracker-collimation",
        (Term("c", _shift(robot, "beam_aside", FAR), ANGLE),),
        "The beam points aside from where the instrument's head does.",
        "azimuth + c / sin(zenith)",
        MODELS,
        usual_causes=("mirror or laser of the instrument that has turned",),
    )


def tracker_offset(robot: Robot) -> Mechanism:
    """The beam passes beside the point where the instrument's axes meet."""
    aside = _shift(robot, "beam_aside")
    rise = _shift(robot, "beam_rise")
    return Mechanism(
        "tracker-offset",
        (Term("oh", aside, OFFSET), Term("ov", rise, OFFSET)),
        "The beam passes beside the point where the instrument's axes meet.",
        "azimuth + oh / (range sin(zenith)), elevation + ov / range",
        MODELS,
        usual_causes=("mirror or laser of the instrument that has shifted",),
    )


def tracker_errors(robot: Robot) -> Mechanism:
    """Errors of angles and beam all together, as an instrument has that was long not compensated."""
    parts = (
        tracker_azimuth(robot, 1),
        tracker_zenith(robot, 1),
        tracker_index(robot),
        tracker_transit(robot),
        tracker_collimation(robot),
        tracker_offset(robot),
    )
    return Mechanism(
        "tracker-errors",
        terms_of(parts),
        "Several angles of the instrument err, or its beam passes beside its axes.",
        "; ".join(part.equation for part in parts),
        MODELS,
        usual_causes=("instrument that was not compensated for long, or knocked",),
    )


def reflector_incidence(robot: Robot, degree: float) -> Mechanism:
    """A distance follows the side from which the beam meets the target, by a polynomial: of degree 1
    it has 1 - cos of the angle to any axis, of degree 2 the square of its sine, too."""
    sides: list[Cause] = [Named(f"beam_face_{axis}") for axis in "xyz"]
    terms = [Term("ρ0", _shift(robot, "beam"), OFFSET)]
    for axis, side in zip("xyz", sides, strict=True):
        terms.append(Term(f"k{axis}", _shift(robot, "beam", side), OFFSET))
    if degree > 1:
        # the three squares have the sum 1
        *products, _ = combinations_with_replacement(zip("xyz", sides, strict=True), 2)
        for (axis, side), (other, turned) in products:
            terms.append(Term(f"k{axis}{other}", _shift(robot, "beam", side * turned), OFFSET))
    return Mechanism(
        "reflector-incidence",
        tuple(terms),
        "Distances from the instrument err with the side from which the beam meets the target.",
        "x = x + (polynomial of the beam in the target's frame) · direction of the beam",
        "ISO 10360-10, laser trackers: retro-reflectors, angle of incidence",
        usual_causes=(
            "reflector that is not turned towards the instrument",
            "prism of glass",
            "reflector whose mirrors do not meet in its centre",
        ),
    )
