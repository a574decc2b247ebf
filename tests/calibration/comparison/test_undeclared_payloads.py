"""Two campaigns of one arm that carries something heavier in the second, which nobody wrote down."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from builders import drawn, planted

from modelsel.calibration.calibration import Calibration, calibrate
from modelsel.calibration.comparison.campaigns import compare_campaigns
from modelsel.calibration.comparison.comparison_sentences import describe_comparison
from modelsel.fitting.design import Model
from modelsel.fitting.least_squares import fit
from modelsel.fitting.noise import Floor
from modelsel.fitting.whitening import Whitening
from modelsel.mechanisms.compliance import yields_to_weight
from modelsel.mechanisms.registry import mechanism
from modelsel.robot.files import load_robot
from modelsel.selection.evaluation import Split

NOISE = 0.05
ROBOT = load_robot("puma760")
COUNT = 120
GEOMETRIC, SPRING, PAYLOAD = (
    mechanism(name, ROBOT) for name in ("geometric", "joint-compliance:2", "payload-deflection:2")
)
OTHER_PAYLOAD = "Another payload would make the same change of joint-compliance:2"


def calibrated(rng: np.random.Generator, kg: float, is_written: bool) -> Calibration:
    """A campaign of an arm whose joint 2 yields to its own weight and to what it carries."""
    at = drawn(ROBOT, rng, COUNT, covariates={"payload_kg": np.full(COUNT, kg)})
    at = replace(at, whitening=Whitening(1 / NOISE))
    size = 0.02 * SPRING.terms[0].size[1]
    # about half a milliradian under 10 kg
    of_payload = 0.02 * PAYLOAD.terms[0].size[1]
    terms = SPRING.terms + PAYLOAD.terms
    at = planted(at, terms, np.array([size, of_payload]), rng, NOISE)
    if not is_written:
        at = replace(at, data=replace(at.data, covariates={}))
    rows = np.ones(COUNT, bool)
    split = Split(at, rows, ~rows, np.zeros(COUNT, np.intp), True)
    fitted = fit(at, Model((GEOMETRIC, SPRING)))
    return calibrate("payloads", split, fitted, Floor(NOISE, "stated"), None, False, {})


@pytest.mark.parametrize("is_written", [False, True])
def test_a_payload_that_nobody_wrote_down_may_look_like_a_spring_that_grew(
    is_written: bool, rng: np.random.Generator
) -> None:
    first = calibrated(rng, 0.0, is_written)
    second = calibrated(rng, 10.0, is_written)
    found = compare_campaigns(first, second)
    (only,) = found.mechanisms
    assert only.what in ("grew", "shrank")
    said = "\n".join(describe_comparison(found))
    assert (OTHER_PAYLOAD in said) is not is_written


def test_nothing_is_said_of_payloads_where_nothing_changed(rng: np.random.Generator) -> None:
    found = compare_campaigns(calibrated(rng, 0.0, False), calibrated(rng, 0.0, False))
    assert not found.as_by_payload
    assert "payload" not in "\n".join(describe_comparison(found))


@pytest.mark.parametrize(
    ("name", "yields"),
    [
        ("joint-compliance:2", True),
        ("joint3-twist", True),
        ("base-tilt", True),
        ("payload-deflection:2", False),
        ("tool-droop", False),
        ("gear-eccentricity:2", False),
    ],
)
def test_what_yields_to_the_arms_weight(name: str, yields: bool) -> None:
    assert yields_to_weight(mechanism(name, ROBOT)) is yields
