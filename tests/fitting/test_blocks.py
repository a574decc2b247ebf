"""Any number of rows is a few passes over blocks of them: the answers are those of all rows at
once, and no cause is worked out again for every model, fold or block."""

from __future__ import annotations

from dataclasses import asdict, fields, replace

import numpy as np
import pytest
from builders import drawn, planted, study_of

from modelsel._random import generator
from modelsel.diagnosis.columns.candidate_columns import stack_design
from modelsel.fitting import problem, state_variables
from modelsel.fitting import reduction as reduce
from modelsel.fitting.design import Model, residuals
from modelsel.fitting.least_squares import fit
from modelsel.fitting.problem import Problem
from modelsel.fitting.state_variables import StateVariables
from modelsel.mechanisms.registry import mechanism
from modelsel.robot.files import load_robot
from modelsel.selection import cross_validation as folds
from modelsel.selection.comparison import compare_subsets
from modelsel.selection.cross_validation import fold, fold_by_unit
from modelsel.selection.evaluation import Split, evaluate
from modelsel.uncertainty.parameters import bootstrap_parameters
from modelsel.uncertainty.posterior import linear_posterior, weight_draws
from modelsel.uncertainty.significance import assess_significance
from modelsel.uncertainty.summary import assess_confidence

ARM = load_robot("puma760")
BASE = Model((mechanism("geometric", ARM),))
OFFERED = tuple(
    mechanism(name, ARM)
    for name in ("gravity-twist", "joint-compliance:5", "wrist-coupling:5", "link-bending:2")
)
M, BLOCK = 300, 64


@pytest.fixture
def split(rng: np.random.Generator) -> Split:
    """300 configurations, 100 held out, two effects planted, every reading of ten measured twice,
    two outliers."""
    whole = BASE + OFFERED[:2]
    theta = np.concatenate(
        [
            rng.normal(size=len(BASE.terms)) * np.array([t.size[1] / 3 for t in BASE.terms]),
            [-2e-4, -1.4e-3, -1.7e-3, 4e-4],
        ]
    )
    at = drawn(ARM, rng, M)
    again = np.r_[np.arange(M - 10), np.arange(10)]
    at = planted(replace(at, data=at.data.take(again)), whole.terms, theta, rng, 0.05)
    data = study_of(at, held_out=100)
    data.outlying[[3, 250]] = True
    return data


@pytest.fixture
def blocks(monkeypatch: pytest.MonkeyPatch):
    """Says after which calls blocks are small and nothing is remembered, as with millions of
    rows."""

    def smaller() -> None:
        for module in (folds, problem):
            monkeypatch.setattr(module, "BLOCK", BLOCK)
        monkeypatch.setattr(Problem.parts, "__defaults__", (BLOCK,))
        monkeypatch.setattr(Problem.blocks, "__defaults__", (BLOCK,))
        monkeypatch.setattr(reduce, "STREAM", 50)
        monkeypatch.setattr(state_variables, "MAX_ROWS_KEPT", BLOCK)

    return smaller


def near(one, other) -> None:
    """Equal to 1e-8, whatever they are made of."""
    if isinstance(one, float):
        assert one == pytest.approx(other, rel=1e-8, abs=1e-12)
    elif isinstance(one, (list, tuple)):
        assert len(one) == len(other)
        for a, b in zip(one, other, strict=True):
            near(a, b)
    elif isinstance(one, np.ndarray):
        np.testing.assert_allclose(one, other, rtol=0, atol=1e-8)
    elif isinstance(one, dict):
        near(list(one.items()), list(other.items()))
    else:
        assert one == other


def test_folds_of_any_size(split: Split, blocks) -> None:
    at, terms, point = split.problem, BASE.terms, fit(split.training, BASE).at()
    ways = [np.arange(M) % 3, np.arange(M) % 150, np.random.default_rng(0).permutation(M)]
    before = [fold(at, terms, own, point) for own in ways]
    (whole,) = fold_by_unit(at, terms, at.data.block, point)
    blocks()
    for own, want in zip(ways, before, strict=True):
        found = fold(at, terms, own, point)
        assert np.array_equal(found.rows, want.rows)
        for a, b in zip(found.blocks, want.blocks, strict=True):
            np.testing.assert_allclose(
                a.T @ a, b.T @ b, rtol=1e-9, atol=1e-9 * np.abs(b.T @ b).max()
            )
    parts = list(fold_by_unit(at, terms, at.data.block, point))
    assert len(parts) > 3
    assert max(len(p.blocks) for p in parts) <= BLOCK
    some = [b[np.abs(b).any(1)] for p in parts for b in p.blocks]
    for a, b in zip(some, whole.blocks, strict=True):
        np.testing.assert_allclose(a, b[: len(a)], rtol=0, atol=1e-9)
    assert np.concatenate([p.rows for p in parts]).tolist() == whole.rows.tolist()
    assert len(whole.rows) == M - 10
    assert whole.rows.max() == 6  # measured twice: one configuration


def test_table_of_subsets_in_blocks(split: Split, blocks) -> None:
    fitted = fit(split.training, BASE)
    before = compare_subsets(split, fitted, OFFERED, ("geometric",))
    blocks()
    after = compare_subsets(split, fitted, OFFERED, ("geometric",))
    assert [r.names for r in after.best] == [r.names for r in before.best]
    for a, b in zip(after.best, before.best, strict=True):
        near(
            *(
                [
                    {
                        f.name: getattr(r, f.name)
                        if f.name not in ("estimation", "held_out")
                        else vars(getattr(r, f.name))
                        for f in fields(r)
                        if f.name not in ("fit", "residual")
                    }
                    for r in (a, b)
                ]
            )
        )


def test_rows_of_the_table_are_one_linear_step(split: Split) -> None:
    """Against the linear step from the base's fit, worked out from the rows with the base's prior
    below them."""
    training = split.training
    base = fit(training, BASE)
    for row in compare_subsets(split, base, OFFERED, ("geometric",)).best[:6]:
        model, root = BASE + tuple(m for m in OFFERED if m.name in row.names), row.fit.root
        X, r = stack_design(training, model.terms, base.at())
        kept = list(row.fit.found.kept)
        theta = np.append(base.theta, np.zeros(len(model.terms) - len(base.theta)))
        step = np.linalg.lstsq(
            np.vstack([X, root])[:, kept], np.append(r, -root @ theta), rcond=1e-15
        )[0]
        theta[kept] += step
        size = np.linalg.norm(X, axis=0)
        np.testing.assert_allclose(
            row.fit.theta * size, theta * size, rtol=0, atol=1e-6 * np.abs(theta * size).max()
        )
        one = evaluate(split, model, row.names, row.fit)
        for name in ("rank", "cv_rms_mm", "cv_mean_mm", "aicc", "bic", "gcv", "log_density"):
            assert getattr(row, name) == pytest.approx(getattr(one, name), rel=1e-9)
        near([vars(row.estimation), vars(row.held_out)], [vars(one.estimation), vars(one.held_out)])


def test_confidence_in_blocks(split: Split, blocks) -> None:
    model = BASE + OFFERED[:3]
    fitted = fit(split.training, model)
    before = assess_confidence(split, fitted, model.names, 3).to_dict()
    blocks()
    near(assess_confidence(split, fitted, model.names, 3).to_dict(), before)
    boot = bootstrap_parameters(split, fitted, generator(3, "bootstrap"))
    # halves of bundles have the same answer as halves of configurations
    bundled = assess_significance(
        split, fitted, model.names, boot, generator(3, "halves"), max_bundles=60
    )
    for a, b in zip(map(asdict, bundled), before["significance"], strict=True):
        # no orientation was measured, and the record has no turns
        assert a.pop("mean_mrad") is None
        assert a.pop("max_mrad") is None
        assert abs(a["stability"] - b["stability"]) <= 0.3
        near(
            {k: v for k, v in a.items() if k != "stability"},
            {k: v for k, v in b.items() if k != "stability"},
        )


def test_thinned_weights_are_the_weights(split: Split, rng: np.random.Generator) -> None:
    fitted = fit(split.training, BASE, held="nothing")
    draws = linear_posterior(fitted).draw(rng, 200)
    draws = replace(
        draws, theta=fitted.theta + 6 * (draws.theta - fitted.theta)
    )  # so that the chain's curvature is felt
    want = weight_draws(split.training, fitted, draws)
    assert want.effective < 150
    found = weight_draws(split.training, fitted, draws, max_rows=66)
    away = [np.log(w.weight) - np.log(w.weight).mean() for w in (found, want)]
    assert np.corrcoef(*away)[0, 1] > 0.8
    assert np.std(away[0]) == pytest.approx(np.std(away[1]), rel=0.4)


def test_causes_are_evaluated_once_a_block(split: Split, blocks, monkeypatch) -> None:
    """The table's passes cost the same evaluations of the chain's moments whether it lists few
    models or many; residuals of a whole problem evaluate each block's, not all rows' for every
    block."""
    fitted = fit(split.training, BASE)
    blocks()
    evaluated: list[int] = []
    pose = StateVariables.pose
    monkeypatch.setattr(
        StateVariables, "pose", lambda self: evaluated.append(len(self.data)) or pose(self)
    )
    rows = []
    for offered in (OFFERED[1:2], OFFERED):
        evaluated.clear()
        assert (
            len(compare_subsets(split, fitted, offered, ("geometric",)).best)
            >= (2, 12)[len(offered) == 4]
        )
        rows.append(sum(evaluated))
    assert rows[1] <= 1.5 * rows[0]
    evaluated.clear()
    fresh = replace(split.problem, tools=split.problem.tools.copy())
    residuals(fresh, (*BASE.terms, *OFFERED[1].terms), np.full(len(BASE.terms) + 1, 1e-4))
    assert sum(evaluated) == M
    assert max(evaluated) == BLOCK
