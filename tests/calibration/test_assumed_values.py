"""Covariates that doubtful findings alone look at may be missing: they are taken where the effect is
counted from, and that is said."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from builders import drawn, planted

from modelsel.calibration.assumed_values import describe_assumed, find_assumed
from modelsel.calibration.calibration import Calibration, calibrate
from modelsel.calibration.calibration_file import calibration_text
from modelsel.calibration.commands.compensation import correct
from modelsel.calibration.export.grid_options import GridOptions, hold_others
from modelsel.calibration.loading import parse_calibration
from modelsel.calibration.refitting import Refits
from modelsel.exceptions import DataError
from modelsel.fitting.design import Model
from modelsel.fitting.least_squares import fit
from modelsel.fitting.noise import Floor
from modelsel.mechanisms.registry import build_mechanisms, mechanism
from modelsel.robot.files import load_robot
from modelsel.selection.evaluation import Split

ROBOT = load_robot("puma760")
WARM = "thermal-zero:4"


@pytest.fixture(scope="module")
def made() -> Calibration:
    """A calibration with one finding of temperature."""
    rng = np.random.default_rng(5)
    at = drawn(ROBOT, rng, 80)
    model = Model((mechanism("geometric", ROBOT), *build_mechanisms(WARM, ROBOT)))
    at = planted(at, model.terms, np.full(len(model.terms), 1e-4), rng, 0.03)
    rows = np.ones(80, bool)
    split = Split(at, rows, ~rows, np.zeros(80, np.intp), True)
    return calibrate("warm", split, fit(at, model), Floor(0.03, "stated"), None, False, {})


def cold(c: Calibration):
    """Planned commands without a temperature."""
    q = ROBOT.draw(np.random.default_rng(6), 8) * 0.5
    columns = [f"q{j}_rad" for j in range(1, 7)]
    return pd.DataFrame(q, columns=columns)


def test_a_finding_that_is_confirmed_wants_its_column(made) -> None:
    assert find_assumed(made) == {}
    with pytest.raises(DataError, match="needs temperature_C, for which there is no column"):
        correct(made, cold(made))


def test_a_doubtful_one_is_taken_at_its_reference(made) -> None:
    c = replace(made, doubtful=(WARM,))
    assert find_assumed(c) == {"temperature_C": 20.0}
    planned = cold(c)
    with pytest.warns(UserWarning, match="temperature_C is not in the file and taken as 20: ther"):
        found = correct(c, planned)
    at_reference = planned.assign(temperature_C=20.0)
    np.testing.assert_allclose(
        found["q4_rad"], correct(made, at_reference)["q4_rad"], rtol=0, atol=1e-12
    )
    warm = correct(c, planned.assign(temperature_C=35.0))
    assert (warm["q4_rad"] - found["q4_rad"]).abs().max() > 1e-3


def test_nothing_is_said_of_a_column_that_is_there(made) -> None:
    c = replace(made, doubtful=(WARM,))
    assert describe_assumed(c, drawn(ROBOT, np.random.default_rng(1), 5).data) == []


def test_what_a_firm_finding_looks_at_too_is_wanted(made) -> None:
    growth = build_mechanisms("thermal-growth:2", ROBOT)
    model = Model((*made.model.mechanisms, *growth))
    more = len(model.terms) - len(made.theta)
    theta = np.append(made.theta, np.zeros(more))
    assert find_assumed(replace(made, model=model, theta=theta, doubtful=(WARM,))) == {}


def test_the_file_keeps_which_are_doubtful(made) -> None:
    c = replace(made, doubtful=(WARM,))
    assert parse_calibration(calibration_text(c)).doubtful == (WARM,)
    assert '"doubtful"' not in calibration_text(made)


def test_a_grid_is_at_the_temperature_of_the_other_forms(made) -> None:
    """Not in the middle of what the calibration has seen."""
    c = replace(made, refits=Refits({}, (None, None), 31.125))
    assert hold_others(c, GridOptions()).covariates["temperature_C"] == 31.125
    assert hold_others(made, GridOptions()).covariates["temperature_C"] < 30
    given = hold_others(c, GridOptions(at={"temperature_C": 22.0}))
    assert given.covariates["temperature_C"] == 22.0
