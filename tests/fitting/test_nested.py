"""Fits of some terms of a model that very many rows were reduced on: the minimum that a fit of their
own has."""

from __future__ import annotations

import numpy as np
import pytest
from builders import drawn, planted, seeds, split_of

from modelsel._typing import Array, Index
from modelsel.fitting import nested, sampled
from modelsel.fitting.design import Model
from modelsel.fitting.folded_rows import FoldedProblem, Point, measure_slopes
from modelsel.fitting.least_squares import Fit
from modelsel.fitting.nested import Reduced, fit_within
from modelsel.fitting.problem import Problem
from modelsel.fitting.shrinkage import fit_shrunk
from modelsel.mechanisms.causes import Bump, q, sin, torque
from modelsel.mechanisms.registry import mechanism
from modelsel.mechanisms.terms import Mechanism, Screw, Term
from modelsel.robot.files import load_robot
from modelsel.selection.comparison import compare_subsets
from modelsel.selection.evaluation import Split, evaluate

ARM = load_robot("puma760")
ROWS = 1600
GEOMETRY = mechanism("geometric", ARM)
SPRING = mechanism("joint-compliance:2", ARM)
BUMPS = tuple(Bump("q3", centre, 0.4) for centre in np.arange(-1.2, 1.3, 0.4).tolist())
CURVE = Mechanism(
    "free(q3)", tuple(Term(f"s{k}", (Screw(3, "rz", b),)) for k, b in enumerate(BUMPS))
)


def effect(name: str, frame: int, cause: object) -> Mechanism:
    return Mechanism(name, (Term("w", (Screw(frame, "rz", cause),)),))


WAVE = effect("wave", 2, sin(5.0 * q(2)))
LOAD = effect("load", 3, torque(3))


def measure(rng: np.random.Generator) -> Problem:
    whole = Model((GEOMETRY, SPRING, WAVE, effect("own", 3, sin(q(3)))))
    sizes = [0.3 if term.unit == "mm" else 1e-3 for term in whole.terms]
    theta = rng.normal(0, 1, len(sizes)) * sizes
    theta[-3:] = 4e-6, 3e-4, 4e-4
    return planted(drawn(ARM, rng, ROWS), whole.terms, theta, rng, 0.05)


def fold_of(at: Problem, rng: np.random.Generator) -> Index:
    return np.asarray(rng.integers(0, 5, len(at)), dtype=np.intp)


@pytest.fixture
def many(monkeypatch):
    """A function that makes the rows very many."""
    return lambda: monkeypatch.setattr(sampled, "MANY_ROWS", 1000)


def fit_both(
    at: Problem, whole: Model, part: Model, folds: Index, many: object
) -> tuple[Fit, Fit | None]:
    """The part's own fit, and that within the whole's."""
    own = fit_shrunk(at, part, held="all")
    many()
    last = fit_shrunk(at, whole, held="all", fold_of=folds)
    reduced = Reduced.by(last, FoldedProblem.of(at, folds))
    return own, fit_within(at, part, reduced, "all")


@pytest.mark.parametrize("curve", [(), (CURVE,)], ids=["plain", "free function"])
@pytest.mark.parametrize("dropped", ["last", "first"])
@seeds(1)
def test_the_minimum_is_that_of_an_own_fit(curve, dropped, rng, many) -> None:
    at = measure(rng)
    whole = Model((GEOMETRY, SPRING, WAVE, *curve))
    left = {"last": (GEOMETRY, SPRING, *curve), "first": (GEOMETRY, WAVE, *curve)}[dropped]
    own, within = fit_both(at, whole, Model(left), fold_of(at, rng), many)
    assert within is not None
    # the variance of a free function is found to a thousandth
    tolerance = 1e-5 if curve else 1e-6
    assert within.rss == pytest.approx(own.rss, rel=tolerance)
    apart = within.residuals(at) - own.residuals(at)
    assert np.abs(apart).max() < 3e-3 * own.sigma / at.whitening.typical_weight()
    assert len(within.found.kept) - within.weak.held == len(own.found.kept) - own.weak.held


@seeds(1)
def test_folds_are_those_of_the_minimum(rng, many) -> None:
    """The reduction of every fold has its exact slope at the solution."""
    at = measure(rng)
    folds = fold_of(at, rng)
    _, within = fit_both(at, Model((GEOMETRY, SPRING, WAVE)), Model((GEOMETRY, WAVE)), folds, many)
    assert within is not None
    point = Point(within.terms, within.theta)
    (slopes,) = measure_slopes(FoldedProblem.of(at, folds), [point])
    exact = list(within.found.kept)
    for part, slope in zip(within.reduction.parts, slopes, strict=True):
        assert np.square(part.R[:, -1]).sum() == pytest.approx(slope.squares, rel=1e-6)
        products = part.R[:, :-1].T @ part.R[:, -1]
        norm = np.linalg.norm(part.R[:, exact], axis=0) * np.sqrt(slope.squares)
        assert (
            np.abs((products - slope.products)[exact] / norm).max() < 1e-4
        )  # of another fold: 1e-2


@seeds(1)
def test_what_was_not_reduced_is_not_fitted(rng, many, monkeypatch) -> None:
    at = measure(rng)
    folds = fold_of(at, rng)
    whole = Model((GEOMETRY, SPRING))
    _, within = fit_both(at, whole, Model((GEOMETRY, LOAD)), folds, many)
    assert within is None
    last = fit_shrunk(at, whole, held="all", fold_of=folds)
    reduced = Reduced.by(last, FoldedProblem.of(at, folds))
    part = Model((GEOMETRY,))
    assert fit_within(at, part, reduced, "all") is not None
    monkeypatch.setattr(nested, "STEPS", 1)  # a step, and no word of what it left
    assert fit_within(at, part, reduced, "all") is None


def figures(split: Split) -> Array:
    """The figures of every subset that is listed."""
    base = evaluate(split, Model((GEOMETRY,)), ("geometric",))
    comparison = compare_subsets(split, base.fit, [SPRING, WAVE, LOAD], ("geometric",))
    table = [
        [one.cv_rms_mm, one.cv_mean_mm, one.log_density, one.held_out.rms_mm, one.bic, one.weight]
        for one in comparison.best
    ]
    return np.array(table, dtype=float)


@seeds(1)
def test_subsets_have_the_figures_of_their_blocks(rng, many) -> None:
    split = split_of(measure(rng), rng)
    by_blocks = figures(split)
    many()
    by_slopes = figures(split)
    assert by_slopes == pytest.approx(by_blocks, rel=2e-5, abs=1e-12)
