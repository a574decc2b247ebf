"""Pictures of what a mechanism does to an arm: one function for all, from the mechanism's own
screws and the arm's own chain."""

from __future__ import annotations

import re
from dataclasses import dataclass, replace

import numpy as np

from modelsel._typing import Array
from modelsel.fitting.design import twist_of
from modelsel.fitting.problem import Problem
from modelsel.measurements.measurements import build_measurements
from modelsel.mechanisms.terms import Mechanism, Term
from modelsel.report.style import BLUE, ORANGE, QUIET, choose_unit, svg, use_style
from modelsel.robot.kinematics import Robot, forward, pose

TOOL = (40.0, -25.0, 100.0)  # off the last axis, so that every joint moves the target
REST = np.radians([-45.0, -35.0, 40.0, 35.0, 50.0, 20.0])
FAN = np.radians(
    [[-45, -70, 60, 0, 40, 0], [-30, 10, -10, 60, -50, 40], [135, -120, 30, -40, 60, -60]]
)
DRAWN = (-115.0, -50.0, 15.0)  # degrees of the driving joint at which the arm is drawn
POINTS = 241
TRAVEL = 500.0  # mm to either side of a slide
TRACKER = (-2500.0, -1500.0, 0.0)  # mm, frame 0: where the instrument stands
SHOWN = 0.22  # of the reach: how far the most displaced target is drawn away
TURN = 0.4  # rad: no joint is drawn turned by more
WEIGHTS = (
    1.0,
    -0.7,
    0.5,
    0.8,
    -0.6,
    0.9,
)  # of terms side by side, where physics does not give their sign
ARROW = {"arrowstyle": "-|>", "color": ORANGE, "lw": 1.2, "shrinkA": 0, "shrinkB": 0}
AT = {"temperature_C": (15.0, 35.0), "payload_kg": (0.0, 5.0)}


@dataclass(frozen=True)
class Driver:
    """What is varied to show an effect: a joint, a covariate, or the order of motion."""

    name: str  # q3, move3, rate3, temperature_C, payload_kg, progress
    joint: int = 0
    both: bool = False  # the way back differs from the way there
    slides: bool = False

    @property
    def words(self) -> str:
        """For an axis."""
        if self.name.startswith("move"):
            return f"last move of joint {self.joint} [deg]"
        if self.name.startswith("rate"):
            return f"speed of joint {self.joint} [deg/s]"
        if self.slides:
            return f"slide {self.joint} [mm]"
        if self.joint:
            return f"joint {self.joint} [deg]{', there and back' if self.both else ''}"
        return {"temperature_C": "temperature [°C]", "payload_kg": "payload [kg]"}.get(
            self.name, "share of the campaign"
        )


def driver(mechanism: Mechanism) -> Driver:
    """What shows a mechanism best: the covariate it follows, else a joint its causes look at, else
    joint 2."""
    names = sorted(mechanism.names())
    for name in names:
        if name in (*AT, "progress"):
            return Driver(name)
    for stem in ("move", "rate", "approach", "q", "torque", "moment"):
        joints = [
            int(found[1]) for name in names if (found := re.fullmatch(rf"{stem}(\d+)(_.*)?", name))
        ]
        if joints:
            shown = stem if stem in ("move", "rate") else "q"
            slides = mechanism.stem == "slide-scales"
            return Driver(f"{shown}{joints[0]}", joints[0], stem == "approach", slides)
    joint = 5 if "down_x" in names else 3 if "range_mm" in names else 2
    return Driver(f"q{joint}", joint)


def put_on_slides(robot: Robot) -> Robot:
    """The robot with slides in the place of its first two joints."""
    slides = [
        replace(joint, prismatic=True, limits=(-TRAVEL, TRAVEL)) for joint in robot.joints[:2]
    ]
    return replace(robot, name=f"{robot.name} on two slides", joints=(*slides, *robot.joints[2:]))


def values(terms: tuple[Term, ...]) -> Array:
    """A usual size for every term: the geometric mean of its range, its sign where physics gives
    one."""
    out = []
    for k, term in enumerate(terms):
        low, high = term.size or (1e-4, 1e-4)
        size = high / 10 if low == 0 else np.sqrt(low * high)
        out.append(size * (term.sign * abs(WEIGHTS[k % 6]) if term.sign else WEIGHTS[k % 6]))
    return np.array(out)


def _problem(robot: Robot, q: Array, **covariates: Array) -> Problem:
    everything = {
        "payload_kg": np.full(len(q), 5.0),
        "temperature_C": np.full(len(q), 30.0),
        **covariates,
    }
    data = build_measurements(
        q,
        forward(robot, q, np.array(TOOL)),
        configuration=list(range(len(q))),
        covariates=everything,
    )
    return replace(Problem(robot, data, np.array([TOOL])), tracker=TRACKER)


def sweep(robot: Robot, by: Driver) -> tuple[Problem, Array]:
    """(configurations along the driver, its values): a joint goes there and back; all else
    rests."""
    q, along = np.tile(REST, (POINTS, 1)), np.linspace(0, 1, POINTS)
    if by.name.startswith("move"):
        q[:, by.joint - 1] += np.radians(np.linspace(0.5, 60, POINTS)) * np.where(
            np.arange(POINTS) % 2, 1, -1
        )
        at = _problem(robot, q)
        return at, np.degrees(at.value(f"move{by.joint}") * at.value(f"approach{by.joint}"))
    if by.name.startswith("rate"):
        q[:, by.joint - 1] += np.radians(40) * np.sin(np.pi * along)
        at = _problem(robot, q, time_s=2.0 * along)
        return at, np.degrees(at.value(by.name))
    if by.slides:
        q[:, by.joint - 1] = TRAVEL * (1 - 2 * np.abs(2 * along - 1))
        return _problem(robot, q), q[:, by.joint - 1]
    if by.joint:
        q[:, by.joint - 1] = np.radians(150) * (1 - 2 * np.abs(2 * along - 1))
        return _problem(robot, q), np.degrees(q[:, by.joint - 1])
    if by.name == "progress":
        return _problem(robot, q), along
    low, high = AT[by.name]
    return _problem(robot, q, **{by.name: low + along * (high - low)}), low + along * (high - low)


def _postures(robot: Robot, by: Driver, along: Problem) -> Problem:
    """Three configurations to draw the arm in: on the way of a joint, or a fan where no joint is
    the driver."""
    if by.slides:
        return along.take(np.array([POINTS // 2, POINTS // 3, POINTS // 6]))
    if by.joint and not by.name.startswith(("move", "rate")):
        there = np.degrees(along.data.q[: POINTS // 2, by.joint - 1])
        return along.take(np.array([np.abs(there - angle).argmin() for angle in DRAWN]))
    covariates = {"time_s": np.arange(len(FAN), dtype=float)} if by.name.startswith("rate") else {}
    return _problem(robot, FAN, **covariates)


def _joints(robot: Robot, q: Array, twist: Array | None = None) -> Array:
    """(m, points, 3) mm: the foot, every frame's origin, the target."""
    at = pose(robot, q, np.array(TOOL), twist)
    points = np.concatenate([np.zeros((1, 3, len(q))), at.origins[: robot.n], at.target[None]])
    return points.transpose(2, 0, 1)


def _seen(points: Array) -> Array:
    """(..., 2): the room from the front, a little from above."""
    a, e = np.radians(-62.0), np.radians(20.0)
    x, y, z = np.moveaxis(points, -1, 0)
    depth = -np.sin(a) * x + np.cos(a) * y
    return np.stack([np.cos(a) * x + np.sin(a) * y, z * np.cos(e) + depth * np.sin(e)], -1)


def displacement(at: Problem, terms: tuple[Term, ...], theta: Array) -> Array:
    """(m, 3) mm: how far the exact chain moves the target."""
    tool, twist = np.array(TOOL), twist_of(at, terms, theta, slice(0, len(at)))
    return np.asarray(
        pose(at.robot, at.data.q, tool, twist).target.T - forward(at.robot, at.data.q, tool)
    )


def picture(mechanism: Mechanism, robot: Robot) -> tuple[bytes, str]:
    """(SVG, its text): the arm nominal and with the effect exaggerated; the target's true
    displacement along the driver."""
    by, theta = driver(mechanism), values(mechanism.terms)
    along, x = sweep(robot, by)
    few = _postures(robot, by, along)
    twist = twist_of(few, mechanism.terms, theta, slice(0, len(few)))
    true = np.linalg.norm(displacement(few, mechanism.terms, theta), axis=1).max()
    factor = min(
        SHOWN * robot.reach / max(true, 1e-9), TURN / max(np.abs(twist[:, 3:]).max(), 1e-12)
    )
    factor = float(f"{factor:.1g}")
    nominal, moved = _joints(robot, few.data.q), _joints(robot, few.data.q, factor * twist)
    shift = displacement(along, mechanism.terms, theta)
    scale, unit = choose_unit("mm", float(np.abs(shift).max()))
    with use_style() as plt:
        fig, (left, right) = plt.subplots(
            1, 2, figsize=(6.5, 2.5), layout="none", width_ratios=(1, 1.15)
        )
        fig.subplots_adjust(
            0.01, 0.17, 0.99, 0.9, wspace=0.24
        )  # constrained layout takes twice the time, 27 times over
        for a, b in zip(_seen(nominal), _seen(moved), strict=True):
            left.plot(*a.T, "-", color="#9A9A9A", lw=2.2, solid_joinstyle="round")
            left.plot(*b.T, "-", color=BLUE, lw=1.3, solid_joinstyle="round")
            left.annotate("", b[-1], a[-1], arrowprops=ARROW)
        left.set_aspect("equal")
        left.axis("off")
        left.set_title(
            f"drawn {factor:,.0f} times too large", fontsize=7, color=QUIET, fontweight="normal"
        )
        order = np.argsort(x) if by.name.startswith(("move", "rate")) else np.arange(len(x))
        for axis, (style, colour) in enumerate((("-", BLUE), ("--", ORANGE), (":", QUIET))):
            right.plot(
                x[order], scale * shift[order, axis], style, color=colour, lw=1.3, label="xyz"[axis]
            )
        right.axhline(0, color="#BBBBBB", lw=0.6, zorder=0)
        right.set_xlabel(by.words)
        right.set_ylabel(f"target displaced by [{unit}]")
        right.legend(
            ncols=3, loc="lower left", bbox_to_anchor=(0, 1.0), borderaxespad=0, handlelength=1.6
        )
        drawn = svg(fig, f"What {mechanism.name} does to the arm")
    said = (
        f"The arm in three postures, grey as drawn and blue with {mechanism.name}, {factor:,.0f} times too large; and the "
        f"target's displacement against {by.words}, up to {scale * np.abs(shift).max():.3g} {unit}."
    )
    return short(drawn), said


def short(drawn: bytes) -> bytes:
    """The same SVG with one decimal: a tenth of a point is finer than a line."""
    return re.sub(rb"(?<=[\s\"(MLCQ,-])(\d+)\.(\d)\d+", rb"\1.\2", drawn)
