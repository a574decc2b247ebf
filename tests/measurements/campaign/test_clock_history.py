"""What the clock says of the rows before: a temperature that is followed late, and work since a rest."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from builders import bind, drawn, seeds
from scipy.integrate import solve_ivp

from modelsel.measurements.campaign.clock_history import (
    LAGS,
    REST,
    derive_late,
    derive_since_rest,
    find_lags,
)
from modelsel.measurements.campaign.late_names import is_temperature, list_sources, name_late
from modelsel.measurements.measurements import build_measurements


def wander(rng: np.random.Generator, rows: int) -> tuple[np.ndarray, np.ndarray]:
    """Uneven times (m,) [s] that grow, and a temperature (m,) that wanders."""
    time = np.cumsum(rng.uniform(20, 900, rows))
    return time, 20 + np.cumsum(rng.normal(0, 1.0, rows))


def integrate(time: np.ndarray, readings: np.ndarray, minutes: float) -> np.ndarray:
    """What a mass of a time constant has at the times, by its differential equation."""
    late = [readings[0]]
    for k in range(1, len(time)):
        span = time[k - 1], time[k]
        slope = (readings[k] - readings[k - 1]) / (time[k] - time[k - 1])

        def rate(now: float, mass: np.ndarray, k: int = k, slope: float = slope) -> np.ndarray:
            air = readings[k - 1] + slope * (now - time[k - 1])
            return (air - mass) / (60 * minutes)

        late.append(solve_ivp(rate, span, [late[-1]], rtol=1e-9, atol=1e-10).y[0, -1])
    return np.array(late)


@seeds(1, 2)
def test_a_mass_follows_the_temperature_as_its_equation_says(rng: np.random.Generator) -> None:
    time, readings = wander(rng, 12)
    shuffled = rng.permutation(12)
    group = np.zeros(12, np.intp)
    found = derive_late(group, time[shuffled], readings[shuffled])
    for column in rng.choice(len(LAGS), 3, replace=False):
        true = integrate(time, readings, LAGS[column])
        assert found[:, column] == pytest.approx(true[shuffled], abs=1e-6)


@seeds(1)
def test_sessions_follow_one_another_only_by_one_clock(rng: np.random.Generator) -> None:
    time, readings = wander(rng, 20)
    group = np.repeat([0, 1], 10)
    one = derive_late(np.zeros(20, np.intp), time, readings)
    assert derive_late(group, time, readings) == pytest.approx(one)
    again = np.concatenate([time[:10], time[:10]])
    each = derive_late(group, again, readings)
    alone = derive_late(np.zeros(10, np.intp), time[:10], readings[10:])
    assert each[:10] == pytest.approx(one[:10])
    assert each[10:] == pytest.approx(alone)


@seeds(1)
def test_rows_at_one_time_are_one_reading(rng: np.random.Generator) -> None:
    time, readings = wander(rng, 8)
    twice = np.repeat(time, 2)
    apart = np.repeat(readings, 2) + np.tile([0.3, -0.3], 8)
    group = np.zeros(16, np.intp)
    once = derive_late(group[:8], time, readings)
    assert derive_late(group, twice, apart) == pytest.approx(np.repeat(once, 2, axis=0))


@seeds(1)
def test_work_is_counted_afresh_after_a_rest(rng: np.random.Generator) -> None:
    time, _ = wander(rng, 15)
    later = time + 10 * (np.arange(15) >= 9) * REST
    since = derive_since_rest(np.zeros(15, np.intp), later)
    assert since[:9] == pytest.approx(time[:9] - time[0])
    assert since[9:] == pytest.approx(time[9:] - time[9])
    shuffled = rng.permutation(15)
    again = derive_since_rest(np.zeros(15, np.intp), later[shuffled])
    assert again == pytest.approx(since[shuffled])


@seeds(1)
def test_only_lags_that_show_are_looked_for(rng: np.random.Generator) -> None:
    time = np.cumsum(rng.uniform(20, 40, 200))
    group = np.zeros(200, np.intp)
    slow = 20 + 3e-4 * time
    assert not find_lags(slow[:30], derive_late(group[:30], time[:30], np.full(30, 20.0)))
    swing = 20 + 5 * np.sin(2 * np.pi * time / 6000)
    lags = find_lags(swing, derive_late(group, time, swing))
    assert lags == LAGS[-len(lags) :]
    assert 0 < len(lags) <= len(LAGS)
    assert find_lags(swing, None) == ()


@seeds(1)
def test_history_is_of_all_rows_and_nothing_without_a_clock(rng: np.random.Generator) -> None:
    at = drawn("ur5", rng, 30)
    name = name_late(25)
    rows = rng.choice(30, 11, replace=False)
    some = replace(at, data=at.data.take(rows))
    assert some.state.value(name) == pytest.approx(at.state.value(name)[rows])
    assert some.state.value("since_rest_s") == pytest.approx(at.state.value("since_rest_s")[rows])
    warm = {"temperature_C": at.data.covariates["temperature_C"]}
    still = bind("ur5", build_measurements(at.data.q, at.data.position, covariates=warm))
    assert still.state.value(name) == pytest.approx(warm["temperature_C"])
    assert still.names()[name] == "°C"
    cold = bind("ur5", build_measurements(at.data.q, at.data.position))
    assert name not in cold.names()
    assert is_temperature(name)
    assert list_sources([name, "q1"]) == {"temperature_C", "q1"}
