"""Errors in mm by hand, and a gain whose interval holds what it says it holds."""

from __future__ import annotations

import numpy as np
import pytest
from builders import estimate_gain, seeds
from scipy import stats

from modelsel.selection.evaluation import summarise_errors


def test_errors_by_hand() -> None:
    """Lengths 5, 13, 0 and an outlier of 100."""
    residual = np.array([[3.0, 4, 0], [0, 5, 12], [0, 0, 0], [100, 0, 0]])
    found = summarise_errors(residual, np.array([False, False, False, True]))
    assert found.mean_mm == pytest.approx(6)
    assert found.rms_mm == pytest.approx(np.sqrt((25 + 169) / 3))
    assert found.max_mm == 13
    assert found.p95_mm == pytest.approx(np.percentile([0, 5, 13], 95))
    assert (found.rows, found.left_out) == (3, 1)
    assert found.mean_all_mm == pytest.approx(29.5)
    assert (
        summarise_errors(residual).mean_mm
        == summarise_errors(residual).mean_all_mm
        == pytest.approx(29.5)
    )


def test_rotational_residuals_are_not_millimetres() -> None:
    six = np.array([[3.0, 4, 0, 9, 9, 9]])
    assert summarise_errors(six).mean_mm == 5
    found = estimate_gain(
        six.repeat(4, 0), 2 * six.repeat(4, 0), np.arange(4), np.random.default_rng(1)
    )
    assert (found.held_out_rms_before_mm, found.held_out_rms_after_mm) == (5, 10)


def test_no_rows_no_figures(rng) -> None:
    nothing = summarise_errors(np.zeros((0, 3)))
    assert (nothing.mean_mm, nothing.rms_mm, nothing.p95_mm, nothing.max_mm, nothing.rows) == (
        None,
        None,
        None,
        None,
        0,
    )
    left = summarise_errors(np.ones((2, 3)), np.ones(2, bool))
    assert (left.mean_mm, left.rows, left.left_out) == (None, 0, 2)
    assert left.mean_all_mm == pytest.approx(np.sqrt(3))
    assert (
        estimate_gain(
            np.zeros((0, 3)), np.zeros((0, 3)), np.zeros(0, int), rng
        ).held_out_rms_before_mm
        is None
    )
    two = estimate_gain(np.ones((6, 3)), np.zeros((6, 3)), np.arange(6) // 3, rng)
    assert two.interval_mm is None
    assert two.held_out_rms_before_mm == pytest.approx(np.sqrt(3))


@seeds(1, 2, 3)
def test_gain_is_paired(rng) -> None:
    """Both share a scatter ten times what separates them: the interval is narrow, holds the figure
    and excludes nought."""
    common = rng.normal(size=(100, 3)) * rng.uniform(0.2, 3, (100, 1))
    found = estimate_gain(common, 0.95 * common, np.arange(100), rng)
    low, high = found.interval_mm
    difference = found.held_out_rms_before_mm - found.held_out_rms_after_mm
    assert difference == pytest.approx(0.05 * np.sqrt(np.square(common).sum(1).mean()))
    assert 0 < low < difference < high
    assert high - low < 0.6 * difference
    swapped = estimate_gain(0.95 * common, common, np.arange(100), rng).interval_mm
    assert swapped[1] < 0


def test_nothing_gained(rng) -> None:
    same = rng.normal(size=(50, 3))
    assert estimate_gain(same, same, np.arange(50), rng).interval_mm == (0, 0)


def test_whole_configurations_are_drawn(rng) -> None:
    """Ten rows of one configuration that are one observation ten times: the interval is as wide as
    without the copies."""
    before, after = rng.normal(size=(40, 3)), 0.7 * rng.normal(size=(40, 3))
    once = estimate_gain(before, after, np.arange(40), np.random.default_rng(1))
    copies = estimate_gain(
        before.repeat(10, 0),
        after.repeat(10, 0),
        np.arange(40).repeat(10),
        np.random.default_rng(1),
    )
    np.testing.assert_allclose(copies.interval_mm, once.interval_mm, rtol=1e-9)
    alone = estimate_gain(
        before.repeat(10, 0), after.repeat(10, 0), np.arange(400), np.random.default_rng(1)
    )
    assert np.ptp(alone.interval_mm) < 0.5 * np.ptp(once.interval_mm)


def test_one_seed_one_interval() -> None:
    rng = np.random.default_rng(3)
    before, after = rng.normal(size=(2, 30, 3))
    first, again = (
        estimate_gain(before, after, np.arange(30), np.random.default_rng(9)) for _ in range(2)
    )
    assert first == again


@pytest.mark.integration
@pytest.mark.parametrize("rows", [1, 3], ids=lambda v: f"{v}-a-configuration")
def test_interval_covers(rows, rng) -> None:
    """100 studies of 60 held-out configurations, rows of one configuration alike in part: the true
    gain, sigma before and after known, lies inside about 95 % of the intervals: a bootstrap of 60
    gives 90 to 97 %."""
    trials, m, inside = 100, 60, 0
    truth = np.sqrt(3) * (1.0 - np.sqrt(0.5))
    for _ in range(trials):
        shared, own = rng.normal(size=(2, m, 1, 3)), rng.normal(size=(2, m, rows, 3))
        mixed = (np.sqrt(0.6) * shared + np.sqrt(0.4) * own).reshape(2, -1, 3)
        after = np.sqrt(0.5) * mixed[0]
        before = after + np.sqrt(0.5) * mixed[1]
        low, high = estimate_gain(before, after, np.arange(m).repeat(rows), rng).interval_mm
        inside += low <= truth <= high
    assert stats.binom.cdf(inside, trials, 0.90) > 1e-3, f"only {inside} of {trials}"
    assert stats.binom.sf(inside - 1, trials, 0.975) > 1e-3, f"too wide: {inside} of {trials}"
