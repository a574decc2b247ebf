"""Types of arrays and callbacks that the whole package shares."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Index = NDArray[np.intp]
Rows = NDArray[np.intp] | NDArray[np.bool_] | slice  # that some rows are chosen by
Mask = NDArray[np.bool_]
Say = Callable[[str], None]  # told what is being done, for a progress line

# mm, degrees, kg in a file: no arm and no room is larger; beyond it the arithmetic overflows
LARGEST = 1e9
