"""The noise floor: what one coordinate's standard uncertainty is, where that comes from, and the
weights that follow."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from .._typing import Array, Index
from ..exceptions import StudyError
from ..measurements.measurements import Measurements
from ..measurements.repeats import Repeats, find_repeats
from ..robot.kinematics import forward
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
# rows whose poses are held at a time
ROWS_TOGETHER = 100_000
# distances from which a pair of targets shows how they scatter
MIN_DISTANCES = 3
# squares about the median of n values are (1 - this / n) of the variance (large n, normal errors)
MEDIAN_EXCESS = 2 - np.pi / 2
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
            "noise: the instrument stands on a measured point; give [noise] tracker_mm in the data's frame"
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


def from_repeats(data: Measurements, placed: Index, residuals: Array | None = None) -> Floor | None:
    """Estimate the floor from the pooled standard deviation of positions at equal joint readings, per
    target and placement of the instrument, `placed` (m,); None with too few.

    `residuals` (m, 3): what a model leaves of the positions, which knows what differs from one repeat to
    the next (readings, a payload, the side that a joint came from)."""
    repeats = find_repeats(data, placed, residuals is not None)
    if repeats.freedom < MIN_FREEDOM:
        return None
    values = data.position if residuals is None else residuals
    return _pool_repeats(repeats, values)


def _pool_repeats(repeats: Repeats, values: Array) -> Floor:
    """Pool how far the values (m, 3) of repeats stray from each other."""
    is_repeated = repeats.is_repeated
    count = repeats.count[repeats.posture[is_repeated]]
    unbiased = np.sqrt(count / (count - 1))
    deviation = repeats.deviate(values)[is_repeated] * unbiased[:, None]
    return Floor(_pool_deviations(deviation), "repeats", repeats.freedom)


def _pool_deviations(deviation: Array) -> float:
    """Pool deviations to a standard deviation: the root mean square of those within FAR robust ones,
    of which a swapped reflector is none."""
    size = np.abs(deviation)
    median = float(np.median(size))
    robust = NORMAL * median
    within = size[size <= FAR * robust]
    squares = np.square(within)
    return float(np.sqrt(squares.mean()))


def from_target_pairs(data: Measurements, residuals: Array | None = None) -> Floor | None:
    """Estimate the floor from the scatter of the distances between reflectors on one flange: the
    variance of each is 2 σ². None with too few, or where the distances are always the same to
    MIN_RELATIVE_SCATTER: a rigid body fitted to the markers keeps them, and shows no noise.

    `residuals` (m, 3): what a model leaves of the positions that knows of reflectors which moved on
    the flange."""
    position = _arrange_by_target(data, data.position)
    first, second = np.triu_indices(position.shape[1], 1)
    lines = position[:, first] - position[:, second]
    distance = np.linalg.norm(lines, axis=2)
    if residuals is not None:
        predicted = _arrange_by_target(data, data.position - residuals)
        expected = predicted[:, first] - predicted[:, second]
        distance -= np.linalg.norm(expected, axis=2)
    is_measured = np.isfinite(distance)
    count = is_measured.sum(0)
    is_repeated = count >= MIN_DISTANCES
    if not is_repeated.any():
        return None
    which = first[is_repeated], second[is_repeated]
    freedom = _count_freedom(lines[:, is_repeated], *which, position.shape[1])
    if freedom < MIN_FREEDOM:
        return None
    repeated = distance[:, is_repeated]
    deviation = np.abs(repeated - np.nanmedian(repeated, axis=0))
    unbiased = 1 - MEDIAN_EXCESS / count[is_repeated]
    # the variance of a distance is that of two coordinates
    scaled = deviation / np.sqrt(2 * unbiased)
    scatter = _pool_deviations(scaled[is_measured[:, is_repeated]])
    size = np.nanmedian(np.linalg.norm(position, axis=2))
    if scatter <= MIN_RELATIVE_SCATTER * size:
        return None
    return Floor(scatter, "target pairs", freedom)


def _arrange_by_target(data: Measurements, points: Array) -> Array:
    """Arrange points (m, 3) of the rows (n, T, 3) by configuration and target, NaN where one was not measured; of
    several measurements the first."""
    number, which = np.unique(data.configuration, return_inverse=True)
    shape = len(number), len(data.targets), 3
    position = np.full(shape, np.nan)
    position[which[::-1], data.target[::-1]] = points[::-1]
    return position


def _count_freedom(lines: Array, first: Index, second: Index, targets: int) -> int:
    """Count the degrees of freedom of the pooled squares of distances along lines (n, P, 3) between
    targets `first` and `second` (P,): distances that share a target are not independent.

    Of equal noise in all coordinates the distances have the covariance σ² C, and the squares are
    those of (tr C)² / tr C² independent ones (Satterthwaite 1946, Biometrics Bulletin 2, 110), less
    the share that the pairs' own middles take. tr C² has blocks u uᵀ of every pair, and their sums at
    every target."""
    with np.errstate(invalid="ignore", divide="ignore"):
        directions = lines / np.linalg.norm(lines, axis=2)[:, :, None]
    directions = np.nan_to_num(directions)
    pair = np.arange(len(first))
    is_end = np.zeros((len(first), targets))
    is_end[pair, first] = 1.0
    is_end[pair, second] = 1.0
    of_targets = np.einsum("pt,npx,npy->ntxy", is_end, directions, directions, optimize=True)
    distances = float(np.square(directions).sum())
    if not distances:
        # two targets at one place have no line between them
        return 0
    trace = 2 * distances
    squares = float(np.square(of_targets).sum()) + 2 * distances
    middles = len(first) / distances
    return int(trace**2 / squares * (1 - middles))


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
    measured = compare_repeats(problem, problem.placed) or from_target_pairs(data)
    return measured, None


def compare_repeats(problem: Problem, placed: Index) -> Floor | None:
    """Estimate the floor from repeats as `from_repeats` does, less how far the nominal arm moves between
    their readings."""
    repeats = find_repeats(problem.data, placed, is_predicted=True)
    if repeats.freedom < MIN_FREEDOM:
        return None
    is_repeated = repeats.is_repeated
    again = problem.take(is_repeated)
    starts = range(0, len(again), ROWS_TOGETHER)
    pieces = [again.take(slice(start, start + ROWS_TOGETHER)) for start in starts]
    residuals = np.zeros_like(problem.data.position)
    predicted = np.concatenate([_predict_nominal(one) for one in pieces])
    residuals[is_repeated] = again.data.position - predicted
    return _pool_repeats(repeats, residuals)


def _predict_nominal(problem: Problem) -> Array:
    """Compute where the nominal arm has each row's target (m, 3), in the measurements' frame."""
    rotations, origins = problem.placement
    group = problem.data.group
    places = forward(problem.robot, problem.data.q, problem.tool)
    turned = np.einsum("mij,mj->mi", rotations[group], places)
    return np.asarray(turned + origins[group])


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
