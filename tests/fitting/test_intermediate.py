"""Intermediate fits of a search: their squares are expanded once, and they end where the last fit
does."""

from __future__ import annotations

import numpy as np
import pytest
from builders import drawn, planted

from modelsel import mechanism
from modelsel._typing import Array
from modelsel.fitting import gauss_newton
from modelsel.fitting.design import Model
from modelsel.fitting.expansion import Expansion
from modelsel.fitting.gauss_newton import COARSE_MM
from modelsel.fitting.least_squares import STEP_MM, fit
from modelsel.fitting.shrinkage import fit_shrunk
from modelsel.fitting.solver import Solver


def test_an_intermediate_fit_expands_less_and_ends_where_the_last_does(
    rng: np.random.Generator, monkeypatch: pytest.MonkeyPatch
) -> None:
    at = drawn("puma760", rng, 120)
    effect = mechanism("encoder-eccentricity:3", at.robot)
    bent = planted(at, effect.terms, [3e-5, 2e-5], rng, 0.03)
    base = Model((mechanism("geometric", at.robot),))
    extended = Model((*base.mechanisms, effect))
    start = fit(bent, base)
    calls: list[Array] = []
    expand = gauss_newton.expand_squares

    def count(solver: Solver, theta: Array) -> Expansion:
        calls.append(theta)
        return expand(solver, theta)

    monkeypatch.setattr(gauss_newton, "expand_squares", count)
    residuals, counts = [], []
    for step_mm in (COARSE_MM, STEP_MM):
        calls.clear()
        fitted = fit_shrunk(bent, extended, start, step_mm)
        residuals.append(fitted.residuals(bent))
        counts.append(len(calls))
    assert counts[0] == 1 < counts[1]
    assert np.linalg.norm(residuals[0] - residuals[1]) < COARSE_MM
    moved = residuals[1] - start.residuals(bent)
    assert np.linalg.norm(moved) > 10 * COARSE_MM
