"""The stiffness under a payload and under the arm's own weight stand against each other by an interval."""

from __future__ import annotations

import numpy as np
import pytest
from builders import seeds

from modelsel.diagnosis.findings.springs_apart import SQUARE_95, compare_springs

Rng = np.random.Generator


@seeds(*range(4))
def test_the_interval_has_every_ratio_that_the_data_allow(rng: Rng) -> None:
    """A ratio r is allowed where own - r payload is within 1.96 of its standard errors."""
    root = rng.normal(0, 0.15, (2, 2))
    covariance = root @ root.T
    estimate = rng.uniform(1, 3, 2)
    apart = compare_springs(estimate, covariance)
    assert apart is not None
    ratios = np.linspace(-20, 20, 400_001)
    across = np.stack([np.ones_like(ratios), -ratios])
    misfit = np.square(estimate @ across)
    variance = np.einsum("ik,ij,jk->k", across, covariance, across)
    allowed = ratios[misfit <= SQUARE_95 * variance]
    assert (apart.low, apart.high) == pytest.approx((allowed.min(), allowed.max()), abs=2e-4)
    assert apart.is_doubted == (not allowed.min() <= 1 <= allowed.max())
    assert apart.weight == pytest.approx(estimate[0] / estimate[1])
    assert apart.error == pytest.approx(np.sqrt(covariance[1, 1]))


def test_where_the_payload_hardly_winds_it_up_nothing_is_told_of_the_weight() -> None:
    apart = compare_springs(np.array([1.0, 0.1]), np.diag([0.01, 0.01]))
    assert apart is not None
    assert (apart.low, apart.high) == (None, None)
    assert not apart.is_doubted
    assert compare_springs(np.array([1.0, -0.1]), np.diag([0.01, 0.01])) is None
