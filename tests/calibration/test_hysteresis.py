"""A calibration with hysteresis that remembers: stored, applied to rows in order of motion, exported."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest
from builders import bind, one

from modelsel._typing import Array
from modelsel.calibration.calibration import Calibration, calibrate
from modelsel.calibration.calibration_file import calibration_text
from modelsel.calibration.commands.command_notes import (
    describe_extrapolation,
    describe_order_dependence,
)
from modelsel.calibration.commands.compensation import compensate_commands, correct
from modelsel.calibration.commands.large_changes import leave_out_rows
from modelsel.calibration.export import GridOptions, export, export_grid
from modelsel.calibration.loading import parse_calibration
from modelsel.calibration.prediction import predict
from modelsel.calibration.validation.validation import judge
from modelsel.fitting.design import Model
from modelsel.fitting.least_squares import fit
from modelsel.fitting.noise import Floor
from modelsel.measurements.measurements import Measurements, build_measurements
from modelsel.mechanisms.causes import Named
from modelsel.mechanisms.registry import mechanism
from modelsel.robot.files import load_robot
from modelsel.robot.kinematics import forward
from modelsel.selection.evaluation import Split

TOOL = np.array([40.0, -25.0, 100.0])
SIZE, WIDTH = 6e-4, 0.5
NAME = "drag2_500"


def hold_back(path: Array) -> Array:
    """How far a joint is ahead of a block between two stops, half a rad to either side."""
    block = path[0]
    ahead = []
    for place in path:
        block = min(max(block, place - WIDTH), place + WIDTH)
        ahead.append(place - block)
    return np.array(ahead)


def measure(rng: np.random.Generator, m: int, noise: float = 0.0, **more: object) -> Measurements:
    """Rows of an arm whose second joint is off by what it has wound up."""
    robot = load_robot("puma760")
    q = robot.draw(rng, m)
    off = q.copy()
    off[:, 1] += SIZE * hold_back(q[:, 1])
    position = forward(robot, off, TOOL)
    return build_measurements(q, position + noise * rng.normal(size=position.shape), **more)


@pytest.fixture(scope="module")
def made() -> Calibration:
    rng = np.random.default_rng(5)
    at = bind("puma760", measure(rng, 120, 0.01), TOOL)
    model = Model((mechanism("geometric", at.robot), one(2, "rz", Named(NAME, "rad"))))
    every_row = np.ones(120, bool)
    data = Split(at, every_row, ~every_row, np.zeros(120, np.intp), True)
    return calibrate("drag", data, fit(at, model), Floor(0.01, "stated"), None, True, {})


def test_it_comes_back_and_tells_another_day(made: Calibration) -> None:
    stored = parse_calibration(calibration_text(made))
    assert stored.model == made.model
    assert calibration_text(stored) == calibration_text(made)
    assert made.ranges[NAME] == pytest.approx((-WIDTH, WIDTH))
    later = measure(np.random.default_rng(6), 80)
    found = predict(stored, stored.problem(later))
    np.testing.assert_array_equal(found, predict(made, made.problem(later)))
    assert np.abs(found - later.position).max() < 0.02
    # only the way that the joint came tells them apart
    given = measure(np.random.default_rng(6), 80, approach=-later.approach)
    without = predict(stored, stored.problem(given))
    assert np.abs(without - later.position).max() > 0.1


def test_it_stays_valid_in_order_of_motion_alone(made: Calibration) -> None:
    rng = np.random.default_rng(7)
    later = measure(rng, 60, 0.01)
    assert judge(made, later, free_setup=False).p > 0.01
    shuffled = later.take(rng.permutation(60))
    mixed = build_measurements(shuffled.q, shuffled.position)
    assert judge(made, mixed, free_setup=False).p < 1e-6


@pytest.mark.filterwarnings("ignore::UserWarning")
def test_commands_that_are_corrected_land_where_they_should(made: Calibration) -> None:
    """The joint is driven to the corrected readings, and winds up on the way."""
    rng = np.random.default_rng(8)
    wanted = measure(rng, 40)
    nominal = forward(made.robot, wanted.q, TOOL)
    plan = build_measurements(wanted.q, nominal)
    commands = compensate_commands(made, plan)
    off = commands.q.copy()
    off[:, 1] += SIZE * hold_back(commands.q[:, 1])
    before = np.linalg.norm(wanted.position - nominal, axis=1).max()
    after = np.linalg.norm(forward(made.robot, off, TOOL) - nominal, axis=1).max()
    assert before > 0.1
    assert after < 0.03
    table = pd.DataFrame(wanted.q, columns=[f"q{j}_rad" for j in range(1, 7)])
    found = correct(made, table)
    np.testing.assert_allclose(found["q2_rad"], commands.q[:, 1], atol=1e-12)


def test_notes_say_what_it_is_taken_from(made: Calibration) -> None:
    later = measure(np.random.default_rng(6), 20)
    (said,) = describe_order_dependence(made, later)
    assert said == (
        "joint 2: the effects of hysteresis are taken from the order of the targets in the file. Run "
        "them in this order."
    )
    assert not [one for one in describe_extrapolation(made, later) if "hysteresis" in one]
    given = measure(np.random.default_rng(6), 20, approach=-later.approach)
    assert describe_order_dependence(made, given) == []
    (said,) = [one for one in describe_extrapolation(made, given) if "hysteresis" in one]
    assert said == (
        "joint 2: with directions of approach given, the way that the joint came is not known; the "
        "middle of its hysteresis is taken."
    )


def test_rows_left_out_change_the_way(made: Calibration) -> None:
    later = measure(np.random.default_rng(6), 20)
    left_out = np.arange(20) % 4 == 1
    some = leave_out_rows(later, left_out)
    found = bind("puma760", some).value(NAME)
    np.testing.assert_allclose(found, hold_back(later.q[~left_out, 1]), atol=1e-12)


@pytest.mark.parametrize("form", ["python", "table"])
def test_exports_ask_for_it_by_name(form: str, made: Calibration) -> None:
    exported = export(made, form)
    assert NAME in exported.text
    assert exported.error_mm < 1e-3


def test_a_grid_leaves_it_out_and_says_so(made: Calibration) -> None:
    exported = export_grid(made, GridOptions((1, 2, 3), 0.2))
    assert NAME not in exported.text
    left = [one for one in exported.left_out if "drags along" in one]
    assert left == ["what a joint drags along (the middle between both sides is taken)"]
    assert "for what a joint drags along, the middle between both sides is taken" in exported.text
