"""State variables of the rows of a problem: evaluated once, never carried to another set-up."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from .._linalg import TINY
from .._typing import Array, Rows
from ..exceptions import StudyError
from ..measurements.campaign.clock_history import LAGS
from ..measurements.campaign.late_names import name_late
from ..measurements.campaign.reference_temperature import TEMPERATURE
from ..measurements.campaign.state_names import (
    StateKind,
    StateVariable,
    covariate_unit,
    describe_state_name,
    parse_state_name,
    state_units,
)
from ..measurements.measurements import Measurements
from ..mechanisms.causes import Cause
from ..robot.kinematics import Pose, Robot, pose
from . import weight_variables as weights
from .weight_variables import Values, by_axis

MAX_ROWS_KEPT = 20_000  # up to so many rows, causes are kept once evaluated
# kinds that are measured, or counted
MEASURED = (
    StateKind.READING,
    StateKind.TARGET,
    StateKind.ON_FLANGE,
    StateKind.LOAD_ON_FLANGE,
    StateKind.GROUP,
    StateKind.PROGRESS,
    StateKind.APPROACH,
    StateKind.MOVE,
    StateKind.DRAG,
    StateKind.RATE,
    StateKind.SINCE_REST,
    StateKind.LATE,
)
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
        own_inputs = _inputs(self.data)
        other_inputs = _inputs(data)
        R, t = self.placement
        other_R, other_t = placement
        pairs = (
            (self.robot, robot),
            (self.tools, tools),
            (R, other_R),
            (t, other_t),
            *zip(own_inputs, other_inputs, strict=True),
        )
        same_tracker = self.tracker == tracker
        return same_tracker and all(known is given for known, given in pairs)

    def take(self, index: Rows, data: Measurements) -> StateVariables:
        """Return the variables of some rows, `data` those rows' measurements; values come along,
        causes do not."""
        values = {name: column[index] for name, column in self._values.items()}
        return StateVariables(self.robot, data, self.tools, self.placement, self.tracker, values)

    def names(self) -> dict[str, str]:
        """Return every name that a cause may use, with its unit."""
        return dict(self._units)

    @cached_property
    def _units(self) -> dict[str, str]:
        covariates = {name: covariate_unit(name) for name in self.data.covariates}
        units = state_units(self.robot) | covariates
        if TEMPERATURE not in covariates:
            for lag in LAGS:
                del units[name_late(lag)]
        return units

    def value(self, name: str) -> Array:
        """Return the values (m,) of a name. Raises StudyError for one that there is not."""
        if name not in self._values:
            evaluated = self._evaluate(name)
            self._values.update(evaluated)
        return self._values[name]

    def missing(self, names: Sequence[str]) -> list[str]:
        """Choose the names whose values need the chain, and are not evaluated yet."""
        return [name for name in names if name not in self._values and _needs_chain(name)]

    def keep(self, values: Mapping[str, Array]) -> None:
        """Keep values (m,) that have been evaluated elsewhere."""
        self._values.update(values)

    def cause(self, cause: Cause) -> Array | float:
        """Return a cause at every row, (m,) or one number."""
        values = self._causes.get(cause)
        if values is None:
            values = cause.of(self)
            if len(self.data) <= MAX_ROWS_KEPT:
                self._causes[cause] = values
        return values

    def _evaluate(self, name: str) -> dict[str, Array]:
        """Evaluate a name: its values, and those that come along at no cost, by name."""
        data = self.data
        covariates = data.covariates
        if name in covariates:
            return {name: covariates[name]}
        variable = parse_state_name(name)
        if variable is None or not variable.exists(self.robot):
            raise StudyError(
                f"the model depends on {describe_state_name(name)}, of which the measurements say nothing."
            )
        if variable.kind is StateKind.DRAG:
            return {name: _lead(self, variable)}
        evaluate = EVALUATORS[variable.kind]
        values = evaluate(self)
        columns = values.items()
        return {each.name: column for each, column in columns}

    def pose(self) -> Pose:
        """Return the nominal pose of all rows in frame 0."""
        data = self.data
        tools = self.tools[data.target]
        readings = data.q
        return pose(self.robot, readings, tools)

    def loaded_pose(self) -> Pose:
        """Return the nominal pose of all rows with the place where a load hangs as the target."""
        if len(self.tools) == 1 and self.robot.payload_at_mm is None:
            return self.pose()
        readings = self.data.q
        place = self.load_place()
        return pose(self.robot, readings, place)

    def load_place(self) -> Array:
        """Return where a load hangs in the flange's frame (3,) [mm]: as stated, else at the mean of all
        targets."""
        stated = self.robot.payload_at_mm
        if stated is None:
            return np.asarray(self.tools.mean(0))
        return np.array(stated)


def _needs_chain(name: str) -> bool:
    """Whether a name is of a quantity that depends on where the arm's links are."""
    variable = parse_state_name(name)
    return variable is not None and variable.kind not in MEASURED


def _inputs(data: Measurements) -> tuple[object, ...]:
    """What the state variables take from measurements."""
    return (
        data.q,
        data.approach,
        data.move,
        data.path,
        data.on_path,
        data.rate,
        data.since_rest,
        data.late_temperature,
        data.progress,
        data.target,
        data.group,
        data.covariates,
    )


# -- evaluation of each kind
# ------------------------------------------------------------------------------------------------------


def _by_joint(kind: StateKind, columns: Array) -> Values:
    """Name the columns (m, n) of a table, one a joint."""
    return {StateVariable(kind, joint): column for joint, column in enumerate(columns.T, 1)}


def _readings(state: StateVariables) -> Values:
    readings = state.data.q
    return _by_joint(StateKind.READING, readings)


def _approaches(state: StateVariables) -> Values:
    approaches = state.data.approach
    return _by_joint(StateKind.APPROACH, approaches)


def _moves(state: StateVariables) -> Values:
    moves = state.data.move
    return _by_joint(StateKind.MOVE, moves)


def _lead(state: StateVariables, variable: StateVariable) -> Array:
    """Compute how far a joint is ahead of what it drags along (m,): nowhere where its path is not
    known."""
    data = state.data
    joint = variable.joint
    assert joint is not None
    path, on_path = data.path, data.on_path
    if path is None or on_path is None:
        return np.zeros(len(data))
    most = variable.most
    leads = path.lead(joint, most)
    return leads[on_path]


def _rates(state: StateVariables) -> Values:
    """Return how fast the joints move: not at all where there is no clock."""
    rates = state.data.rate
    if rates is None:
        readings = state.data.q
        rates = np.zeros(readings.shape)
    return _by_joint(StateKind.RATE, rates)


def _since_rest(state: StateVariables) -> Values:
    """Return how long the arm has been at work: not at all where there is no clock."""
    data = state.data
    since = data.since_rest
    if since is None:
        since = np.zeros(len(data))
    return {StateVariable(StateKind.SINCE_REST): since}


def _late_temperatures(state: StateVariables) -> Values:
    """Return the temperature as slow masses have it: as it is where nothing went before."""
    data = state.data
    late = data.late_temperature
    if late is None:
        steady = state.value(TEMPERATURE)
        late = np.repeat(steady[:, None], len(LAGS), axis=1)
    columns = zip(LAGS, late.T, strict=True)
    return {StateVariable(StateKind.LATE, lag=lag): column for lag, column in columns}


def _target(state: StateVariables) -> Values:
    targets = state.data.target
    numbers = targets.astype(float)
    return {StateVariable(StateKind.TARGET): numbers}


def _on_flange(state: StateVariables) -> Values:
    offsets = state.tools[state.data.target]
    return by_axis(StateKind.ON_FLANGE, offsets.T)


def _group(state: StateVariables) -> Values:
    groups = state.data.group
    numbers = groups.astype(float)
    return {StateVariable(StateKind.GROUP): numbers}


def _progress(state: StateVariables) -> Values:
    progress = state.data.progress
    shares = np.asarray(progress, dtype=float)
    variable = StateVariable(StateKind.PROGRESS)
    return {variable: shares}


def _positions(state: StateVariables) -> Values:
    """Compute the target in frame 0, its distances from the instrument and from axis 1, and the
    directions along and across the beam, in frame 0, too.

    The instrument's upright axis is the z axis of its frame."""
    pose = state.pose()
    target, group = pose.target, state.data.group
    R, t = state.placement
    line = np.einsum("mij,jm->mi", R[group], target) + t[group] - np.array(state.tracker)
    length = np.linalg.norm(line, axis=1)
    distances = {
        StateVariable(StateKind.RANGE): length,
        StateVariable(StateKind.REACH): _measure_reach(state.robot, target),
    }
    direction = line / np.maximum(length, TINY)[:, None]
    beam = np.einsum("mij,mi->jm", R[group], direction)
    places = by_axis(StateKind.POSITION, target)
    face = np.einsum("aim,im->am", pose.axes[-1, :3], beam)
    seen = by_axis(StateKind.BEAM, beam) | by_axis(StateKind.FACE, face)
    return places | distances | seen | _beam_angles(direction, R[group])


def _beam_angles(direction: Array, R: Array) -> Values:
    """Compute the angles of beams (m, 3) of an instrument whose z axis is upright, and the directions
    in which they turn, in frame 0."""
    x, y, z = direction.T
    level = np.hypot(x, y)
    azimuth = np.arctan2(y, x)
    sine, cosine = np.sin(azimuth), np.cos(azimuth)
    aside = np.stack([-sine, cosine, np.zeros(len(z))])
    rise = np.stack([-z * cosine, -z * sine, level])
    angles = {
        StateVariable(StateKind.AZIMUTH): azimuth,
        StateVariable(StateKind.ZENITH): np.arctan2(level, z),
    }
    across = by_axis(StateKind.ASIDE, np.einsum("mij,im->jm", R, aside))
    return angles | across | by_axis(StateKind.RISE, np.einsum("mij,im->jm", R, rise))


def _measure_reach(robot: Robot, target: Array) -> Array:
    """Measure how far targets (3, m) are from joint 1's axis."""
    first = robot.joints[0]
    x, y, _, origin = first.before[:3].T
    line = target.T - origin
    across = [line @ x, line @ y]
    reach = np.hypot(*across)
    return np.asarray(reach)


EVALUATORS: dict[StateKind, Callable[[StateVariables], Values]] = {
    StateKind.READING: _readings,
    StateKind.POSITION: _positions,
    StateKind.RANGE: _positions,
    StateKind.BEAM: _positions,
    StateKind.AZIMUTH: _positions,
    StateKind.ZENITH: _positions,
    StateKind.ASIDE: _positions,
    StateKind.RISE: _positions,
    StateKind.FACE: _positions,
    StateKind.REACH: _positions,
    StateKind.TARGET: _target,
    StateKind.ON_FLANGE: _on_flange,
    StateKind.LOAD_ON_FLANGE: weights.load_on_flange,
    StateKind.LOAD_POSITION: weights.load_position,
    StateKind.GROUP: _group,
    StateKind.PROGRESS: _progress,
    StateKind.APPROACH: _approaches,
    StateKind.MOVE: _moves,
    StateKind.RATE: _rates,
    StateKind.SINCE_REST: _since_rest,
    StateKind.LATE: _late_temperatures,
    StateKind.TORQUE: weights.link_moments,
    StateKind.BASE_MOMENT: weights.moment_of_base,
    StateKind.DOWN: weights.down,
    StateKind.DOWN_AT_JOINT: weights.down_at_joints,
    StateKind.BENDING: weights.link_moments,
    StateKind.UNIT_BENDING: weights.unit_moments,
    StateKind.UNIT_TORQUE: weights.unit_moments,
}
