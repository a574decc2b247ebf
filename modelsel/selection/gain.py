"""The gain of one model over another on held-out rows, with a paired bootstrap of configurations."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from .._typing import Array, Index

# configurations from which an interval is given
MIN_CONFIGURATIONS = 3
# numbers of a block of draws
MAX_DRAWN = 1_000_000


class Change(NamedTuple):
    """A held-out rms before and after, and the 95 % interval [low, high] of its fall, all in one
    unit."""

    before: float
    after: float
    interval: Sequence[float] | None
    unit: str

    @property
    def fall(self) -> float:
        """By how much the error falls."""
        return self.before - self.after


def _build_change(
    before: float | None, after: float | None, interval: Sequence[float] | None, unit: str
) -> Change | None:
    """Build a change; None where nothing is held out."""
    if before is None or after is None:
        return None
    return Change(before, after, interval, unit)


@dataclass(frozen=True)
class Gain:
    """Held-out rms before and after, and the 95 % interval [low, high] of their difference, by
    configurations."""

    held_out_rms_before_mm: float | None
    held_out_rms_after_mm: float | None
    interval_mm: Sequence[float] | None

    @property
    def change(self) -> Change | None:
        """The change, where anything is held out."""
        before = self.held_out_rms_before_mm
        after = self.held_out_rms_after_mm
        return _build_change(before, after, self.interval_mm, "mm")


@dataclass(frozen=True)
class OrientationGain:
    """As `Gain`, of the orientation's error [mrad]."""

    held_out_rms_before_mrad: float | None
    held_out_rms_after_mrad: float | None
    interval_mrad: Sequence[float] | None

    @property
    def change(self) -> Change | None:
        """The change, where any orientation is held out."""
        before = self.held_out_rms_before_mrad
        after = self.held_out_rms_after_mrad
        return _build_change(before, after, self.interval_mrad, "mrad")


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
    """The rms of one model's held-out residuals, in their unit, and of every bootstrap draw (draws,) of the
    configurations; None where there are too few."""

    rms: float | None
    drawn: Array | None = field(default=None, repr=False)

    def gain_of(self, after: ResampledErrors) -> Gain:
        """Return the gain of another model, of the same draws."""
        interval = self._compare(after)
        return Gain(self.rms, after.rms, interval)

    def orientation_gain_of(self, after: ResampledErrors) -> OrientationGain:
        """Return the gain of another model, of the same draws, where the residuals are in mrad."""
        interval = self._compare(after)
        return OrientationGain(self.rms, after.rms, interval)

    def _compare(self, after: ResampledErrors) -> tuple[float, float] | None:
        """Return the interval of the error's fall; None where there are too few configurations."""
        if self.drawn is None or after.drawn is None:
            return None
        falls = self.drawn - after.drawn
        low, high = np.percentile(falls, [2.5, 97.5])
        return float(low), float(high)


def resample_errors(
    residuals: Sequence[Array],
    block: Index,
    rng: np.random.Generator,
    options: ResamplingOptions = ResamplingOptions(),
) -> list[ResampledErrors]:
    """Draw configurations with replacement, the same for several models' residuals (m, 3) of position
    [mm] or of orientation.

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
