"""The base's fits to the rows of one diagnosis: rounds and searches that use the same rows share one."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

from .._typing import Mask
from ..fitting.design import Model
from ..fitting.least_squares import Fit, fit
from ..selection.evaluation import Split

# told which rows (m,) are outliers, and the base fitted without them
TellBase = Callable[[Mask, Fit], None]


def keep_base(outlying: Mask, fitted: Fit) -> None:
    """Tell nobody."""


@dataclass(frozen=True, eq=False)
class BaseFits:
    """Fits of a base to rows as they are stated, by which rows these are."""

    base: Model
    _known: dict[bytes, Fit] = field(default_factory=dict, repr=False)

    def fit(self, split: Split) -> Fit:
        """Fit the base to the rows that a split uses. Raises NotEstimable."""
        rows = split.used.tobytes()
        if rows not in self._known:
            self._known[rows] = fit(split.training, self.base)
        return self._known[rows]
