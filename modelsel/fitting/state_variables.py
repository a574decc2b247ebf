"""State variables of the rows of a problem: evaluated once, never carried to another set-up."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from .._typing import Array, Rows
from ..measurements.measurements import Measurements
from ..measurements.state_names import (
    StateKind,
    StateVariable,
    covariate_unit,
    parse_state_name,
    state_units,
)
from ..mechanisms.causes import Cause
from ..robot.gravity import compute_base_moment, compute_joint_moments, compute_unit_moments
from ..robot.kinematics import Pose, Robot, pose

MAX_ROWS_KEPT = 20_000  # up to so many rows, causes are kept once evaluated
Placement = tuple[Array, Array]
Bound = tuple[Robot, Measurements, Array, Placement, tuple[float, float, float]]


@dataclass(frozen=True, eq=False)
class StateVariables:
    """Values of the state variables at every row of a problem, kept once evaluated.

    Bound to all that they depend on: the robot, the readings and indices of the measurements (not
    the measured positions), the nominal targets, where the instrument stands. `belongs_to` says
    whether that is still so; what a problem was changed in, it evaluates afresh."""

    robot: Robot
    data: Measurements
    tools: Array  # (T, 3) mm, nominal target in the flange frame
    placement: Placement  # R (G, 3, 3), t (G, 3) mm: frame 0 in the tracker's frame
    tracker: tuple[float, float, float]
    _values: dict[str, Array] = field(default_factory=dict, repr=False)
    _causes: dict[Cause, Array | float] = field(default_factory=dict, repr=False)

    def belongs_to(
        self,
        robot: Robot,
        data: Measurements,
        tools: Array,
        placement: Placement,
        tracker: tuple[float, float, float],
    ) -> bool:
        """Return whether the values are true of another set-up, too: the very same objects."""
        pairs = (
            (self.robot, robot),
            (self.tools, tools),
            (self.placement[0], placement[0]),
            (self.placement[1], placement[1]),
            *zip(_inputs(self.data), _inputs(data), strict=True),
        )
        return self.tracker == tracker and all(known is given for known, given in pairs)

    def take(self, index: Rows, data: Measurements) -> StateVariables:
        """Return the variables of some rows, `data` those rows' measurements; values come along,
        causes do not."""
        values = {name: column[index] for name, column in self._values.items()}
        return StateVariables(self.robot, data, self.tools, self.placement, self.tracker, values)

    def names(self) -> dict[str, str]:
        """Return every name that a cause may use, with its unit."""
        units = state_units(self.robot)
        return units | {name: covariate_unit(name) for name in self.data.covariates}

    def value(self, name: str) -> Array:
        """Return the values (m,) of a name; raises KeyError for one that there is not."""
        if name not in self._values:
            self._values.update(self._evaluate(name))
        return self._values[name]

    def cause(self, cause: Cause) -> Array | float:
        """Return a cause at every row, (m,) or one number."""
        values = self._causes.get(cause)
        if values is None:
            values = cause.of(self)
            if len(self.data) <= MAX_ROWS_KEPT:
                self._causes[cause] = values
        return values

    def _evaluate(self, name: str) -> dict[str, Array]:
        """Values by name: of the name, and of what comes along at no cost."""
        if name in self.data.covariates:
            return {name: self.data.covariates[name]}
        variable = parse_state_name(name)
        if variable is None or not variable.exists(self.robot):
            raise KeyError(name)
        values = EVALUATORS[variable.kind](self)
        return {each.name: column for each, column in values.items()}

    def pose(self) -> Pose:
        """Return the nominal pose of all rows in frame 0."""
        return pose(self.robot, self.data.q, self.tools[self.data.target])


def _inputs(data: Measurements) -> tuple[object, ...]:
    """What the state variables take from measurements."""
    return (
        data.q,
        data.approach,
        data.move,
        data.progress,
        data.target,
        data.group,
        data.covariates,
    )


# -- evaluation of each kind
# ------------------------------------------------------------------------------------------------------

Values = dict[StateVariable, Array]


def _by_joint(kind: StateKind, columns: Array) -> Values:
    """Columns (m, n) of a table, one a joint."""
    return {StateVariable(kind, joint): column for joint, column in enumerate(columns.T, 1)}


def _by_axis(kind: StateKind, components: Array) -> Values:
    """Components (3, m) of a vector."""
    return {
        StateVariable(kind, axis=axis): row for axis, row in zip("xyz", components, strict=True)
    }


def _readings(state: StateVariables) -> Values:
    return _by_joint(StateKind.READING, state.data.q)


def _approaches(state: StateVariables) -> Values:
    return _by_joint(StateKind.APPROACH, state.data.approach)


def _moves(state: StateVariables) -> Values:
    return _by_joint(StateKind.MOVE, state.data.move)


def _target(state: StateVariables) -> Values:
    return {StateVariable(StateKind.TARGET): state.data.target.astype(float)}


def _group(state: StateVariables) -> Values:
    return {StateVariable(StateKind.GROUP): state.data.group.astype(float)}


def _progress(state: StateVariables) -> Values:
    return {StateVariable(StateKind.PROGRESS): np.asarray(state.data.progress, dtype=float)}


def _positions(state: StateVariables) -> Values:
    """The target in frame 0, and its distance from the instrument."""
    target, group = state.pose().target, state.data.group
    R, t = state.placement
    line = np.einsum("mij,jm->mi", R[group], target) + t[group] - np.array(state.tracker)
    distance = {StateVariable(StateKind.RANGE): np.linalg.norm(line, axis=1)}
    return _by_axis(StateKind.POSITION, target) | distance


def _down(state: StateVariables) -> Values:
    last_axes = state.pose().axes[-1, :3]
    return _by_axis(StateKind.DOWN, np.einsum("aim,i->am", last_axes, _gravity(state)))


def _base_moment(state: StateVariables) -> Values:
    return _by_axis(
        StateKind.BASE_MOMENT, compute_base_moment(state.robot, state.pose(), state.data.q)
    )


def _link_moments(state: StateVariables) -> Values:
    """Torques about the joints' axes, and moments across them."""
    out: Values = {}
    for joint, rows in enumerate(compute_joint_moments(state.robot, state.pose(), state.data.q), 1):
        out[StateVariable(StateKind.BENDING, joint, "x")] = rows[0]
        out[StateVariable(StateKind.BENDING, joint, "y")] = rows[1]
        out[StateVariable(StateKind.TORQUE, joint)] = rows[2]
    return out


def _unit_moments(state: StateVariables) -> Values:
    """The same of 1 kg at the origin of one frame."""
    out: Values = {}
    for (joint, frame), rows in compute_unit_moments(state.robot, state.pose()).items():
        out[StateVariable(StateKind.UNIT_BENDING, joint, "x", frame)] = rows[0]
        out[StateVariable(StateKind.UNIT_BENDING, joint, "y", frame)] = rows[1]
        out[StateVariable(StateKind.UNIT_TORQUE, joint, frame=frame)] = rows[2]
    return out


def _gravity(state: StateVariables) -> Array:
    return np.array(state.robot.gravity)


EVALUATORS: dict[StateKind, Callable[[StateVariables], Values]] = {
    StateKind.READING: _readings,
    StateKind.POSITION: _positions,
    StateKind.RANGE: _positions,
    StateKind.TARGET: _target,
    StateKind.GROUP: _group,
    StateKind.PROGRESS: _progress,
    StateKind.APPROACH: _approaches,
    StateKind.MOVE: _moves,
    StateKind.TORQUE: _link_moments,
    StateKind.BASE_MOMENT: _base_moment,
    StateKind.DOWN: _down,
    StateKind.BENDING: _link_moments,
    StateKind.UNIT_BENDING: _unit_moments,
    StateKind.UNIT_TORQUE: _unit_moments,
}
