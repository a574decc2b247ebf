"""A calibration taken apart: the constant geometry, which any robot description can carry, and the
rest, which none can."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from .._typing import Array
from ..fitting.design import PLACE
from ..fitting.problem import Problem
from ..measurements.measurements import Measurements, build_measurements
from ..measurements.reader import RESERVED
from ..mechanisms.causes import Cause, Combined, Member, Number
from ..mechanisms.terms import Screw, Term
from ..robot.kinematics import Robot
from ..robot.rigid import rotation_matrix, transform
from .calibration import Calibration, pose_of
from .refitting import carries, part_of

TRIED = 400  # configurations that a round trip is measured at


@dataclass(frozen=True)
class Part:
    """Some screws of a term: `value` is its estimate, `error` its standard error, `mechanism` whose
    it is."""

    mechanism: str
    term: Term
    value: float
    error: float


@dataclass(frozen=True, eq=False)
class Carried:
    """The constant part: every joint's transform with its errors in it, and where each target sits
    on the flange (4, 4)."""

    robot: Robot
    targets: Mapping[str, Array]


def enough(c: Calibration, form: str) -> str:
    """ "whole" where a form ("geometry", "table", "whole") carries all terms, else the form."""
    return "whole" if all(map(carries(c.model, form), c.terms)) else form


def alone(c: Calibration, form: str) -> Calibration:
    """The calibration of what a form ("geometry", "table", "whole") carries: as refitted without
    the rest, or, where there is no refit, as estimated with it."""
    if enough(c, form) == "whole":
        return c
    found, keep = None if c.refits is None else c.refits.alone.get(form), carries(c.model, form)
    some = [k for k, t in enumerate(c.terms) if keep(t)] if found is None else list(found.terms)
    return _some(c, some, c.theta[some] if found is None else found.theta)


def missing(c: Calibration, form: str) -> list[Part]:
    """What a form cannot carry, for the first target and group."""
    keep = carries(c.model, form)
    some = [k for k, t in enumerate(c.terms) if not keep(t)]
    constant, varying = parts(_some(c, some, c.theta[some]))
    return constant + varying


def _some(c: Calibration, some: Sequence[int], theta: Array) -> Calibration:
    """The calibration of some of its terms, at other estimates."""
    screws = {c.terms[k].screws for k in some}
    return replace(
        c,
        model=part_of(c.model, lambda t: t.screws in screws),
        theta=theta,
        factor=c.factor[list(some)],
        kept=tuple(i for i, k in enumerate(some) if k in c.kept),
    )


def fixed(cause: Cause, target: int, group: int) -> Cause:
    """The cause for one target and group: a constant, where nothing else is in it, is a Number."""
    if isinstance(cause, Member):
        return Number(float(cause.index == (target if cause.kind == "target" else group)))
    if isinstance(cause, Combined):
        a, b = fixed(cause.left, target, group), fixed(cause.right, target, group)
        if isinstance(a, Number) and isinstance(b, Number):
            value = {"+": a.number + b.number, "-": a.number - b.number, "*": a.number * b.number}
            return Number(a.number / b.number if cause.operator == "/" else value[cause.operator])
        return Combined(cause.operator, a, b)
    return cause


def parts(c: Calibration, target: int = 0, group: int = 0) -> tuple[list[Part], list[Part]]:
    """(the constant screws, those that vary with the state) of every term that is not nought, for
    one target and group."""
    owner = {t.screws: m.name for m in reversed(c.model.mechanisms) for t in m.terms}
    constant, varying = list[Part](), list[Part]()
    for term, value, error in zip(
        c.terms, c.theta.tolist(), c.standard_errors.tolist(), strict=True
    ):
        if not value:
            continue
        screws = [Screw(s.frame, s.axis, fixed(s.cause, target, group)) for s in term.screws]
        for out, some in (
            (constant, [s for s in screws if isinstance(s.cause, Number)]),
            (varying, [s for s in screws if not isinstance(s.cause, Number)]),
        ):
            if some:
                out.append(
                    Part(owner[term.screws], replace(term, screws=tuple(some)), value, error)
                )
    return constant, varying


def constants(c: Calibration, target: int = 0, group: int = 0) -> Array:
    """(n+1, 6) constant entries of every H for one target and group."""
    out = np.zeros((c.robot.n + 1, 6))
    for one in parts(c, target, group)[0]:
        for s in one.term.screws:
            assert isinstance(s.cause, Number)
            out[s.frame - 1, PLACE[s.axis]] += one.value * s.cause.number
    return out


def screw(entries: Array) -> Array:
    """H = Trans(a, b, c) Rx(α) Ry(β) Rz(γ), (4, 4)."""
    return transform(
        rotation_matrix(0, entries[3])
        @ rotation_matrix(1, entries[4])
        @ rotation_matrix(2, entries[5]),
        entries[:3],
    )


def carried(c: Calibration, group: int = 0) -> Carried:
    """The chain with its constant errors in it."""
    H = constants(c, 0, group)
    joints = tuple(replace(j, before=j.before @ screw(H[k])) for k, j in enumerate(c.robot.joints))
    targets = {
        name: transform(None, c.tools[t]) @ screw(constants(c, t, group)[-1])
        for t, name in enumerate(c.targets)
    }
    robot = Robot(
        c.robot.name,
        f"calibrated by modelsel, study {c.study}",
        joints,
        c.robot.last,
        c.robot.gravity,
    )
    return Carried(robot, targets)


def workspace(c: Calibration, target: int = 0, group: int = 0, m: int = TRIED) -> Problem:
    """Configurations all over what the calibration has seen, evenly drawn, with every covariate and
    direction of approach."""
    rng = np.random.default_rng(0)
    values = {name: rng.uniform(low, high, m) for name, (low, high) in c.ranges.items()}
    q = np.stack([values[f"q{j}"] for j in range(1, c.robot.n + 1)], 1)
    data: Measurements = build_measurements(
        q,
        np.zeros((m, 3)),
        target=[c.targets[target]] * m,
        group=[c.groups[group]] * m,
        approach=rng.choice([-1.0, 1.0], q.shape),
        covariates={n: v for n, v in values.items() if not RESERVED.fullmatch(n)},
    )
    move = np.stack([values.get(f"move{j}", np.ones(m)) for j in range(1, c.robot.n + 1)], 1)
    return c.problem(replace(data, move=move))


def points(at: Problem, some: Sequence[Part]) -> Array:
    """(m, 3) mm: the target in frame 0 with these screws in the chain."""
    return pose_of(at, tuple(p.term for p in some), np.array([p.value for p in some])).target.T


def rms_and_most(difference: Array) -> tuple[float, float]:
    """(root mean square, largest) length of rows (m, 3)."""
    size = np.linalg.norm(difference, axis=1)
    return float(np.sqrt(np.square(size).mean())), float(size.max())
