"""Dates as people write them: the day or the month first."""

from __future__ import annotations

from datetime import UTC, datetime, timedelta

import numpy as np
import pytest

from modelsel.measurements.point_times import parse_clock

HOUR = 3600.0
ORDERS = {
    "day": "%d/%m/%Y %H:%M",
    "month": "%m/%d/%Y %H:%M",
    "dashes": "%d-%m-%Y %H:%M",
    "points": "%d.%m.%Y %H:%M",
    "year": "%Y-%m-%d %H:%M",
}


@pytest.mark.parametrize("written", ORDERS)
def test_a_campaign_of_some_days_lasts_as_long_in_every_order(written: str, rng) -> None:
    start = datetime(2025, 1, 1, tzinfo=UTC) + timedelta(days=int(rng.integers(0, 365)))
    hours = np.concatenate([[0], np.sort(rng.choice(np.arange(1, 120), 9, replace=False))])
    times = [(start + timedelta(hours=int(hour))).strftime(ORDERS[written]) for hour in hours]
    seconds = parse_clock(np.array(times, object))
    assert seconds is not None
    np.testing.assert_allclose(seconds, hours * HOUR)


def test_dates_that_contradict_each_other_are_no_times() -> None:
    assert parse_clock(np.array(["13/04/2025 10:00", "04/14/2025 10:00"], object)) is None
