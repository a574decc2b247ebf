"""Usable numbers: what a finding means in units that a mechanic, a buyer or a controller takes.

Angles of play and ripple are in arc seconds with their millimetres at the wrist or at the target,
thermal effects are per 10 K, slopes per quarter of a turn; `compliance_numbers` has wind-up and
stiffness. A finding without an entry here has its worst effect alone."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from ...diagnosis.findings.sentences import has_contrary_signs, is_wave
from ...diagnosis.findings.torque_functions import find_loaded_joint
from ...fitting.design import PLACE
from ...measurements.campaign.reference_temperature import TEMPERATURE
from ...measurements.campaign.state_names import StateKind, parse_state_name
from ...mechanisms.causes import Bump, Cause, Combined, Named
from ...mechanisms.environment import find_references
from ...mechanisms.motors import name_drive
from ...mechanisms.terms import Mechanism
from ...robot.kinematics import Robot
from ..runs.map_details import MIN_DISPLACEMENT
from .compliance_numbers import (
    measure_base_tilt,
    measure_joint_turn,
    measure_payload_bending,
    measure_wind_up,
)
from .instrument_numbers import (
    measure_angle,
    measure_angle_wave,
    measure_axes,
    measure_beam_offset,
    measure_errors,
    measure_incidence,
    measure_range,
    measure_scale,
)
from .lag_numbers import measure_servo_lag
from .quantities import ARC_SECONDS, MILLI, Usable, express, format_figure, say_where
from .target_numbers import (
    RISE,
    measure_droop,
    measure_load,
    measure_load_shift,
    measure_stretch,
    measure_tool_play,
    measure_warm_shift,
)
from .workspace import Fitted, Range

SHIFTS = slice(0, 3)
ABOUT_Z = slice(5, 6)
# mechanisms whose estimate is half of the step between two sides
PLAYS = ("backlash", "approach-backlash", "overshoot")
# kinds of state that have two sides
SIDED = (StateKind.APPROACH, StateKind.DRAG)
SIDES = "difference between the two directions"
# rad and mm over which slopes are told
# where a turn of a joint moves the target most; the worst over all readings is told beside it
AT_LONGEST = "at the target at the longest lever"
QUARTER_TURN = np.pi / 2
METRE = 1000.0
# joints of an arm that has a wrist of three
WRIST_JOINTS = 6

Measure = Callable[[Mechanism, Fitted], Iterator[Usable]]


def list_usable(mechanism: Mechanism, fitted: Fitted) -> list[Usable]:
    """List the usable numbers of an effect; none where the catalogue knows none. An effect that
    only turns the target has none in mm there."""
    measure = MEASURES.get(mechanism.stem)
    if measure is None:
        measure = _choose_by_shape(mechanism, fitted.workspace.problem.robot)
    if measure is None:
        return []
    usable = []
    for one in measure(mechanism, fitted):
        is_large = abs(one.value) >= MIN_DISPLACEMENT
        if one.unit != "mm" or is_large:
            usable.append(one)
    return usable


def _choose_by_shape(mechanism: Mechanism, robot: Robot) -> Measure | None:
    terms = mechanism.terms
    if is_wave(terms):
        return _measure_wave
    screws = terms[0].screws
    first = screws[0]
    if isinstance(first.cause, Bump):
        return _measure_curve if first.axis == "rz" else None
    if first.axis == "rz" and find_loaded_joint(robot, mechanism):
        return measure_joint_turn
    if len(terms) > 1 or len(screws) > 1:
        return None
    return _choose_by_driver(first.cause)


def _choose_by_driver(cause: Cause) -> Measure | None:
    """Choose how to measure an effect of one screw: a side of approach, or a rise in temperature."""
    (name, *others) = sorted(cause.names()) or [""]
    variable = parse_state_name(name)
    is_side = variable is not None and variable.kind in SIDED
    if is_side and isinstance(cause, Named):
        return _measure_sides
    is_rise = isinstance(cause, Named) or (isinstance(cause, Combined) and cause.operator in "+-")
    if find_references(cause) and not others and is_rise:
        return _measure_warm_place
    return None


# -- play


@dataclass(frozen=True)
class _Lever:
    """The longest lever [mm] of a joint's rotation, and of what."""

    mm: float
    point: str


def _measure_play(mechanism: Mechanism, fitted: Fitted) -> Iterator[Usable]:
    """Measure the whole step between the two sides, and what it is at the wrist; nothing where one
    side alone was measured."""
    screw = mechanism.terms[0].screws[0]
    if not fitted.workspace.has_both_sides(screw.cause):
        return
    words = _describe_step(mechanism, fitted)
    both_sides = np.array([2.0])
    whole = fitted.range_of(both_sides)
    if screw.axis == "tz":
        yield express(words, whole, "mm")
        return
    turn = whole.scale(ARC_SECONDS)
    seconds = f"{format_figure(turn.value)} arc seconds"
    step = "" if words == SIDES else f"of {words} from side to side, or {seconds}"
    yield express(words, turn, "arcsec", step)
    lever = _find_wrist_lever(fitted, screw.frame)
    moved = whole.scale(lever.mm)
    at = f"at the {lever.point}"
    yield express(f"{words} {at}", moved, "mm", f"{at} from side to side")


def _measure_sides(mechanism: Mechanism, fitted: Fitted) -> Iterator[Usable]:
    """Measure the whole step of a place that has no registered name; nothing where one side alone
    was measured."""
    screw = mechanism.terms[0].screws[0]
    if not fitted.workspace.has_both_sides(screw.cause):
        return
    (variable,) = map(parse_state_name, screw.cause.names())
    assert variable is not None
    whole = fitted.range_of(np.array([2.0 * variable.most]))
    yield _express_motion(SIDES, whole, screw.axis)


def _express_motion(words: str, motion: Range, axis: str, where: str = "") -> Usable:
    """Express a shift in mm, a turn in arc seconds."""
    kind = axis[0]
    if kind == "t":
        return express(words, motion, "mm", where)
    turn = motion.scale(ARC_SECONDS)
    return express(words, turn, "arcsec", where)


def _describe_step(mechanism: Mechanism, fitted: Fitted) -> str:
    if mechanism.stem == "overshoot":
        return SIDES
    if has_contrary_signs(mechanism, fitted.estimate):
        return "step"
    return "play"


def _find_wrist_lever(fitted: Fitted, joint: int) -> _Lever:
    """Find how far the wrist (the target, for a joint of the wrist) is from a joint's axis at most."""
    pose = fitted.workspace.pose
    n = fitted.workspace.problem.robot.n
    wrist = n - 1 if n >= WRIST_JOINTS else n
    if joint >= wrist:
        return _Lever(_find_lever(fitted, joint), "target")
    offset = pose.origins[wrist - 1] - pose.origins[joint - 1]
    moved = np.cross(pose.axes[joint - 1, 2], offset, axis=0)
    return _Lever(float(np.linalg.norm(moved, axis=0).max()), "wrist")


def _find_lever(fitted: Fitted, frame: int) -> float:
    """Find how far the target moves at most per rad about a frame's z axis [mm]."""
    moved = fitted.workspace.field[frame - 1, PLACE["rz"], :3]
    return float(np.linalg.norm(moved, axis=0).max())


def _measure_rocking(mechanism: Mechanism, fitted: Fitted) -> Iterator[Usable]:
    """Measure how far the base tips about each edge from side to side, and what both do at the
    target."""
    count = len(mechanism.terms)
    for number, own in enumerate(np.eye(count), 1):
        half = fitted.range_of(own)
        whole = half.scale(2 * MILLI)
        words = f"tips about edge {number}"
        yield express(words, whole, "mrad")
    row = fitted.find_worst()
    moved = fitted.moved_at(row)
    moved = moved.scale(2.0)
    where = say_where("at the target from side to side", fitted, row)
    yield express("from side to side, at the target", moved, "mm", where)


# -- ripple


def _measure_wave(mechanism: Mechanism, fitted: Fitted) -> Iterator[Usable]:
    """Measure the amplitude of a wave: of the larger direction, where it has two."""
    is_turn = mechanism.terms[0].screws[0].axis[0] == "r"
    amplitude = _find_amplitude(fitted)
    if is_turn:
        yield express("amplitude", amplitude.scale(ARC_SECONDS), "arcsec")
    else:
        yield express("amplitude", amplitude, "mm")
    yield _express_most("amplitude at the target", fitted)


def _express_most(words: str, fitted: Fitted) -> Usable:
    """Express how far the target moves at most."""
    row = fitted.find_worst()
    moved = fitted.moved_at(row)
    where = say_where("at the target at most", fitted, row)
    return express(words, moved, "mm", where)


def _find_amplitude(fitted: Fitted) -> Range:
    """Find the largest amplitude of sine and cosine terms, two an axis."""
    pairs = fitted.estimate.reshape(-1, 2)
    left, _, right = np.linalg.svd(pairs)
    return fitted.range_of(np.outer(left[:, 0], right[0]).reshape(-1))


def _measure_curve(mechanism: Mechanism, fitted: Fitted) -> Iterator[Usable]:
    """Measure a free function from its lowest to its highest point, within the measured range."""
    frame = mechanism.terms[0].screws[0].frame
    turn, each = fitted.turn(frame, ABOUT_Z)
    seen = turn[0, : fitted.workspace.measured]
    gradient = each[:, 0, int(seen.argmax())] - each[:, 0, int(seen.argmin())]
    height = fitted.range_of(gradient)
    yield express("peak to peak", height.scale(ARC_SECONDS), "arcsec")
    lever = _find_lever(fitted, frame)
    moved = height.scale(lever)
    yield express("peak to peak at the target", moved, "mm", AT_LONGEST)


# -- slopes


def _measure_slope(mechanism: Mechanism, fitted: Fitted) -> Iterator[Usable]:
    """Measure what every term turns over a quarter of a turn of its driver, or slides over a metre."""
    terms = mechanism.terms
    units = np.eye(len(terms))
    for term, unit in zip(terms, units, strict=True):
        screw = term.screws[0]
        driver = _describe_driver(mechanism, screw.cause, fitted.workspace.problem.robot)
        slope = fitted.range_of(unit)
        if screw.axis == "tz":
            words = f"over 1 m {driver}"
            shift = slope.scale(METRE)
            yield express(words, shift, "mm", words)
            continue
        over = slope.scale(QUARTER_TURN)
        words = f"over 90° {driver}"
        turn = over.scale(ARC_SECONDS)
        yield express(words, turn, "arcsec", words)
        lever = _find_lever(fitted, screw.frame)
        moved = over.scale(lever)
        yield express(f"{words}, at the target", moved, "mm", AT_LONGEST)


def _describe_driver(mechanism: Mechanism, cause: Cause, robot: Robot) -> str:
    drive = name_drive(robot, mechanism.joint or 1)
    if mechanism.stem == "slide-scales":
        return "of every slide"
    if mechanism.stem == "settle":
        return f"of {drive}'s last move"
    if mechanism.stem == "encoder-scale":
        return f"of {drive}"
    return f"of joint {str(cause).removeprefix('q')}"


# -- temperature


def _measure_growth(mechanism: Mechanism, fitted: Fitted) -> Iterator[Usable]:
    """Measure a thermal coefficient, and what 10 K do to the link and to the target."""
    reference, warm = _warm(mechanism, fitted)
    yield express("expansion", fitted.range_of(np.ones(1)).scale(1e6), "ppm/K")
    if mechanism.stem == "thermal-growth":
        frame = mechanism.terms[0].screws[0].frame
        shift, each = warm.turn(frame, SHIFTS)
        longer = warm.length_at(shift, each, 0)
        words = f"per 10 K, counted from {reference:g} °C"
        yield express(f"growth of the link {words}", longer, "mm", words)
    yield _measure_warm_target(reference, warm)


def _measure_warm_place(mechanism: Mechanism, fitted: Fitted) -> Iterator[Usable]:
    """Measure what 10 K do to a joint's zero, or to a place that has no registered name."""
    reference, warm = _warm(mechanism, fitted)
    screw = mechanism.terms[0].screws[0]
    place = PLACE[screw.axis]
    shift, each = warm.turn(screw.frame, slice(place, place + 1))
    moved = warm.length_at(shift, each, 0)
    words = f"per 10 K, counted from {reference:g} °C"
    yield _express_motion(words, moved, screw.axis, words)
    yield _measure_warm_target(reference, warm)


def _warm(mechanism: Mechanism, fitted: Fitted) -> tuple[float, Fitted]:
    """Return the reference [°C] that an effect counts from, and the effect 10 K above it."""
    (reference,) = find_references(mechanism.terms[0].screws[0].cause)
    workspace = fitted.workspace.at_covariate(TEMPERATURE, reference + RISE)
    return reference, Fitted(fitted.terms, fitted.estimate, fitted.covariance, workspace)


def _measure_warm_target(reference: float, warm: Fitted) -> Usable:
    row = warm.find_worst()
    moved = warm.moved_at(row)
    words = f"at the target per 10 K, counted from {reference:g} °C"
    where = say_where("at the target per 10 K", warm, row)
    return express(words, moved, "mm", where)


# -- set-up


def _measure_jump(mechanism: Mechanism, fitted: Fitted) -> Iterator[Usable]:
    """Measure how far a frame moves between the beginning and the end; nothing of a free course."""
    if any(isinstance(screw.cause, Bump) for term in mechanism.terms for screw in term.screws):
        return
    axes = [term.screws[0].axis for term in mechanism.terms]
    for kind, words in (("t", "shift"), ("r", "turn")):
        is_kind = np.array([axis[0] == kind for axis in axes])
        if not is_kind.any():
            continue
        vector = np.where(is_kind, fitted.estimate, 0.0)
        length = float(np.linalg.norm(vector))
        moved = fitted.range_of(vector / length) if length else Range(0.0, 0.0, 0.0)
        yield _express_motion(words, moved, kind)


def _measure_zero(mechanism: Mechanism, fitted: Fitted) -> Iterator[Usable]:
    """Measure how far a joint's zero moves, and the target with it."""
    yield from _measure_jump(mechanism, fitted)
    yield _express_most("step at the target", fitted)


MEASURES: Mapping[str, Measure] = {
    **dict.fromkeys(
        (
            "joint-compliance",
            "joint2-twist",
            "joint3-twist",
            "gravity-twist",
            "lateral-compliance",
            "link-bending",
            "payload-deflection",
        ),
        measure_wind_up,
    ),
    "payload-bending": measure_payload_bending,
    "base-tilt": measure_base_tilt,
    "base-rocking": _measure_rocking,
    **dict.fromkeys(PLAYS, _measure_play),
    "gear-eccentricity": _measure_wave,
    "encoder-eccentricity": _measure_wave,
    "gear-ripple": _measure_wave,
    "axis-wobble": _measure_wave,
    **dict.fromkeys(("encoder-scale", "slide-scales", "wrist-coupling", "settle"), _measure_slope),
    "servo-lag": measure_servo_lag,
    "thermal-growth": _measure_growth,
    "thermal-expansion": _measure_growth,
    "thermal-zero": _measure_warm_place,
    **dict.fromkeys(("tracker-drift", "tracker-step", "target-step"), _measure_jump),
    "zero-step": _measure_zero,
    "tracker-scale": measure_scale,
    "tracker-axes": measure_axes,
    "tool-droop": measure_droop,
    "tool-stretch": measure_stretch,
    "tool-play": measure_tool_play,
    "payload-droop": measure_load,
    "payload-shift": measure_load_shift,
    "thermal-shift": measure_warm_shift,
    "tracker-range": measure_range,
    "tracker-azimuth": measure_angle_wave,
    "tracker-zenith": measure_angle_wave,
    **dict.fromkeys(("tracker-index", "tracker-transit", "tracker-collimation"), measure_angle),
    "tracker-offset": measure_beam_offset,
    "tracker-errors": measure_errors,
    "reflector-incidence": measure_incidence,
}
