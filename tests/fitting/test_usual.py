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
from modelsel.mechanisms.causes import cos, q, sin, torque
from modelsel.mechanisms.geometry import OPEN, build_setup, geometric
from modelsel.mechanisms.registry import mechanism
from modelsel.mechanisms.serialization import (
    MechanismRecord,
    mechanism_from_record,
    mechanism_record,
)
from modelsel.mechanisms.terms import Mechanism, Screw, Term
from modelsel.robot.files import load_robot, robot_from_table
from modelsel.robot.plain_values import robot_from_record, robot_record

PUMA = load_robot("puma760")
TABLE = {"joint": [{"dh": {"theta_deg": 0, "d_mm": 100, "a_mm": 300, "alpha_deg": 90}}] * 3}


@seeds(1, slow=(2,))
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


@pytest.mark.parametrize("arm", ["puma760", "ur10"])
@seeds(1)
def test_no_length_goes_far_for_an_effect_that_the_model_lacks(arm, rng) -> None:
    """Thousands of rows see what shifts along parallel axes do by the other errors; without the
    springs and the gears' ripple in the model least squares put 300 mm into them, and 1,600."""
    robot = load_robot(arm)
    names = ("gear-eccentricity:3", "gear-eccentricity:1", "encoder-eccentricity:1")
    known = [mechanism(name, robot) for name in names]
    bent = [Term(f"b{k}", (Screw(4, "rx", f(q(2) + q(3))),)) for k, f in enumerate((sin, cos))]
    model = Model((geometric(robot), *known, Mechanism("bent", tuple(bent))))
    causes = [(2, torque(2), 4e-6), (3, torque(3), 4e-6), (4, cos(2.0 * q(4)), 4e-4)]
    lacking = [Term(f"l{k}", (Screw(k, "rz", cause),)) for k, cause, _ in causes]
    whole = Model((*model.mechanisms, Mechanism("lacking", tuple(lacking))))
    sizes = [0.3 if term.unit == "mm" else 1e-3 for term in model.terms]
    theta = rng.normal(size=len(sizes)) * sizes
    theta = np.append(theta, [size for _, _, size in causes])
    at = planted(drawn(robot, rng, 4000, (0.0, 0.0, 100.0)), whole.terms, theta, rng, 0.005)
    found = fit(at, model)
    assert found.settled
    assert (np.abs(found.theta) < 10 * usual_sizes(model)).all()
    fresh = planted(drawn(robot, rng, 200, (0.0, 0.0, 100.0)), whole.terms, theta)
    before, after = (np.square(found.residuals(rows)).mean() for rows in (at, fresh))
    assert after < 1.2 * before


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
