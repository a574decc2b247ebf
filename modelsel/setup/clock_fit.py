"""By how much the clock of a joint log is ahead of an instrument's, as the nominal arm tells: the
offset at which the readings that are nearest in time explain the positions."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .._typing import Array, Index, Mask
from ..measurements.pairing.nearest_times import Clocks, find_nearest_times
from ..robot.kinematics import Robot, pose

# points, readings and offsets that are examined, spread over the files
MAX_POINTS = 150
MAX_READINGS = 20_000
MAX_OFFSETS = 4_000
# points, spread over the file, to which the readings give the offsets that are tried
ANCHORS = 3
MIN_POINTS = 12
# share of the points that must have readings near in time
MIN_SHARE = 0.5
# an offset fits as the best one does, up to this factor of what it leaves; of another, not beside it,
# this share of the points must have readings for it to leave the offset open
ALIKE = 4.0
RIVAL_SHARE = 0.8
# what the best offset leaves, over the extent of the mapped positions, at most
MAX_LEFT = 0.02


@dataclass(frozen=True)
class ClockFit:
    """Seconds by which a log's clock is ahead: the middle of those that fit, the least, the most."""

    seconds: float
    least: float
    most: float


@dataclass(frozen=True, eq=False)
class _Log:
    """Readings in the order of time: times (n,), the flange's position and axes (n, 3, 4) in frame 0,
    and the seconds that the time of a point may be away."""

    times: Array
    flange: Array
    max_gap: float


def fit_clock_offset(
    robot: Robot, clocks: Clocks, position: Array, q: Array, max_gap: float
) -> ClockFit | None:
    """Find the offset of the log's clock at which the nominal arm explains `position` (m, 3) by the
    readings q (n, joints), whatever the frame, the unit and the target; None where none does, or
    several do."""
    log = _thin_log(robot, clocks.log, q, max_gap)
    chosen = _spread(len(position), MAX_POINTS)
    times = clocks.points[chosen]
    offsets, counts = _list_offsets(log, times)
    if not len(offsets):
        return None
    left = np.array([_measure_left(log, times, position[chosen], each) for each in offsets])
    best = int(left.argmin())
    if not left[best] <= MAX_LEFT:
        return None
    fits = left <= ALIKE * left[best]
    fails = np.flatnonzero(~fits)
    first = max((k + 1 for k in fails if k < best), default=0)
    last = min((k - 1 for k in fails if k > best), default=len(offsets) - 1)
    rival = fits & (counts >= RIVAL_SHARE * counts[best])
    rival[first : last + 1] = False
    if rival.any():
        return None
    least, most = float(offsets[first]), float(offsets[last])
    middle = (least + most) / 2
    return ClockFit(_round_within(middle, most - least), least, most)


def _spread(count: int, most: int) -> Index:
    """List at most so many of `count` places, spread evenly."""
    chosen = np.linspace(0, count - 1, min(count, most))
    return np.unique(chosen.astype(np.intp))


def _thin_log(robot: Robot, times: Array, q: Array, max_gap: float) -> _Log:
    """Keep readings that are finite, in the order of time, at most MAX_READINGS of them."""
    is_finite = np.isfinite(q).all(axis=1)
    usable = np.flatnonzero(is_finite)
    order = usable[np.argsort(times[usable], kind="stable")]
    kept = order[_spread(len(order), MAX_READINGS)]
    reached = pose(robot, q[kept], np.zeros(3))
    origin = reached.target.T[:, :, None]
    axes = reached.axes[-1, :3].transpose(2, 1, 0)
    flange = np.concatenate([origin, axes], axis=2)
    steps = np.diff(times[kept])
    step = float(np.median(steps)) if len(steps) and len(kept) < len(order) else 0.0
    return _Log(times[kept], flange, max(max_gap, step))


def _list_offsets(log: _Log, times: Array) -> tuple[Array, Index]:
    """List the offsets to try, in their order, and how many points have readings near at each: those
    at which some reading belongs to one of a few points, and enough points have readings."""
    anchors = times[_spread(len(times), ANCHORS)]
    differences = np.subtract.outer(log.times, anchors)
    found = np.unique(np.round(differences, 3)).astype(float)
    found = found[_spread(len(found), ANCHORS * MAX_OFFSETS)]
    counts = np.array([_count_near(log, times, each) for each in found])
    needed = max(MIN_POINTS, MIN_SHARE * len(times))
    enough = np.flatnonzero(counts >= needed)
    kept = enough[_spread(len(enough), MAX_OFFSETS)]
    return found[kept], counts[kept]


def _count_near(log: _Log, times: Array, offset: float) -> int:
    _, is_near = _match(log, times, offset)
    return int(is_near.sum())


def _match(log: _Log, times: Array, offset: float) -> tuple[Index, Mask]:
    """Find the reading nearest to every point, and whether it is near enough."""
    wanted = times + offset
    nearest = find_nearest_times(log.times, wanted)
    gap = np.abs(log.times[nearest] - wanted)
    return nearest, gap <= log.max_gap


def _measure_left(log: _Log, times: Array, position: Array, offset: float) -> float:
    """Measure what the best affine map from the instrument to frame 0 and the best target leave, in
    the median of the points with readings, over the extent of the mapped positions."""
    nearest, is_near = _match(log, times, offset)
    x = position[is_near]
    flange = log.flange[nearest[is_near]]
    count = len(x)
    centred = x - x.mean(axis=0)
    size = max(float(np.abs(centred).max()), 1e-9)
    row = np.concatenate([centred / size, np.ones((count, 1))], axis=1)
    basis, _ = np.linalg.qr(row)
    y = flange.reshape(count, 12)
    rest = y - basis @ (basis.T @ y)
    rest = rest.reshape(3 * count, 4)
    target, *_ = np.linalg.lstsq(rest[:, 1:], -rest[:, 0], rcond=1e-9)
    with_target = np.concatenate([[1.0], target])
    left = np.linalg.norm((rest @ with_target).reshape(count, 3), axis=1)
    reached = flange @ with_target
    mapped = basis @ (basis.T @ reached)
    extent = np.linalg.norm(mapped - mapped.mean(axis=0), axis=1)
    return float(np.median(left) / max(float(np.median(extent)), 1e-9))


def _round_within(middle: float, width: float) -> float:
    """Round an offset as far as it stays in the middle half of those that fit."""
    for digits in range(4):
        rounded = round(middle, digits)
        if abs(rounded - middle) <= width / 4:
            return rounded
    return round(middle, 3)
