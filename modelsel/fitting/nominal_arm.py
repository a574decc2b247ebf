"""How far an arm's parameters are from the nominal ones, and the combinations of them that move the
nominal arm by nothing.

Such a combination, a shift along parallel axes say, moves the real arm by products of errors alone:
at usual sizes by less than a micrometre. Many rows see even that, and of a model that lacks an
effect they may ask for metres."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from .._typing import Array, Index
from .prior import SURPRISING

FAR = 10.0  # usual sizes from the nominal arm, within which the nominal chain's dependences hold
OPEN = 1e-9  # of the largest: a combination that moves the nominal arm less is open


@dataclass(frozen=True, eq=False)
class NominalArm:
    """`sizes` (p,): usual sizes of the constant parameters, infinite of other terms; `triangle` gives
    the columns (p, p) at the nominal arm, once they are needed."""

    sizes: Array
    triangle: Callable[[], Array]

    @cached_property
    def sized(self) -> Index:
        """The constant parameters (k,)."""
        return np.flatnonzero(np.isfinite(self.sizes))

    @cached_property
    def shown(self) -> Array:
        """Projection (k, k) of the constant parameters, in usual sizes, onto what moves the nominal
        arm."""
        columns = self.triangle()[:, self.sized] * self.sizes[self.sized]
        _, singular, Vt = np.linalg.svd(columns, full_matrices=False)
        moving = Vt[singular > OPEN * singular.max(initial=0.0)]
        return np.asarray(moving.T @ moving)

    def least(self, theta: Array) -> Array:
        """Return the least parameters, by their usual sizes, that move the nominal arm as theta (p,)
        does; theta itself where it is nowhere surprising."""
        sizes = self.sizes[self.sized]
        units = theta[self.sized] / sizes
        if not (np.abs(units) > SURPRISING).any():
            return theta
        out = theta.copy()
        out[self.sized] = sizes * (self.shown @ units)
        return out

    def is_far(self, theta: Array) -> bool:
        """Return whether theta (p,) moves the arm as only parameters far from the nominal ones do."""
        return self._exceed(theta) and self._exceed(self.least(theta))

    def is_loose(self, theta: Array) -> bool:
        """Return whether a combination that does not move the nominal arm has gone far, and nothing
        else: it stands in for an effect that the model lacks."""
        if not self._exceed(theta):
            return False
        least = self.least(theta)
        return self._exceed(theta - least) and not self._exceed(least)

    def _exceed(self, theta: Array) -> bool:
        return bool((np.abs(theta) > FAR * self.sizes).any())
