"""Compliance as a mechanic tells it: wind-up at full stretch, and one stiffness.

Full stretch is the row of the workspace with the largest load. A stiffness in N m/rad needs the
load in N m: the robot file's masses, or a payload that is measured."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from ..._typing import Array
from ...diagnosis.findings.springs_apart import SpringsApart
from ...diagnosis.shapes.whole_torques import find_load
from ...mechanisms.beams import name_moments
from ...mechanisms.bending import LINK_BENDING
from ...mechanisms.causes import torque
from ...mechanisms.compliance import (
    PAYLOAD_DEFLECTION,
    has_known_masses,
    needs_both_loads,
    payload_torque,
    whole_torque,
)
from ...mechanisms.motors import motor_torque, name_drive
from ...mechanisms.terms import Mechanism
from ...robot.gravity import declares_masses, declares_masses_beyond, find_gravity_joints
from ...robot.kinematics import Robot
from .quantities import MILLI, Usable, express, format_figure, say_where
from .workspace import NORMAL_95, Fitted, Range, Workspace

TURNS = slice(3, 6)
STIFFNESS = "stiffness"
IF_DECLARED = "stiffness with the arm's masses as declared"
OF_PAYLOAD = "stiffness under the payload, whatever the arm's masses"
NO_MASSES = " (no stiffness: the robot file gives no masses)"
NO_PLACE = " (no stiffness: where the payload hangs is not known)"
SOME_MASSES = " (no stiffness: the robot file does not give all masses that are held there)"


def measure_wind_up(mechanism: Mechanism, fitted: Fitted) -> Iterator[Usable]:
    """Measure wind-up, its millimetres and the stiffness of every joint or link that yields."""
    frames = [term.screws[0].frame for term in mechanism.terms]
    for frame in sorted(set(frames)):
        own = [k for k, of in enumerate(frames) if of == frame]
        part = Fitted(
            tuple(mechanism.terms[k] for k in own),
            fitted.estimate[own],
            fitted.covariance[np.ix_(own, own)],
            fitted.workspace,
        )
        load = _find_load(mechanism, frame, part)
        robot = fitted.workspace.problem.robot
        lacking = _find_lacking(robot, frame)
        if mechanism.stem == PAYLOAD_DEFLECTION:
            lacking = NO_PLACE if _hangs_anywhere(mechanism) else ""
        words = f"{_describe_motion(mechanism, frame, robot)} at full stretch"
        ends = frame == max(frames)
        stiffness = IF_DECLARED if needs_both_loads(mechanism) else STIFFNESS
        yield from _measure_yield(words, part, _Load(frame, load, lacking, ends, stiffness))


def measure_springs_apart(apart: SpringsApart) -> Usable:
    """Measure the stiffness that the payload alone tells of a spring under both loads."""
    margin = NORMAL_95 * apart.error
    least = max(apart.compliance - margin, 0.0)
    compliance = Range(apart.compliance, least, apart.compliance + margin)
    return express(OF_PAYLOAD, compliance.invert(1.0), "N m/rad")


def measure_joint_turn(mechanism: Mechanism, fitted: Fitted) -> Iterator[Usable]:
    """Measure how far a joint turns at its largest measured torque, by any function of this, and its
    millimetres: what is not in proportion has no stiffness."""
    screw = mechanism.terms[0].screws[0]
    joint = screw.frame
    workspace = fitted.workspace
    load = find_load(workspace.problem.robot, joint, mechanism.names())
    torques = np.abs(workspace.problem.cause(torque(joint) if load is None else load))
    seen = torques[: workspace.measured]
    row = int(seen.argmax())
    turn, each = fitted.turn(joint, TURNS)
    angle = fitted.length_at(turn, each, row)
    largest = format_figure(float(torques[row]))
    is_known = declares_masses_beyond(workspace.problem.robot, joint)
    newton_metres = f" ({largest} N m)" if is_known else ""
    words = f"turn of joint {joint} at its largest measured torque{newton_metres}"
    moved = fitted.moved_at(row)
    yield express(words, angle.scale(MILLI), "mrad")
    yield express(f"{words}, at the target", moved, "mm", "at the target there")


def measure_base_tilt(mechanism: Mechanism, fitted: Fitted) -> Iterator[Usable]:
    """Measure the tilt of the base, its millimetres and its stiffness."""
    workspace = fitted.workspace
    size = _weigh_turn(mechanism, 1, workspace)
    words = "tilt of the base at full stretch"
    robot = workspace.problem.robot
    # what turns about the vertical alone has hardly a moment on the base
    first = min(find_gravity_joints(robot), default=1)
    lacking = _find_lacking(robot, first)
    yield from _measure_yield(words, fitted, _Load(1, size, lacking, True))


def measure_payload_bending(mechanism: Mechanism, fitted: Fitted) -> Iterator[Usable]:
    """Measure how far a payload turns a link's end or the flange at most, its millimetres and, where
    it is thought to hang at the target, the stiffness."""
    frame = mechanism.terms[0].screws[0].frame
    turn, each = fitted.turn(frame, TURNS)
    size = np.linalg.norm(turn, axis=0)
    row = int(size.argmax())
    angle = fitted.length_at(turn, each, row)
    last = fitted.workspace.problem.robot.n
    end = "the flange" if frame > last else f"the end of link {frame - 1}"
    words = f"turn of {end} under the payload"
    under, torque = words, 0.0
    if len(each) == 1:
        torque = float(np.linalg.norm(each[0, :, row]))
        under = f"{words} ({format_figure(torque)} N m)"
    yield express(under, angle.scale(MILLI), "mrad")
    there = say_where("at the target there", fitted, row)
    moved = fitted.moved_at(row)
    at_target = f"{words}, at the target"
    yield express(at_target, moved, "mm", there)
    if torque and angle.value:
        yield express(STIFFNESS, angle.invert(torque), "N m/rad")


@dataclass(frozen=True, eq=False)
class _Load:
    """What a frame yields to: `size` (m,), what is `lacking` to know it in N m, whether no other frame of
    the effect follows, and what its `stiffness` is called."""

    frame: int
    size: Array
    lacking: str
    ends: bool
    stiffness: str = STIFFNESS


def _measure_yield(words: str, part: Fitted, load: _Load) -> Iterator[Usable]:
    """Measure what yields where the load is largest; with a load in N m, its stiffness."""
    row = int(load.size.argmax())
    turn, each = part.turn(load.frame, TURNS)
    angle = part.length_at(turn, each, row)
    torque = float(load.size[row])
    moved = part.moved_at(row)
    at_target, there = f"{words}, at the target", say_where("at the target there", part, row)
    if load.lacking:
        wound = express(words, angle.scale(MILLI), "mrad")
        yield replace(wound, text=f"{wound.text}{load.lacking if load.ends else ''}")
        yield express(at_target, moved, "mm", there)
        return
    under = f"{words} ({format_figure(torque)} N m)"
    yield express(under, angle.scale(MILLI), "mrad")
    yield express(at_target, moved, "mm", there)
    if torque and angle.value:
        yield express(load.stiffness, angle.invert(torque), "N m/rad")


def _find_lacking(robot: Robot, joint: int) -> str:
    """Find what is lacking to know the torque about a joint in N m, in words; nothing where all masses
    that it carries are declared."""
    if declares_masses_beyond(robot, joint):
        return ""
    return SOME_MASSES if declares_masses(robot) else NO_MASSES


def _hangs_anywhere(mechanism: Mechanism) -> bool:
    """Whether a drive winds up under a payload of which nobody knows where it hangs."""
    if mechanism.stem != PAYLOAD_DEFLECTION:
        return False
    numbers = len(mechanism.terms)
    return numbers > 1


def _find_load(mechanism: Mechanism, frame: int, part: Fitted) -> Array:
    """Find the load (m,) that a joint or a link's end yields to [N m; of 1 kg everywhere where the
    robot file has no masses]; what turns under a load that is not known is in proportion to that."""
    workspace = part.workspace
    problem = workspace.problem
    if _hangs_anywhere(mechanism):
        turn, _ = part.turn(frame, TURNS)
        return np.asarray(np.linalg.norm(turn, axis=0))
    robot = problem.robot
    motor = mechanism.joint or frame
    if mechanism.stem == PAYLOAD_DEFLECTION:
        return np.asarray(np.abs(problem.cause(payload_torque(robot, motor))))
    if mechanism.stem == LINK_BENDING:
        return _weigh_end(mechanism, frame, workspace)
    if needs_both_loads(mechanism):
        return np.asarray(np.abs(problem.cause(whole_torque(robot, motor))))
    if mechanism.stem != "lateral-compliance":
        return np.asarray(np.abs(problem.cause(motor_torque(robot, motor))))
    across = [problem.value(f"moment{frame}_{axis}") for axis in "xy"]
    return np.hypot(*across)


def _weigh_end(mechanism: Mechanism, frame: int, workspace: Workspace) -> Array:
    """Weigh the moment (m,) that a link's end turns with, of a beam with the force's part; of masses that
    are not known, that of the declared ones, or of 1 kg everywhere."""
    if has_known_masses(mechanism):
        return _weigh_turn(mechanism, frame, workspace)
    problem = workspace.problem
    moments = name_moments(problem.robot, frame)
    square = np.zeros(len(problem))
    for moment in moments.values():
        values = problem.cause(moment)
        square += np.square(values)
    return np.sqrt(square)


def _weigh_turn(mechanism: Mechanism, frame: int, workspace: Workspace) -> Array:
    """Weigh the moment (m,) that a frame turns with, where every number has the same unit."""
    turn = np.zeros((3, len(workspace.problem)))
    for term in mechanism.terms:
        turn += workspace.twist(term, frame, TURNS)
    size: Array = np.linalg.norm(turn, axis=0)
    return size


def _describe_motion(mechanism: Mechanism, frame: int, robot: Robot) -> str:
    if mechanism.stem == "lateral-compliance":
        return f"tilt of joint {frame}'s axis"
    if mechanism.stem == LINK_BENDING:
        both = " under the arm's weight and the payload" if needs_both_loads(mechanism) else ""
        return f"turn of the end of link {frame - 1}{both}"
    drive = name_drive(robot, mechanism.joint or frame)
    if mechanism.stem == PAYLOAD_DEFLECTION:
        return f"wind-up of {drive} under the largest payload"
    if needs_both_loads(mechanism):
        return f"wind-up of {drive} under the arm's weight and the payload"
    return f"wind-up of {drive}"
