"""How far parts of a model turn the target: told where orientations were measured, in mrad."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from builders import OFF_AXIS, bind, one, study_of

from modelsel.fitting.design import Model
from modelsel.fitting.least_squares import fit
from modelsel.fitting.problem import Problem
from modelsel.measurements.measurements import build_measurements
from modelsel.mechanisms.causes import q as reading
from modelsel.results.sentences.study_sentences import format_motion
from modelsel.robot.files import load_robot
from modelsel.robot.kinematics import pose
from modelsel.robot.rigid import rotation_matrix
from modelsel.uncertainty.parameters import bootstrap_parameters, describe_parameters
from modelsel.uncertainty.significance import assess_significance
from modelsel.uncertainty.summary import _write_known

ARM = load_robot("ur5")
# the target's own turn about x, in proportion to joint 1's reading
TURN = one(ARM.n + 1, "rx", reading(1))
SLOPE = 2e-3


def campaign(rng: np.random.Generator, *, oriented: bool) -> tuple[Problem, np.ndarray]:
    """An arm whose target is turned and not moved."""
    q = ARM.draw(rng, 80)
    at = pose(ARM, q, np.array(OFF_AXIS))
    turns = [rotation_matrix(0, SLOPE * angle) for angle in q[:, 0]]
    rotation = at.rotation.transpose(2, 0, 1) @ np.array(turns)
    position = at.target.T + rng.normal(0, 0.01, (len(q), 3))
    data = build_measurements(q, position)
    if oriented:
        data = replace(data, rotation=rotation)
    return bind(ARM, data), np.abs(q[:, 0])


def test_what_only_turns_the_target_is_told_by_how_far(rng: np.random.Generator) -> None:
    at, angle = campaign(rng, oriented=True)
    model = Model((TURN, one(1, "tz", 1)))
    split, fitted = study_of(at), fit(at, model)
    boot = bootstrap_parameters(split, fitted, rng)
    names = [each.name for each in model.mechanisms]
    told = {each.mechanism: each for each in assess_significance(split, fitted, names, boot, rng)}
    turning = told[TURN.name]
    slope = abs(fitted.theta[0])
    assert slope == pytest.approx(SLOPE, rel=0.01)
    assert turning.max_mm == pytest.approx(0, abs=1e-6)
    assert turning.mean_mrad == pytest.approx(slope * angle.mean() * 1e3, rel=1e-6)
    assert turning.max_mrad == pytest.approx(slope * angle.max() * 1e3, rel=1e-6)
    parameter, shift = describe_parameters(split, fitted, boot)
    assert parameter.max_mrad == pytest.approx(turning.max_mrad, rel=1e-3)
    assert shift.max_mrad == pytest.approx(0, abs=1e-9)
    assert "max_mrad" in _write_known(parameter)


def test_positions_alone_tell_of_no_turn(rng: np.random.Generator) -> None:
    at, _ = campaign(rng, oriented=False)
    model = Model((one(1, "tz", 1),))
    split, fitted = study_of(at), fit(at, model)
    boot = bootstrap_parameters(split, fitted, rng)
    (told,) = assess_significance(split, fitted, [model.mechanisms[0].name], boot, rng)
    (parameter,) = describe_parameters(split, fitted, boot)
    assert (told.mean_mrad, told.max_mrad, parameter.max_mrad) == (None, None, None)
    assert not any("mrad" in key for one in (told, parameter) for key in _write_known(one))


@pytest.mark.parametrize(
    ("mm", "mrad", "words"),
    [
        (0.0, 0.412, "0.412 mrad"),
        (1e-9, 0.412, "0.412 mrad"),
        (0.2, 0.412, "0.200"),
        (0.0, None, "0.000"),
        (0.0, 0.0, "0.000"),
        (None, None, "–"),
    ],
)
def test_a_cell_has_the_turn_where_nothing_is_moved(mm, mrad, words) -> None:
    assert format_motion(mm, mrad) == words
