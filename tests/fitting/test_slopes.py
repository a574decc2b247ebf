"""Steps towards the minimum without the model's columns, and judgements by their products: the
same as of the columns themselves."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from builders import bind, drawn, planted
from gauged import TOOL, Campaign

from modelsel.fitting import gauss_newton, solver
from modelsel.fitting.design import Model, assemble, whiten
from modelsel.fitting.expansion import Expansion, Unsafe
from modelsel.fitting.gradient import Rows
from modelsel.fitting.least_squares import STEP_MM, begin, fit, solver_of
from modelsel.fitting.linearisation import Linearisation
from modelsel.fitting.prior import Shrinkage
from modelsel.fitting.problem import Problem
from modelsel.fitting.reduction import independent, multiply_problem, reduce, reduce_problem
from modelsel.fitting.shrinkage import (
    MAX_PRECISION,
    MIN_EFFECTIVE,
    TOLERANCE,
    fit_shrunk,
    variances,
)
from modelsel.fitting.solver import ITERATIONS
from modelsel.fitting.whitening import Whitening
from modelsel.measurements.reader import read_measurements
from modelsel.mechanisms.geometry import build_setup
from modelsel.mechanisms.registry import mechanism
from modelsel.robot.files import load_robot

ARM = load_robot("puma760")
EFFECTS = tuple(
    mechanism(name, ARM) for name in ("gravity-twist", "joint-compliance:5", "wrist-coupling:5")
)
MODEL = Model((mechanism("geometric", ARM), *EFFECTS))


def points(rng: np.random.Generator) -> tuple[Problem, Model]:
    return drawn(ARM, rng, 70), MODEL


def weighted(rng: np.random.Generator) -> tuple[Problem, Model]:
    """Each row with a whitening of its own, none of it symmetric."""
    at = drawn(ARM, rng, 70)
    return replace(at, whitening=Whitening(3.0, rng.normal(size=(70, 3, 3)))), MODEL


def oriented(rng: np.random.Generator) -> tuple[Problem, Model]:
    at = drawn(ARM, rng, 70)
    turned = np.broadcast_to(np.eye(3), (70, 3, 3)) + rng.normal(size=(70, 3, 3)) * 1e-3
    return bind(ARM, replace(at.data, rotation=turned)), MODEL


def read(rng: np.random.Generator, folder) -> tuple[Problem, Model]:
    """Points, wires, distances and plates, whose features are fitted, too."""
    campaign = Campaign(rng)
    campaign.points(10)
    campaign.wires(20)
    campaign.distances(20)
    campaign.plates(20, 2)
    data = read_measurements(campaign.file(folder), [False] * 6)
    setup = build_setup(ARM, 1, 1, True, False, data.gauges.features)
    return bind(ARM, data, TOOL), Model((setup, *MODEL.mechanisms))


@pytest.mark.parametrize("kind", [points, weighted, oriented, read])
def test_the_slope_is_that_of_the_columns(kind, rng, tmp_path, monkeypatch) -> None:
    at, model = kind(rng, tmp_path) if kind is read else kind(rng)
    theta = rng.normal(size=len(model.terms)) * 1e-3
    whole = whiten(at, assemble(at, model.terms, Linearisation(model.terms, theta)))
    block = at.select_measured(whole.reshape(len(theta) + 1, -1))
    products = block[:-1] @ block[-1]
    size = np.linalg.norm(block[:-1], axis=1) * np.linalg.norm(block[-1])
    for most in (0, 10**9):  # causes made anew, and kept
        monkeypatch.setattr("modelsel.fitting.gradient.MAX_KEPT", most)
        monkeypatch.setattr("modelsel.fitting.gradient.ROWS", 32)
        slope = Rows(at, model.terms).at(theta)
        assert slope.squares == pytest.approx(block[-1] @ block[-1], rel=1e-12)
        assert (np.abs(slope.products - products) <= 1e-12 * size).all()


def test_products_say_what_the_reduction_says(rng) -> None:
    at, _ = points(rng)
    theta = rng.normal(size=len(MODEL.terms)) * 1e-3
    here = Linearisation(MODEL.terms, theta)
    only = [2, 0, 39]
    products, few = multiply_problem(at, MODEL.terms, here, only)
    by_products = Expansion.of_products(theta, products)
    selected = reduce_problem(at, MODEL.terms, here).select(only).R
    np.testing.assert_allclose(few.R.T @ few.R, selected.T @ selected, rtol=1e-9, atol=1e-9)
    exact = Expansion.of_reduction(theta, reduce_problem(at, MODEL.terms, here))
    np.testing.assert_allclose(by_products.gram, exact.gram, rtol=1e-9, atol=1e-6)
    others, sized = range(39, len(theta)), [0, 3, 7, 8, 13]
    shrinkage = Shrinkage.of(MODEL.terms, np.where(np.arange(len(theta)) == 40, 2.0, 0.0))
    root = shrinkage.rows
    a, b = (e.triangle(others, sized, shrinkage) for e in (by_products, exact))
    np.testing.assert_allclose(a.top.T @ a.top, b.top.T @ b.top, rtol=1e-8)
    np.testing.assert_allclose(a.seen.root.T @ a.seen.root, b.seen.root.T @ b.seen.root, rtol=1e-8)
    said = [t.seen.root.T @ t.seen.response for t in (a, b)]
    np.testing.assert_allclose(*said, rtol=1e-7)
    held = a.held(np.eye(len(theta)))
    whole = by_products.gram[np.ix_(a.order, a.order)] + root[:, a.order].T @ root[:, a.order]
    whole[len(others) :, len(others) :] += np.eye(len(sized))
    np.testing.assert_allclose(held.T @ held, whole, rtol=1e-8)


def test_products_do_not_do_for_columns_that_all_but_depend(rng) -> None:
    X = rng.normal(size=(40, 3))
    X[:, 2] = X[:, 0] + 1e-6 * X[:, 1]
    both = np.column_stack([X[:, [0, 2]], X[:, 1]])
    theta, none = np.zeros(2), Shrinkage(None, np.zeros((0, 2)))
    with pytest.raises(Unsafe):
        Expansion.of_products(theta, both.T @ both).triangle([0, 1], [], none)
    exact = Expansion.of_reduction(theta, reduce(both[:, :2], both[:, 2]))
    assert abs(exact.triangle([0, 1], [], none).top[1, 1]) > 1e-6


def test_columns_that_depend_are_found_among_many(rng) -> None:
    """More than are orthogonalised at once, the dependent ones anywhere."""
    X = rng.normal(size=(200, 90))
    X[:, [5, 40, 70]] = X[:, [3, 39, 2]] + X[:, [1, 33, 65]]
    X[:, 50] = 0
    R = np.linalg.qr(X, mode="r")
    assert independent(R)[0] == [k for k in range(90) if k not in (5, 40, 50, 70)]


def test_few_reductions_do(rng, monkeypatch) -> None:
    """A fit reduces its rows at the nominal arm and at the solution; in between it walks."""
    theta = rng.normal(size=len(MODEL.terms)) * [t.usual or 1e-5 for t in MODEL.terms]
    at = planted(drawn(ARM, rng, 100), MODEL.terms, theta, rng, 0.03)
    calls = []
    for module, name in ((solver, "reduce_problem"), (gauss_newton, "multiply_problem")):
        whole = getattr(module, name)
        monkeypatch.setattr(module, name, lambda *a, f=whole: (calls.append(1), f(*a))[1])
    found = fit(at, MODEL)
    assert len(calls) <= 7
    there = reduce_problem(at, MODEL.terms, found.at())
    np.testing.assert_allclose(found.reduction.R, there.R, atol=1e-9 * np.abs(there.R).max())
    again = fit(at, MODEL, start=found.theta)
    np.testing.assert_allclose(again.theta, found.theta, rtol=1e-6, atol=1e-9)
    assert fit_shrunk(at, MODEL).rss == found.rss


@pytest.mark.parametrize("groups", [[[39, 40], [41]], [[39, 40], [40, 41]], [[41, 39]]])
def test_variances_are_those_of_the_whole_inverse(groups, rng) -> None:
    """MacKay's fixed point, with all terms in one matrix; groups may share a term."""
    theta = rng.normal(size=len(MODEL.terms)) * [t.usual or 1e-5 for t in MODEL.terms]
    at = planted(drawn(ARM, rng, 100), MODEL.terms, theta, rng, 0.03)
    groups = [np.array(group) for group in groups]
    precision = np.where(np.isin(np.arange(len(theta)), np.concatenate(groups)), 1.0, 0.0)
    solver_ = solver_of(at, MODEL, precision, "geometry")
    state = begin(solver_, np.zeros(len(theta)), precision, ITERATIONS, STEP_MM)
    found = variances(solver_, state, groups)
    kept, gram = list(state.found.kept), state.expansion.gram
    response = (state.slope.products + gram @ state.theta)[kept]
    gram, before = gram[np.ix_(kept, kept)], np.zeros(len(kept))
    weak = np.zeros((0, len(theta))) if state.weak.rows is None else state.weak.rows
    inside = [np.array([kept.index(k) for k in group]) for group in groups]
    now = precision[kept]
    while not np.allclose(now, before, rtol=TOLERANCE):
        before, now = now, now.copy()
        inverse = np.linalg.inv(gram + weak[:, kept].T @ weak[:, kept] + np.diag(before))
        beta = inverse @ response
        used = [len(i) - before[i] @ np.diagonal(inverse)[i] for i in inside]
        step = beta - state.theta[kept]
        rss = state.slope.squares - 2 * step @ state.slope.products[kept] + step @ gram @ step
        freedom = solver_.nominal.rows - (len(kept) - sum(map(len, inside))) - sum(used)
        for i, count in zip(inside, used, strict=True):
            size = max(np.square(beta[i]).sum(), 1e-300)
            ratio = rss / freedom * max(count, MIN_EFFECTIVE) / size
            now[i] = min(ratio, MAX_PRECISION * np.diagonal(gram)[i].max())
    np.testing.assert_allclose(found[kept], now, rtol=1e-6)
