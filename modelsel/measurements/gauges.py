"""Gauges: what rows measure where not every row is a point."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from .._typing import Array, Index
from .campaign.features import COORDINATES, KINDS, Feature

if TYPE_CHECKING:
    from .measurements import Measurements


@dataclass(frozen=True, eq=False)
class Gauges:
    """What m rows measure where not every row is a point: `kind` (m,) index into KINDS, `feature`
    (m,) index into `features` (-1: none), `length` (m,) mm (nan: none); `origin`: for rows of kind
    distance, where the length begins (the others: the row itself), None where there are none."""

    kind: Index
    feature: Index
    length: Array
    features: tuple[Feature, ...] = ()
    origin: Measurements | None = None

    @property
    def coordinates(self) -> NDArray[np.bool_]:
        """(m, 3) which coordinates of a row's residual are measured; a single number stands in the
        first (y, z in their own)."""
        return COORDINATES[self.kind]

    def of(self, *kinds: str) -> NDArray[np.bool_]:
        """Mask (m,) the rows of some kinds."""
        numbers = []
        for kind in kinds:
            number = KINDS.index(kind)
            numbers.append(number)
        return np.isin(self.kind, numbers)

    def take(self, index: NDArray[np.intp] | NDArray[np.bool_] | slice) -> Gauges:
        """Select some rows."""
        origin = None if self.origin is None else self.origin.take(index)
        return replace(
            self,
            kind=self.kind[index],
            feature=self.feature[index],
            length=self.length[index],
            origin=origin,
        )
