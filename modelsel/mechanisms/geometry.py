"""Geometry: the six screws of every frame with cause 1, and what the set-up adds to them."""

from __future__ import annotations

from collections.abc import Sequence

from ..measurements.campaign.features import Feature
from ..robot.kinematics import Robot
from ..robot.rigid import AXES
from .causes import ONE, Cause, Member, belongs_to_target
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
    """Build the paper's a b c α β γ of frames 1…n and the target's a b c.

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
        "Chen & Chao 1987, positioning error analysis of robots with rotary joints, Eq. 2",
    )


def _term(frame: int, axis: str, usual: float, cause: Cause = ONE, label: str = "") -> Term:
    symbol = letter(frame, axis) + label
    kind = axis[0]
    screw = Screw(frame, axis, cause)
    return Term(symbol, (screw,), SIZE[kind], usual=usual)


def build_setup(
    robot: Robot,
    targets: int,
    groups: int,
    register: bool,
    orientation: bool,
    features: Sequence[Feature] = (),
    numbers: Sequence[int] = (),
) -> Mechanism:
    """Build what the measuring set-up leaves open: target offsets, target orientation, the
    tracker's placement(s), what is not known of the features that rows share.

    Several targets have an offset each; `groups` > 1 gives every group a placement of its own.
    `numbers`: those of the targets in their file; by default 1, 2 and so on.
    """
    terms: list[Term] = []
    flange = robot.n + 1
    target_labels: list[tuple[Cause, str]] = [(ONE, "")]
    if targets > 1:
        numbers = numbers or range(1, targets + 1)
        target_labels = [
            (belongs_to_target(t, number), f"({number})") for t, number in enumerate(numbers)
        ]
    group_labels: list[tuple[Cause, str]] = [(ONE, "")]
    if groups > 1:
        group_labels = [(Member("group", g), f"[{g + 1}]") for g in range(groups)]
    if targets > 1 or register:
        for cause, label in target_labels:
            terms += [_term(flange, axis, OPEN["t"], cause, label) for axis in AXES[:3]]
    if orientation:
        for cause, label in target_labels:
            terms += [_term(flange, axis, OPEN["r"], cause, label) for axis in AXES[3:]]
    if register:
        for cause, label in group_labels:
            terms += [_term(1, axis, OPEN[axis[0]], cause, label) for axis in AXES]
    for k, feature in enumerate(features):
        for axis in feature.free:
            symbol = f"{_number(feature, axis)} of {feature.name}"
            term = FixtureTerm(symbol, feature=k, axis=axis)
            terms.append(term)
    return Mechanism(
        SETUP,
        tuple(terms),
        "Where the tracker stands and where the targets sit on the flange.",
        "H_1 and H_{n+1}, constant per group and target",
        "contract: register, targets",
    )


def _number(feature: Feature, axis: str) -> str:
    """Name a feature's number: a place's coordinate, a plane's offset and tilts, a
    length."""
    if feature.kind != "plane":
        return axis.removeprefix("t")
    plane = {"tz": "offset", "rx": "tilt 1", "ry": "tilt 2"}
    return plane[axis]
