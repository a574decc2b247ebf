"""The arm as the report draws it: its frames at one measured configuration, and what every fitted
number of the chosen model means on them."""

from __future__ import annotations

from typing import Any

import numpy as np

from ...exceptions import sentence_list
from ...fitting.least_squares import Fit
from ...fitting.problem import Problem
from ...mechanisms.causes import ONE, Cause, Member, find_bump
from ...mechanisms.moved_targets import split_target
from ...mechanisms.terms import Screw, Term
from ...robot.kinematics import Robot
from ...robot.rigid import AXES
from ...uncertainty.parameters import label_terms, list_owners
from .finding_postures import stand_upright

Values = dict[str, Any]


# -- frames
# --------------------------------------------------------------------------------------------------


def describe_arm(problem: Problem) -> Values:
    """Return origins (n+2, 3) [mm] and axes (n+2, 3, 3), columns x y z, of frame 0, the joints' frames
    and the target's, with gravity downwards: the nominal arm at its middling configuration."""
    nearest = find_middling_row(problem)
    middle = problem.take(np.array([nearest]))
    pose = middle.pose(slice(None))
    joints = problem.robot.n
    # axes have the components x y z of a unit vector as rows: (frame, axis, component)
    axes = pose.axes[:, :3, :, 0].transpose(0, 2, 1)
    axes = np.concatenate([np.eye(3)[None], axes])
    origins = np.concatenate([np.zeros((1, 3)), pose.origins[:, :, 0]])
    upright = stand_upright(problem.robot)
    return {
        "origins_mm": np.round(origins @ upright.T, 1).tolist(),
        "axes": np.round(upright @ axes, 5).tolist(),
        "slides": [joint.prismatic for joint in problem.robot.joints[:joints]],
    }


def find_middling_row(problem: Problem) -> int:
    """Find the row whose joint readings are nearest to the median of all."""
    q = problem.data.q
    spread = np.maximum(np.std(q, axis=0), 1e-9)
    scaled = (q - np.median(q, axis=0)) / spread
    distance = np.square(scaled).sum(1)
    return int(np.argmin(distance))


# -- parameters
# --------------------------------------------------------------------------------------------------

DIRECTIONS = {"tx": "x", "ty": "y", "tz": "z", "rx": "x", "ry": "y", "rz": "z"}


def describe_meanings(problem: Problem, fit: Fit) -> list[Values]:
    """Return of every estimable number of a fit its symbol, what it means, and its nominal value
    (None: that of a free function, or of the set-up)."""
    labels = label_terms(fit.model)
    owners = list_owners(fit.model)
    meanings = []
    for k in fit.found.kept:
        term = fit.terms[k]
        screw = term.screws[0] if term.screws else None
        meanings.append(
            {
                "symbol": labels[k],
                "frame": None if screw is None else screw.frame,
                "meaning": describe_meaning(problem, term, owners[k]),
                "nominal": find_nominal(problem, screw),
                "free": screw is not None and find_bump(screw.cause) is not None,
            }
        )
    return meanings


def describe_meaning(problem: Problem, term: Term, owner: str) -> str:
    """Describe what a term moves and, unless it is constant, with what."""
    if not term.screws:
        return f"{owner}: {term.symbol}"
    screw = term.screws[0]
    cause = screw.cause
    place = describe_place(problem.robot, screw.frame, screw.axis, cause == ONE)
    if cause == ONE:
        if _moves_all_targets(problem, screw):
            return f"all {place.replace('target', 'targets', 1)}"
        return place
    if isinstance(cause, Member):
        return f"{place}, {_describe_member(problem, cause)}"
    split = [split_target(screw.cause) for screw in term.screws]
    _, cause = split[0]
    targets = [target for target, _ in split if target is not None]
    others = len(term.screws) // max(len(targets), 1) - 1
    more = f" (and {others} more)" if others else ""
    what = f"{place}{more}"
    if targets:
        what += f", {_describe_member(problem, *targets)}"
    return f"{what} × {cause}"


def _describe_member(problem: Problem, *causes: Member) -> str:
    """Describe the target or group of a cause, or the targets that a term moves alike."""
    data = problem.data
    kind = causes[0].kind
    every = data.targets if kind == "target" else data.groups
    names = [every[cause.index] for cause in causes]
    kinds = kind if len(names) == 1 else f"{kind}s"
    return f"{kinds} {sentence_list(names)}"


def _moves_all_targets(problem: Problem, screw: Screw) -> bool:
    """Return whether a constant screw moves several targets alike."""
    beyond = screw.frame > problem.robot.n
    several = len(problem.tools) > 1
    return beyond and several and screw.cause == ONE


def describe_place(robot: Robot, frame: int, axis: str, constant: bool = True) -> str:
    """Describe what moves where a screw of a frame acts: of a constant one, what of the drawing."""
    direction = DIRECTIONS[axis]
    if frame > robot.n:
        motion = "along" if axis[0] == "t" else "turned about"
        return f"target {motion} the flange's {direction}"
    slides = robot.prismatic[frame - 1]
    if axis == ("tz" if slides else "rz"):
        own = "shift" if slides else "turn"
        return f"joint {frame}, zero of its reading" if constant else f"joint {frame}, its {own}"
    if axis[0] == "t":
        return f"joint {frame}, its axis along {direction}"
    motion = "turned" if axis == "rz" else "tilted"
    return f"joint {frame}, its axis {motion} about {direction}"


def find_nominal(problem: Problem, screw: Screw | None) -> float | None:
    """Find the drawing's value [mm or rad] of what a constant screw corrects: of a shift, where the
    frame stands beyond the one before, along its own axis; of all else zero, being a correction.
    What several targets share has none."""
    if screw is None or _moves_all_targets(problem, screw):
        return None
    if screw.axis[0] == "r":
        return 0.0
    robot, axis = problem.robot, AXES.index(screw.axis)
    if screw.frame > robot.n:
        return _find_target(problem, screw.cause, axis)
    if screw.cause != ONE:
        return 0.0
    before = robot.joints[screw.frame - 1].before
    along = before[:3, :3].T @ before[:3, 3]
    return float(np.round(along[axis], 6)) + 0.0


def _find_target(problem: Problem, cause: Cause, axis: int) -> float:
    """Return a coordinate [mm] of the nominal target in the flange frame."""
    if isinstance(cause, Member) and cause.kind == "target":
        return float(problem.tools[cause.index, axis])
    if cause == ONE:
        return float(problem.tools[0, axis])
    return 0.0
