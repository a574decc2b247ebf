"""Problem: a robot, what was measured on it, where the tracker stands and how well it measures,
bound together.

A problem gives causes their state (named values per row) and the design its blocks of rows.
Frozen; `take` selects rows, `dataclasses.replace` changes parts of it."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .._arguments import check_numbers, check_type, name_type
from .._typing import Array, Index, Rows
from ..exceptions import ArgumentError, count_words
from ..measurements.gauges import Gauges
from ..measurements.measurements import Measurements
from ..mechanisms.causes import Cause
from ..mechanisms.terms import Term
from ..robot.kinematics import Pose, Robot, pose
from .observation import Fixtures, measured_readings
from .state_variables import Bound, Placement, StateVariables
from .whitening import UNIT, Whitening

NOWHERE = Fixtures.unknown(0)  # stands for features at zero
AT_FRAME_0: Placement = (np.zeros((0, 3, 3)), np.zeros((0, 3)))  # stands for identity of any groups
PROBLEM_EXPECTED = "a Problem, as Problem(robot, measurements, tools) makes one"
TOOLS_REMEDY = (
    "Give the nominal position of each target in the flange frame [mm], or one row for all of them."
)
PLACEMENT_EXPECTED = "R (groups, 3, 3) and t (groups, 3) [mm] of frame 0 in the tracker's frame"
MAX_LISTED = 3  # targets that a problem shows
# share of the arm's reach between its base and an instrument that stands apart from it
APART = 0.5
BLOCK = 4096  # rows: the arrays of one block stay in cache


@dataclass(frozen=True, eq=False, repr=False)
class Problem:
    """A robot and measurements on it, of G groups with a placement each and T targets with an
    offset each. Residuals and columns live in the tracker's frame. Raises ValueError for `tools`
    of another shape or with values that are no finite numbers, for a robot or measurements of
    another type, and for readings of another number of joints."""

    robot: Robot
    data: Measurements
    # (T, 3) mm, nominal targets in the flange frame; one row holds for all of them
    tools: Array
    # R (G, 3, 3), t (G, 3) mm: frame 0 in the tracker's frame; by default they are one
    placement: Placement = AT_FRAME_0
    # (T, 3, 3) nominal target's axes on the flange; identity where orientations are measured
    tool_rotations: Array | None = None
    whitening: Whitening = UNIT
    # the instrument's own position, for range_mm
    tracker: tuple[float, float, float] = (0.0, 0.0, 0.0)
    # where features stand, of rows that are no points
    fixtures: Fixtures = NOWHERE
    _state: StateVariables | None = field(default=None, repr=False)

    def __post_init__(self) -> None:
        if self._state is None:
            # not one that was made of another
            _check_parts(self.robot, self.data)
            object.__setattr__(self, "tools", _copy_tools(self.tools))
            _check_setup(self.placement, len(self.data.groups), self.tracker)
            check_type(
                "whitening", self.whitening, Whitening, "a Whitening, as Whitening(1 / sigma)"
            )
        targets, groups = len(self.data.targets), len(self.data.groups)
        features = len(self.data.features)
        object.__setattr__(self, "tools", _tool_each(self.tools, targets))
        if not len(self.placement[0]):
            object.__setattr__(self, "placement", (_identities(groups), np.zeros((groups, 3))))
        if self.tool_rotations is None and self.data.rotation is not None:
            object.__setattr__(self, "tool_rotations", _identities(len(self.tools)))
        if features and not len(self.fixtures.length):
            object.__setattr__(self, "fixtures", Fixtures.unknown(features))
        if self._state is None or not self._state.belongs_to(*self._bound):
            object.__setattr__(self, "_state", StateVariables(*self._bound))

    def __len__(self) -> int:
        return len(self.data)

    def __repr__(self) -> str:
        lines = [f"Problem of {self.robot.name}. {self.data!r}"]
        for name, tool in zip(self.data.targets[:MAX_LISTED], self.tools, strict=False):
            x, y, z = tool
            lines.append(f'  nominal target "{name}": {x:g}, {y:g}, {z:g} mm in the flange frame')
        if len(self.tools) > MAX_LISTED:
            lines.append("  …")
        return "\n".join(lines)

    @cached_property
    def reach_mm(self) -> float:
        """How far the arm and its longest target reach [mm]."""
        return self.robot.reach + float(np.linalg.norm(self.tools, axis=1).max(initial=0))

    @cached_property
    def stands_apart(self) -> bool:
        """Whether the instrument stands apart from the arm, as one does that looks at it; else its
        position is but the origin of a frame, for want of a better one."""
        _, bases = self.placement
        own = np.array(self.tracker)
        distance = np.linalg.norm(bases - own, axis=1)
        least = APART * self.robot.reach
        return bool(distance.min() > least)

    @cached_property
    def placed(self) -> Index:
        """Number (m,) of the instrument's placement in every row: groups placed alike share one."""
        R, t = self.placement
        flat = np.concatenate([R.reshape(len(R), 9), t], axis=1)
        number = np.unique(flat, axis=0, return_inverse=True)[1]
        return np.asarray(number.reshape(-1)[self.data.group])

    @cached_property
    def tool(self) -> Array:
        """Nominal target (m, 3) of every row, in the flange frame [mm]."""
        targets = self.data.target
        return self.tools[targets]

    def take(self, index: Rows) -> Problem:
        """Return the problem of some rows; values already evaluated come along, so causes stay
        local in rows."""
        try:
            data = self.data.take(index)
        except (IndexError, TypeError):
            found = name_type(index)
            expected = f"a mask of the {len(self)} rows, their indices or a slice"
            raise ArgumentError(f"rows: expected {expected}, found {found}.") from None
        state = self.state.take(index, data)
        whitening = self.whitening.take(index)
        return replace(self, data=data, whitening=whitening, _state=state)

    def unweighted(self) -> Problem:
        """Return the problem with unit weights: residuals in mm and rad."""
        return replace(self, whitening=UNIT)

    def as_stated(self) -> Problem:
        """Return the problem weighed as before parts of its errors were estimated."""
        if self.whitening.stated is None:
            return self
        return replace(self, whitening=self.whitening.stated)

    def beside_instrument(self) -> Problem:
        """Return the problem weighed by the parts of its errors that are not the instrument's own."""
        whitening = self.whitening.beside_instrument()
        return replace(self, whitening=whitening)

    def pose(self, rows: slice, twist: Array | None = None) -> Pose:
        """Compute the kinematics of a block of rows in frame 0; twist (n+1, 6, rows)."""
        tool_rotation = self.tool_rotations
        if tool_rotation is not None:
            tool_rotation = tool_rotation[self.data.target[rows]]
        return pose(self.robot, self.data.q[rows], self.tool[rows], twist, tool_rotation)

    # -- what is measured
    # ----------------------------------------------------------------------------------------------

    @property
    def components(self) -> int:
        """Numbers of a row: 3 for positions, 6 with orientations."""
        if self.data.rotation is None:
            return 3
        return 6

    @property
    def only_points(self) -> bool:
        """Whether every row is a point, with every component measured."""
        return self.data.gauges is None

    def observed(self, rows: slice | None = None) -> Gauges:
        """Return what a block of rows measures, where not every row is a point. Raises TypeError
        where each is."""
        gauges = self.data.gauges
        if gauges is None:
            raise TypeError("every row of these measurements is a point")
        return gauges if rows is None else gauges.take(rows)

    @property
    def measured(self) -> NDArray[np.bool_] | None:
        """`components_measured` where not every row is a point, else None."""
        if self.only_points:
            return None
        return self.components_measured

    @cached_property
    def components_measured(self) -> NDArray[np.bool_]:
        """Which components of every row are measured, (m, c)."""
        if self.only_points:
            shape = len(self), self.components
            return np.ones(shape, dtype=bool)
        gauges = self.observed()
        coordinates = gauges.coordinates
        points = gauges.of("point")
        is_oriented = points[:, None]
        turns = self.components - 3
        oriented = np.repeat(is_oriented, turns, axis=1)
        measured = [coordinates, oriented]
        return np.concatenate(measured, axis=1)

    @property
    def coordinates(self) -> int:
        """Count of the measured numbers of all rows."""
        return (
            len(self) * self.components if self.only_points else int(self.components_measured.sum())
        )

    def counted(self, of: Index, count: int) -> Index:
        """Count the measured numbers (count,) of the rows that `of` (m,) numbers alike."""
        if self.only_points:
            return np.asarray(np.bincount(of, minlength=count) * self.components, dtype=np.intp)
        return np.bincount(of, self.components_measured.sum(1), minlength=count).astype(np.intp)

    def select_measured(self, values: Array) -> Array:
        """Return values (..., c·m) of all rows, components first, without those of components that
        are not measured."""
        if self.only_points:
            return values
        measured = self.components_measured.T
        return values[..., measured.reshape(-1)]

    @cached_property
    def readings(self) -> Array:
        """Readings (3, m) of rows that are no points."""
        gauges = self.observed()
        return measured_readings(gauges, self.data.position)

    def plain_points(self) -> Problem:
        """Return the same rows as points alone, unweighted: without orientations and what rows
        that are no points measure."""
        data = replace(self.data, rotation=None, sigma_rotation=None, gauges=None)
        return replace(self, data=data, tool_rotations=None, whitening=UNIT)

    @cached_property
    def bare(self) -> Problem:
        """The same rows as points with measured positions of zero, so that the residual is minus
        the predicted position."""
        data = replace(self.data, position=np.zeros((len(self), 3)), gauges=None)
        return replace(self, data=data, whitening=UNIT)

    @cached_property
    def origin(self) -> Problem | None:
        """`bare` at the configurations where the rows' distances begin; None without distances."""
        if self.only_points:
            return None
        origin = self.observed().origin
        if origin is None:
            return None
        data = replace(origin, position=np.zeros((len(self), 3)))
        return replace(self, data=data, whitening=UNIT)

    # -- blocks of rows
    # ----------------------------------------------------------------------------------------------

    def blocks(self, size: int = BLOCK) -> Iterator[slice]:
        """Return the slices that cover the rows; rows that share errors stay in large ones."""
        if self.whitening.shared is not None:
            size = BLOCK
        return (slice(start, min(start + size, len(self))) for start in range(0, len(self), size))

    def parts(self, size: int = BLOCK) -> Iterator[tuple[slice, Problem]]:
        """Yield (rows, problem of these rows): causes are evaluated block by block, so that none
        is ever held whole; a problem of one block is its own only part, and keeps what it has
        evaluated."""
        for rows in self.blocks(size):
            yield rows, self if rows.stop - rows.start == len(self) else self.take(rows)

    # -- the state that causes look at
    # ----------------------------------------------------------------------------------------------

    @property
    def state(self) -> StateVariables:
        """The state variables of the rows, with what has been evaluated of them."""
        assert self._state is not None
        return self._state

    @property
    def _bound(self) -> Bound:
        """What the state variables depend on."""
        return (self.robot, self.data, self.tools, self.placement, self.tracker)

    def names(self) -> dict[str, str]:
        """Return every name that a cause may use on these data, with its unit."""
        return self.state.names()

    def value(self, name: str) -> Array:
        """Return the values (m,) of a state variable. Raises StudyError for one that these data
        do not have."""
        if len(self) > BLOCK:
            self._keep([name])
        return self.state.value(name)

    def keep_values(self, terms: Iterable[Term]) -> None:
        """Evaluate what some terms need of the chain, once for all rows, block by block: parts of
        the rows have it then."""
        causes = {screw.cause for term in terms for screw in term.screws}
        names = {name for cause in causes for name in cause.names()}
        self._keep(sorted(names))

    def _keep(self, names: Sequence[str]) -> None:
        wanted = self.state.missing(names)
        values = {name: np.empty(len(self)) for name in wanted}
        for rows, part in self.parts() if wanted else ():
            for name, column in values.items():
                column[rows] = part.value(name)
        self.state.keep(values)

    def cause(self, cause: Cause) -> Array | float:
        """Return a cause at every row, (m,) or one number; evaluated once where the data are few
        enough to keep it."""
        return self.state.cause(cause)


def _identities(count: int) -> Array:
    """Return identity matrices (count, 3, 3)."""
    identity = np.eye(3)
    repeats = count, 1, 1
    return np.tile(identity, repeats)


def _check_parts(robot: Robot, data: Measurements) -> None:
    """Refuse a robot and measurements of other types, or of another number of joints each. Raises
    ArgumentError."""
    check_type("robot", robot, Robot, 'a Robot, as load_robot("puma760") returns it')
    check_type("data", data, Measurements, "Measurements, as read_measurements returns them")
    read = data.q.shape[1]
    if read != robot.n:
        joints = count_words(robot.n, "joint")
        raise ArgumentError(
            f"{robot.name} has {joints}, and the measurements have {read} readings a row: give the "
            "robot with which they were read."
        )


def _check_setup(placement: Any, groups: int, tracker: Any) -> None:
    """Refuse a placement that is not one of every group, and a tracker's position that is not a
    point. Raises ArgumentError."""
    check_type("placement", placement, (tuple, list), PLACEMENT_EXPECTED)
    if len(placement) != 2:
        raise ArgumentError(
            f"placement: expected {PLACEMENT_EXPECTED}, found {len(placement)} parts."
        )
    R, t = placement
    is_default = isinstance(R, np.ndarray) and not len(R)
    if not is_default:
        check_numbers("placement[0]", R, (groups, 3, 3), "a rotation of each group")
        check_numbers("placement[1]", t, (groups, 3), "a place of each group [mm]")
    check_numbers("tracker", tracker, (3,), "the instrument's x, y and z [mm]")


def _copy_tools(tools: Array) -> Array:
    """Return targets as an array of its own. Raises ArgumentError for what is no finite number."""
    try:
        rows = np.array(tools, dtype=float)
    except (TypeError, ValueError):
        raise ArgumentError(f"tools: expected numbers. {TOOLS_REMEDY}") from None
    if not np.isfinite(rows).all():
        raise ArgumentError(f"tools: a coordinate is not a finite number. {TOOLS_REMEDY}")
    return rows


def _tool_each(tools: Array, targets: int) -> Array:
    """(T, 3) nominal targets, of one row the same for all. Raises ArgumentError for another number
    of rows."""
    rows = np.atleast_2d(np.asarray(tools, dtype=float))
    if rows.shape == (targets, 3):
        return rows
    if rows.shape != (1, 3):
        raise ArgumentError(
            f"tools has shape {rows.shape}, expected ({targets}, 3). {TOOLS_REMEDY}"
        )
    return np.tile(rows, (targets, 1))
