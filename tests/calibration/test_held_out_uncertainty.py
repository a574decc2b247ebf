"""The model's own uncertainty in the held-out rows is that of all of them, however many there are and
in whatever order their targets stand."""

from __future__ import annotations

import numpy as np
import pytest

from modelsel.calibration import held_out_uncertainty
from modelsel.calibration.calibration import calibrate
from modelsel.calibration.held_out_uncertainty import measure_held_out_uncertainty
from modelsel.fitting.design import Model
from modelsel.fitting.least_squares import fit
from modelsel.fitting.noise import Floor
from modelsel.fitting.problem import Problem
from modelsel.fitting.whitening import Whitening
from modelsel.measurements.measurements import build_measurements
from modelsel.mechanisms.registry import mechanism
from modelsel.robot.files import load_robot
from modelsel.robot.kinematics import pose
from modelsel.selection.evaluation import Split

NOISE_MM = 0.05
FITTED = 40  # configurations


@pytest.mark.parametrize("far", [0, 1, 2])
def test_of_many_rows_no_target_is_taken_alone(rng, far, monkeypatch) -> None:
    """One of three targets is far off the flange, where a turn moves it most; every third row is its."""
    robot = load_robot("ur5")
    configurations = FITTED + int(rng.integers(667, 1000))
    tools = np.array([[0.0, 0.0, 20.0], [0.0, 0.0, 30.0], [0.0, 0.0, 40.0]])
    tools[far] = [900.0, 0.0, 300.0]
    q = robot.draw(rng, configurations)
    places = [pose(robot, q, tool).target.T for tool in tools]
    x = np.stack(places, axis=1).reshape(-1, 3)
    noise = rng.normal(0, NOISE_MM, x.shape)
    names = np.tile(["A", "B", "C"], configurations)
    data = build_measurements(np.repeat(q, 3, axis=0), x + noise, target=names)
    at = Problem(robot, data, tools, whitening=Whitening(1 / NOISE_MM))
    estimation = np.repeat(np.arange(configurations) < FITTED, 3)
    fitted = fit(at.take(estimation), Model((mechanism("geometric", robot),)))
    split = Split(at, estimation, np.zeros(len(at), bool), np.arange(len(at)) % 5, True)
    c = calibrate("many", split, fitted, Floor(NOISE_MM, "stated"), None, False, {})
    of_some = measure_held_out_uncertainty(c, split)
    monkeypatch.setattr(held_out_uncertainty, "MAX_ROWS", len(at))
    of_all = measure_held_out_uncertainty(c, split)
    assert of_some == pytest.approx(of_all, rel=0.06)
