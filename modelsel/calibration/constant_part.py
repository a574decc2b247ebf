"""A calibration taken apart: the constant geometry, which any robot description can carry, and the
rest, which none can."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from operator import add, mul, sub, truediv
from typing import TYPE_CHECKING

import numpy as np

from .._typing import Array
from ..fitting.design import PLACE
from ..fitting.problem import Problem
from ..measurements.measurements import Measurements, build_measurements
from ..measurements.state_names import is_state_name
from ..mechanisms.causes import Cause, Combined, Member, Number
from ..mechanisms.terms import Screw, Term
from ..robot.kinematics import Robot
from ..robot.rigid import rotation_matrix, transform
from .prediction import compute_pose
from .refitting import part_of, select_carried

if TYPE_CHECKING:
    from .calibration import Calibration

OPERATORS = {"+": add, "-": sub, "*": mul, "/": truediv}
SAMPLED_CONFIGURATIONS = 400  # configurations that a round trip is measured at


@dataclass(frozen=True)
class Part:
    """Some screws of a term: `value` is its estimate, `error` its standard error, `mechanism` whose
    it is."""

    mechanism: str
    term: Term
    value: float
    error: float


@dataclass(frozen=True, eq=False)
class ConstantChain:
    """The constant part: every joint's transform with its errors in it, and where each target sits
    on the flange (4, 4)."""

    robot: Robot
    targets: Mapping[str, Array]


def resolve_form(c: Calibration, form: str) -> str:
    """ "whole" where a form ("geometry", "table", "whole") carries all terms, else the form."""
    return "whole" if all(map(select_carried(c.model, form), c.terms)) else form


def restrict_to_form(c: Calibration, form: str) -> Calibration:
    """Return the calibration of what a form ("geometry", "table", "whole") carries: as refitted
    without the rest, or, where there is no refit, as estimated with it."""
    if resolve_form(c, form) == "whole":
        return c
    refit = None if c.refits is None else c.refits.alone.get(form)
    if refit is not None:
        return _select_terms(c, refit.terms, refit.theta)
    carries = select_carried(c.model, form)
    places = [k for k, term in enumerate(c.terms) if carries(term)]
    return _select_terms(c, places, c.theta[places])


def list_left_out(c: Calibration, form: str) -> list[Part]:
    """List what a form cannot carry, for the first target and group."""
    carries = select_carried(c.model, form)
    places = [k for k, term in enumerate(c.terms) if not carries(term)]
    constant, varying = split_parts(_select_terms(c, places, c.theta[places]))
    return constant + varying


def _select_terms(c: Calibration, places: Sequence[int], theta: Array) -> Calibration:
    """Return the calibration of the terms at some places, at other estimates."""
    screws = {c.terms[place].key for place in places}
    return replace(
        c,
        model=part_of(c.model, lambda term: term.key in screws),
        theta=theta,
        factor=c.factor[list(places)],
        kept=tuple(k for k, place in enumerate(places) if place in c.kept),
    )


def fix_members(cause: Cause, target: int, group: int) -> Cause:
    """Return the cause for one target and group: a Number where nothing else is in it."""
    if isinstance(cause, Member):
        chosen = target if cause.kind == "target" else group
        return Number(float(cause.index == chosen))
    if not isinstance(cause, Combined):
        return cause
    left, right = fix_members(cause.left, target, group), fix_members(cause.right, target, group)
    if isinstance(left, Number) and isinstance(right, Number):
        operate = OPERATORS[cause.operator]
        return Number(operate(left.number, right.number))
    return Combined(cause.operator, left, right)


def split_parts(c: Calibration, target: int = 0, group: int = 0) -> tuple[list[Part], list[Part]]:
    """Split every term that is not zero into its constant screws and those that vary with the
    state, for one target and group."""
    constant, varying = list[Part](), list[Part]()
    estimates = zip(c.terms, c.theta.tolist(), c.standard_errors.tolist(), strict=True)
    owner = {term.key: m.name for m in reversed(c.model.mechanisms) for term in m.terms}
    for term, value, error in estimates:
        if not value:
            continue
        screws = [Screw(s.frame, s.axis, fix_members(s.cause, target, group)) for s in term.screws]
        fixed = tuple(s for s in screws if isinstance(s.cause, Number))
        moving = tuple(s for s in screws if not isinstance(s.cause, Number))
        mechanism = owner[term.key]
        if fixed:
            constant.append(Part(mechanism, replace(term, screws=fixed), value, error))
        if moving:
            varying.append(Part(mechanism, replace(term, screws=moving), value, error))
    return constant, varying


def constant_entries(c: Calibration, target: int = 0, group: int = 0) -> Array:
    """Sum the constant entries (n+1, 6) of every H for one target and group."""
    entries = np.zeros((c.robot.n + 1, 6))
    for part in split_parts(c, target, group)[0]:
        for screw in part.term.screws:
            assert isinstance(screw.cause, Number)
            entries[screw.frame - 1, PLACE[screw.axis]] += part.value * screw.cause.number
    return entries


def frame_transform(entries: Array) -> Array:
    """Compute H = Trans(a, b, c) Rx(α) Ry(β) Rz(γ), (4, 4), of six entries."""
    rotation = (
        rotation_matrix(0, entries[3])
        @ rotation_matrix(1, entries[4])
        @ rotation_matrix(2, entries[5])
    )
    return transform(rotation, entries[:3])


def build_constant_chain(c: Calibration, group: int = 0) -> ConstantChain:
    """Build the chain with its constant errors in it."""
    entries = constant_entries(c, 0, group)
    joints = tuple(
        replace(joint, before=joint.before @ frame_transform(entries[k]))
        for k, joint in enumerate(c.robot.joints)
    )
    targets = {}
    for k, name in enumerate(c.targets):
        offset = frame_transform(constant_entries(c, k, group)[-1])
        targets[name] = transform(None, c.tools[k]) @ offset
    source = f"calibrated by modelsel, study {c.study}"
    robot = Robot(c.robot.name, source, joints, c.robot.last, c.robot.gravity)
    return ConstantChain(robot, targets)


def sample_workspace(
    c: Calibration, target: int = 0, group: int = 0, m: int = SAMPLED_CONFIGURATIONS
) -> Problem:
    """Sample configurations evenly from all that the calibration has seen, with every covariate and
    direction of approach."""
    rng = np.random.default_rng(0)
    joints = range(1, c.robot.n + 1)
    values = {name: rng.uniform(low, high, m) for name, (low, high) in c.ranges.items()}
    q = np.stack([values[f"q{j}"] for j in joints], 1)
    data: Measurements = build_measurements(
        q,
        np.zeros((m, 3)),
        target=[c.targets[target]] * m,
        group=[c.groups[group]] * m,
        approach=rng.choice([-1.0, 1.0], q.shape),
        covariates={name: v for name, v in values.items() if not is_state_name(name)},
    )
    move = np.stack([values.get(f"move{j}", np.ones(m)) for j in joints], 1)
    return c.problem(replace(data, move=move))


def compute_points(at: Problem, parts: Sequence[Part]) -> Array:
    """Compute the target (m, 3) [mm] in frame 0 with these screws in the chain."""
    terms = tuple(part.term for part in parts)
    theta = np.array([part.value for part in parts])
    return compute_pose(at, terms, theta).target.T


def rms_and_max(difference: Array) -> tuple[float, float]:
    """Return the root mean square and the largest length of rows (m, 3)."""
    lengths = np.linalg.norm(difference, axis=1)
    return float(np.sqrt(np.square(lengths).mean())), float(lengths.max())
