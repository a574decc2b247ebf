"""A correction table: the error of the target over a grid of joint readings, to be subtracted, and
how far it is off between the points of the grid."""

from __future__ import annotations

import csv
import io
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import product
from typing import TYPE_CHECKING

import numpy as np

from ..._typing import Array
from ...exceptions import StudyError, one_line, sentence_list, suggest
from ...fitting.problem import Problem
from ...measurements.state_names import is_state_name
from ...robot.kinematics import forward
from ..constant_part import bind_configurations, rms_and_max, sample_workspace
from ..prediction import compute_pose
from .form import Exported
from .lookup import interpolate

if TYPE_CHECKING:
    from ..calibration import Calibration

MAX_JOINTS = 3  # of a grid: with more its points are too many, or too far apart
MAX_POINTS = 100_000
FIRST_POINTS = 5  # along each joint, halved until what lies between is near enough
LARGEST_MM = 0.01
CHECKED = 2000  # configurations within the grid that its file is checked at
BLOCK = 5000  # configurations that are computed at once
NUMBER = r"[+-]?(?:\d+\.?\d*|\.\d+)"
RANGE = re.compile(rf"(\d{{1,3}})(?:=({NUMBER}):({NUMBER}))?")
UNITS = {"deg": np.pi / 180, "rad": 1.0, "mm": 1.0}


@dataclass(frozen=True)
class GridOptions:
    """What a grid is over: `joints` (from 1), until it is within `largest_mm` between its points;
    `at`: readings (q4_deg) and covariates that the others are held at; `ranges` of the joints
    [rad, mm], where they are not all that the calibration has seen."""

    joints: tuple[int, ...] = (1, 2, 3)
    largest_mm: float = LARGEST_MM
    at: Mapping[str, float] = field(default_factory=dict)
    ranges: Mapping[int, tuple[float, float]] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class _Held:
    """What every point of a grid shares: readings (n,) [rad, mm], covariates, sizes of moves
    (n,)."""

    q: Array
    covariates: Mapping[str, float]
    move: Array


def to_grid(c: Calibration, options: GridOptions | None = None) -> Exported:
    """Tabulate the real minus the nominal position of the first target, in frame 0, over a grid of
    joint readings. Raises StudyError for joints or values that the calibration does not have."""
    options = options or GridOptions(default_joints(c))
    _check_joints(c, options.joints)
    ranges = _find_ranges(c, options)
    held = _hold(c, options)
    axes, values, steps = _refine(c, options, held, ranges)
    remarks = _describe(c, options, held)
    text = _format(c, options.joints, axes, values, remarks)
    largest, checked = _check(c, options.joints, held, text)
    bound = max(largest, sum(steps))
    near = (
        "at most" if bound <= options.largest_mm else f"more than {options.largest_mm:g} mm: up to"
    )
    said = (
        f"{len(values):,} points, to be interpolated linearly: between them the table is off by {near} "
        f"{bound:.2g} mm, bounded by its second differences; the largest error found at {checked:,} "
        f"places is {largest:.2g} mm"
    )
    text = f"# {said}\n{text}"
    apart = _measure_elsewhere(c, options.joints, text)
    others = _list_held(c, options.joints, held)
    return Exported(text, bound, checked, others, apart, (said, remarks[0]))


def _find_ranges(c: Calibration, options: GridOptions) -> list[tuple[float, float]]:
    """Find the ends of the grid along every joint [rad, mm]. Raises StudyError beyond what the
    calibration has seen."""
    ranges = []
    for joint in options.joints:
        slides = c.robot.prismatic[joint - 1]
        seen_low, seen_high = c.ranges[f"q{joint}"]
        low, high = options.ranges.get(joint, (seen_low, seen_high))
        if not seen_low <= low < high <= seen_high:
            ends = np.array([seen_low, seen_high])
            unit = "mm" if slides else "deg"
            first, last = (ends if slides else np.degrees(ends)).tolist()
            raise StudyError(
                f"--joints: the grid of joint {joint} must lie within the {first:.6g} to {last:.6g} "
                f"{unit} that the calibration has seen, and start below its end."
            )
        ranges.append((low, high))
    return ranges


def default_joints(c: Calibration) -> tuple[int, ...]:
    """Return the first joints, as many as a grid is over."""
    most = min(c.robot.n, MAX_JOINTS)
    return tuple(range(1, most + 1))


def read_ranges(
    c: Calibration, text: str
) -> tuple[tuple[int, ...], dict[int, tuple[float, float]]]:
    """Read joints as people write them, "1=-90:90,2": their numbers, and the ends [rad, mm] of
    those that have some. Raises StudyError."""
    numbers = []
    ranges = {}
    for part in text.split(","):
        written = RANGE.fullmatch(part.strip())
        if written is None:
            raise StudyError(
                f"--joints {text}: expected joints such as 1,2,3, or 1=-90:90 from -90 to 90 (degrees "
                "or mm)."
            )
        number = int(written[1])
        numbers.append(number)
        if written[2] is None or not 1 <= number <= c.robot.n:
            continue
        scale = 1.0 if c.robot.prismatic[number - 1] else np.pi / 180
        ranges[number] = (float(written[2]) * scale, float(written[3]) * scale)
    return tuple(numbers), ranges


def _check_joints(c: Calibration, joints: Sequence[int]) -> None:
    distinct = len(set(joints)) == len(joints)
    known = all(1 <= joint <= c.robot.n for joint in joints)
    if not (distinct and known and 1 <= len(joints) <= MAX_JOINTS):
        listed = ",".join(map(str, joints))
        raise StudyError(
            f"--joints {listed}: a grid is over one to {MAX_JOINTS} of the joints 1 to {c.robot.n}, "
            "each once."
        )


def _hold(c: Calibration, options: GridOptions) -> _Held:
    """Hold every value in the middle of what the calibration has seen, or where it is asked to be.
    Raises StudyError for a value that it does not know, or has not seen."""
    middles = {name: _round_middle(c, name) for name in c.ranges}
    given = {}
    for name, value in options.at.items():
        key, factor = _find_key(c, name, options.joints)
        given[key] = value * factor
        low, high = c.ranges[key]
        if not low <= given[key] <= high:
            raise StudyError(
                f"--at {name}={value:g}: the calibration has seen {low / factor:.6g} to "
                f"{high / factor:.6g}."
            )
    middles |= given
    joints = range(1, c.robot.n + 1)
    q = np.array([middles[f"q{joint}"] for joint in joints])
    move = np.array([middles.get(f"move{joint}", 1.0) for joint in joints])
    covariates = {name: middles[name] for name in c.ranges if not is_state_name(name)}
    return _Held(q, covariates, move)


def _find_key(c: Calibration, name: str, joints: Sequence[int]) -> tuple[str, float]:
    """Find the value of the state that --at names, and the factor to its unit."""
    known = {name: (name, 1.0) for name in c.ranges if not is_state_name(name)}
    for joint, slides in enumerate(c.robot.prismatic, 1):
        if joint in joints:
            continue
        for unit in ("mm",) if slides else ("deg", "rad"):
            known[f"q{joint}_{unit}"] = (f"q{joint}", UNITS[unit])
    if name not in known:
        raise StudyError(
            f"--at {name}: the calibration has no such value beside those of the grid. {suggest(name, known)}"
        )
    return known[name]


def _round_middle(c: Calibration, name: str) -> float:
    """Return the middle of a range: of a joint in whole degrees, of others to three digits."""
    low, high = c.ranges[name]
    middle = (low + high) / 2
    joints = {f"q{k}" for k, slides in enumerate(c.robot.prismatic, 1) if not slides}
    rounded = float(f"{middle:.3g}")
    if name in joints:
        rounded = float(np.radians(round(np.degrees(middle))))
    return min(max(rounded, low), high)


def _compute_errors(at: Problem, c: Calibration) -> Array:
    """Compute the real minus the nominal position (m, 3) [mm] in frame 0."""
    real = compute_pose(at, c.terms, c.theta).target.T
    return np.asarray(real - forward(at.robot, at.data.q, at.tool))


def _errors_at(c: Calibration, joints: Sequence[int], held: _Held, readings: Array) -> Array:
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


def _evaluate(c: Calibration, joints: Sequence[int], held: _Held, axes: Sequence[Array]) -> Array:
    """Evaluate the errors at the points of a grid: an axis a joint, and 3 [mm]."""
    shape = [len(axis) for axis in axes]
    return _errors_at(c, joints, held, _mesh(axes)).reshape(*shape, 3)


def _refine(
    c: Calibration, options: GridOptions, held: _Held, ranges: Sequence[tuple[float, float]]
) -> tuple[list[Array], Array, list[float]]:
    """Halve the grid along the joint that bends the error most, until it is near enough between
    its points, or they are too many. Returns the readings of every joint, the errors (points, 3),
    and what half a step along each joint misses at most [mm]: together they bound what multilinear
    interpolation misses."""
    joints = options.joints
    counts = [FIRST_POINTS] * len(ranges)
    while True:
        axes = [np.linspace(*ends, count) for ends, count in zip(ranges, counts, strict=True)]
        values = _evaluate(c, joints, held, axes)
        steps = []
        for k, axis in enumerate(axes):
            between = [*axes]
            between[k] = (axis[1:] + axis[:-1]) / 2
            found = _evaluate(c, joints, held, between)
            steps.append(_measure_half_steps(values, found, k))
        worst = int(np.argmax(steps))
        more = 2 * counts[worst] - 1
        points = int(np.prod(counts)) // counts[worst] * more
        if sum(steps) <= options.largest_mm or points > MAX_POINTS:
            return axes, values.reshape(-1, 3), steps
        counts[worst] = more


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


def _check(c: Calibration, joints: Sequence[int], held: _Held, text: str) -> tuple[float, int]:
    """Compare a file with the model at the centres of its cells and at places drawn within it:
    the largest difference [mm], and at how many places."""
    axes, read = _read_back(text)
    rng = np.random.default_rng(0)
    low = [axis[0] for axis in axes]
    high = [axis[-1] for axis in axes]
    drawn = rng.uniform(low, high, (CHECKED, len(axes)))
    centres = _mesh([(axis[1:] + axis[:-1]) / 2 for axis in axes])
    places = np.concatenate([centres, drawn])
    difference = read(places) - _errors_at(c, joints, held, places)
    return rms_and_max(difference)[1], len(places)


def _measure_elsewhere(c: Calibration, joints: Sequence[int], text: str) -> tuple[float, float]:
    """Measure how far the table, whose edges hold beyond it, is from the whole model over all that
    the calibration has seen: (rms, largest) mm."""
    at = sample_workspace(c)
    columns = [joint - 1 for joint in joints]
    _, read = _read_back(text)
    return rms_and_max(_compute_errors(at, c) - read(at.data.q[:, columns]))


# -- words
# --------------------------------------------------------------------------------------------


def _list_held(c: Calibration, joints: Sequence[int], held: _Held) -> tuple[str, ...]:
    """List what the table does not look at, with where it is held."""
    out = []
    for joint, slides in enumerate(c.robot.prismatic, 1):
        if joint in joints:
            continue
        value = float(held.q[joint - 1])
        shown = f"{value:.6g} mm" if slides else f"{np.degrees(value):.6g} deg"
        out.append(f"joint {joint} away from {shown}")
    needs = c.needs()
    for name, value in held.covariates.items():
        if name in needs:
            out.append(f"{name} away from {value:.6g}")
    if any(name.startswith("approach") for name in needs):
        out.append("the direction of approach (the middle of the play is taken)")
    if any(name.startswith("move") for name in needs):
        out.append("the size of the last move")
    return tuple(out)


def _describe(c: Calibration, options: GridOptions, held: _Held) -> list[str]:
    """Describe whose errors they are, and what they hold for."""
    first = c.targets[0]
    named = sentence_list([str(joint) for joint in options.joints])
    joint_word = "joints" if len(options.joints) > 1 else "joint"
    whose = (
        f'error of target "{first}": real minus nominal position in frame 0, mm, over {joint_word} '
        f"{named}; subtract it from the position that is commanded"
    )
    remarks = [whose]
    others = _list_held(c, options.joints, held)
    if others:
        remarks.append(f"it does not look at {'; '.join(others)}")
    return remarks
