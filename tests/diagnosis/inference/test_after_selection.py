"""Sizes after a search: of what is found, the interval holds the truth as often as it says."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from modelsel.diagnosis.inference.after_selection import allow_for_search, find_limit


@pytest.mark.integration
@pytest.mark.parametrize("terms", [1, 2, 5])
@pytest.mark.parametrize("size", [0.6, 1.0, 1.6])
def test_of_what_is_found_the_interval_holds_the_truth(
    terms: int, size: float, rng: np.random.Generator
) -> None:
    """Draws of an effect of `size` times what the search asks, by normal numbers."""
    limit = 30.0
    true = size * np.sqrt(limit)
    drawn = rng.standard_normal((400_000, terms))
    drawn[:, 0] += true
    squares = np.square(drawn).sum(1)
    found = squares[squares > limit][:1500]
    told = [allow_for_search(float(square), limit, terms) for square in found]
    held = np.mean([a.low <= true / np.sqrt(s) <= a.high for a, s in zip(told, found, strict=True)])
    assert held == pytest.approx(0.95, abs=0.02)
    # half of all medians are too large
    large = np.mean([a.factor > true / np.sqrt(s) for a, s in zip(told, found, strict=True)])
    assert large == pytest.approx(0.5, abs=0.05)


def test_plain_estimates_of_what_is_found_are_too_large(rng: np.random.Generator) -> None:
    """What the interval is for: at the limit, the plain one holds too rarely."""
    limit = 30.0
    estimates = 0.6 * np.sqrt(limit) + rng.standard_normal(2_000_000)
    found = estimates[estimates > np.sqrt(limit)]
    assert len(found) > 1000
    assert np.mean(np.abs(found - 0.6 * np.sqrt(limit)) < 1.96) < 0.05


@given(square=st.floats(5.0, 1e6), share=st.floats(0.0, 1.0), terms=st.integers(1, 12))
@settings(max_examples=150, deadline=None)
def test_intervals_are_in_order_and_finite(square: float, share: float, terms: int) -> None:
    told = allow_for_search(square, share * square, terms)
    assert 0 <= told.low <= told.factor <= told.high
    assert np.isfinite(told.high)


def test_a_large_effect_is_as_large_as_it_is_estimated() -> None:
    told = allow_for_search(900.0, 30.0, 1)
    assert told.factor == pytest.approx(1.0, abs=1e-3)
    assert (told.low, told.high) == pytest.approx((1 - 1.96 / 30, 1 + 1.96 / 30), abs=1e-3)


def test_the_limit_has_the_evidence_that_is_asked() -> None:
    limit = find_limit(60.0, 2, 200, 10.0)
    assert 30 < limit < 45
    assert find_limit(60.0, 2, 200, 0.0) == 60.0
    assert find_limit(60.0, 2, 200, 1e3) == 0.0
