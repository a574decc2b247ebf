"""What the data hardly determine is held by its usual size: smoothly, by the robot file's word, and
nothing else is touched."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from builders import drawn, planted, seeds

from modelsel.exceptions import StudyError
from modelsel.fitting.design import Model, residuals
from modelsel.fitting.least_squares import fit
from modelsel.fitting.prior import usual_sizes
from modelsel.mechanisms.geometry import OPEN, build_setup, geometric
from modelsel.mechanisms.serialization import (
    MechanismRecord,
    mechanism_from_record,
    mechanism_record,
)
from modelsel.robot.files import load_robot, robot_from_table
from modelsel.robot.plain_values import robot_from_record, robot_record

PUMA = load_robot("puma760")
TABLE = {"joint": [{"dh": {"theta_deg": 0, "d_mm": 100, "a_mm": 300, "alpha_deg": 90}}] * 3}


@seeds(1, 2)
def test_a_target_wanders_off_the_axis_without_a_jump(rng) -> None:
    """From on the last axis to a millimetre off it two combinations become estimable on paper. The
    arm that is predicted with a longer tool moves by micrometres a step; keeping parameters at zero
    by a threshold moved it by tenths of a millimetre."""
    at = drawn(PUMA, rng, 80, (0.0, 0.0, 100.0))
    model = Model((geometric(PUMA),))
    noise = rng.normal(0, 0.05, (80, 3))
    theta = rng.normal(size=39) * np.where([t.unit == "mm" for t in model.terms], 0.7, 1.5e-3)
    fresh = drawn(PUMA, rng, 60, (0.0, 0.0, 250.0))
    predicted = []
    for off in (0.0, 1e-9, 1e-6, 1e-4, 1e-2, 0.03, 0.1, 0.3, 1.0):
        here = replace(at, tools=np.array([[off, 0.0, 100.0]]))
        here = planted(here, model.terms, theta)
        found = fit(
            replace(here, data=replace(here.data, position=here.data.position + noise)), model
        )
        assert found.rank == pytest.approx(25, abs=2)
        predicted.append(residuals(fresh, found.terms, found.theta))
    jumps = [np.linalg.norm(b - a, axis=1).max() for a, b in pairwise(predicted)]
    assert max(jumps[:-1]) < 0.02, jumps
    assert jumps[-1] < 0.15, jumps  # a millimetre is another tool


@seeds(1, 2)
def test_what_is_well_determined_is_least_squares(rng) -> None:
    """Parameters that do not depend on each other, each determined far better than to a quarter of
    its usual size."""
    whole = geometric(load_robot("ur5"))
    at = drawn("ur5", rng, 200)
    kept = fit(at, Model((whole,)), held="nothing").found.kept
    model = Model((replace(whole, terms=tuple(whole.terms[k] for k in kept)),))
    at = planted(
        at, model.terms, rng.normal(size=len(kept)) * [t.usual for t in model.terms], rng, 0.002
    )
    held, plain = fit(at, model), fit(at, model, held="nothing")
    assert (usual_sizes(model) > 4 * np.sqrt(len(kept)) * plain.standard_errors).all()
    np.testing.assert_allclose(held.theta, plain.theta, rtol=1e-9)
    np.testing.assert_allclose(held.covariance, plain.covariance, rtol=1e-9)


def test_the_robot_file_may_say_more(rng) -> None:
    robot = robot_from_table({**TABLE, "usual_mm": 0.2, "usual_mrad": 5.0}, "robot.toml")
    assert robot.usual == (0.2, 5e-3)
    model = Model((build_setup(robot, 1, 1, True, False), geometric(robot)))
    sizes = {t.symbol: s for t, s in zip(model.terms, usual_sizes(model), strict=True)}
    assert (sizes["a2"], sizes["α2"]) == (0.2, 5e-3)
    assert (sizes["a1"], sizes["α1"], sizes["a4"]) == (
        OPEN["t"],
        OPEN["r"],
        OPEN["t"],
    )  # found by registration
    assert robot_from_record(robot_record(robot)).usual == robot.usual
    assert mechanism_from_record(
        MechanismRecord.model_validate(mechanism_record(geometric(robot)))
    ) == geometric(robot)


@pytest.mark.parametrize(
    ("key", "value"),
    [("usual_mm", 0.0), ("usual_mrad", -1.0), ("usual_mm", float("nan")), ("usual_mrad", "much")],
)
def test_a_usual_size_is_a_number_above_zero(key, value) -> None:
    with pytest.raises(StudyError, match=key):
        robot_from_table({**TABLE, key: value}, "robot.toml")
