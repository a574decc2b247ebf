"""Types of arrays and callbacks that the whole package shares."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    pass

Index = NDArray[np.intp]
Say = Callable[[str], None]

Array = NDArray[np.float64]
# mm, degrees, kg in a file: no arm and no room is larger; beyond it the arithmetic overflows
LARGEST = 1e9
