"""How fast motors move, from the clock of a motion that goes on."""

from __future__ import annotations

import numpy as np
import pytest
from builders import seeds

from modelsel.measurements.campaign.rates import derive_rates
from modelsel.measurements.measurements import build_measurements


def wander(rng: np.random.Generator, m: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Uneven times (m,) of a smooth motion of three joints, its readings and its true rates (m, 3)."""
    time = 1e6 + np.cumsum(rng.uniform(0.4, 1.2, m))
    speed = rng.uniform(0.05, 0.2, 3)
    phase = rng.uniform(0, 2 * np.pi, 3)
    angle = np.outer(time, speed) + phase
    return time, np.sin(angle), speed * np.cos(angle)


@seeds(1, 2, 3)
def test_rates_are_the_derivative_of_the_readings(rng: np.random.Generator) -> None:
    m = int(rng.integers(60, 200))
    time, q, rate = wander(rng, m)
    group = np.repeat([0, 1], [m // 3, m - m // 3])
    shuffled = rng.permutation(m)
    found = derive_rates(q[shuffled], group[shuffled], np.arange(m), time[shuffled])
    error = np.abs(found - rate[shuffled])
    assert error.max() < 2e-3 * np.abs(rate).max()
    assert np.median(error) < 1e-4 * np.abs(rate).max()


@pytest.mark.parametrize("degree", [1, 2, 3, 4])
def test_a_polynomial_has_its_exact_derivative(degree: int, rng: np.random.Generator) -> None:
    time = np.linspace(-1, 1, 12) + rng.uniform(-0.04, 0.04, 12)
    factors = rng.normal(size=degree + 1)
    q = np.polyval(factors, time)[:, None]
    found = derive_rates(q, np.zeros(12, np.intp), np.arange(12), time)
    np.testing.assert_allclose(found[:, 0], np.polyval(np.polyder(factors), time), atol=1e-6)


@seeds(1, 2, 3)
@pytest.mark.parametrize("per_line", [3, 4, 9])
def test_no_rate_looks_across_a_pause(per_line: int, rng: np.random.Generator) -> None:
    """Lines that joints follow as polynomials of second degree, apart by a pause in which the arm goes
    elsewhere: the rates are exact at the ends of each, too."""
    lines = 14
    within = 0.25 * np.arange(per_line)
    time = (within + (within[-1] + 3.25) * np.arange(lines)[:, None]).ravel()
    start, speed, bend = rng.uniform(-1, 1, (3, lines, 1, 4))
    q = start + speed * within[:, None] + bend * within[:, None] ** 2
    rate = speed + 2 * bend * within[:, None]
    m = len(time)
    found = derive_rates(q.reshape(m, 4), np.zeros(m, np.intp), np.arange(m), time)
    np.testing.assert_allclose(found, rate.reshape(m, 4), atol=1e-9)


def test_a_clock_that_ticks_slower_from_some_time_on_has_no_pauses() -> None:
    time = np.append(0.1 * np.arange(200), 20 + np.arange(30))
    q = time[:, None] ** 3 / 1e3
    m = len(time)
    found = derive_rates(q, np.zeros(m, np.intp), np.arange(m), time)
    np.testing.assert_allclose(found[:, 0], 3 * time**2 / 1e3, atol=1e-6)


def test_a_row_alone_between_pauses_has_the_rate_of_its_neighbours() -> None:
    time = np.array([0.0, 1, 2, 3, 4, 9, 14, 15, 16, 17, 18])
    found = derive_rates(2 * time[:, None], np.zeros(11, np.intp), np.arange(11), time)
    np.testing.assert_allclose(found, 2.0)


def test_an_arm_that_stands_still_has_no_rate(rng: np.random.Generator) -> None:
    """Three rows of each visit, some seconds apart; and rows of several targets at one time move."""
    places = rng.normal(size=(20, 3))
    q = np.repeat(places, 3, axis=0)
    visit = np.repeat(np.arange(20), 3)
    time = np.arange(60.0)
    assert not derive_rates(q, np.zeros(60, np.intp), visit, time).any()
    together = np.repeat(time[::3], 3)
    moving = derive_rates(q, np.zeros(60, np.intp), visit, together)
    assert (np.ptp(moving.reshape(20, 3, 3), axis=1) == 0).all()
    assert moving.any()


def test_few_rows_have_a_rate_where_two_times_differ() -> None:
    q = np.array([[1.0], [3.0]])
    group, visit = np.zeros(2, np.intp), np.arange(2)
    np.testing.assert_allclose(derive_rates(q, group, visit, np.array([5.0, 9.0])), 0.5)
    assert not derive_rates(q, group, visit, np.array([5.0, 5.0])).any()


def test_measurements_with_a_clock_have_rates(rng: np.random.Generator) -> None:
    time, q, rate = wander(rng, 80)
    position = rng.normal(size=(80, 3))
    data = build_measurements(q, position, covariates={"time_s": time})
    assert data.rate is not None
    some = data.take(np.arange(10, 30))
    np.testing.assert_allclose(some.rate, rate[10:30], atol=2e-3)
    assert build_measurements(q, position).rate is None
