"""A calibration of an arm that follows the temperature late, or warms up after each rest: stored, applied
on another day, exported."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from builders import bind, one

from modelsel.calibration.calibration import Calibration, calibrate
from modelsel.calibration.calibration_file import calibration_text
from modelsel.calibration.commands.command_notes import describe_extrapolation
from modelsel.calibration.export import export
from modelsel.calibration.loading import parse_calibration
from modelsel.calibration.prediction import predict
from modelsel.fitting.design import Model
from modelsel.fitting.least_squares import fit
from modelsel.fitting.noise import Floor
from modelsel.measurements.measurements import Measurements, build_measurements
from modelsel.mechanisms.causes import Applied, Cause, Named
from modelsel.mechanisms.environment import find_references, temperature_rise
from modelsel.mechanisms.registry import mechanism
from modelsel.robot.files import load_robot
from modelsel.robot.kinematics import forward
from modelsel.selection.evaluation import Split

TOOL = np.array([40.0, -25.0, 100.0])
SIZE = 1e-4
NAME = "temperature_40_min_late"


def follow(time: np.ndarray, air: np.ndarray) -> np.ndarray:
    """What a mass of 40 min has, by steps of two seconds."""
    fine = np.arange(time[0], time[-1] + 2.0, 2.0)
    path = np.interp(fine, time, air)
    late = [path[0]]
    for value in path[1:]:
        late.append(late[-1] + 2.0 / 2400 * (value - late[-1]))
    return np.interp(time, fine, late)


def measure(
    rng: np.random.Generator, m: int, noise: float = 0.0, clock: bool = True
) -> Measurements:
    """Rows of an arm whose second joint is off by what follows the temperature late."""
    robot = load_robot("puma760")
    q = robot.draw(rng, m)
    time = np.cumsum(rng.uniform(60, 200, m))
    air = 20 + np.cumsum(rng.normal(0, 1.0, m))
    off = q.copy()
    off[:, 1] += SIZE * (follow(time, air) - 20)
    position = forward(robot, off, TOOL)
    covariates = {"temperature_C": air} | ({"time_s": time} if clock else {})
    position += noise * rng.normal(size=position.shape)
    return build_measurements(q, position, covariates=covariates)


def calibrate_with(cause: Cause, rng: np.random.Generator) -> Calibration:
    at = bind("puma760", measure(rng, 120, 0.01), TOOL)
    effect = replace(one(2, "rz", cause), name="late-zero")
    model = Model((mechanism("geometric", at.robot), effect))
    every_row = np.ones(120, bool)
    data = Split(at, every_row, ~every_row, np.zeros(120, np.intp), True)
    return calibrate("late", data, fit(at, model), Floor(0.01, "stated"), None, True, {})


@pytest.fixture(scope="module")
def made() -> Calibration:
    return calibrate_with(temperature_rise(20.0, 40), np.random.default_rng(5))


def test_it_comes_back_and_tells_another_day(made: Calibration) -> None:
    stored = parse_calibration(calibration_text(made))
    assert stored.model == made.model
    assert "temperature_C" in made.needs()
    assert NAME not in made.needs()
    later = measure(np.random.default_rng(6), 80)
    found = predict(stored, stored.problem(later))
    assert np.abs(found - later.position).max() < 0.02
    assert not [s for s in describe_extrapolation(made, later) if "temperature late" in s]


def test_without_a_clock_the_temperature_has_lasted(made: Calibration) -> None:
    later = measure(np.random.default_rng(6), 80, clock=False)
    assert later.late_temperature is None
    found = predict(made, made.problem(later))
    assert np.abs(found - later.position).max() > 0.05
    plain = calibrate_with(temperature_rise(20.0), np.random.default_rng(5))
    lasting = bind("puma760", later, TOOL).value(NAME)
    np.testing.assert_array_equal(lasting, later.covariates["temperature_C"])
    assert find_references(plain.terms[-1].screws[0].cause) == {20.0}
    (said,) = [s for s in describe_extrapolation(made, later) if "temperature late" in s]
    assert said.endswith("the temperature is taken to have long been what it is.")


@pytest.mark.parametrize("form", ["python", "table", "json"])
def test_exports_take_the_temperature_as_it_is(form: str, made: Calibration) -> None:
    exported = export(made, form)
    assert "temperature_C" in exported.text
    assert NAME not in exported.text
    assert exported.error_mm < 1e-3
    assert any("follows the temperature late" in note for note in exported.notes)


def test_a_module_asks_how_long_the_arm_has_been_at_work() -> None:
    settling = Applied("exp", Named("since_rest_s", "s") / -900.0)
    made = calibrate_with(settling, np.random.default_rng(5))
    exported = export(made, "python")
    assert "since_rest_s" in exported.text
    assert exported.error_mm < 1e-3
