"""Nuisance parameters that sampling adds to a model's coefficients: noise scales and inner constants.

Noise: which whitened coordinate shares which scale, where the study gives reason for several.
Stated uncertainties set the ratios inside a component; the scale of each component is free.
Constants: those of scanned mechanisms that are real numbers, taken as continuous; the moment at
which a tracker was moved, for one."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np

from .._typing import Array, Index
from ..fitting.design import PLACE, Model
from ..fitting.noise import Instrument
from ..fitting.problem import Problem
from ..mechanisms.moved_targets import find_moved_targets, limit_to_targets
from ..mechanisms.registry import Registry, Scanned
from ..mechanisms.target_names import number_targets
from ..mechanisms.terms import Mechanism, Screw, TermKey
from ..robot.kinematics import Robot

SINGLE = "noise scale"
POSITION, ORIENTATION = "noise of position", "noise of orientation"
# units of a scale that multiplies stated uncertainties, or estimated ones
STATED = "of the stated"
ESTIMATED = "of the estimated"
# components of a row: mm, and rad
POSITIONS, ORIENTATIONS = slice(0, 3), slice(3, 6)
# values at which a cause is worked out; between them it is interpolated
GRID = 401

# what a constant changes: ((frame, axis), term index, change (GRID, m) of the cause)
Table = tuple[tuple[int, int], int, Array]
# a mechanism of a value of its constant
Build = Callable[[float], Mechanism]


@dataclass(frozen=True, eq=False)
class Components:
    """Components of the noise of a problem with c whitened coordinates a row.

    problem: its weights turned where the components ask for it (`align_with_beam`).
    component: component (c,) of every coordinate.
    names, units: of the T scales.
    factor: (T,) what a scale of one is in its unit.
    """

    problem: Problem
    component: Index
    names: tuple[str, ...]
    units: tuple[str, ...]
    factor: Array

    @property
    def count(self) -> int:
        """Number of scales."""
        return len(self.names)


def assign_components(problem: Problem, instrument: Instrument | None = None) -> Components:
    """Assign the whitened coordinates of a problem to components of the noise.

    Per-coordinate uncertainties in the data: a scale per axis of the tracker's frame. An instrument
    (None where a floor is stated): one along the beam, one across. Orientations: one of their own.
    Rows of several kinds, errors whose parts were estimated, and all else: one scale for everything
    that is in mm. A scale is in mm or rad where nothing is stated row by row, else a multiple."""
    six = problem.components == 6
    mixed = problem.data.gauges is not None
    whitening = problem.whitening
    estimated = whitening.stated is not None
    is_uniform = not mixed and not estimated
    if is_uniform and problem.data.sigma is not None:
        component = [0, 1, 2]
        names = ["noise in x", "noise in y", "noise in z"]
    elif is_uniform and instrument is not None:
        problem = align_with_beam(problem, instrument)
        component = [0, 1, 1]
        names = ["noise along the beam", "noise across the beam"]
    else:
        component = [0, 0, 0]
        names = [POSITION if six else SINGLE]
    count = len(names)
    relative = ESTIMATED if estimated else STATED
    units = [relative] * count
    factor = np.ones(count)
    if names == [SINGLE] and whitening.matrices is None:
        units = ["mm"]
        factor = np.array([1 / whitening.weight])
    if six:
        component += [count] * 3
        names.append(ORIENTATION)
        units.append(relative)
        factor = np.append(factor, 1.0)
        for k, own, unit in ((0, POSITIONS, "mm"), (count, ORIENTATIONS, "rad")):
            sigma = _common_sigma(problem, own)
            if sigma is not None:
                units[k] = unit
                factor[k] = sigma
    return Components(
        problem, np.array(component, dtype=np.intp), tuple(names), tuple(units), factor
    )


def _common_sigma(problem: Problem, own: slice) -> float | None:
    """Return the noise [mm or rad] by which positions or orientations are weighed, where it is one for all
    rows and none is stated row by row; else None."""
    data = problem.data
    matrices = problem.whitening.matrices
    stated = data.sigma
    if own == ORIENTATIONS:
        stated = data.sigma_rotation
    if stated is not None or matrices is None:
        return None
    blocks = matrices[:, own, own]
    weight = blocks[0, 0, 0]
    identity = np.eye(3)
    common = weight * identity
    if not np.allclose(blocks, common):
        return None
    sigma = 1 / weight
    return float(sigma)


def align_with_beam(problem: Problem, instrument: Instrument) -> Problem:
    """Rotate each row's whitened coordinates so that the first is along the beam, the others across.

    Least-squares estimates are invariant to this orthogonal rotation. Raises TypeError for a
    problem with one weight for all rows."""
    whitening = problem.whitening
    matrices = whitening.matrices
    if matrices is None:
        raise TypeError("an instrument's weights are a block per row")
    instrument_at = np.array(instrument.at)
    line = problem.data.position - instrument_at
    basis = _beam_basis(line)
    weight = matrices[:, :3, :3]
    information = np.einsum("mji,mjk->mik", weight, weight)
    covariance = np.linalg.inv(information)
    variance = np.einsum("mai,mij,maj->ma", basis, covariance, basis)
    sigma = np.sqrt(variance)
    aligned = matrices.copy()
    aligned[:, :3, :3] = basis / sigma[:, :, None]
    whitening = replace(whitening, matrices=aligned)
    return replace(problem, whitening=whitening)


def _beam_basis(line: Array) -> Array:
    """Compute orthonormal bases (m, 3, 3) whose rows are along the lines (m, 3), across, across."""
    length = np.linalg.norm(line, axis=1)
    along = line / length[:, None]
    size = np.abs(along)
    farthest_axis = np.argmin(size, axis=1)
    axes = np.eye(3)
    across = np.cross(along, axes[farthest_axis])
    length = np.linalg.norm(across, axis=1)
    across /= length[:, None]
    third = np.cross(along, across)
    return np.stack([along, across, third], axis=1)


def merge_components(noise: Components) -> Components:
    """Merge all components into one scale."""
    component = np.zeros_like(noise.component)
    units = noise.units[:1]
    factor = noise.factor[:1]
    return Components(noise.problem, component, (SINGLE,), units, factor)


@dataclass(frozen=True, eq=False)
class Constant:
    """An inner constant of a scanned mechanism.

    name, mechanism: its name and its mechanism's.
    low, high: its range.
    held: the value that the model holds.
    tables: for every screw it changes, how far the cause departs from the model's over the range.
    """

    name: str
    mechanism: str
    low: float
    high: float
    held: float
    tables: tuple[Table, ...] = field(repr=False)

    def add_twist(self, theta: Array, value: Array, twist: dict[tuple[int, int], Array]) -> None:
        """Add what the constant's values (W,) change at parameters theta (W, p) to the twists
        (W, m) of the (frame, axis) places."""
        below, share = self.interpolate(value)
        above = below + 1
        upper = share[:, None]
        lower = 1 - upper
        none = np.zeros((1, 1))
        for place, k, table in self.tables:
            cause = table[below] * lower
            next_cause = table[above]
            step = next_cause * upper
            cause = cause + step
            coefficient = theta[:, k]
            coefficient = coefficient[:, None]
            change = coefficient * cause
            # added to what other constants change there
            known = twist.get(place, none)
            changed = known + change
            twist[place] = changed

    def interpolate(self, value: Array) -> tuple[Index, Array]:
        """Return the grid point below each value (W,), and the share of the way to the next one."""
        last = GRID - 1
        width = self.high - self.low
        departure = value - self.low
        share = departure / width
        position = share * last
        # the last value belongs to the interval before it
        below = np.clip(position, 0, GRID - 2)
        index = below.astype(np.intp)
        rest = position - index
        return index, rest


def list_constants(problem: Problem, model: Model, registry: Registry) -> tuple[Constant, ...]:
    """List the constants of the mechanisms that the registry scans over a range of real numbers.

    They are numbered where a mechanism is in the model several times, as the labels of its
    coefficients are."""
    place = {t.key: k for k, t in enumerate(model.terms)}
    constants = []
    for mechanism in model.mechanisms:
        entry = registry.get(mechanism.stem)
        if not isinstance(entry, Scanned):
            continue
        bounds = entry.range
        if bounds is None:
            continue
        constant = _constant(problem, mechanism, entry, bounds, place)
        if constant is not None:
            constants.append(constant)
    return _number_names(constants)


def _constant(
    problem: Problem,
    mechanism: Mechanism,
    entry: Scanned,
    bounds: tuple[float, float],
    place: dict[TermKey, int],
) -> Constant | None:
    """Build the constant of a mechanism; None where no scanned value gives the mechanism."""
    build = _choose_builder(problem, mechanism, entry)
    held = _held_value(entry, build, problem.robot, mechanism)
    if held is None:
        return None
    low, high = bounds
    variants = []
    grid = np.linspace(low, high, GRID)
    for value in grid.tolist():
        variant = build(value)
        variants.append(variant)
    tables = _tabulate(problem, mechanism, variants, place)
    name = mechanism.name
    return Constant(f"constant of {name}", name, low, high, held, tables)


def _number_names(constants: Sequence[Constant]) -> tuple[Constant, ...]:
    """Number the constants whose mechanism is in the model several times."""
    mechanisms = [c.mechanism for c in constants]
    numbered = []
    for k, constant in enumerate(constants):
        name = constant.name
        mechanism = constant.mechanism
        if mechanisms.count(mechanism) > 1:
            so_far = mechanisms[: k + 1]
            number = so_far.count(mechanism)
            name += f" ({number})"
        renamed = replace(constant, name=name)
        numbered.append(renamed)
    return tuple(numbered)


def _choose_builder(problem: Problem, mechanism: Mechanism, entry: Scanned) -> Build:
    """Choose what builds a mechanism of a scanned constant: of its joint, or of the targets of
    several that it moves."""
    robot = problem.robot
    joint = _list_joint(mechanism, entry)
    build = partial(entry.build, robot, *joint)
    targets = find_moved_targets(mechanism)
    if not targets:
        return build
    data = problem.data
    names = data.targets
    numbers = number_targets(names, data.listed_targets)
    moved = {target.index: names[target.index] for target in targets}

    def build_limited(value: float) -> Mechanism:
        step = build(value)
        return limit_to_targets(step, moved, numbers)

    return build_limited


def _list_joint(mechanism: Mechanism, entry: Scanned) -> list[int]:
    """List the joint of a scanned mechanism that has one."""
    if entry.joints is None:
        return []
    joint = mechanism.joint
    return [] if joint is None else [joint]


def _held_value(entry: Scanned, build: Build, robot: Robot, mechanism: Mechanism) -> float | None:
    """Find the scanned value that gives this mechanism."""
    joint = _list_joint(mechanism, entry)
    for value in entry.constants(robot, *joint):
        variant = build(value)
        if variant.terms == mechanism.terms:
            return float(value)
    return None


def _tabulate(
    problem: Problem, mechanism: Mechanism, variants: Sequence[Mechanism], place: dict[TermKey, int]
) -> tuple[Table, ...]:
    """Tabulate how the causes of every screw of a mechanism change over its variants."""
    tables = []
    for i, term in enumerate(mechanism.terms):
        k = place[term.key]
        for j, screw in enumerate(term.screws):
            held = _evaluate_cause(problem, screw)
            causes = []
            for variant in variants:
                same_term = variant.terms[i]
                other = same_term.screws[j]
                cause = _evaluate_cause(problem, other)
                causes.append(cause)
            change = np.stack(causes) - held
            axis = PLACE[screw.axis]
            frame_axis = (screw.frame - 1, axis)
            table = (frame_axis, k, change)
            tables.append(table)
    return tuple(tables)


def _evaluate_cause(problem: Problem, screw: Screw) -> Array:
    rows = len(problem)
    cause = screw.cause
    values = cause.of(problem)
    return np.broadcast_to(values, (rows,))
