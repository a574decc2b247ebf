"""Coefficients of free functions say nothing alone, whether the function stands alone or times another
cause: none is sampled, tabulated or correlated."""

from __future__ import annotations

import numpy as np
import pytest
from builders import drawn, planted, small_arm, study_of

from modelsel.diagnosis.findings.sentences import describe_amount
from modelsel.diagnosis.shapes.unregistered import build_bumps
from modelsel.fitting.design import Model
from modelsel.fitting.least_squares import fit
from modelsel.mechanisms.causes import Cause, Named
from modelsel.mechanisms.registry import BUILTIN, mechanism
from modelsel.mechanisms.terms import Mechanism, Screw, Term
from modelsel.uncertainty.parameters import correlate_parameters, mask_free_functions
from modelsel.uncertainty.summary import build_log_posterior

ARM = small_arm()
BASE = Model((mechanism("geometric", ARM),))


def build_function(factor: Cause | None) -> Mechanism:
    """A free function of joint 2's reading, times a factor."""
    bumps = build_bumps("q2", -2.0, 2.0, 0.8)
    terms = []
    for number, bump in enumerate(bumps):
        cause = bump if factor is None else bump * factor
        terms.append(Term(f"f{number}", (Screw(2, "rz", cause),)))
    return Mechanism("function", tuple(terms), "Made up for tests.")


@pytest.mark.parametrize("factor", [None, Named("payload_kg", "kg"), Named("approach2", "1")])
def test_no_coefficient_of_a_free_function_stands_alone(
    factor: Cause | None, rng: np.random.Generator
) -> None:
    function = build_function(factor)
    model = Model((*BASE.mechanisms, function))
    theta = np.concatenate([np.zeros(len(BASE.terms)), np.full(len(function.terms), 1e-3)])
    at = planted(drawn(ARM, rng, 60), model.terms, theta, rng, 0.05)
    fitted = fit(at, model)
    is_free = mask_free_functions(model)
    assert is_free.tolist() == [False] * len(BASE.terms) + [True] * len(function.terms)
    correlation = correlate_parameters(fitted)
    assert not any(name.startswith("f") for name in correlation.symbols)
    for over in ("default", "all"):
        target = build_log_posterior(study_of(at), fitted, BASE, BUILTIN, over=over)
        assert target is not None
        assert not any(name.startswith("f") for name in target.names)


def test_the_size_of_a_function_times_a_cause_is_no_list_of_coefficients() -> None:
    function = build_function(Named("payload_kg", "kg"))
    count = len(function.terms)
    values = np.ones(count)
    said = describe_amount(function.terms, values, values)
    assert said == f"a function of {count} coefficients"
