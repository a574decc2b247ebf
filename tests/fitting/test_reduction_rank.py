"""Which columns of a triangle depend on others: rounding makes no direction of its own."""

from __future__ import annotations

import numpy as np
import pytest
from builders import seeds

from modelsel.fitting import reduction
from modelsel.fitting.reduction import independent


def nearly_dependent(rng: np.random.Generator) -> np.ndarray:
    """Columns of which the third is a combination of the first two, hardly different, with
    coefficients of a hundred thousand; the last is a direction of 1e-8."""
    A = rng.normal(size=(400, 6))
    A[:, 1] = A[:, 0] + 1e-5 * A[:, 1]
    A[:, 2] = (A[:, 0] - A[:, 1]) * 1e5 * rng.uniform(0.5, 1) + A[:, 3] * 1e-13
    A[:, 5] = A[:, 3] + A[:, 4] + 1e-8 * A[:, 5]
    return A


@seeds(1, 2, 3, 4)
def test_what_rounding_leaves_of_a_combination_is_no_direction(rng: np.random.Generator) -> None:
    A = nearly_dependent(rng)
    kept, scale = independent(np.linalg.qr(A, mode="r"))
    assert kept == [0, 1, 3, 4, 5]
    np.testing.assert_allclose(scale, np.linalg.norm(A, axis=0), rtol=1e-12)


def test_the_coefficients_are_what_tells_rounding(monkeypatch: pytest.MonkeyPatch) -> None:
    """With none allowed for, at least one of the triangles has a direction too many."""
    monkeypatch.setattr(reduction, "ROUNDING", 0.0)
    counts = []
    for seed in range(20):
        A = nearly_dependent(np.random.default_rng(seed))
        counts.append(len(independent(np.linalg.qr(A, mode="r"))[0]))
    assert max(counts) == 6
