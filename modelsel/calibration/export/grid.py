"""A correction table: the error of the target over a grid of joint readings, to be subtracted, and
how far it is off between the points of the grid."""

from __future__ import annotations

import csv
import io
from collections.abc import Callable, Sequence
from itertools import product
from typing import TYPE_CHECKING

import numpy as np

from ..._typing import Array
from ...exceptions import one_line, sentence_list, write_rounded
from ...fitting.problem import Problem
from ...robot.kinematics import forward
from ..arm_alone import leave_out_instrument
from ..constant_part import bind_configurations, rms_and_max, sample_workspace
from ..prediction import compute_pose
from .form import Exported
from .grid_options import (
    GridOptions,
    Held,
    check_joints,
    default_joints,
    describe_validity,
    find_ranges,
    hold_others,
    list_held,
)
from .lookup import interpolate
from .notes import describe_coupling, describe_instrument

if TYPE_CHECKING:
    from ..calibration import Calibration

MAX_POINTS = 100_000
FIRST_POINTS = 5  # along each joint, halved until what lies between is near enough
STALLED = (
    0.7  # of what interpolation missed before a halving: a jump stays, a bend leaves a quarter
)
CHECKED = 2000  # configurations within the grid that its file is checked at
# of the nominal arm's rms error: a table that leaves more of it is hardly worth its use
MIN_USE = 0.8
BLOCK = 5000  # configurations that are computed at once


def to_grid(c: Calibration, options: GridOptions | None = None) -> Exported:
    """Tabulate the real minus the nominal position of the first target, in frame 0, over a grid of
    joint readings. Raises StudyError for joints or values that the calibration does not have."""
    left_out = describe_instrument(c)
    c = leave_out_instrument(c)
    options = options or GridOptions(default_joints(c))
    check_joints(c, options.joints)
    ranges = find_ranges(c, options)
    held = hold_others(c, options)
    axes, values, steps = _refine(c, options, held, ranges)
    remarks = _describe(c, options, held)
    text = _format(c, options.joints, axes, values, remarks)
    missed = _check(c, options.joints, held, text)
    largest = float(missed.max())
    checked = len(missed)
    bound = max(largest, sum(steps))
    near = (
        "at most" if bound <= options.largest_mm else f"more than {options.largest_mm:g} mm: up to"
    )
    said = (
        f"{len(values):,} points, to be interpolated linearly: between them the table is off by {near} "
        f"{write_rounded(bound, 2)} mm, bounded by its second differences; of {checked:,} places the worst is off by "
        f"{write_rounded(largest, 2)} mm, and 95 % by no more than {write_rounded(np.percentile(missed, 95), 2)} mm"
    )
    text = f"# {said}\n{text}"
    apart, bare = _measure_elsewhere(c, options.joints, text)
    others = list_held(c, options.joints, held)
    compared = (
        f"over all that the calibration has seen the table leaves {write_rounded(apart[0])} mm rms ({write_rounded(apart[1])} mm at most); "
        f"without it the arm is off by {write_rounded(bare[0])} mm rms ({write_rounded(bare[1])} mm)"
    )
    notes = (said, compared, remarks[0], *left_out, *describe_coupling(c))
    errors = ("over all that the calibration has seen", bare[0], apart[0], 0.0)
    return Exported(text, bound, checked, others, apart, notes, errors, MIN_USE)


def _compute_errors(at: Problem, c: Calibration) -> Array:
    """Compute the real minus the nominal position (m, 3) [mm] in frame 0."""
    real = compute_pose(at, c.terms, c.theta).target.T
    return np.asarray(real - forward(at.robot, at.data.q, at.tool))


def _errors_at(c: Calibration, joints: Sequence[int], held: Held, readings: Array) -> Array:
    """Compute the errors (m, 3) at readings (m, k) of the grid's joints, the others held."""
    out = []
    places = [joint - 1 for joint in joints]
    for start in range(0, len(readings), BLOCK):
        some = readings[start : start + BLOCK]
        m = len(some)
        q = np.tile(held.q, (m, 1))
        q[:, places] = some
        covariates = {name: np.full(m, value) for name, value in held.covariates.items()}
        move = np.tile(held.move, (m, 1))
        at = bind_configurations(c, q, covariates, np.zeros_like(q), move)
        out.append(_compute_errors(at, c))
    return np.concatenate(out)


def _mesh(axes: Sequence[Array]) -> Array:
    """List the points (m, k) of a grid, the last joint's readings first."""
    mesh = np.meshgrid(*axes, indexing="ij")
    return np.stack([each.ravel() for each in mesh], 1)


def _evaluate(c: Calibration, joints: Sequence[int], held: Held, axes: Sequence[Array]) -> Array:
    """Evaluate the errors at the points of a grid: an axis a joint, and 3 [mm]."""
    shape = [len(axis) for axis in axes]
    return _errors_at(c, joints, held, _mesh(axes)).reshape(*shape, 3)


def _refine(
    c: Calibration, options: GridOptions, held: Held, ranges: Sequence[tuple[float, float]]
) -> tuple[list[Array], Array, list[float]]:
    """Halve the grid along the joint that bends the error most, until it is near enough between
    its points, or they are too many. Returns the readings of every joint, the errors (points, 3),
    and what half a step along each joint misses at most [mm]: together they bound what multilinear
    interpolation misses."""
    joints = options.joints
    counts = [FIRST_POINTS] * len(ranges)
    before = [np.inf] * len(ranges)
    while True:
        axes = [np.linspace(*ends, count) for ends, count in zip(ranges, counts, strict=True)]
        values = _evaluate(c, joints, held, axes)
        steps = []
        for k, axis in enumerate(axes):
            between = [*axes]
            between[k] = (axis[1:] + axis[:-1]) / 2
            found = _evaluate(c, joints, held, between)
            steps.append(_measure_half_steps(values, found, k))
        k = _choose_joint(steps, before, options.largest_mm)
        more = 2 * counts[k] - 1
        points = int(np.prod(counts)) // counts[k] * more
        if sum(steps) <= options.largest_mm or points > MAX_POINTS:
            return axes, values.reshape(-1, 3), steps
        counts[k] = more
        before[k] = steps[k]


def _choose_joint(steps: Sequence[float], before: Sequence[float], largest_mm: float) -> int:
    """Choose the joint (from 0) to halve: the one that misses most, before those that the last
    halving did not help, because the model jumps there."""
    share = largest_mm / len(steps)
    helped = [
        now if now > share and now < STALLED * last else 0.0
        for now, last in zip(steps, before, strict=True)
    ]
    return int(np.argmax(helped if any(helped) else steps))


def _measure_half_steps(values: Array, found: Array, k: int) -> float:
    """Measure what interpolation between neighbours along axis k misses half-way: the largest
    length [mm]."""
    count = values.shape[k]
    lower = np.take(values, range(count - 1), k)
    upper = np.take(values, range(1, count), k)
    missed = np.linalg.norm(found - (lower + upper) / 2, axis=-1)
    return float(missed.max())


# -- the file
# --------------------------------------------------------------------------------------------


def _format(
    c: Calibration,
    joints: Sequence[int],
    axes: Sequence[Array],
    values: Array,
    remarks: Sequence[str],
) -> str:
    """Write the grid as CSV: readings [rad, mm] and the error to be subtracted [mm]."""
    stream = io.StringIO()
    for remark in remarks:
        stream.write(f"# {one_line(remark)}\n")
    writer = csv.writer(stream, lineterminator="\n")
    names = [f"q{joint}_{c.robot.unit(joint)}" for joint in joints]
    writer.writerow([*names, "dx_mm", "dy_mm", "dz_mm"])
    for readings, error in zip(product(*axes), values.tolist(), strict=True):
        writer.writerow(
            [*(f"{value:.10g}" for value in readings), *(f"{value:.6f}" for value in error)]
        )
    return stream.getvalue()


def _read_back(text: str) -> tuple[list[Array], Callable[[Array], Array]]:
    """Read a file of this form: the readings of its joints, and the interpolated error (m, 3) at
    readings (m, k)."""
    lines = [line for line in text.splitlines() if not line.startswith("#")]
    table = np.array([line.split(",") for line in lines[1:]], dtype=float)
    axes = [np.unique(column) for column in table[:, :-3].T]
    shape = [len(axis) for axis in axes]

    def read(readings: Array) -> Array:
        columns = []
        for error in table[:, -3:].T:
            column = interpolate(axes, error.reshape(shape), list(readings.T))
            columns.append(column)
        return np.stack(columns, 1)

    return axes, read


def _check(c: Calibration, joints: Sequence[int], held: Held, text: str) -> Array:
    """Compare a file with the model at the centres of its cells and at places drawn within it:
    the differences (m,) [mm]."""
    axes, read = _read_back(text)
    rng = np.random.default_rng(0)
    low = [axis[0] for axis in axes]
    high = [axis[-1] for axis in axes]
    drawn = rng.uniform(low, high, (CHECKED, len(axes)))
    centres = _mesh([(axis[1:] + axis[:-1]) / 2 for axis in axes])
    places = np.concatenate([centres, drawn])
    difference = read(places) - _errors_at(c, joints, held, places)
    return np.asarray(np.linalg.norm(difference, axis=1))


def _measure_elsewhere(
    c: Calibration, joints: Sequence[int], text: str
) -> tuple[tuple[float, float], tuple[float, float]]:
    """Measure how far the table, whose edges hold beyond it, and the nominal arm are from the whole
    model over all that the calibration has seen: (rms, largest) mm of each."""
    at = sample_workspace(c)
    columns = [joint - 1 for joint in joints]
    _, read = _read_back(text)
    errors = _compute_errors(at, c)
    return rms_and_max(errors - read(at.data.q[:, columns])), rms_and_max(errors)


def _describe(c: Calibration, options: GridOptions, held: Held) -> list[str]:
    """Describe whose errors they are, and what they hold for."""
    first = c.targets[0]
    named = sentence_list([str(joint) for joint in options.joints])
    joint_word = "joints" if len(options.joints) > 1 else "joint"
    whose = (
        f'error of target "{first}": real minus nominal position in frame 0, mm, over {joint_word} '
        f"{named}; subtract it from the position that is commanded"
    )
    remarks = [whose, *describe_coupling(c)]
    validity = describe_validity(c, options.joints, held)
    return remarks + validity
