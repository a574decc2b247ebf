"""Whether an arm was measured in motion, and which way it went where it turns back between rows."""

from __future__ import annotations

import numpy as np
import pytest
from builders import seeds

from modelsel._typing import Array
from modelsel.measurements.measurements import Measurements, build_measurements

Rng = np.random.Generator


def swing(rng: Rng, m: int, interval: float) -> tuple[Array, Array, Array]:
    """Uneven times (m,) of three joints that swing, their readings and true speeds (m, 3)."""
    time = interval * np.cumsum(rng.uniform(0.8, 1.2, m))
    speed = rng.uniform(0.15, 0.4, 3) / interval
    angle = np.outer(time, speed) + rng.uniform(0, 2 * np.pi, 3)
    return time, np.sin(angle), speed * np.cos(angle)


def build(q: Array, time: Array, **more: Array) -> Measurements:
    return build_measurements(q, np.zeros((len(q), 3)), covariates={"time_s": time}, **more)


@seeds(1, 2, 3)
def test_a_path_that_the_rows_describe_is_a_motion(rng: Rng) -> None:
    time, q, _ = swing(rng, 80, rng.uniform(0.01, 4.0))
    assert build(q, time).in_motion
    assert build(q, time).take(np.arange(5)).in_motion
    with_noise = q + rng.normal(0, 1e-4, q.shape)
    assert build(with_noise, time).in_motion


@seeds(1, 2, 3)
def test_an_arm_that_stops_for_each_row_is_in_no_motion(rng: Rng) -> None:
    time, q, _ = swing(rng, 80, 1.0)
    assert not build_measurements(q, np.zeros((80, 3))).in_motion
    assert not build(q, 30 * time).in_motion
    assert not build(rng.permutation(q), time).in_motion
    assert not build(np.cumsum(rng.normal(size=q.shape), axis=0), time).in_motion
    assert not build(np.repeat(q[::4], 4, axis=0), time).in_motion
    assert not build(q[:8], time[:8]).in_motion


def draw_lines(rng: Rng, lines: int, per_line: int) -> tuple[Array, Array]:
    """Times (m,) of lines that begin anywhere, with a pause between them, and the readings (m, 3)."""
    within = 0.25 * np.arange(per_line)
    time = (within + (within[-1] + 3.25) * np.arange(lines)[:, None]).ravel()
    start, speed = rng.uniform(-1, 1, (2, lines, 1, 3))
    q = start + speed * within[:, None]
    return time, q.reshape(-1, 3)


@seeds(1, 2, 3)
@pytest.mark.parametrize("per_line", [3, 4, 9])
def test_lines_with_pauses_between_them_are_a_motion(per_line: int, rng: Rng) -> None:
    """Whether or not a column says which rows are a line."""
    time, q = draw_lines(rng, 14, per_line)
    line = np.repeat([f"L{k}" for k in range(14)], per_line)
    assert build(q, time).in_motion
    assert build(q, time, group=line).in_motion
    assert not build(rng.permutation(q), time).in_motion
    assert not build(rng.permutation(q), time, group=line).in_motion


@seeds(1, 2, 3)
def test_readings_that_creep_while_the_arm_stops_are_no_motion(rng: Rng) -> None:
    time, q = draw_lines(rng, 14, 5)
    goals = np.repeat(q[::5], 5, axis=0)
    assert not build(goals + 1e-6 * (q - goals), time).in_motion


@seeds(1, 2, 3)
def test_the_first_row_of_a_line_has_the_direction_of_the_line(rng: Rng) -> None:
    time, q = draw_lines(rng, 14, 9)
    data = build(q, time)
    line = np.sign(q[1::9] - q[::9])
    found = data.approach.reshape(14, 9, 3)
    assert (found[1:] == line[1:, None]).all()


@seeds(1, 2, 3)
def test_where_a_joint_turns_back_its_speed_tells_the_direction(rng: Rng) -> None:
    time, q, rate = swing(rng, 200, 1.0)
    is_clear = np.abs(rate) > 0.02 * np.abs(rate).max()
    is_clear[0] = False
    found = build(q, time).approach
    assert (found == np.sign(rate))[is_clear].all()
    last = np.sign(np.diff(q, axis=0, prepend=q[:1]))
    assert not (last == np.sign(rate))[is_clear].all()


@pytest.mark.parametrize("interval", [30.0, None])
def test_the_last_move_tells_the_direction_of_an_arm_that_stops(
    interval: float | None, rng: Rng
) -> None:
    """Or it is given."""
    time, q, _ = swing(rng, 100, interval or 1.0)
    last = np.sign(np.diff(q, axis=0, prepend=q[:1]))
    if interval is not None:
        np.testing.assert_array_equal(build(q, time).approach, last)
        return
    assert build(q, time).in_motion
    np.testing.assert_array_equal(build(q, time, approach=last).approach, last)
