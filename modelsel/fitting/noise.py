"""The noise floor: what one coordinate's standard uncertainty is, where that comes from, and the
weights that follow."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .._typing import Array
from ..exceptions import StudyError
from ..measurements.measurements import Measurements
from ..measurements.visits import SAME_READING
from .problem import Problem

# standard deviation over median absolute deviation: a swapped reflector must not set the floor
NORMAL = 1.4826
LACKING = "lack-of-fit"  # code of the warning that a model leaves another noise than is known
MEDIAN = (
    0.37  # degrees of freedom of a standard deviation by the median, against one by the mean square
)
ENOUGH = 10  # degrees of freedom before repeats or target pairs are believed
# of its size: no instrument tells a distance better; where pairs agree so well, one was computed
# from the other
FINEST = 1e-7


@dataclass(frozen=True)
class Instrument:
    """A tracker: radial range_mm + range_ppm of the distance, angle_urad across; `at` its position
    in the data's frame."""

    range_mm: float = 0.0
    range_ppm: float = 0.0
    angle_urad: float = 0.0
    at: tuple[float, float, float] = (0.0, 0.0, 0.0)


@dataclass(frozen=True)
class Floor:
    """Standard uncertainty of one coordinate [mm] and its source; `freedom` its degrees of freedom
    (inf where stated); how many `coordinates` a row has, on average."""

    coordinate_mm: float
    source: str
    freedom: float = np.inf
    coordinates: float = 3.0


def covariance(data: Measurements, instrument: Instrument) -> Array:
    """(m, 3, 3) mm²: σ_r² uuᵀ + σ_a² d² (I − uuᵀ), u from the tracker to the point, d its
    distance."""
    line = data.position - np.array(instrument.at)
    d = np.linalg.norm(line, axis=1)
    if not d.all():
        raise StudyError(
            "noise: the tracker stands on a measured point; give [noise] tracker_mm in the data's frame"
        )
    u = line / d[:, None]
    along = np.einsum("mi,mj->mij", u, u)
    radial = (instrument.range_mm + instrument.range_ppm * 1e-6 * d) ** 2
    across = (instrument.angle_urad * 1e-6 * d) ** 2
    out = radial[:, None, None] * along + across[:, None, None] * (np.eye(3) - along)
    if not (radial > 0).all() or not (across > 0).all():
        raise StudyError("noise: range_mm or range_ppm, and angle_urad, must both be above zero")
    return np.asarray(out)


def from_repeats(data: Measurements) -> Floor | None:
    """Pooled standard deviation of positions at equal joint readings, per target; None with too
    few."""
    key = data.block * len(data.targets) + data.target
    _, inverse, count = np.unique(key, return_inverse=True, return_counts=True)
    low, high = (np.full((len(count), data.q.shape[1]), sign * np.inf) for sign in (1, -1))
    np.minimum.at(low, inverse, data.q)
    np.maximum.at(high, inverse, data.q)
    count[(high - low).max(1) > SAME_READING] = (
        1  # an arm read anew has moved its target, too: no repeat
    )
    freedom = 3 * int((count - 1).sum())
    if freedom < ENOUGH:
        return None
    mean = np.stack([np.bincount(inverse, data.position[:, a]) / count for a in range(3)], 1)
    repeated = count[inverse] > 1
    scaled = (data.position - mean[inverse])[repeated] * np.sqrt(count / np.maximum(count - 1, 1))[
        inverse[repeated]
    ][:, None]
    return Floor(NORMAL * float(np.median(np.abs(scaled))), "repeats", freedom)


def from_target_pairs(data: Measurements) -> Floor | None:
    """From the scatter of the distance between two reflectors on one flange: its variance is 2 σ²;
    None with too few, or where the distance is always the same to FINEST: a rigid body fitted to
    the markers keeps it, and shows no noise."""
    deviations, freedom, size = [], 0, [0.0]
    for a in range(len(data.targets)):
        for b in range(a + 1, len(data.targets)):
            first, second = (np.flatnonzero(data.target == t) for t in (a, b))
            _, i, j = np.intersect1d(
                data.configuration[first], data.configuration[second], return_indices=True
            )
            if len(i) > 2:
                d = np.linalg.norm(data.position[first[i]] - data.position[second[j]], axis=1)
                deviations.append(np.abs(d - np.median(d)) / np.sqrt(2))
                freedom += len(i) - 1
                size.append(float(np.median(np.linalg.norm(data.position[first[i]], axis=1))))
    if freedom < ENOUGH:
        return None
    scatter = NORMAL * float(np.median(np.concatenate(deviations)))
    return Floor(scatter, "target pairs", freedom) if scatter > FINEST * max(size) else None


def weigh(
    problem: Problem,
    instrument: Instrument | None,
    stated_mm: float | None,
    rotation_rad: float | None = None,
) -> tuple[Problem, Floor | None]:
    """The problem with its weights, and the floor where it is known before any fit (None: estimate it
    from the residuals).

    Uncertainties in the data go first, then the stated floor, the instrument, repeats, target
    pairs."""
    data = problem.data
    blocks: Array | None = None
    if (
        instrument is not None
        and data.gauges is not None
        and data.sigma is None
        and stated_mm is None
    ):
        raise StudyError(
            "noise: range_mm, range_ppm and angle_urad say how a tracker measures points, but the file has rows of "
            "other kinds; give s_mm in the file, or floor_mm"
        )
    if data.sigma is not None:
        blocks = np.einsum("mi,ij->mij", 1 / data.sigma, np.eye(3))
        floor: Floor | None = Floor(float(np.sqrt(np.square(data.sigma).mean())), "stated")
    elif stated_mm is not None:
        floor = Floor(stated_mm, "stated")
    elif instrument is not None:
        spread = covariance(data, instrument)
        blocks = np.linalg.inv(np.linalg.cholesky(spread))
        floor = Floor(float(np.sqrt(np.trace(spread, axis1=1, axis2=2).mean() / 3)), "instrument")
    elif data.gauges is not None:
        floor = (
            None  # rows of several kinds: what repeats of one would say is not true of the others
        )
    else:
        floor = from_repeats(data) or from_target_pairs(data)
    at = instrument.at if instrument is not None else problem.tracker
    weight = 1.0 if floor is None else 1.0 / max(floor.coordinate_mm, 1e-9)
    if data.rotation is not None:
        whole = np.zeros((len(data), 6, 6))
        whole[:, :3, :3] = weight * np.eye(3) if blocks is None else blocks
        spread_r = data.sigma_rotation
        if spread_r is None:
            spread_r = np.full((len(data), 3), rotation_rad or 1e-3 / weight)
        whole[:, 3:, 3:] = np.einsum("mi,ij->mij", 1 / spread_r, np.eye(3))
        blocks = whole
    return problem.anew(whiten=weight if blocks is None else blocks, tracker=at), floor
