"""Whether any smooth function of the configuration still predicts the residual: a Gaussian process, leave-one-out."""
from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .._typing import Array
from ..measurements.measurements import Measurements
from .flips import LASTING, together

LENGTHS = (0.3, 0.6, 1.2, 2.4)      # of the kernel, in units of sine and cosine of a joint's angle, all joints together
NOISE_RATIOS = (0.3, 1.0, 3.0, 10.0)      # noise variance over signal variance
FLIPS = 199
LARGEST = 800                        # configurations; more are thinned evenly


@dataclass(frozen=True)
class Predictable:
    """Share of the residual's sum of squares that leave-one-configuration-out prediction explains, and how often sign flips
    of whole configurations (of whole groups, where errors last within them) do as well."""

    share: float
    p: float


def predictable(data: Measurements, residual: Array, prismatic: tuple[bool, ...], rng: np.random.Generator) -> Predictable | None:
    """Of residuals (m, 3) [mm]: Gaussian process with a squared-exponential kernel on the joint angles (Rasmussen & Williams
    2006, eq. 5.12). None with fewer than twenty configurations."""
    blocks, index = np.unique(data.block, return_inverse=True)
    if len(blocks) < 20:
        return None
    count = np.bincount(index)
    mean = np.stack([np.bincount(index, residual[:, a]) / count for a in range(3)], 1)
    first = np.unique(data.block, return_index=True)[1]
    thin = np.unique(np.linspace(0, len(blocks) - 1, LARGEST).astype(int)) if len(blocks) > LARGEST else np.arange(len(blocks))
    y = mean[thin] - mean[thin].mean(0)
    q = data.q[first[thin]]
    parts = [q[:, [j]] / max(float(np.ptp(q[:, j])), 1e-9) if slides else np.stack([np.sin(q[:, j]), np.cos(q[:, j])], 1)
             for j, slides in enumerate(prismatic)]
    X = np.concatenate(parts, axis=1)
    square = np.square(X[:, None] - X[None]).sum(2)
    unit = np.arange(len(y))
    if together(data, residual, rng) <= LASTING:        # errors last within groups: these change their signs as a whole
        unit = np.unique(data.group[first[thin]], return_inverse=True)[1]
    flips = rng.choice([-1.0, 1.0], (FLIPS, int(unit.max()) + 1))[:, unit]
    many = np.concatenate([y[:, None], (flips[:, :, None] * y).transpose(1, 0, 2)], axis=1).reshape(len(y), -1)
    total = np.square(many).reshape(len(y), -1, 3).sum((0, 2))
    best = np.full(FLIPS + 1, -np.inf)
    for length in LENGTHS:
        value, vector = np.linalg.eigh(np.exp(-square / (2 * length ** 2)))
        turned = vector.T @ many
        for ratio in NOISE_RATIOS:
            weight = 1 / (np.maximum(value, 0) + ratio)
            left = (vector @ (weight[:, None] * turned)) / (np.square(vector) @ weight)[:, None]
            best = np.maximum(best, 1 - np.square(left).reshape(len(y), -1, 3).sum((0, 2)) / total)
    return Predictable(float(best[0]), float((1 + (best[1:] >= best[0]).sum()) / (FLIPS + 1)))
