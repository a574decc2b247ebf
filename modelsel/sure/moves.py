"""The moves of the ensemble: differential evolution from emcee, snooker, put right, and constants drawn afresh."""
from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from .._typing import Array

GAMMA = 1.7     # ter Braak & Vrugt 2008: 1.2 to 2.2


def moves(ranges: Sequence[tuple[int, float, float]] = ()) -> list[tuple[Any, float]]:
    """emcee's DEMove 0.8 and the snooker below 0.2; where there are constants, of which the `ranges` say (position, lowest,
    highest), a third of all moves instead draws one of them anew over its range: far modes are reached in one step.

    The DESnookerMove of emcee 3.1.6 weighs a proposal by half of (d − 1) ln |x*−z|/|x−z| and steps by √|x−z| too far
    (github.com/dfm/emcee/pull/531): its intervals are some 8 % narrow in eleven dimensions (benchmarks/calibration.py).
    """
    import emcee

    class Snooker(emcee.moves.RedBlueMove):  # type: ignore[misc]
        """x* = x + γ · (z1 − z2) projected on the line from z to x; all walkers at once."""

        def get_proposal(self, sample: Array, complement: list[Array], random: Any) -> tuple[Array, Array]:
            others = np.concatenate(complement)
            pick = np.argsort(random.rand(len(sample), len(others)), axis=1)[:, :3]
            z, first, second = others[pick].transpose(1, 0, 2)
            return snooker(sample, z, first - second)

    class Afresh(emcee.moves.RedBlueMove):  # type: ignore[misc]
        """One constant of each walker drawn anew, evenly over its range."""

        def get_proposal(self, sample: Array, complement: list[Array], random: Any) -> tuple[Array, Array]:
            position, low, high = (np.array(part) for part in zip(*ranges, strict=True))
            which = random.randint(len(position), size=len(sample))
            proposal = sample.copy()
            proposal[np.arange(len(sample)), position[which]] = random.uniform(low[which], high[which])
            return proposal, np.zeros(len(sample))

    plain = [(emcee.moves.DEMove(), 0.8), (Snooker(), 0.2)]
    return [*plain, (Afresh(), 0.5)] if ranges else plain


def snooker(x: Array, z: Array, difference: Array) -> tuple[Array, Array]:
    """(proposals (W, d), ln of (|x*−z|/|x−z|)^(d−1)) of walkers x along their lines to z (ter Braak & Vrugt 2008, eq. 4)."""
    line = x - z
    before = np.linalg.norm(line, axis=1)
    u = line / before[:, None]
    proposal = x + GAMMA * np.einsum("wd,wd->w", u, difference)[:, None] * u
    after = np.linalg.norm(proposal - z, axis=1)
    return proposal, (x.shape[1] - 1.0) * np.log(after / before)
