"""The noise floor: what one coordinate's standard uncertainty is, where that comes from, and the
weights that follow."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from .._typing import Array, Index
from ..exceptions import StudyError
from ..measurements.measurements import Measurements
from ..measurements.repeats import find_repeats
from .problem import Problem
from .whitening import Whitening

# standard deviation over median absolute deviation: a swapped reflector must not set the floor
NORMAL = 1.4826
LACKING = "lack-of-fit"  # code of the warning that a model leaves another noise than is known
# robust standard deviations beyond which a deviation is no noise
FAR = 5.0
# of a standard deviation's interval
COVERAGE = 0.95
# degrees of freedom from which repeats or pairs of targets are believed
MIN_FREEDOM = 10
# of a distance's size: no instrument measures one better; where pairs agree so well, one was
# computed from the other
MIN_RELATIVE_SCATTER = 1e-7
MIN_SIGMA_MM = 1e-9  # of a floor, so that its weight stays finite
# rad of orientation for 1 mm of position, where no uncertainty of orientations is known
RAD_PER_MM = 1e-3


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
    """Compute the covariance (m, 3, 3) mm² of each position: σ_r² uuᵀ + σ_a² d² (I − uuᵀ), u from
    the tracker to the point, d its distance. Raises StudyError where it is not definite."""
    line = data.position - np.array(instrument.at)
    distance = np.linalg.norm(line, axis=1)
    if not distance.all():
        raise StudyError(
            "noise: the tracker stands on a measured point; give [noise] tracker_mm in the data's frame"
        )
    u = line / distance[:, None]
    along = np.einsum("mi,mj->mij", u, u)
    identity = np.eye(3)
    across = identity - along
    relative = instrument.range_ppm * 1e-6
    range_sigma = instrument.range_mm + relative * distance
    angle_sigma = instrument.angle_urad * 1e-6
    lateral_sigma = angle_sigma * distance
    radial = range_sigma**2
    lateral = lateral_sigma**2
    is_definite = (radial > 0).all() and (lateral > 0).all()
    if not is_definite:
        raise StudyError("noise: range_mm or range_ppm, and angle_urad, must both be above zero")
    by_range = radial[:, None, None] * along
    by_angle = lateral[:, None, None] * across
    matrices: Array = by_range + by_angle
    return matrices


def from_repeats(data: Measurements, placed: Index) -> Floor | None:
    """Estimate the floor from the pooled standard deviation of positions at equal joint readings, per
    target and placement of the instrument, `placed` (m,); None with too few."""
    repeats = find_repeats(data, placed)
    freedom = repeats.freedom
    if freedom < MIN_FREEDOM:
        return None
    is_repeated = repeats.is_repeated
    count = repeats.count[repeats.posture[is_repeated]]
    unbiased = np.sqrt(count / (count - 1))
    deviation = repeats.deviate(data.position)[is_repeated] * unbiased[:, None]
    return Floor(_pool_deviations(deviation), "repeats", freedom)


def _pool_deviations(deviation: Array) -> float:
    """Pool deviations to a standard deviation: the root mean square of those within FAR robust ones,
    of which a swapped reflector is none."""
    size = np.abs(deviation)
    median = float(np.median(size))
    robust = NORMAL * median
    within = size[size <= FAR * robust]
    squares = np.square(within)
    return float(np.sqrt(squares.mean()))


def from_target_pairs(data: Measurements) -> Floor | None:
    """Estimate the floor from the scatter of the distance between two reflectors on one flange:
    its variance is 2 σ². None with too few, or where the distance is always the same to
    MIN_RELATIVE_SCATTER: a rigid body fitted to the markers keeps it, and shows no noise."""
    deviations = []
    freedom = 0
    largest = 0.0
    targets = range(len(data.targets))
    for first, second in combinations(targets, 2):
        at_first, at_second = _paired_positions(data, first, second)
        if len(at_first) > 2:
            line = at_first - at_second
            distance = np.linalg.norm(line, axis=1)
            middle = np.median(distance)
            deviation = np.abs(distance - middle)
            # the variance of a distance is that of two coordinates
            deviations.append(deviation / np.sqrt(2))
            freedom += len(distance) - 1
            sizes = np.linalg.norm(at_first, axis=1)
            size = float(np.median(sizes))
            largest = max(largest, size)
    if freedom < MIN_FREEDOM:
        return None
    pooled = np.concatenate(deviations)
    scatter = _pool_deviations(pooled)
    if scatter <= MIN_RELATIVE_SCATTER * largest:
        return None
    return Floor(scatter, "target pairs", freedom)


def _paired_positions(data: Measurements, first: int, second: int) -> tuple[Array, Array]:
    """Return the positions (k, 3) of two targets in the configurations that have both."""
    at_first = data.target == first
    at_second = data.target == second
    rows = np.flatnonzero(at_first)
    others = np.flatnonzero(at_second)
    configuration = data.configuration
    _, i, j = np.intersect1d(configuration[rows], configuration[others], return_indices=True)
    position = data.position
    return position[rows[i]], position[others[j]]


def weigh(
    problem: Problem,
    instrument: Instrument | None,
    stated_mm: float | None,
    rotation_rad: float | None = None,
) -> tuple[Problem, Floor | None]:
    """Weigh the rows of a problem; also return the floor where it is known before any fit (None:
    estimate it from the residuals). Raises StudyError.

    Uncertainties in the data go first, then the stated floor, the instrument, repeats, pairs of
    targets."""
    floor, blocks = _known_floor(problem, instrument, stated_mm)
    weight = 1.0 if floor is None else 1.0 / max(floor.coordinate_mm, MIN_SIGMA_MM)
    if problem.data.rotation is not None:
        blocks = _with_orientations(problem.data, weight, blocks, rotation_rad)
    whitening = Whitening(weight) if blocks is None else Whitening(matrices=blocks)
    tracker = problem.tracker if instrument is None else instrument.at
    return replace(problem, whitening=whitening, tracker=tracker), floor


def _known_floor(
    problem: Problem, instrument: Instrument | None, stated_mm: float | None
) -> tuple[Floor | None, Array | None]:
    """(the floor, whitening matrices (m, 3, 3) of the positions where rows differ). Repeats of one
    kind of row say nothing of the others."""
    data = problem.data
    if data.sigma is not None:
        variance = np.square(data.sigma).mean()
        floor = Floor(float(np.sqrt(variance)), "stated")
        return floor, _diagonal(1 / data.sigma)
    if stated_mm is not None:
        return Floor(stated_mm, "stated"), None
    if instrument is not None:
        return _instrument_floor(data, instrument)
    if data.gauges is not None:
        return None, None
    measured = from_repeats(data, problem.placed) or from_target_pairs(data)
    return measured, None


def _instrument_floor(data: Measurements, instrument: Instrument) -> tuple[Floor, Array]:
    if data.gauges is not None:
        raise StudyError(
            "noise: range_mm, range_ppm and angle_urad say how a tracker measures points, but the file has rows of "
            "other kinds; give s_mm in the file, or floor_mm"
        )
    spread = covariance(data, instrument)
    mean_variance = np.trace(spread, axis1=1, axis2=2).mean() / 3
    matrices = np.linalg.inv(np.linalg.cholesky(spread))
    return Floor(float(np.sqrt(mean_variance)), "instrument"), np.asarray(matrices)


def _with_orientations(
    data: Measurements, weight: float, blocks: Array | None, rotation_rad: float | None
) -> Array:
    """Whitening matrices (m, 6, 6) of positions and orientations; `blocks` (m, 3, 3) of the
    positions, else one `weight`."""
    sigma = data.sigma_rotation
    count = len(data)
    if sigma is None:
        usual = rotation_rad or RAD_PER_MM / weight
        sigma = np.full((count, 3), usual)
    positions = blocks
    if positions is None:
        positions = weight * np.eye(3)
    orientations = _diagonal(1 / sigma)
    shape = count, 6, 6
    matrices = np.zeros(shape)
    matrices[:, :3, :3] = positions
    matrices[:, 3:, 3:] = orientations
    return matrices


def _diagonal(values: Array) -> Array:
    """Build diagonal matrices (m, k, k) of values (m, k)."""
    size = values.shape[1]
    identity = np.eye(size)
    matrices: Array = np.einsum("mi,ij->mij", values, identity)
    return matrices


def compute_interval(scale: float, freedom: float) -> tuple[float, float]:
    """Compute the 95 % interval of a standard deviation of so many degrees of freedom; a known one
    is its own."""
    from scipy.special import chdtri

    if np.isinf(freedom):
        return scale, scale
    tail = (1 - COVERAGE) / 2
    freedom = max(freedom, 1.0)
    high_quantile, low_quantile = chdtri(freedom, [tail, 1 - tail])
    low_ratio = freedom / high_quantile
    high_ratio = freedom / low_quantile
    low = scale * np.sqrt(low_ratio)
    high = scale * np.sqrt(high_ratio)
    return float(low), float(high)
