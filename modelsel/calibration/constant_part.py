"""A calibration taken apart: the constant geometry, which any robot description can carry, and the
rest, which none can."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from .._typing import Array
from ..fitting.design import PLACE
from ..fitting.problem import Problem
from ..measurements.campaign.joint_path import JointPath
from ..measurements.campaign.late_names import is_temperature
from ..measurements.campaign.reference_temperature import TEMPERATURE
from ..measurements.campaign.state_names import StateKind, is_state_name, parse_state_name
from ..measurements.measurements import Measurements, build_measurements
from ..mechanisms.cause_functions import FUNCTIONS
from ..mechanisms.causes import ARITHMETIC, ONE, Applied, Cause, Combined, Member, Named, Number
from ..mechanisms.terms import Screw, Term
from ..robot.kinematics import Robot
from ..robot.rigid import rotation_matrix, transform
from .arm_alone import list_misreadings
from .prediction import compute_pose
from .refitting import list_moves, part_of, select_carried

if TYPE_CHECKING:
    from .calibration import Calibration

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
    """Return "whole" where a form ("geometry", "table", "whole") carries all terms of the arm, else
    the form."""
    carries = select_carried(c.model, form)
    of_arm = filter(select_carried(c.model, "whole"), c.terms)
    if all(map(carries, of_arm)):
        return "whole"
    return form


def restrict_to_form(c: Calibration, form: str) -> Calibration:
    """Return the calibration of what a form ("geometry", "table", "whole") carries: as refitted
    without the rest, or, where there is no refit, as estimated with it. None carries errors of the
    instrument."""
    form = resolve_form(c, form)
    if form == "whole" and not list_misreadings(c.model):
        return c
    refits = c.refits
    if refits is not None and form in refits.alone:
        refit = refits.alone[form]
        return select_terms(c, refit.terms, refit.theta)
    carries = select_carried(c.model, form)
    carried = list(map(carries, c.terms))
    places = np.flatnonzero(carried).tolist()
    estimates = c.theta[places]
    return select_terms(c, places, estimates)


def list_left_out(c: Calibration, form: str) -> list[Part]:
    """List what a form cannot carry of the arm, for the first target and group."""
    arm = leave_out_moves(restrict_to_form(c, "whole"))
    carries = select_carried(c.model, form)
    places = []
    for place, term in enumerate(arm.terms):
        if not carries(term):
            places.append(place)
    estimates = arm.theta[places]
    left_out = select_terms(arm, places, estimates)
    constant, varying = split_parts(left_out)
    return constant + varying


def leave_out_moves(c: Calibration) -> Calibration:
    """Return the calibration without what the instrument and the base moved against each other while
    it was measured, which is no error of the arm."""
    moves = list_moves(c.model)
    places = []
    for place, term in enumerate(c.terms):
        if term.key not in moves:
            places.append(place)
    estimates = c.theta[places]
    return select_terms(c, places, estimates) if moves else c


def select_terms(c: Calibration, places: Sequence[int], theta: Array) -> Calibration:
    """Return the calibration of the terms at some places, at other estimates."""
    carried = {c.terms[place].key for place in places}
    rows = list(places)
    kept = tuple(k for k, place in enumerate(places) if place in c.kept)
    model = part_of(c.model, lambda term: term.key in carried)
    return replace(c, model=model, theta=theta, factor=c.factor[rows], kept=kept)


def fix_members(cause: Cause, target: int) -> Cause:
    """Return the cause for one target and the first group: a Number where nothing else is in it."""
    if isinstance(cause, Member):
        chosen = 0
        if cause.kind == "target":
            chosen = target
        is_chosen = cause.index == chosen
        return Number(float(is_chosen))
    if isinstance(cause, Applied):
        argument = fix_members(cause.argument, target)
        return _apply(cause.function, argument)
    if not isinstance(cause, Combined):
        return _drop_lag(cause)
    left = fix_members(cause.left, target)
    right = fix_members(cause.right, target)
    none = Number(0.0)
    is_product = cause.operator == "*"
    if is_product and none in (left, right):
        return none
    if isinstance(left, Number) and isinstance(right, Number):
        operate = ARITHMETIC[cause.operator]
        with np.errstate(divide="ignore", invalid="ignore"):
            number = operate(left.number, right.number)
        return Number(float(number))
    return _combine(cause.operator, left, right)


def _drop_lag(cause: Cause) -> Cause:
    """Return a temperature that is late as it is: before one configuration nothing is known to have
    been."""
    if isinstance(cause, Named) and is_temperature(cause.name):
        return Named(TEMPERATURE, cause.dimension)
    return cause


def _combine(operator: str, left: Cause, right: Cause) -> Cause:
    """Combine two causes, a factor 1 left out."""
    if left == ONE and operator == "*":
        return right
    if right == ONE and operator in "*/":
        return left
    return Combined(operator, left, right)


def _apply(function: str, argument: Cause) -> Cause:
    """Apply a function to a cause: a Number where that is one."""
    applied = Applied(function, argument)
    if not isinstance(argument, Number):
        return applied
    value = FUNCTIONS[function](argument.number)
    return Number(float(value))


def split_parts(c: Calibration, target: int = 0) -> tuple[list[Part], list[Part]]:
    """Split every term that is not zero into its constant screws and those that vary with the
    state, for one target and the first group."""
    constant = list[Part]()
    varying = list[Part]()
    owner = {}
    for mechanism in reversed(c.model.mechanisms):
        for term in mechanism.terms:
            owner[term.key] = mechanism.name
    estimates = c.theta.tolist()
    errors = c.standard_errors.tolist()
    for term, value, error in zip(c.terms, estimates, errors, strict=True):
        if not value:
            continue
        fixed = list[Screw]()
        moving = list[Screw]()
        for screw in term.screws:
            cause = fix_members(screw.cause, target)
            bound = Screw(screw.frame, screw.axis, cause)
            if isinstance(cause, Number):
                fixed.append(bound)
            else:
                moving.append(bound)
        name = owner[term.key]
        for screws, parts in ((fixed, constant), (moving, varying)):
            if screws:
                some = replace(term, screws=tuple(screws))
                parts.append(Part(name, some, value, error))
    return constant, varying


def constant_entries(c: Calibration, target: int = 0) -> Array:
    """Sum the constant entries (n+1, 6) [mm, rad] of every H for one target and the first group."""
    frames = c.robot.n + 1
    entries = np.zeros((frames, 6))
    constant, _ = split_parts(c, target)
    for part in constant:
        value = part.value
        for screw in part.term.screws:
            cause = screw.cause
            assert isinstance(cause, Number)
            frame = screw.frame - 1
            place = PLACE[screw.axis]
            number = cause.number
            entries[frame, place] += value * number
    return entries


def frame_transform(entries: Array) -> Array:
    """Compute H = Trans(a, b, c) Rx(α) Ry(β) Rz(γ), (4, 4), of six entries."""
    rotation = (
        rotation_matrix(0, entries[3])
        @ rotation_matrix(1, entries[4])
        @ rotation_matrix(2, entries[5])
    )
    return transform(rotation, entries[:3])


def build_constant_chain(c: Calibration) -> ConstantChain:
    """Build the chain with its constant errors in it."""
    entries = constant_entries(c)
    joints = []
    for k, joint in enumerate(c.robot.joints):
        correction = frame_transform(entries[k])
        before = joint.before @ correction
        joints.append(replace(joint, before=before))
    targets = {}
    for k, name in enumerate(c.targets):
        target_entries = constant_entries(c, k)
        offset = frame_transform(target_entries[-1])
        nominal = transform(None, c.tools[k])
        targets[name] = nominal @ offset
    source = f"calibrated by modelsel, study {c.study}"
    robot = Robot(
        c.robot.name,
        source,
        tuple(joints),
        c.robot.last,
        c.robot.gravity,
        coupling=c.robot.coupling,
        payload_at_mm=c.robot.payload_at_mm,
    )
    return ConstantChain(robot, targets)


def sample_workspace(
    c: Calibration, target: int = 0, m: int = SAMPLED_CONFIGURATIONS, group: int = 0
) -> Problem:
    """Sample configurations evenly from all that the calibration has seen, with every covariate and
    direction of approach."""
    rng = np.random.default_rng(0)
    joints = range(1, c.robot.n + 1)
    values = {}
    covariates = {}
    for name, (low, high) in c.ranges.items():
        drawn = rng.uniform(low, high, m)
        values[name] = drawn
        if not is_state_name(name):
            covariates[name] = drawn
    readings = [values[f"q{joint}"] for joint in joints]
    q = np.stack(readings, 1)
    approach = rng.choice([-1.0, 1.0], q.shape)
    still = np.ones(m)
    moves = []
    for joint in joints:
        move = values.get(f"move{joint}", still)
        moves.append(move)
    moved = np.stack(moves, 1)
    at = bind_configurations(c, q, covariates, approach, moved, target, group)
    path = _lay_path(values, q)
    return replace(at, data=replace(at.data, path=path))


def _lay_path(values: Mapping[str, Array], q: Array) -> JointPath:
    """Lay a path on which every configuration (m, n) is the first of its group, and joints are ahead of
    what they drag along as drawn."""
    steps = np.zeros(q.shape)
    for name, drawn in values.items():
        variable = parse_state_name(name)
        if variable is None or variable.kind is not StateKind.DRAG:
            continue
        joint = variable.joint
        assert joint is not None
        steps[:, joint - 1] = drawn
    return JointPath(steps, np.ones(len(q), bool))


def bind_configurations(
    c: Calibration,
    q: Array,
    covariates: Mapping[str, Array],
    approach: Array,
    move: Array,
    target: int = 0,
    group: int = 0,
) -> Problem:
    """Bind configurations to the calibrated set-up: q, approach and move (m, n), covariates
    (m,)."""
    m = len(q)
    data: Measurements = build_measurements(
        q,
        np.zeros((m, 3)),
        target=[c.targets[target]] * m,
        group=[c.groups[group]] * m,
        approach=approach,
        covariates=covariates,
        coupling=c.robot.coupling,
    )
    # nothing is known of what went before each
    return c.problem(replace(data, move=move, late_temperature=None))


def compute_points(at: Problem, parts: Sequence[Part]) -> Array:
    """Compute the target (m, 3) [mm] in frame 0 with these screws in the chain."""
    terms = []
    values = []
    for part in parts:
        terms.append(part.term)
        values.append(part.value)
    theta = np.array(values)
    pose = compute_pose(at, tuple(terms), theta)
    return pose.target.T


def rms_and_max(difference: Array) -> tuple[float, float]:
    """Return the root mean square and the largest length of rows (m, 3)."""
    lengths = np.linalg.norm(difference, axis=1)
    squares = np.square(lengths)
    mean_square = squares.mean()
    root = np.sqrt(mean_square)
    rms = float(root)
    largest = float(lengths.max())
    return rms, largest
