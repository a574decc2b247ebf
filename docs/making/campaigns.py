"""Simulated campaigns for the figures: a PUMA 760 with geometric errors, planted effects and noise,
fitted and scanned."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from modelsel.diagnosis.candidates.candidate import Candidate
from modelsel.diagnosis.candidates.candidate_list import build_candidates
from modelsel.diagnosis.columns.candidate_columns import Columns, build_columns, stack_design
from modelsel.diagnosis.inference.scan import Response, Scan, build_scan, compute_basis
from modelsel.fitting.design import Model, residuals
from modelsel.fitting.least_squares import Fit, fit
from modelsel.fitting.problem import Problem
from modelsel.measurements.measurements import build_measurements
from modelsel.mechanisms.registry import every, mechanism
from modelsel.mechanisms.terms import Term
from modelsel.robot.files import load_robot
from modelsel.robot.kinematics import forward

ROBOT, TOOL = load_robot("puma760"), (40.0, -25.0, 100.0)
BASE = Model((mechanism("geometric", ROBOT),))
NOISE = 0.05  # mm per coordinate


def effect(name: str, *sizes: float) -> list[tuple[Term, float]]:
    """A registered mechanism's terms at these sizes."""
    return list(zip(mechanism(name, ROBOT).terms, sizes, strict=True))


def measured(
    m: int, effects: Sequence[tuple[Term, float]], seed: int, noise: float = NOISE
) -> Problem:
    """m configurations drawn within the limits, measured on the exact chain with geometric errors,
    the effects and noise."""
    rng = np.random.default_rng(seed)
    q = ROBOT.draw(rng, m)
    at = Problem(ROBOT, build_measurements(q, forward(ROBOT, q, np.array(TOOL))), np.array([TOOL]))
    size = [0.3 if t.screws[0].axis[0] == "t" else 5e-4 for t in BASE.terms]
    built = np.random.default_rng([seed, 1]).normal(
        0, size
    )  # of its own stream: the same arm however much is measured
    theta = np.concatenate([built, [v for _, v in effects]])
    terms = (*BASE.terms, *(t for t, _ in effects))
    position = at.data.position - residuals(at, terms, theta)[:, :3] + rng.normal(0, noise, (m, 3))
    return replace(at, data=replace(at.data, position=position))


@dataclass(frozen=True, eq=False)
class View:
    """A campaign with a fitted model: every candidate, its columns, the scan beyond the model, what
    the model leaves."""

    at: Problem
    fitted: Fit
    found: tuple[Candidate, ...]
    cols: Columns
    seen: Scan
    rest: Response


def look(at: Problem, model: Model = BASE, cols: Columns | None = None) -> View:
    """Fit a model and scan beyond it; `cols` are those of the base."""
    found, fitted = build_candidates(at, BASE, every(ROBOT)), fit(at, model)
    cols = build_columns(at, found, fitted.at()) if cols is None else cols
    A, r = stack_design(at, model.terms, fitted.at())
    Q = compute_basis(A[:, list(fitted.found.kept)])
    seen = build_scan(cols, Q)
    return View(at, fitted, found, cols, seen, seen.see(r - Q @ (Q.T @ r)))
