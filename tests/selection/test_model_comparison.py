"""Comparison of named models: the true model is best, the table is what its columns say."""

from __future__ import annotations

from dataclasses import fields, replace

import numpy as np
import pytest
from builders import drawn, planted

from modelsel.fitting.design import Model
from modelsel.mechanisms.registry import mechanism
from modelsel.robot.files import load_robot
from modelsel.selection.evaluation import evaluate
from modelsel.selection.model_comparison import ComparedModel, _split, compare

ARM = load_robot("puma760")
GEOMETRY = mechanism("geometric", ARM)
TWIST = mechanism("joint3-twist", ARM)
OTHER = mechanism("joint2-twist", ARM)
MODELS = {
    "nominal": Model(()),
    "geometry": Model((GEOMETRY,)),
    "twist": Model((GEOMETRY, TWIST)),
    "both": Model((GEOMETRY, TWIST, OTHER)),
}


@pytest.fixture
def problem(rng):
    """80 configurations, the last ten measured twice; geometric errors, a joint twist, noise."""
    terms = MODELS["twist"].terms
    sizes = [rng.normal() * (1.0 if t.unit == "mm" else 2e-3) for t in terms]
    sizes[len(MODELS["geometry"].terms) :] = [-1.4e-3] * len(TWIST.terms)
    at = drawn(ARM, rng, 80)
    again = np.r_[np.arange(80), np.arange(70, 80)]
    at = replace(at, data=at.data.take(again))
    return planted(at, terms, np.array(sizes), rng, 0.05)


def test_true_model_is_best_and_rows_are_ordered(problem) -> None:
    found = compare(problem, MODELS)
    assert found.best in ("twist", "both")
    rms = [row.cv_rms_mm for row in found.rows]
    assert rms == sorted(rms)
    rows = {row.model: row for row in found.rows}
    assert rows[found.best].difference_mm == 0.0
    assert rows[found.best].standard_error_mm == 0.0
    assert "lowest cross-validated error" in rows[found.best].note
    other = ({"twist", "both"} - {found.best}).pop()
    assert "not distinguishable from the best" in rows[other].note
    assert rows["geometry"].difference_mm > 2 * rows["geometry"].standard_error_mm > 0
    assert rows["nominal"].parameters == 0
    for weight in ("aicc_weight", "bic_weight"):
        assert sum(getattr(row, weight) for row in found.rows) == pytest.approx(1)
    ratio = rows["twist"].bic_weight / rows["both"].bic_weight
    assert ratio == pytest.approx(np.exp((rows["both"].bic - rows["twist"].bic) / 2))


def test_figures_are_those_of_evaluate(problem) -> None:
    """A row holds the evaluation of its model on the same split; half of the rows held out."""
    estimation = problem.data.block % 2 == 0
    found = compare(problem, MODELS, folds=5, seed=3, estimation=estimation)
    split = _split(problem, 5, 3, estimation)
    row = next(row for row in found.rows if row.model == "geometry")
    want = evaluate(split, MODELS["geometry"], ("geometric",))
    assert (row.cv_rms_mm, row.aicc, row.bic) == (want.cv_rms_mm, want.aicc, want.bic)
    assert row.held_out_rms_mm == want.held_out.rms_mm
    assert row.estimation_rms_mm == want.estimation.rms_mm
    assert found.evaluations["geometry"].fit.theta == pytest.approx(want.fit.theta)


def test_standard_error_is_that_of_a_bootstrap_of_configurations(problem, rng) -> None:
    """The delta method agrees with drawing whole configurations."""
    found = compare(problem, MODELS)
    row = next(row for row in found.rows if row.model == "geometry")
    lengths = [found.evaluations[name].crossed for name in ("geometry", found.best)]
    _, unit = np.unique(problem.data.block, return_inverse=True)
    count = np.bincount(unit)
    squares = np.stack([np.bincount(unit, np.square(length)) for length in lengths])
    draws = rng.multinomial(len(count), np.full(len(count), 1 / len(count)), 4000)
    one, other = np.sqrt(squares @ draws.T / (draws @ count))
    assert row.standard_error_mm == pytest.approx((one - other).std(), rel=0.1)


def test_table_has_the_documented_columns(problem) -> None:
    table = compare(problem, MODELS).to_frame()
    assert [table.index.name, *table.columns] == [f.name for f in fields(ComparedModel)]
    assert all(name in (ComparedModel.__doc__ or "") for name in table.columns)
    assert table.loc["nominal", "held_out_rms_mm"] != table.loc["nominal", "held_out_rms_mm"]
    assert set(table.index) == set(MODELS)
    assert table["cv_rms_mm"].dtype == float


@pytest.mark.integration
def test_seed_and_order_of_models(problem) -> None:
    """The folds come from the seed alone: the order of the models changes nothing."""
    backwards = dict(reversed(MODELS.items()))
    first, second = compare(problem, MODELS), compare(problem, backwards)
    assert first.rows == second.rows
    assert compare(problem, MODELS, seed=1).rows != first.rows


def test_refused(problem) -> None:
    with pytest.raises(ValueError, match="at least one"):
        compare(problem, {})
    with pytest.raises(ValueError, match=r"expected \(90,\)"):
        compare(problem, MODELS, estimation=np.ones(3, bool))
