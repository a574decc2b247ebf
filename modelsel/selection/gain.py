"""The gain of one model over another on held-out rows, with a paired bootstrap of configurations."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from .._typing import Array, Index

# configurations from which an interval is given
MIN_CONFIGURATIONS = 3
# numbers of a block of draws
MAX_DRAWN = 1_000_000


@dataclass(frozen=True)
class Gain:
    """Held-out rms before and after, and the 95 % interval [low, high] of their difference, by
    configurations."""

    held_out_rms_before_mm: float | None
    held_out_rms_after_mm: float | None
    interval_mm: tuple[float, float] | None


@dataclass(frozen=True)
class ResamplingOptions:
    """Effort of the bootstrap of a gain.

    draws: number of bootstrap draws.
    max_units: configurations that are drawn singly; more are drawn in bundles, and the interval is
        the same.
    """

    draws: int = 2000
    max_units: int = 5000


@dataclass(frozen=True, eq=False)
class ResampledErrors:
    """The rms [mm] of one model's held-out residuals, and of every bootstrap draw (draws,) of the
    configurations; None where there are too few."""

    rms: float | None
    drawn: Array | None = field(default=None, repr=False)

    def gain_of(self, after: ResampledErrors) -> Gain:
        """Return the gain of another model, of the same draws."""
        interval = None
        if self.drawn is not None and after.drawn is not None:
            low, high = np.percentile(self.drawn - after.drawn, [2.5, 97.5])
            interval = float(low), float(high)
        return Gain(self.rms, after.rms, interval)


def resample_errors(
    residuals: Sequence[Array],
    block: Index,
    rng: np.random.Generator,
    options: ResamplingOptions = ResamplingOptions(),
) -> list[ResampledErrors]:
    """Draw configurations with replacement, the same for several models' residuals (m, 3) [mm].

    `block` (m,) is every row's configuration."""
    blocks, unit = np.unique(block, return_inverse=True)
    rows = len(unit)
    count = min(len(blocks), options.max_units)
    if not rows:
        return [ResampledErrors(None)] * len(residuals)
    unit = unit.reshape(-1) % count
    lengths = [np.square(residual[:, :3]).sum(1) for residual in residuals]
    squares = np.stack([np.bincount(unit, length) for length in lengths])
    rms = np.sqrt(squares.sum(1) / rows).tolist()
    if count < MIN_CONFIGURATIONS:
        return [ResampledErrors(value) for value in rms]
    sums = np.vstack([squares, np.bincount(unit)])
    drawn = _draw_sums(sums, rng, options.draws)
    drawn_rms = np.sqrt(drawn[:-1] / drawn[-1])
    return [ResampledErrors(*one) for one in zip(rms, drawn_rms, strict=True)]


def _draw_sums(values: Array, rng: np.random.Generator, draws: int) -> Array:
    """Draw units with replacement, and sum their values (k, units): (k, draws)."""
    count = values.shape[1]
    chance = np.full(count, 1 / count)
    step = max(1, MAX_DRAWN // count)
    sums = np.empty((len(values), draws))
    for start in range(0, draws, step):
        places = slice(start, min(start + step, draws))
        counts = rng.multinomial(count, chance, places.stop - start)
        sums[:, places] = values @ counts.T.astype(float)
    return sums


def estimate_gain(
    before: Array,
    after: Array,
    block: Index,
    rng: np.random.Generator,
    options: ResamplingOptions = ResamplingOptions(),
) -> Gain:
    """Estimate the gain between two models from residuals (m, 3) [mm] of the same rows.

    The interval is that of a paired bootstrap of whole configurations; `block` (m,) is every row's
    configuration."""
    first, second = resample_errors([before, after], block, rng, options)
    return first.gain_of(second)
