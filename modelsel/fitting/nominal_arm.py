"""How far an arm's parameters are from the nominal ones, and the combinations of them that move the
nominal arm by nothing.

Such a combination, a shift along parallel axes say, moves the real arm by products of errors alone:
at usual sizes by less than a micrometre. Many rows see even that, and of a model that lacks an
effect they may ask for metres."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from .._typing import Array, Index
from .prior import SURPRISING

FAR = 10.0  # usual sizes from the nominal arm, within which the nominal chain's dependences hold
PLENTY = 10  # measured numbers for each term, of which fewer see no product of errors
OPEN = 1e-9  # of the largest: a combination that moves the nominal arm less is open


@dataclass(frozen=True, eq=False)
class NominalArm:
    """`sizes` (p,): usual sizes of the constant parameters, infinite of other terms; `triangle` (p, p):
    of the columns at the nominal arm, None where too few numbers were measured to see more."""

    sizes: Array
    triangle: Array | None

    @cached_property
    def sized(self) -> Index:
        """The constant parameters (k,)."""
        return np.flatnonzero(np.isfinite(self.sizes))

    @cached_property
    def shown(self) -> Array:
        """Projection (k, k) of the constant parameters, in usual sizes, onto what moves the nominal
        arm."""
        sized = self.sized
        assert self.triangle is not None
        columns = self.triangle[:, sized]
        effects = columns * self.sizes[sized]
        _, singular, Vt = np.linalg.svd(effects, full_matrices=False)
        largest = singular.max(initial=0.0)
        moving = Vt[singular > OPEN * largest]
        return np.asarray(moving.T @ moving)

    def least(self, theta: Array) -> Array:
        """Return the least parameters, by their usual sizes, that move the nominal arm as theta (p,)
        does; theta itself where it is nowhere surprising."""
        sized = self.sized
        sizes = self.sizes[sized]
        units = theta[sized] / sizes
        surprises = np.abs(units) > SURPRISING
        if self.triangle is None or not surprises.any():
            return theta
        least = self.shown @ units
        out = theta.copy()
        out[sized] = sizes * least
        return out

    def is_far(self, theta: Array) -> bool:
        """Return whether theta (p,) moves the arm as only parameters far from the nominal ones do."""
        if not self._exceed(theta):
            return False
        least = self.least(theta)
        return self._exceed(least)

    def is_loose(self, theta: Array) -> bool:
        """Return whether a combination that does not move the nominal arm has gone far, and nothing
        else: it stands in for an effect that the model lacks."""
        if not self._exceed(theta):
            return False
        least = self.least(theta)
        is_far = self._exceed(least)
        open_part = theta - least
        return not is_far and self._exceed(open_part)

    def _exceed(self, theta: Array) -> bool:
        limit = FAR * self.sizes
        exceeds = np.abs(theta) > limit
        return bool(exceeds.any())
