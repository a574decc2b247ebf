"""What remains unexplained: the detection limit, and whether the residual is still predictable.

The detection limit is the size of an effect that the search would find with probability POWER. The
residual is predictable where a Gaussian process of the configuration, leaving one configuration out,
explains more of it than chance."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from .._typing import Array, Index
from ..exceptions import count_words
from ..fitting.design import measure_rounding, whitened
from ..fitting.noise import Floor
from ..measurements.measurements import Measurements
from ..selection.evaluation import Evaluation, Split
from .candidates.candidate import Candidate
from .findings.outcome import Diagnosis
from .findings.sentences import format_angle, format_length
from .findings.stated_probability import format_chance, format_probability, write_chance
from .inference.evidence import RATIOS
from .inference.residual_tests import find_together
from .inference.simulation_counts import REST_FLIPS
from .search.state import LEVEL

# length scales of the kernel, in units of the sines and cosines of all joints' angles together
LENGTHS = (0.3, 0.6, 1.2, 2.4)
# noise variance over signal variance
NOISE_RATIOS = (0.3, 1.0, 3.0, 10.0)
# configurations that are needed, and that are used at most: more are thinned evenly
MIN_CONFIGURATIONS = 20
MAX_CONFIGURATIONS = 800
# probability with which an effect at the detection limit is found
POWER = 0.90
BISECTIONS = 60
# degrees of freedom of a noise floor from which a model is compared with it, and those of a floor
# that is stated
MIN_FLOOR_FREEDOM = 10
STATED_FLOOR_FREEDOM = 1e9


class DetectionLimit(NamedTuple):
    """What a further effect would have had to be to be found, as a sentence, its displacement [mm]
    and, where orientations were measured, the turning [mrad] of one that only turns the target; None
    where the data are too few."""

    sentence: str
    mm: float | None = None
    mrad: float | None = None


@dataclass(frozen=True)
class Predictable:
    """How predictable a residual is, leaving one configuration out.

    `share`: the share of its sum of squares that prediction explains; `p`: how often sign flips of
    whole configurations (of whole groups or lines, where errors last within them) do as well."""

    share: float
    p: float


def estimate_predictability(
    data: Measurements, residual: Array, prismatic: tuple[bool, ...], rng: np.random.Generator
) -> Predictable | None:
    """Estimate how predictable residuals (m, 3) [mm] are from the joint angles.

    By a Gaussian process with a squared-exponential kernel (Rasmussen & Williams 2006, eq. 5.12).

    None with fewer than MIN_CONFIGURATIONS configurations, or where nothing is left."""
    blocks, first, index = np.unique(data.block, return_index=True, return_inverse=True)
    if len(blocks) < MIN_CONFIGURATIONS or not residual.any():
        return None
    count = np.bincount(index)
    mean = np.stack([np.bincount(index, residual[:, a]) / count for a in range(3)], 1)
    chosen = _thin(len(blocks))
    rows = first[chosen]
    y = mean[chosen] - mean[chosen].mean(0)
    unit = np.arange(len(y))
    together = find_together(data, residual, rng)
    if together is not None:
        unit = np.unique(together[rows], return_inverse=True)[1]
    flips = rng.choice([-1.0, 1.0], (REST_FLIPS, int(unit.max()) + 1))[:, unit]
    flipped = (flips[:, :, None] * y).transpose(1, 0, 2)
    responses = np.concatenate([y[:, None], flipped], axis=1)
    explained = _compute_explained(_compute_distances(data.q[rows], prismatic), responses)
    as_large = (explained[1:] >= explained[0]).sum()
    return Predictable(float(explained[0]), float((1 + as_large) / (REST_FLIPS + 1)))


def _thin(count: int) -> Index:
    if count <= MAX_CONFIGURATIONS:
        return np.arange(count)
    places = np.linspace(0, count - 1, MAX_CONFIGURATIONS)
    whole_places = places.astype(int)
    return np.unique(whole_places)


def _compute_distances(q: Array, prismatic: tuple[bool, ...]) -> Array:
    """Compute (k, k) squared distances between configurations (k, n).

    Angles count by their sines and cosines, slides over their range."""
    parts = []
    for j, slides in enumerate(prismatic):
        if slides:
            parts.append(q[:, [j]] / max(float(np.ptp(q[:, j])), 1e-9))
        else:
            parts.append(np.stack([np.sin(q[:, j]), np.cos(q[:, j])], 1))
    X = np.concatenate(parts, axis=1)
    # about their mean, so that rounding is that of the distances
    X = X - X.mean(0)
    square = np.square(X).sum(1)
    distances = square[:, None] + square - 2 * (X @ X.T)
    return np.asarray(np.maximum(distances, 0.0))


def _compute_explained(square: Array, responses: Array) -> Array:
    """Compute (B,) the largest share of responses (k, B, 3) that leave-one-out explains.

    The largest over all length scales and noise ratios; `square` (k, k): squared distances."""
    count = len(responses)
    flat = responses.reshape(count, -1)
    total = np.square(flat).reshape(count, -1, 3).sum((0, 2))
    best = np.full(responses.shape[1], -np.inf)
    for length in LENGTHS:
        value, vector = np.linalg.eigh(np.exp(-square / (2 * length**2)))
        rotated = vector.T @ flat
        for ratio in NOISE_RATIOS:
            weight = 1 / (np.maximum(value, 0) + ratio)
            diagonal = np.square(vector) @ weight
            errors = (vector @ (weight[:, None] * rotated)) / diagonal[:, None]
            left = np.square(errors).reshape(count, -1, 3).sum((0, 2))
            best = np.maximum(best, 1 - left / total)
    return best


def compute_detection_limit(
    diagnosis: Diagnosis, priors: Sequence[float], rows: int, sigma: float
) -> float | None:
    """Compute the displacement of an effect that the scan would find with probability POWER.

    `rows`: the number of rows that were scanned. It is the root mean square per row [whitened units of sigma], beyond the model, of an effect of
    one column.

    It is the noncentrality at which the effect's evidence exceeds the bound, with the median prior
    of the candidates. None where the data are too few for any effect to exceed it."""
    from scipy.special import chndtr

    freedom = diagnosis.fit.beyond
    share = np.concatenate([np.linspace(0.0, 0.9, 4001)[1:], 1 - np.logspace(-1, -7, 1201)[1:]])
    log_prior = float(np.log(np.median(priors)))
    evidence = log_prior + np.max(
        [
            -0.5 * np.log1p(ratio) - 0.5 * freedom * np.log1p(-share * ratio / (1 + ratio))
            for ratio in RATIOS
        ],
        axis=0,
    )
    is_found = evidence > diagnosis.bound
    if freedom <= 1 or not is_found.any():
        return None
    smallest = share[np.argmax(is_found)]
    critical = smallest / (1 - smallest) * (freedom - 1)
    low, high = 0.0, 10 * critical + 100
    for _ in range(BISECTIONS):
        middle = (low + high) / 2
        is_short = 1 - chndtr(critical, 1, middle) < POWER
        low, high = (middle, high) if is_short else (low, middle)
    return float(sigma * np.sqrt(high / rows))


def is_subsampled(diagnosis: Diagnosis, split: Split) -> bool:
    """Return whether naming used only a part of the estimation rows."""
    return diagnosis.fit.rows < split.training.coordinates


def count_rows_seen(diagnosis: Diagnosis, split: Split) -> int:
    """Count the rows that naming used."""
    training = split.training
    rows = len(training)
    coordinates = diagnosis.fit.rows
    return coordinates * rows // training.coordinates


def describe_unexplained(
    diagnosis: Diagnosis,
    found: tuple[Candidate, ...],
    split: Split,
    chosen: Evaluation,
    reason: str = "",
    has_faults: bool = False,
) -> DetectionLimit:
    """Describe what a further effect would have had to be to be found; `reason`: why candidates
    that were asked for are not among those found; `has_faults`: whether faults of the data were."""
    if not found and reason:
        return DetectionLimit(f"Nothing was searched: {reason}")
    if not found or diagnosis.left is None:
        return DetectionLimit(
            "No candidate of this study can extend the base: nothing was searched."
        )
    if _explains_everything(diagnosis, split):
        return DetectionLimit(
            "Nothing is left to explain: the model agrees with the measurements to rounding."
        )
    is_more = bool(diagnosis.effects) or has_faults
    found_nothing = f"Nothing {'else ' if is_more else ''}was found"
    postures = _count_saturating(diagnosis, split)
    if postures:
        return DetectionLimit(
            f"{found_nothing}, and nothing could be: the model fits its {postures} postures whatever is measured "
            "there; let more postures fit the models."
        )
    sigma = estimate_floor(chosen, split).coordinate_mm
    priors, rows = [c.prior for c in found], count_rows_seen(diagnosis, split)
    limit = compute_detection_limit(diagnosis, priors, rows, sigma)
    limit_mrad = None
    rad_per_mm = _measure_rad_per_mm(chosen, split)
    if limit is not None and rad_per_mm is not None:
        limit_mrad = 1e3 * rad_per_mm * limit
    if diagnosis.left_p <= LEVEL:
        return DetectionLimit(_describe_stop(diagnosis), limit, limit_mrad)
    if limit is None:
        reach = "the data are too few for any further effect to be found, however large."
    else:
        size = format_length(limit)
        if limit_mrad is not None:
            size += f" or {format_angle(limit_mrad * 1e-3)} of orientation"
        reach = (
            f"a listed effect above {size} rms beyond what the geometry absorbs would "
            "have been found with 90 % probability."
        )
    left = (
        " The strongest remaining candidate would occur by chance with probability "
        f"{format_chance(diagnosis.left_p)}."
    )
    return DetectionLimit(f"{found_nothing}; {reach}{left}", limit, limit_mrad)


def _explains_everything(diagnosis: Diagnosis, split: Split) -> bool:
    """Return whether the extended model leaves no more than rounding of the data."""
    training = split.training
    residual = whitened(training, diagnosis.fit.residuals(training))
    size = float(np.linalg.norm(residual))
    return size <= measure_rounding(training)


def _count_saturating(diagnosis: Diagnosis, split: Split) -> int:
    """Count the postures, measured again and again, that the extended model is fitted to, where it has
    about as many parameters as these have coordinates; else 0."""
    training = split.training
    data = training.data
    blocks = np.unique(data.block)
    postures = len(blocks)
    configurations = np.unique(data.configuration)
    visits = len(configurations)
    if not training.only_points or postures == visits:
        return 0
    labels = np.stack([data.block, data.target])
    _, positions = np.unique(labels, axis=1).shape
    coordinates = positions * training.components
    parameters = len(diagnosis.fit.representatives)
    beyond = coordinates - parameters
    if beyond >= training.components:
        return 0
    return postures


def _measure_rad_per_mm(evaluation: Evaluation, split: Split) -> float | None:
    """Measure a model's rms residual of orientation against that of position, per coordinate [rad
    per mm]; None where no orientation was measured, or nothing is left of the position."""
    used = split.used
    residual = evaluation.residual[used]
    measured = split.problem.components_measured[used]
    if residual.shape[1] == 3 or not measured[:, 3:].any():
        return None
    sums = np.square(residual) * measured
    counts = measured[:, :3].sum(), measured[:, 3:].sum()
    position, orientation = sums[:, :3].sum() / counts[0], sums[:, 3:].sum() / counts[1]
    return float(np.sqrt(orientation / position)) if position > 0 else None


def _describe_stop(diagnosis: Diagnosis) -> str:
    """Describe a search that stopped although chance hardly leaves as much."""
    assert diagnosis.left is not None
    first = diagnosis.left.entries[0]
    count = len(diagnosis.effects)
    stopped = "No effect was named"
    if count:
        stopped = f"The search stopped after {count_words(count, 'effect')}"
    return (
        f"{stopped}, but something systematic may be left ({write_chance(diagnosis.left_p)}). It looks "
        f"most like {first.candidate.label} (probability {format_probability(first.probability)})."
    )


def estimate_floor(evaluation: Evaluation, split: Split) -> Floor:
    """Estimate the standard deviation of one coordinate [mm] from a fitted model's residuals."""
    fitted = evaluation.fit
    used = split.used
    measured = split.problem.measured
    residual = evaluation.residual[used]
    square = np.square(residual[:, :3])
    mean = square.mean()
    if measured is not None:
        counted = measured[used][:, :3]
        mean = square.sum() / counted.sum()
    variance = mean * fitted.rows / fitted.freedom
    return Floor(coordinate_mm=float(np.sqrt(variance)), source="estimated", freedom=fitted.freedom)


def predict_remainder(
    split: Split, last: Evaluation, rng: np.random.Generator
) -> Predictable | None:
    """Estimate how predictable the residual of the last model still is.

    Where not every row is a point, only the rows of the kind and feature that has most are used."""
    data = split.problem.data
    rows = split.used
    gauges = data.gauges
    if gauges is not None:
        features = len(gauges.features) + 1
        code = gauges.kind * features + gauges.feature + 1
        counts = np.bincount(code[rows])
        rows = rows & (code == counts.argmax())
    return estimate_predictability(
        data.take(rows), last.residual[rows][:, :3], split.problem.robot.prismatic, rng
    )
