"""A spring under the arm's weight and the payload, told apart: what the payload alone says.

A payload is weighed, the arm's masses are declared. One stiffness for both holds as far as these do; that
under the payload does so whatever the arm weighs."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..._typing import Array

# square of the standard errors from an estimate to the ends of its 95 % interval
SQUARE_95 = 1.96**2


@dataclass(frozen=True)
class SpringsApart:
    """One spring under two loads, told apart: `compliance` [rad/(N m)] under the payload, with its standard
    `error`; `weight`: how many times as much as that the arm's own weight winds it up, masses as declared,
    with its 95 % interval, of which an end that the data leave open is None."""

    compliance: float
    error: float
    weight: float
    low: float | None
    high: float | None

    @property
    def is_doubted(self) -> bool:
        """Whether one stiffness with the declared masses is outside the interval."""
        is_below = self.high is not None and self.high < 1
        is_above = self.low is not None and self.low > 1
        return is_below or is_above


def compare_springs(estimate: Array, covariance: Array) -> SpringsApart | None:
    """Compare the compliances (2,) under the arm's weight and under the payload, by their covariance; None
    where the payload does not wind it up.

    The interval of their ratio is Fieller's: the ratios whose misfit is within its 95 %."""
    own, payload = estimate.tolist()
    if payload <= 0:
        return None
    spread = SQUARE_95 * covariance
    a = payload**2 - spread[1, 1]
    b = own * payload - spread[0, 1]
    c = own**2 - spread[0, 0]
    error = float(np.sqrt(covariance[1, 1]))
    apart = SpringsApart(payload, error, own / payload, None, None)
    if a <= 0:
        return apart
    root = float(np.sqrt(max(b**2 - a * c, 0.0)))
    low, high = (b - root) / a, (b + root) / a
    return SpringsApart(payload, error, own / payload, low, high)
