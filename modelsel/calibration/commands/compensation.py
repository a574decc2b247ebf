"""Joint commands whose real position is the wanted one: the calibrated exact chain, inverted near
the nominal command.

Damped Gauss-Newton of least joint change, all rows at once (Levenberg 1944; Nakamura & Hanafusa
1986): the joints' own columns of the screw field are the derivative; that causes change with the
reading as well is second order and left to the iteration."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..._typing import Array
from ...exceptions import DataError
from ...fitting.problem import Problem
from ...measurements.campaign.state_names import StateKind
from ...measurements.formats.table import Source, load_table
from ...measurements.measurements import Measurements
from ...measurements.reader import read_measurements
from ...robot.kinematics import Robot, forward
from ...robot.rigid import rotation_vector
from ..arm_alone import describe_left_out_instrument, leave_out_instrument
from ..expected_noise import describe_other_noise, expect_noise
from ..other_sides import describe_other_sides
from ..prediction import compute_pose, compute_sensitivities, predict, to_tracker_frame
from .command_notes import (
    describe_extrapolation,
    describe_order_dependence,
    find_past_limits,
    list_joints_of,
)
from .commands_table import build_commands_table, find_carried_columns
from .large_changes import check_bound, find_weakest, refuse_large_changes
from .open_switches import count_open_switches
from .side_differences import count_other_sides

if TYPE_CHECKING:
    import pandas as pd

    from ..calibration import Calibration

MAX_ITERATIONS = 60
START_DAMPING, MIN_DAMPING, MAX_DAMPING = 1e-9, 1e-12, 1e6  # of the trace of J Jᵀ
FIGURE_DECIMALS = 6  # of mm and mrad in a table: nanometres and nanoradians
REACHED_MM = 1e-3  # 1 µm: a row that is nearer is reached
SETTLED_MM = 1e-7  # a row that is nearer is left alone
# what a radian of a wanted orientation weighs against a mm, and a slide's mm against a radian
LEVER_MM = 100.0
ARRAYS = (np.ndarray, list, tuple)  # kinds of joint readings without names
MAX_CORRECTION = (10e-3, 20.0)  # rad, mm: a correction beyond is more likely a mistake


@dataclass(frozen=True, eq=False)
class Commands:
    """Corrected commands q (m, n), which the motors are to read, and where they lead: `wanted`
    (m, 3) in the tracker's frame;
    `before_mm` the error of the nominal command, `left_mm` what the corrected one leaves on the
    calibrated model, `model_mm` the standard uncertainty of that model there (length),
    `expected_mm` the root of the sum of squares of the two, of the measuring noise, of half the
    play where a direction of approach is unknown, and of what may be the instrument's; `before_rad`
    and `left_rad` the same of wanted orientations, None without, and `model_rad`, None also where the
    study measured no orientations and cannot know it; `beyond` (m, n) commands beyond a
    joint's limits; `weakest` (m,) [rad/mm]: of `find_weakest`; `noise_mm`: the noise of one coordinate
    that is expected."""

    q: Array
    change: Array
    wanted: Array
    before_mm: Array
    left_mm: Array
    model_mm: Array
    expected_mm: Array
    before_rad: Array | None = None
    left_rad: Array | None = None
    model_rad: Array | None = None
    beyond: NDArray[np.bool_] = field(default_factory=lambda: np.zeros((0, 0), bool))
    weakest: Array = field(default_factory=lambda: np.zeros(0))
    noise_mm: float = np.nan

    @property
    def reached(self) -> NDArray[np.bool_]:
        """(m,) rows that land on the wanted position to 1 µm of the model, and have the wanted
        orientation to 10 µrad."""
        near = self.left_mm <= REACHED_MM
        if self.left_rad is None:
            return near
        turned = self.left_rad <= REACHED_MM / LEVER_MM
        return near & turned

    @property
    def where_left(self) -> str:
        """The columns that say how far from the wanted place a row ends."""
        return (
            "error_left_mm" if self.left_rad is None else "error_left_mm and orientation_left_mrad"
        )

    def figures(self) -> dict[str, Array]:
        """Return what is expected of every row, by the names of a table's columns."""
        out = {
            "error_before_mm": self.before_mm,
            "error_left_mm": self.left_mm,
            "model_uncertainty_mm": self.model_mm,
            "expected_error_mm": self.expected_mm,
        }
        if self.before_rad is not None and self.left_rad is not None:
            out |= {
                "orientation_before_mrad": self.before_rad * 1e3,
                "orientation_left_mrad": self.left_rad * 1e3,
            }
        if self.model_rad is not None:
            out["orientation_uncertainty_mrad"] = self.model_rad * 1e3
        return {name: np.round(values, FIGURE_DECIMALS) for name, values in out.items()}


def replace_readings(at: Problem, q: Array) -> Problem:
    """Return the problem at other joint readings, all else as it was: the direction and size of the
    moves are those of the plan."""
    data = at.data
    moved = replace(data, q=q)
    return replace(at, data=moved)


def predict_nominal(at: Problem) -> Array:
    """Predict where the nominal robot has the target (m, 3), in the tracker's frame."""
    points = forward(at.robot, at.data.q, at.tool)
    return to_tracker_frame(at, points)


def _pose_error(c: Calibration, at: Problem, wanted: Array) -> tuple[Array, Array]:
    """Return what is missing (m, k) in frame 0 and its derivative to the joints (m, k, n): mm, and
    with orientations rad · LEVER_MM."""
    pose = compute_pose(at, c.terms, c.theta)
    R, t = (part[at.data.group] for part in at.placement)
    inside = np.einsum("mji,mj->mi", R, wanted - t)
    moving_axis = [2 if joint.prismatic else 5 for joint in at.robot.joints]  # tz or rz
    joints = range(at.robot.n)
    J = pose.displacement()[joints, moving_axis].transpose(2, 1, 0)
    error = inside - pose.target.T
    if at.data.rotation is None:
        return error, J
    rotation = pose.rotation.transpose(2, 0, 1)
    turn = rotation_vector(np.einsum("mji,mjk,mlk->mil", R, at.data.rotation, rotation))
    revolute = ~np.array(at.robot.prismatic)
    K = pose.axes[joints, moving_axis].transpose(2, 1, 0) * revolute
    both_errors = np.concatenate([error, LEVER_MM * turn], 1)
    return both_errors, np.concatenate([J, LEVER_MM * K], 1)


@dataclass(eq=False)
class _Inversion:
    """Commands q (m, n) on their way: the error there with its length, its derivative J, and every
    row's damping."""

    q: Array
    error: Array
    J: Array
    size: Array
    damping: Array

    def find_unsettled(self) -> NDArray[np.bool_]:
        """Find the rows (m,) that are not there yet and may still come nearer."""
        far = self.size > SETTLED_MM
        open_rows = self.damping < MAX_DAMPING
        return far & open_rows

    def propose(self, rows: NDArray[np.bool_], moves: Array) -> Array:
        """Return the commands after a damped step of least change in some rows; `moves` (n, k): how
        the joints move by one of what is to change least."""
        J = self.J[rows] @ moves
        inner = J @ J.transpose(0, 2, 1)
        weight = self.damping[rows] * np.trace(inner, axis1=1, axis2=2)
        damped = inner + weight[:, None, None] * np.eye(inner.shape[1])
        step = J.transpose(0, 2, 1) @ np.linalg.solve(damped, self.error[rows, :, None])
        trial = self.q.copy()
        trial[rows] += step[:, :, 0] @ moves.T
        return trial

    def accept(self, rows: NDArray[np.bool_], trial: Array, error: Array, J: Array) -> None:
        """Take the rows of a trial that come nearer; damp the others more."""
        size = np.linalg.norm(error, axis=1)
        better = rows & (size < self.size)
        self.error = np.where(better[:, None], error, self.error)
        self.q[better] = trial[better]
        self.J[better] = J[better]
        self.size[better] = size[better]
        relaxed = np.maximum(self.damping / 10, MIN_DAMPING)
        raised = np.where(rows, self.damping * 10, self.damping)
        self.damping = np.where(better, relaxed, raised)


def _list_moves(robot: Robot) -> Array:
    """List how the joints move by a rad (a slide's LEVER_MM) of every motor that can be moved,
    (n, k)."""
    scale = np.where(robot.prismatic, LEVER_MM, 1.0)
    if robot.coupling is None:
        return np.diag(scale)
    return np.asarray(scale[:, None] * robot.coupling.driven)


def compensate_commands(c: Calibration, data: Measurements) -> Commands:
    """Correct planned commands.

    `data.q` are nominal commands, `data.position` wanted positions (NaN: where the nominal robot
    has the target), `data.rotation` wanted orientations where there are any. Errors of the instrument
    are left out: they are none of the arm's. Raises DataError.
    """
    c = leave_out_instrument(c)
    start = c.problem(data)
    unstated = np.isnan(data.position)
    wanted = np.where(unstated, predict_nominal(start), data.position)
    before, J = _pose_error(c, start, wanted)
    size = np.linalg.norm(before, axis=1)
    damping = np.full(len(data), START_DAMPING)
    inversion = _Inversion(data.q.copy(), before, J, size, damping)
    moves = _list_moves(c.robot)
    weakest = find_weakest(J @ moves, before)
    for _ in range(MAX_ITERATIONS):
        rows = inversion.find_unsettled()
        if not rows.any():
            break
        trial = inversion.propose(rows, moves)
        at = replace_readings(start, trial)
        error, J = _pose_error(c, at, wanted)
        inversion.accept(rows, trial, error, J)
    return replace(_summarise_commands(c, start, wanted, before, inversion), weakest=weakest)


def _summarise_commands(
    c: Calibration, start: Problem, wanted: Array, before: Array, inversion: _Inversion
) -> Commands:
    q = inversion.q
    left = inversion.error
    there = replace_readings(start, q)
    factors = compute_sensitivities(c, there, c.terms, c.factor)
    model_variance = np.square(factors).sum(2)
    position_variance = model_variance[:, :3].sum(1)
    model_mm = np.sqrt(position_variance)
    before_mm = np.linalg.norm(before[:, :3], axis=1)
    left_mm = np.linalg.norm(left[:, :3], axis=1)
    sigma, _ = expect_noise(c, factors[:, :3])
    noise = 3 * sigma**2
    unknown = _compute_unknown_approach(c, there)
    unknown += count_other_sides(c, there)
    unknown += count_open_switches(c, there)
    expected_square = left_mm**2 + model_mm**2 + noise + unknown
    expected_mm = np.sqrt(expected_square)
    before_rad = left_rad = model_rad = None
    if start.data.rotation is not None:
        before_rad = np.linalg.norm(before[:, 3:], axis=1) / LEVER_MM
        left_rad = np.linalg.norm(left[:, 3:], axis=1) / LEVER_MM
        if c.tool_rotations is not None:
            turn_variance = model_variance[:, 3:].sum(1)
            model_rad = np.sqrt(turn_variance)
    commanded = replace(start.data, q=q).readings
    change = commanded - start.data.readings
    beyond = find_past_limits(c, q)
    return Commands(
        q=commanded,
        change=change,
        wanted=wanted,
        before_mm=before_mm,
        left_mm=left_mm,
        model_mm=model_mm,
        expected_mm=expected_mm,
        before_rad=before_rad,
        left_rad=left_rad,
        model_rad=model_rad,
        beyond=beyond,
        noise_mm=sigma,
    )


def _compute_unknown_approach(c: Calibration, at: Problem) -> Array:
    """Compute the variance (m,) [mm²] that joints add whose direction of approach is unknown: the
    target is half of their play to either side."""
    variance = np.zeros(len(at))
    for joint in list_joints_of(c, StateKind.APPROACH):
        unknown = at.data.approach[:, joint - 1] == 0
        if not unknown.any():
            continue
        ends = []
        for direction in (1.0, -1.0):
            approach = at.data.approach.copy()
            approach[unknown, joint - 1] = direction
            data = replace(at.data, approach=approach)
            ends.append(predict(c, replace(at, data=data)))
        half = (ends[0] - ends[1]) / 2
        variance += np.square(half).sum(1)
    return variance


def correct(
    c: Calibration, targets: Source, *, bound: tuple[float, float] = MAX_CORRECTION
) -> pd.DataFrame:
    """Correct the planned commands of a file or DataFrame.

    Columns are q1_rad … (or _deg), wanted x_mm y_mm z_mm where they are not the nominal ones, and
    what the model needs, under these names or those of the study's own file. Returns the corrected commands, with the error before, what is left and
    what is expected. `bound` (rad, mm): a correction beyond it is refused. Warns of configurations
    that the calibration has not seen and of rows that are not reached; the same sentences are in
    the table's attrs["notes"]. Raises DataError, and StudyError for a bound that is not one.
    """
    from warnings import warn

    check_bound(bound)
    table = load_table(targets)
    mapping = c.form.map_columns(table, {})
    data = read_measurements(table, c.robot, mapping, positions=False, once=False)
    file = ""
    if isinstance(targets, (str, PathLike)):
        file = Path(targets).name
    commands = compensate_commands(c, data)
    refuse_large_changes(c, commands, data, bound, file)
    notes = note_commands(c, commands, data)
    is_missed = ~commands.reached
    count = is_missed.sum()
    missed = int(count)
    if missed:
        where = commands.where_left
        verb = "is" if missed == 1 else "are"
        total = len(data)
        notes.append(f"{missed:,} of {total:,} rows {verb} not reached: see {where}.")
    for note in notes:
        warn(note, stacklevel=3)  # where the program corrects
    figures = commands.figures()
    form = find_carried_columns(c, table, mapping)
    corrected = build_commands_table(c, data, commands.q, commands.wanted, figures, form)
    # Python shows a warning of one line once
    corrected.attrs["notes"] = notes
    return corrected


def note_commands(c: Calibration, commands: Commands, data: Measurements) -> list[str]:
    """List what to note about planned commands and their correction."""
    return [
        *describe_left_out_instrument(c),
        *describe_other_sides(c),
        *describe_extrapolation(c, data),
        *describe_order_dependence(c, data),
        *describe_other_noise(c, commands.noise_mm),
        *describe_limit_violations(commands),
    ]


def tabulate_readings(c: Calibration, readings: Array | Sequence[Any]) -> pd.DataFrame:
    """Tabulate joint readings (m, n) [rad, mm], an array or a list of lists, as planned commands.
    Raises DataError for another number of joints, and for what are no numbers."""
    import pandas as pd

    joints = c.robot.n
    try:
        q = np.asarray(readings, dtype=float)
    except (TypeError, ValueError):
        raise DataError(
            f"joint readings: expected numbers, {joints} in every row.",
            remedy="Give one row a configuration, one column a joint.",
        ) from None
    if q.ndim != 2 or q.shape[1] != joints:
        shape = " x ".join(map(str, q.shape))
        raise DataError(
            f"joint readings: expected an array of m x {joints}, found {shape}.",
            remedy="Give one row a configuration, one column a joint.",
        )
    names = []
    for joint in range(1, joints + 1):
        unit = c.robot.unit(joint)
        names.append(f"q{joint}_{unit}")
    return pd.DataFrame(q, columns=names)


def read_planned(c: Calibration, source: Source | Array | Sequence[Any]) -> Measurements:
    """Read configurations that nobody measured: joint readings (m, n) [rad, mm], or a file or
    DataFrame with columns as the study's own. Raises DataError."""
    if isinstance(source, ARRAYS):
        source = tabulate_readings(c, source)
    loaded = load_table(source)
    mapping = c.form.map_columns(loaded, {})
    return read_measurements(loaded, c.robot, mapping, positions=False, once=False)


def describe_limit_violations(commands: Commands) -> list[str]:
    """Describe which corrected commands are beyond their joint's limits."""
    counts = commands.beyond.sum(0).tolist()
    total = len(commands.q)
    sentences = []
    for j, count in enumerate(counts, 1):
        verb = "lies" if count == 1 else "lie"
        if count:
            sentences.append(
                f"joint {j}: {count:,} of {total:,} corrected commands {verb} beyond its limits."
            )
    return sentences
