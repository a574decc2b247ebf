"""The nominal model of a ladder: registered where the study asks for it, else as the study has it;
too few rows to register, or to compare anything, cannot be estimated."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from builders import drawn, study_with

from modelsel.config.study_file import Study
from modelsel.exceptions import NotEstimable
from modelsel.fitting.problem import Problem
from modelsel.mechanisms.registry import BUILTIN
from modelsel.setup.registration import register
from modelsel.study.models.model_ladder import build_model, build_nominal
from modelsel.study.preparation.preparation import _check_enough_configurations

TOOLS = np.array([[30.0, 0, 100], [-40, 20, 60]])


def measure_two_targets(rng: np.random.Generator) -> Problem:
    """Forty postures of a UR5, every other one measured at the second target."""
    at = drawn("ur5", rng, 40)
    target = np.arange(40) % 2
    data = replace(at.data, target=target, targets=("A", "B"))
    return replace(at, data=data, tools=TOOLS)


def count_terms(study: Study, at: Problem) -> tuple[int, int]:
    """How many parameters the nominal model has, and the one of the set-up alone."""
    nominal = build_nominal(study, at, BUILTIN)
    setup = build_model(study, at, BUILTIN, ())
    return len(nominal.terms), len(setup.terms)


def test_the_nominal_model_is_registered_where_asked_alone(rng: np.random.Generator) -> None:
    at = measure_two_targets(rng)
    assert count_terms(study_with(), at) == (0, 6)
    assert count_terms(study_with(register=True), at) == (12, 12)


def test_too_few_rows_to_register_cannot_be_estimated(rng: np.random.Generator) -> None:
    at = drawn("ur5", rng, 10)
    use = np.arange(10) < 3
    with pytest.raises(NotEstimable, match="registration needs 4 per placement"):
        register(at, use, per_group=False)


def test_one_posture_that_estimates_cannot_be_estimated(rng: np.random.Generator) -> None:
    at = drawn("ur5", rng, 10)
    estimation = np.arange(10) < 1
    with pytest.raises(NotEstimable, match="one set of joint readings: nothing can be compared"):
        _check_enough_configurations(study_with(), at.data, estimation)
