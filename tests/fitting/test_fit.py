"""The fit against another program (statsmodels) and closed forms, streamed as in one piece; NIST's
sets: test_nist.py."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from builders import drawn, one, planted, seeds
from hypothesis import given
from hypothesis import strategies as st

from modelsel.exceptions import NotEstimable
from modelsel.fitting.design import Model, compute_design
from modelsel.fitting.identifiability import identify
from modelsel.fitting.least_squares import fit
from modelsel.fitting.problem import Problem
from modelsel.fitting.reduction import Reduction, merged, reduce, reduce_problem
from modelsel.fitting.whitening import Whitening
from modelsel.mechanisms.causes import Named
from modelsel.mechanisms.registry import mechanism
from modelsel.robot.files import load_robot

# -- problems
# -----------------------------------------------------------------------------------------------------------

WHOLE = ("geometric", "joint2-twist", "joint3-twist", "wrist-coupling")


def whole(robot: str = "puma760") -> Model:
    return Model(tuple(mechanism(name, load_robot(robot)) for name in WHOLE))


def some(which: Model, rng: np.random.Generator, mm: float = 1.0, rad: float = 3e-3) -> np.ndarray:
    return rng.normal(size=len(which.terms)) * [mm if t.unit == "mm" else rad for t in which.terms]


@pytest.mark.parametrize("robot", ["puma760", "ur5", "irb120"])
@pytest.mark.parametrize(("mm", "rad"), [(0.5, 2e-3), (2.5, 1e-2)], ids=["small", "large"])
def test_exact_recovery(robot, mm, rad, rng) -> None:
    """No noise: the representatives come back on the exact chain, at the upper end of the usual
    sizes too."""
    which, at = whole(robot), drawn(robot, rng, 60)
    kept = list(fit(at, which, held="nothing").found.kept)
    theta = np.zeros(len(which.terms))
    theta[kept] = some(which, rng, mm, rad)[kept]
    found = fit(planted(at, which.terms, theta), which, held="nothing")
    np.testing.assert_allclose(found.theta, theta, rtol=1e-6, atol=1e-9)
    assert found.rss < 1e-15 * found.rows * mm
    assert found.step_mm < 1e-4


@seeds(1, 2)
def test_single_steps_do_not_run_away(rng) -> None:
    """From far off, every step lowers the cost, however few are asked for at a time."""
    which, at = Model((mechanism("geometric", load_robot("ur5")),)), drawn("ur5", rng, 20)
    moved = planted(at, which.terms, some(which, rng), rng, 0.05)
    far = some(which, rng, mm=80.0, rad=0.08)
    slow = fit(moved, which, start=far, iterations=1)
    assert slow.rss < 2 * fit(moved, which).rss


@pytest.mark.integration
@seeds(1, 2)
def test_estimate_and_covariance_are_statsmodels(rng) -> None:
    """At the solution, the linear regression of what is left, on the representatives."""
    import statsmodels.api as sm

    which = whole()
    at = planted(drawn("puma760", rng, 50), which.terms, some(which, rng), rng, 0.1)
    found = fit(at, which, held="nothing")
    kept = list(found.found.kept)
    X, left = (part.reshape(150, -1) for part in compute_design(at, which.terms, found.at()))
    other = sm.OLS(left[:, 0] + X[:, kept] @ found.theta[kept], X[:, kept]).fit(method="qr")
    np.testing.assert_allclose(found.theta[kept], other.params, rtol=1e-6, atol=1e-9)
    np.testing.assert_allclose(found.standard_errors[kept], other.bse, rtol=1e-7)
    np.testing.assert_allclose(
        found.covariance[np.ix_(kept, kept)],
        other.cov_params(),
        rtol=1e-6,
        atol=1e-6 * np.square(other.bse).min(),
    )
    assert found.sigma == pytest.approx(np.sqrt(other.mse_resid), rel=1e-9)
    assert found.freedom == other.df_resid
    lost = [k for k in range(len(which.terms)) if k not in kept]
    assert not found.theta[lost].any()
    assert not found.standard_errors[lost].any()
    np.testing.assert_allclose(found.residuals(at), left.reshape(50, 3), atol=1e-9)


def test_weights(rng) -> None:
    """Every row its own covariance: generalised least squares, by the normal equations of the whole
    covariance."""
    which = Model((mechanism("gravity-twist", load_robot("puma760")),))
    at = planted(drawn("puma760", rng, 30), which.terms, np.array([1e-3, -2e-3, 5e-4]), rng, 0.3)
    A = rng.normal(size=(30, 3, 3)) + 3 * np.eye(3)
    spread = A @ A.transpose(0, 2, 1)
    found = fit(
        replace(at, whitening=Whitening(matrices=np.linalg.inv(np.linalg.cholesky(spread)))), which
    )
    X, r = compute_design(at, which.terms, found.at())
    weight = np.linalg.inv(spread)
    gram = np.einsum("mip,mij,mjq->pq", X, weight, X)
    assert (
        np.abs(np.einsum("mip,mij,mj->p", X, weight, r)).max() < 1e-3 * np.sqrt(np.diag(gram)).min()
    )
    np.testing.assert_allclose(found.factor @ found.factor.T, np.linalg.inv(gram), rtol=1e-9)


def test_prior(rng) -> None:
    """A precision shrinks towards nought, not towards the last iterate: at the solution X'r = P
    theta."""
    which = whole()
    at = planted(drawn("puma760", rng, 40), which.terms, some(which, rng), rng, 0.1)
    precision = np.array([0.0 if t.unit == "mm" else 1e6 for t in which.terms])
    found = fit(at, which, precision=precision, held="nothing")
    X, r = (part.reshape(120, -1) for part in compute_design(at, which.terms, found.at()))
    kept = list(found.found.kept)
    slope = (X.T @ r[:, 0] - precision * found.theta)[kept]
    np.testing.assert_allclose(slope / np.linalg.norm(X[:, kept], axis=0), 0, atol=1e-3)
    inner = np.linalg.inv(X[:, kept].T @ X[:, kept] + np.diag(precision[kept]))
    assert found.rows - found.freedom == pytest.approx(
        np.trace(X[:, kept] @ inner @ X[:, kept].T), rel=1e-6
    )
    assert np.linalg.norm(precision * found.theta) < np.linalg.norm(
        precision * fit(at, which, held="nothing").theta
    )


@pytest.mark.parametrize("m", [5, 9])
def test_too_few_rows_are_refused(m, rng) -> None:
    with pytest.raises(
        NotEstimable, match=f"{3 * m} measured coordinates cannot determine"
    ) as caught:
        fit(drawn("puma760", rng, m), whole())
    assert caught.value.exit_code == 4
    assert "γ3" in caught.value.parameters


# -- streaming
# --------------------------------------------------------------------------------------------------------


def same(one: Reduction, other: Reduction) -> None:
    """Equal Gram matrices of unit columns (rows of R may differ in sign)."""
    scale = np.linalg.norm(one.R, axis=0)
    scale[scale == 0] = 1
    np.testing.assert_allclose(
        (one.R / scale).T @ (one.R / scale), (other.R / scale).T @ (other.R / scale), atol=1e-12
    )
    assert one.rows == other.rows


@pytest.mark.parametrize("late", [False, True], ids=["dependent", "not dependent after all"])
def test_dependent_terms_are_put_back(late, rng, monkeypatch) -> None:
    """Terms left out of the factorisation come back as they are; one that only the probe's rows
    made dependent is noticed."""
    from modelsel.fitting import reduction as reducer

    which = Model((*whole().mechanisms, one(4, "rx", Named("payload_kg", "kg"))))
    at = planted(
        drawn("puma760", rng, 400), which.terms, 1e-4 * rng.normal(size=len(which.terms)), rng, 0.1
    )
    load_ = np.full(400, 2.0)
    load_[157] += late  # a payload that changes in one row, which no probe of 20 sees
    data = replace(at.data, covariates={**at.data.covariates, "payload_kg": load_})
    at = replace(at, data=data)
    plain = reduce_problem(at, which.terms)
    monkeypatch.setattr(reducer, "PROBE", (20, 100))
    monkeypatch.setattr(reducer, "STREAM", 64)
    streams: list[int] = []
    right = reducer._stream
    monkeypatch.setattr(reducer, "_stream", lambda *a: streams.append(len(a[3])) or right(*a))
    again = reduce_problem(at, which.terms)
    same(plain, again)
    assert identify(again).kept == identify(plain).kept
    assert (len(which.terms) + 1 in streams[1:]) == late  # the first is the probe's own


@pytest.mark.parametrize("size", [7, 64])
def test_streamed_is_one_piece(size, rng, monkeypatch) -> None:
    which = whole()
    at = planted(drawn("puma760", rng, 100), which.terms, some(which, rng), rng, 0.1)
    at = replace(
        at,
        whitening=Whitening(matrices=np.linalg.inv(np.eye(3) + 0.1 * rng.normal(size=(100, 3, 3)))),
    )
    once, reduction = fit(at, which), reduce_problem(at, which.terms)
    left = once.residuals(at)
    in_one = Problem.blocks
    seen: list[int] = []

    def small(self: Problem, _: int = 0):
        for rows in in_one(self, size):
            seen.append(rows.stop - rows.start)
            yield rows

    monkeypatch.setattr(Problem, "blocks", small)
    same(reduction, reduce_problem(at, which.terms))
    again = fit(at, which)
    assert max(seen) == size
    assert again.found.kept == once.found.kept
    np.testing.assert_allclose(
        again.theta, once.theta, rtol=1e-10, atol=1e-10 * np.abs(once.theta).max()
    )
    np.testing.assert_allclose(again.standard_errors, once.standard_errors, rtol=1e-8)
    np.testing.assert_allclose(again.residuals(at), left, atol=1e-9)
    assert again.rss == pytest.approx(once.rss, rel=1e-10)


@given(
    st.integers(0, 10**6), st.integers(1, 6), st.lists(st.integers(0, 12), min_size=3, max_size=3)
)
def test_merge_is_associative(seed, p, heights) -> None:
    """Any grouping and order of parts, empty and short ones too, is the whole matrix."""
    rng = np.random.default_rng(seed)
    parts = [
        reduce(rng.normal(size=(h, p)) * 10.0 ** rng.integers(-3, 4, p), rng.normal(size=h))
        for h in heights
    ]
    a, b, c = parts
    for grouping in (
        a.merge(b.merge(c)),
        merged(parts),
        merged([c, a, b]),
        Reduction.empty(p).merge(merged(parts)),
    ):
        same(a.merge(b).merge(c), grouping)


def test_reduction_is_the_gram_matrix(rng) -> None:
    X, y = rng.normal(size=(40, 5)), rng.normal(size=40)
    whole_of = np.column_stack([X, y])
    out = reduce(X[:17], y[:17]).add(whole_of[17:])
    np.testing.assert_allclose(out.R.T @ out.R, whole_of.T @ whole_of, rtol=1e-12, atol=1e-12)
    assert out.rows == 40
    assert np.array_equal(out.R, np.triu(out.R))
    same(out.select([3, 0]), reduce(X[:, [3, 0]], y))


@pytest.mark.parametrize("noise", [{"floor_mm": 0.05}, {"range_mm": 0.02, "angle_urad": 5.0}])
def test_distances_are_from_where_the_tracker_stands(noise) -> None:
    """With or without the instrument's figures."""
    from modelsel import Study, read_measurements
    from modelsel.study.preparation.preparation import prepare

    file = Path(__file__).parents[2] / "studies" / "puma760" / "measurements.csv"
    study = Study(
        name="far",
        robot={"name": "puma760", "tool_mm": [0, 0, 100]},
        measurements=file,
        split={"estimation": 80},
        noise={**noise, "tracker_mm": [4000, 0, 500]},
    )
    measured = read_measurements(file, (False,) * 6)
    data = prepare(study, load_robot("puma760"), measured)[0]
    distance = np.linalg.norm(measured.position - [4000, 0, 500], axis=1)
    np.testing.assert_allclose(
        data.problem.value("range_mm"), distance, atol=15
    )  # nominal target against measured
