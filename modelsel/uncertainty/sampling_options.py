"""Options of sampling: its effort, and when a chain has converged."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

# steps stored between two checkpoints
CHUNK = 100


@dataclass(frozen=True)
class SamplingOptions:
    """Effort of sampling, and when a chain has converged.

    min_times: autocorrelation times that the chain must be longer than.
    max_change: largest relative change of the longest time between two checks.
    max_r_hat: largest R-hat; walkers of 50 autocorrelation times come to 1.02 when all is well.
    first_check, growth: steps before the first check, and largest factor between two checks.
    max_steps: steps after which an unconverged chain stops.
    min_walkers, walkers_per_name: number of walkers.
    max_evaluations: walkers x rows a step up to which the exact chain is evaluated; beyond it its
        QR-reduced linear form is sampled.
    """

    min_times: float = 50
    max_change: float = 0.1
    max_r_hat: float = 1.05
    first_check: int = 400
    growth: float = 1.5
    max_steps: int = 20_000
    min_walkers: int = 48
    walkers_per_name: int = 3
    max_evaluations: int = 9_000

    def next_check(self, check: int, needed: float) -> int:
        """Return the number of steps at which to judge the chain next.

        That is when it should be long enough, but no more than `growth` times later, so that the
        times are seen to settle."""
        least = 1.15 * check
        enough = 1.02 * needed
        wanted = max(enough, least)
        latest = self.growth * check
        wanted = min(latest, wanted)
        # the chain grows by whole chunks
        chunks = np.ceil(wanted / CHUNK)
        steps = CHUNK * int(chunks)
        return min(self.max_steps, steps)


DEFAULT_SAMPLING = SamplingOptions()
