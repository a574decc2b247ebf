"""Dates as people write them: the day or the month first."""

from __future__ import annotations

from datetime import UTC, datetime, timedelta

import numpy as np
import pandas as pd
import pytest

from modelsel.measurements.quantities.point_times import parse_clock

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


def test_times_are_parsed_once(rng, monkeypatch) -> None:
    """Every way of joining two files asks for their times again."""
    start = datetime(2025, 1, 1, tzinfo=UTC) + timedelta(days=int(rng.integers(0, 365)))
    minutes = np.sort(rng.choice(np.arange(1, 1000), 9, replace=False))
    times = [(start + timedelta(minutes=int(minute))).isoformat(" ") for minute in minutes]
    parse, parsed = pd.to_datetime, []

    def counted(series: pd.Series, **options: object) -> object:
        parsed.append(len(series))
        return parse(series, **options)

    monkeypatch.setattr(pd, "to_datetime", counted)
    first = parse_clock(np.array(times, object))
    again = parse_clock(np.array([f" {time}" for time in times], object))
    assert first is not None
    np.testing.assert_array_equal(first, again)
    np.testing.assert_allclose(first, 60.0 * (minutes - minutes[0]))
    assert parsed == [len(times)]
    other = parse_clock(np.array([*times[:-1], times[0]], object))
    assert other is not None
    assert other[-1] == 0
