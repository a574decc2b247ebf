"""Whether any smooth function of the configuration still predicts the residual: a Gaussian process,
leave-one-out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from .._typing import Array
from ..fitting.noise import Floor
from ..measurements.measurements import Measurements
from ..selection.evaluation import Evaluation, Split
from .candidates import Candidate
from .evidence import RATIOS
from .residual_tests import GROUP_LEVEL, compute_group_p
from .sentences import format_length
from .state import LEVEL
from .stepwise import Diagnosis

LENGTHS = (
    0.3,
    0.6,
    1.2,
    2.4,
)  # of the kernel, in units of sine and cosine of a joint's angle, all joints together
NOISE_RATIOS = (0.3, 1.0, 3.0, 10.0)  # noise variance over signal variance
FLIPS = 199
LARGEST = 800  # configurations; more are thinned evenly


@dataclass(frozen=True)
class Predictable:
    """Share of the residual's sum of squares that leave-one-configuration-out prediction explains,
    and how often sign flips of whole configurations (of whole groups, where errors last within
    them) do as well."""

    share: float
    p: float


def estimate_predictability(
    data: Measurements, residual: Array, prismatic: tuple[bool, ...], rng: np.random.Generator
) -> Predictable | None:
    """Of residuals (m, 3) [mm]: Gaussian process with a squared-exponential kernel on the joint
    angles (Rasmussen & Williams 2006, eq. 5.12). None with fewer than twenty configurations."""
    blocks, index = np.unique(data.block, return_inverse=True)
    if len(blocks) < 20:
        return None
    count = np.bincount(index)
    mean = np.stack([np.bincount(index, residual[:, a]) / count for a in range(3)], 1)
    first = np.unique(data.block, return_index=True)[1]
    thin = (
        np.unique(np.linspace(0, len(blocks) - 1, LARGEST).astype(int))
        if len(blocks) > LARGEST
        else np.arange(len(blocks))
    )
    y = mean[thin] - mean[thin].mean(0)
    q = data.q[first[thin]]
    parts = [
        q[:, [j]] / max(float(np.ptp(q[:, j])), 1e-9)
        if slides
        else np.stack([np.sin(q[:, j]), np.cos(q[:, j])], 1)
        for j, slides in enumerate(prismatic)
    ]
    X = np.concatenate(parts, axis=1)
    square = np.square(X[:, None] - X[None]).sum(2)
    unit = np.arange(len(y))
    if (
        compute_group_p(data, residual, rng) <= GROUP_LEVEL
    ):  # errors last within groups: these change their signs as a whole
        unit = np.unique(data.group[first[thin]], return_inverse=True)[1]
    flips = rng.choice([-1.0, 1.0], (FLIPS, int(unit.max()) + 1))[:, unit]
    many = np.concatenate([y[:, None], (flips[:, :, None] * y).transpose(1, 0, 2)], axis=1).reshape(
        len(y), -1
    )
    total = np.square(many).reshape(len(y), -1, 3).sum((0, 2))
    best = np.full(FLIPS + 1, -np.inf)
    for length in LENGTHS:
        value, vector = np.linalg.eigh(np.exp(-square / (2 * length**2)))
        turned = vector.T @ many
        for ratio in NOISE_RATIOS:
            weight = 1 / (np.maximum(value, 0) + ratio)
            left = (vector @ (weight[:, None] * turned)) / (np.square(vector) @ weight)[:, None]
            best = np.maximum(best, 1 - np.square(left).reshape(len(y), -1, 3).sum((0, 2)) / total)
    return Predictable(float(best[0]), float((1 + (best[1:] >= best[0]).sum()) / (FLIPS + 1)))


POWER = 0.90


def compute_detection_limit(
    diagnosis: Diagnosis, priors: Sequence[float], configurations: int, sigma: float
) -> float | None:
    """Root mean square displacement per row [whitened units of sigma] beyond the model of a
    single-column effect that the scan would find with 90 %: the noncentrality at which its evidence
    passes the bound (methods.md A.7). None where the data are so few that nothing passes it,
    however large."""
    from scipy.special import chndtr

    log_prior = float(np.log(np.median(priors)))
    freedom = diagnosis.fit.beyond
    share = np.concatenate([np.linspace(0.0, 0.9, 4001)[1:], 1 - np.logspace(-1, -7, 1201)[1:]])
    best = np.max(
        [
            log_prior - 0.5 * np.log1p(r) - 0.5 * freedom * np.log1p(-share * r / (1 + r))
            for r in RATIOS
        ],
        axis=0,
    )
    if freedom <= 1 or not (best > diagnosis.bound).any():
        return None
    passing = share[np.argmax(best > diagnosis.bound)]
    critical = passing / (1 - passing) * (freedom - 1)
    low, high = 0.0, 10 * critical + 100
    for _ in range(60):
        middle = (low + high) / 2
        low, high = (middle, high) if 1 - chndtr(critical, 1, middle) < POWER else (low, middle)
    return float(sigma * np.sqrt(high / configurations))


MIN_FLOOR_FREEDOM = 10  # degrees of freedom of a floor before a model is held against it
STATED_FLOOR_FREEDOM = 1e9  # degrees of freedom of a floor that is stated


def is_subsampled(diagnosis: Diagnosis, split: Split) -> bool:
    """Whether naming has seen only some of the estimation rows."""
    return diagnosis.fit.rows < split.training().coordinates


def count_rows_seen(diagnosis: Diagnosis, split: Split) -> int:
    """How many rows naming has seen."""
    training = split.training()
    return diagnosis.fit.rows * len(training) // training.coordinates


def describe_unexplained(
    diagnosis: Diagnosis, found: tuple[Candidate, ...], split: Split, chosen: Evaluation
) -> tuple[str, float | None]:
    """(sentence, limit in mm): what a further effect would have had to be to be found."""
    if not found or diagnosis.left is None:
        return "No mechanism may extend the base in this study: nothing was searched.", None
    sigma = estimate_floor(chosen, split).coordinate_mm
    limit = compute_detection_limit(
        diagnosis, [c.prior for c in found], count_rows_seen(diagnosis, split), sigma
    )
    if diagnosis.left_p <= LEVEL:
        first = diagnosis.left.entries[0]
        stopped = (
            f"The search stopped after {len(diagnosis.effects)} effects, but something systematic is left: chance alone "
            f"would explain it with probability {diagnosis.left_p:.2g}. It looks most like {first.candidate.label} "
            f"(probability {first.probability:.2f})."
        )
        return stopped, limit
    more = "else " if diagnosis.effects else ""
    left = f" The strongest of what is left would come by chance with probability {diagnosis.left_p:.2g}."
    if limit is None:
        return (
            f"Nothing {more}was found; the data are too few for any further effect to be found, however large.{left}",
            None,
        )
    return (
        f"Nothing {more}was found; an effect above {format_length(limit)} rms beyond what the geometry absorbs would have been "
        f"found with 90 %.{left}"
    ), limit


def estimate_floor(rung_: Evaluation, split: Split) -> Floor:
    """One coordinate's standard deviation [mm] from the residuals of a fitted model."""
    fitted = rung_.fit
    square = np.square(rung_.residual[split.used][:, :3])
    mean = square.sum() / split.problem.components_measured[split.used][:, :3].sum()
    return Floor(float(np.sqrt(mean * fitted.rows / fitted.freedom)), "estimated", fitted.freedom)


def predict_remainder(
    split: Split, last: Evaluation, rng: np.random.Generator
) -> Predictable | None:
    """Whether any smooth function of the configuration still predicts what the last rung leaves;
    where not every row is a point, of the rows of the kind and feature that has most."""
    rows, gauges = split.used, split.problem.data.gauges
    if gauges is not None:
        code = gauges.kind * (len(gauges.features) + 1) + gauges.feature + 1
        rows = rows & (code == np.bincount(code[rows]).argmax())
    return estimate_predictability(
        split.problem.data.take(rows),
        last.residual[rows][:, :3],
        split.problem.robot.prismatic,
        rng,
    )
