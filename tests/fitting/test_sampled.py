"""Fits of very many rows, from a sample's fit: the minimum of all rows, as of a fit of them all."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from builders import drawn, planted, split_of

from modelsel._typing import Array
from modelsel.fitting import sampled
from modelsel.fitting.design import Model
from modelsel.fitting.gradient import Slope
from modelsel.fitting.iteration import compute_direction
from modelsel.fitting.least_squares import STEP_MM, Fit, finish, fit, sampled_solver
from modelsel.fitting.prior import Shrinkage
from modelsel.fitting.problem import Problem
from modelsel.fitting.reduction import Reduction
from modelsel.fitting.sampled import SampledRows, draw_sample
from modelsel.fitting.shrinkage import fit_shrunk
from modelsel.fitting.solver import ITERATIONS
from modelsel.mechanisms.causes import Bump, Named, q, sin
from modelsel.mechanisms.registry import mechanism
from modelsel.mechanisms.terms import Mechanism, Screw, Term
from modelsel.robot.files import load_robot
from modelsel.selection.evaluation import Evaluation, Split, evaluate
from modelsel.study.pipeline.study_notes import collect_fit_notes

ARM = load_robot("puma760")
ROWS = 1600


def effect(name: str, cause: object) -> Mechanism:
    return Mechanism(name, (Term("w", (Screw(3, "rz", cause),)),))


PLAIN = Model(
    (mechanism("geometric", ARM), mechanism("joint-compliance:2", ARM), effect("own", sin(q(3))))
)
BUMPS = tuple(Bump("q3", centre, 0.4) for centre in np.arange(-1.2, 1.3, 0.4).tolist())
CURVE = tuple(Term(f"s{k}", (Screw(3, "rz", bump),)) for k, bump in enumerate(BUMPS))
FREE = Model((mechanism("geometric", ARM), Mechanism("free(q3)", CURVE)))

NO_PRIOR = Shrinkage.of(PLAIN.terms, None)


def measure(rng: np.random.Generator, model: Model) -> Problem:
    """An arm with the model's errors, and one that no model has."""
    at = drawn(ARM, rng, ROWS)
    wave = effect("wave", sin(5.0 * q(2)))
    whole = Model((*model.mechanisms, wave))
    sizes = [0.3 if term.unit == "mm" else 1e-3 for term in model.terms]
    theta = np.append(rng.normal(0, 1, len(sizes)) * sizes, 3e-4)
    return planted(at, whole.terms, theta, rng, 0.05)


@pytest.fixture
def many(monkeypatch):
    """A function that says from how many rows a sample is fitted first."""

    def of(rows: int) -> None:
        monkeypatch.setattr(sampled, "MANY_ROWS", rows)

    return of


def same(one: Fit, other: Fit, tolerance: float = 1e-4) -> None:
    assert one.found.kept == other.found.kept
    assert one.weak.count == other.weak.count
    assert one.rss == pytest.approx(other.rss, rel=1e-7 * tolerance)
    error = np.maximum(other.standard_errors, 1e-12)
    assert np.abs((one.theta - other.theta) / error).max() < tolerance
    assert one.standard_errors == pytest.approx(other.standard_errors, rel=0.1 * tolerance)


@pytest.mark.parametrize(
    ("model", "held"),
    [(PLAIN, "geometry"), (PLAIN, "all"), (FREE, "geometry"), (FREE, "all")],
    ids=["plain", "plain, all", "free", "free, all"],
)
def test_the_fit_is_that_of_all_rows(model, held, rng, many) -> None:
    at = measure(rng, model)
    whole = fit_shrunk(at, model, held=held)
    many(1000)
    from_sample = fit_shrunk(at, model, held=held)
    # the variance of a free function is found to a thousandth
    same(from_sample, whole, 1e-2 if model is FREE else 1e-4)
    alone = fit_shrunk(draw_sample(at), model, held=held)
    assert (
        np.abs(alone.theta - whole.theta).max()
        > 1e3 * np.abs(from_sample.theta - whole.theta).max()
    )


def test_what_few_rows_show_is_fitted(rng, many) -> None:
    """A cause that is nought in all of the sample."""
    at = measure(rng, PLAIN)
    few = np.setdiff1d(np.arange(ROWS), draw_sample(at).data.row)[:40]
    switched = np.zeros(ROWS)
    switched[few] = 1.0
    at = replace(at, data=replace(at.data, covariates={"switched": switched}))
    model = Model((*PLAIN.mechanisms, effect("switch", Named("switched"))))
    whole = fit(at, model)
    many(500)
    same(fit(at, model), whole)
    assert len(model.terms) - 1 in whole.found.kept


def test_a_step_that_overshoots_is_damped(rng) -> None:
    """By products of a sample that say too little, a full step would raise the cost."""
    at = measure(rng, PLAIN)
    sample = draw_sample(at)
    first = fit(sample, PLAIN)
    solver = sampled_solver(at, sample, first, "geometry", None)
    slope = solver.rows.at(first.theta)
    few = Reduction(0.3 * first.reduction.R, first.reduction.rows)
    faint = SampledRows(solver.strategy.sample, few)
    solver = replace(solver, strategy=faint)
    expansion = faint.expand_sample(solver, first.theta, slope)
    start = replace(solver.start(expansion, NO_PRIOR, first.found), slope=slope)
    delta, _ = compute_direction(solver.judge(start))
    assert solver.rows.at(first.theta + delta).squares > slope.squares
    arrived = faint.approach(solver, start)
    assert arrived.cost < start.cost
    assert solver.rows.at(arrived.theta).squares < slope.squares


def test_a_fit_ends_where_its_cost_gets_no_lower(rng) -> None:
    """Where the rows' second order leads uphill, the fit stays where they were reduced, and says
    so; nothing is raised."""
    at = measure(rng, PLAIN)
    sample = draw_sample(at)
    first = fit(sample, PLAIN)
    assert first.settled
    solver = sampled_solver(at, sample, first, "geometry", None)
    strategy = solver.strategy
    state = strategy.begin(solver, first.theta, NO_PRIOR, first.found)
    gram, squares = state.expansion.gram, state.slope.squares
    tilt = gram[0] * np.sqrt(0.5 * squares / gram[0, 0])
    steep = Slope(squares, state.slope.products + tilt)
    uphill = replace(state, slope=steep, expansion=replace(state.expansion, slope=steep))
    ended = strategy.settle(solver, uphill, ITERATIONS, STEP_MM)
    assert np.array_equal(ended.theta, state.expansion.theta)
    fitted = finish(solver, ended, STEP_MM)
    assert np.array_equal(fitted.theta, state.expansion.theta)
    assert not replace(fitted, step_mm=1.0).settled


def figures(split: Split) -> tuple[list[float], Array]:
    evaluation = evaluate(split, PLAIN, PLAIN.names)
    numbers = [
        evaluation.cv_rms_mm,
        evaluation.cv_mean_mm,
        evaluation.log_density,
        evaluation.held_out.rms_mm,
        evaluation.aicc,
        evaluation.bic,
    ]
    return numbers, evaluation.crossed


def test_a_fit_that_has_not_settled_is_said(rng) -> None:
    split = split_of(measure(rng, PLAIN), rng)
    evaluation = evaluate(split, PLAIN, PLAIN.names)
    stopped = replace(evaluation, fit=replace(evaluation.fit, step_mm=1.0))

    def warned(ladder: list[Evaluation]) -> list[str]:
        return [note.code for note in collect_fit_notes(split, ladder, None, floor_doubted=True)]

    assert warned([evaluation]) == []
    assert warned([stopped, evaluation]) == ["fit-unsettled"]


def test_folds_come_with_the_fit(rng, many) -> None:
    split = split_of(measure(rng, PLAIN), rng)
    numbers, lengths = figures(split)
    many(500)
    others, other_lengths = figures(split)
    assert others == pytest.approx(numbers, rel=1e-9)
    assert other_lengths == pytest.approx(lengths, rel=1e-7)


def test_a_sample_has_every_target() -> None:
    """Rows of three targets in turn: no multiple of three falls on one of them alone."""
    at = drawn(ARM, np.random.default_rng(0), 24_000)
    counts = np.bincount(draw_sample(at).data.row % 3)
    assert counts.min() > 0.3 * counts.sum()
