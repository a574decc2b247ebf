"""Geometry: the six screws of every frame with cause 1, and what the set-up adds to them."""

from __future__ import annotations

from collections.abc import Sequence

from ..measurements.features import Feature
from ..robot.kinematics import Robot
from ..robot.rigid import AXES
from .causes import ONE, Cause, Member
from .terms import FixtureTerm, Mechanism, Screw, Term, letter

SETUP = "set-up"  # name of the placement and the targets: no error of the arm
OPEN = {
    "t": 100.0,
    "r": 0.1,
}  # mm, rad: standard deviation of a placement or a target that registration has found already
SIZE = {
    "t": (0.0, 5.0),
    "r": (0.0, 20e-3),
}  # mm, rad: what an assembled arm shows against its drawing


def geometric(robot: Robot) -> Mechanism:
    """The paper's a b c α β γ of frames 1…n and the target's a b c.

    The target comes first: an earlier term represents the later ones that depend on it, and b7 says
    in mm what γ6 would say in radians where the target is nearly on the last axis."""
    places = [(robot.n + 1, axis) for axis in AXES[:3]] + [
        (f, axis) for f in range(1, robot.n + 1) for axis in AXES
    ]
    return Mechanism(
        "geometric",
        tuple(_term(f, axis, robot.usual[axis[0] == "r"]) for f, axis in places),
        "The links, joint axes, joint zeros and the target are not where the drawing has them.",
        "H_k = Trans(a,b,c) Rx(α) Ry(β) Rz(γ) in every frame, constant",
        "Positioning error analysis (the reference), Eq. 2",
    )


def _term(frame: int, axis: str, usual: float, cause: Cause = ONE, label: str = "") -> Term:
    return Term(
        letter(frame, axis) + label, (Screw(frame, axis, cause),), SIZE[axis[0]], usual=usual
    )


def build_setup(
    robot: Robot,
    targets: int,
    groups: int,
    register: bool,
    orientation: bool,
    features: Sequence[Feature] = (),
) -> Mechanism:
    """What the measuring set-up leaves open: target offsets, target orientation, the tracker's
    placement(s), what is not known of the features that rows share.

    Several targets have an offset each; `groups` > 1 gives every group a placement of its own.
    """
    terms: list[Term] = []
    if targets > 1 or register:
        for t in range(targets):
            cause, label = (Member("target", t), f"({t + 1})") if targets > 1 else (ONE, "")
            terms += [_term(robot.n + 1, axis, OPEN["t"], cause, label) for axis in AXES[:3]]
    if orientation:
        for t in range(targets):
            cause, label = (Member("target", t), f"({t + 1})") if targets > 1 else (ONE, "")
            terms += [_term(robot.n + 1, axis, OPEN["r"], cause, label) for axis in AXES[3:]]
    if register:
        for g in range(groups):
            cause, label = (Member("group", g), f"[{g + 1}]") if groups > 1 else (ONE, "")
            terms += [_term(1, axis, OPEN[axis[0]], cause, label) for axis in AXES]
    terms += [
        FixtureTerm(f"{_number(f, axis)} of {f.name}", feature=k, axis=axis)
        for k, f in enumerate(features)
        for axis in f.free
    ]
    return Mechanism(
        SETUP,
        tuple(terms),
        "Where the tracker stands and where the targets sit on the flange.",
        "H_1 and H_{n+1}, constant per group and target",
        "contract: register, targets",
    )


def _number(feature: Feature, axis: str) -> str:
    """What a feature's number is called: a place's coordinate, a plane's offset and tilts, a
    length."""
    plane = {"tz": "offset", "rx": "tilt 1", "ry": "tilt 2"}
    return plane[axis] if feature.kind == "plane" else axis.removeprefix("t")
