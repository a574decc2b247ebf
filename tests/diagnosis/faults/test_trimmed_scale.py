"""The scale of rows of which the largest are left out: that of all, whatever share is kept."""

from __future__ import annotations

import numpy as np
import pytest

from modelsel.diagnosis.faults.outliers import _estimate_trimmed_scale


@pytest.mark.parametrize("keep", [10, 13])
def test_a_trimmed_scale_is_that_of_all_rows(rng: np.random.Generator, keep: int) -> None:
    """13 of 14 rows are kept where a base of many parameters needs them."""
    scales = []
    for _ in range(2000):
        size = np.linalg.norm(rng.normal(size=(14, 3)), axis=1)
        inside = size <= np.sort(size)[keep - 1]
        scales.append(_estimate_trimmed_scale(size, inside, None, 3))
    assert np.median(scales) == pytest.approx(1.0, abs=0.03)
