"""What is said of a stated uncertainty that is too small does not contradict what the search found."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from builders import OFF_AXIS, bind, study_of

from modelsel.fitting.design import Model
from modelsel.fitting.error_structure import ErrorStructure, find_structure
from modelsel.fitting.least_squares import Fit, fit
from modelsel.fitting.noise import Floor
from modelsel.fitting.possible_parts import list_parts
from modelsel.fitting.problem import Problem
from modelsel.fitting.whitening import Whitening
from modelsel.measurements.measurements import build_measurements
from modelsel.mechanisms.registry import mechanism
from modelsel.results.conclusions.goodness_of_fit import measure_lack_of_fit
from modelsel.results.repeatability.repeatability import measure_unrepeated
from modelsel.robot.files import load_robot
from modelsel.robot.kinematics import forward
from modelsel.study.preparation.stated_noise import check_stated_noise

ARM = load_robot("puma560")


@pytest.mark.parametrize("sought", [True, False])
def test_where_joints_were_looked_at_their_repeatability_is_not_suspected(rng, sought) -> None:
    """Otherwise one sentence would say that no joint was found, and the next that it is the arm."""
    q = ARM.draw(rng, 80)
    position = forward(ARM, q, np.array(OFF_AXIS)) + rng.normal(0, 0.08, (80, 3))
    at = bind(ARM, build_measurements(q, position))
    at = replace(at, whitening=Whitening(1 / 0.01))
    fitted = fit(at, Model((mechanism("geometric", ARM),)))
    _, _, (note,) = check_stated_noise(study_of(at), Floor(0.01, "stated"), fitted, sought)
    assert ("how well the arm itself repeats" in note.sentence) == (not sought)
    assert ("a mean of many readings" in note.sentence) == sought


def hold_in_stated(at: Problem, floor: Floor, part: str) -> tuple[Fit, ErrorStructure]:
    """Find one part of the errors, and that what is stated holds it; the fit, and the errors."""
    every = np.ones(len(at), bool)
    fitted = fit(at, Model((mechanism("geometric", ARM),)))
    errors = find_structure(at, every, fitted, list_parts(at, every))
    assert errors.names == (part,)
    split = study_of(errors.whiten(at))
    assert check_stated_noise(split, floor, fitted, True)[2] == ()
    found = measure_lack_of_fit(SimpleNamespace(fit=fitted), floor, split)
    assert found.p > 1e-4
    return fitted, errors


def test_what_the_instrument_has_in_one_direction_is_in_its_stated_uncertainty(rng) -> None:
    """Stated per coordinate, as the mean of a quiet x and y and a loud z, it is right."""
    size = np.array([0.01, 0.01, float(rng.uniform(0.06, 0.1))])
    q = ARM.draw(rng, 90)
    position = forward(ARM, q, np.array(OFF_AXIS)) + rng.normal(0, size, (90, 3))
    stated = float(np.sqrt(np.mean(size**2)))
    at = replace(bind(ARM, build_measurements(q, position)), whitening=Whitening(1 / stated))
    fitted, errors = hold_in_stated(at, Floor(stated, "stated"), "instrument z")
    # stated as a fifth of that it is too small
    smaller = replace(at, whitening=Whitening(5 / stated))
    narrow = study_of(errors.whiten(smaller))
    found = measure_lack_of_fit(SimpleNamespace(fit=fitted), Floor(stated / 5, "stated"), narrow)
    assert found.f == pytest.approx(25, rel=0.5)


def test_what_the_instrument_has_at_one_target_is_in_its_stated_uncertainty(rng) -> None:
    """Stated for all targets alike, as the mean of two quiet ones and a loud one, it is right."""
    size = np.array([0.01, 0.01, float(rng.uniform(0.06, 0.1))])
    tools = np.array([OFF_AXIS, (-60.0, 30.0, 140.0), (10.0, 80.0, 200.0)])
    target = np.arange(150) % 3
    visit = np.arange(150) // 3
    q = ARM.draw(rng, 50)[visit]
    position = rng.normal(0, size[target][:, None], (150, 3))
    for number in range(3):
        rows = target == number
        position[rows] += forward(ARM, q[rows], tools[number])
    data = build_measurements(q, position, target=target.tolist(), configuration=visit)
    stated = float(np.sqrt(np.mean(size**2)))
    at = replace(Problem(ARM, data, tools), whitening=Whitening(1 / stated))
    floor = Floor(stated, "stated")
    _, errors = hold_in_stated(at, floor, "instrument target 2")
    # the floor holds all that the instrument has
    assert measure_unrepeated(errors, floor) == 0
