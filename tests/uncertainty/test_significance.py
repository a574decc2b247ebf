"""Significance, bootstrap and correlation against statsmodels, refits written out, and
simulation."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from builders import drawn, one, planted, small_arm, study_of
from scipy.linalg import sqrtm
from scipy.stats import binom

from modelsel._json import to_json
from modelsel.fitting.design import Model, compute_design, residuals
from modelsel.fitting.least_squares import Fit, fit
from modelsel.fitting.whitening import Whitening
from modelsel.mechanisms.causes import Named, q, sin
from modelsel.mechanisms.registry import BUILTIN, mechanism
from modelsel.robot.rigid import from_rotation_vector
from modelsel.selection.cross_validation import fold_by_unit
from modelsel.selection.evaluation import Split, evaluate
from modelsel.uncertainty import bootstrap
from modelsel.uncertainty.bootstrap import draw_half_samples, draw_signs, run_bootstrap
from modelsel.uncertainty.parameters import (
    bootstrap_parameters,
    correlate_parameters,
    describe_parameters,
    label_terms,
    note_differences,
)
from modelsel.uncertainty.posterior import linear_posterior
from modelsel.uncertainty.significance import Significance, assess_significance, compare_nested
from modelsel.uncertainty.stability import measure_stability
from modelsel.uncertainty.summary import assess_confidence, build_log_posterior, sample_confidence

ARM = small_arm()
BASE = Model((mechanism("geometric", ARM),))
MODEL = Model(
    (*BASE.mechanisms, mechanism("joint-compliance:2", ARM), mechanism("gear-eccentricity:2", ARM))
)
NAMES = ("geometric", "joint-compliance:2", "gear-eccentricity:2")
TRUTH = np.zeros(len(MODEL.terms))
TRUTH[-3:] = 2e-4, 1e-3, -5e-4


@pytest.fixture
def split(rng: np.random.Generator) -> Split:
    """40 configurations, 10 held out, compliance and eccentricity planted, one outlier."""
    data = study_of(planted(drawn(ARM, rng, 40), MODEL.terms, TRUTH, rng, 0.1), held_out=10)
    data.outlying[4] = True
    data.problem.data.position[4] += 30.0
    return data


def linear(split: Split, fitted: Fit) -> tuple[np.ndarray, np.ndarray, list[int]]:
    """(X (m, 3, p), response (m, 3) as if fitted from nought, kept) of the training rows."""
    X, r = compute_design(split.training, fitted.terms, fitted.at())
    return X, r + X @ fitted.theta, list(fitted.found.kept)


def judged(
    split: Split, fitted: Fit, names: Sequence[str], rng: np.random.Generator
) -> tuple[Significance, ...]:
    return assess_significance(split, fitted, names, bootstrap_parameters(split, fitted, rng), rng)


@pytest.mark.integration
def test_nested_f_is_that_of_statsmodels(split: Split, rng: np.random.Generator) -> None:
    import statsmodels.api as sm

    fitted = fit(split.training, MODEL, held="nothing")
    X, y, kept = linear(split, fitted)
    whole = sm.OLS(y.ravel(), X.reshape(-1, len(TRUTH))[:, kept]).fit()
    boot, ruled = bootstrap_parameters(split, fitted, rng), set()
    for own in ([kept[-1]], kept[-2:], *([k] for k in kept[:12])):
        less = sm.OLS(
            y.ravel(), X.reshape(-1, len(TRUTH))[:, [k for k in kept if k not in own]]
        ).fit()
        f, p, _ = compare_nested(fitted, own, boot)
        expected = whole.compare_f_test(less)
        assert f == pytest.approx(expected[0], rel=1e-6)
        assert p == pytest.approx(
            max(expected[1], boot.p_value(fitted, own)), rel=1e-4
        )  # no smaller than signs allow
        ruled.add(bool(p > boot.p_value(fitted, own)))
    assert ruled == {True, False}


def test_errors_beside_orientations_are_of_positions(
    split: Split, rng: np.random.Generator
) -> None:
    """In mm, as on the ladder, however poorly orientations are measured."""
    at = split.problem
    turned = np.einsum("ijm->mij", at.pose(slice(None)).rotation)
    noise = from_rotation_vector(rng.normal(0, 0.05, (len(at), 3)))
    weights = np.diag([10.0] * 3 + [20.0] * 3)
    posed = replace(
        at,
        data=replace(at.data, rotation=noise @ turned),
        tool_rotations=None,
        whitening=Whitening(matrices=np.tile(weights, (len(at), 1, 1))),
    )
    oriented = replace(split, problem=posed)
    whole = evaluate(oriented, MODEL, NAMES)
    for one_mechanism in judged(oriented, whole.fit, NAMES, rng):
        assert one_mechanism.cv_rms_mm == pytest.approx(whole.cv_rms_mm, rel=1e-6)


@pytest.mark.integration
def test_what_is_lost_without_a_mechanism(split: Split, rng: np.random.Generator) -> None:
    """Every column against fits of the smaller model, fold by fold and on held-out rows; the whole
    model's against its rung."""
    whole = evaluate(split, MODEL, NAMES)
    rows = {s.mechanism: s for s in judged(split, whole.fit, NAMES, rng)}
    assert set(rows) == set(NAMES)
    for s in rows.values():
        assert s.cv_rms_mm == pytest.approx(whole.cv_rms_mm, rel=1e-6)
        assert s.held_out_rms_mm == pytest.approx(whole.held_out.rms_mm, rel=1e-6)
    X, y, kept = linear(split, whole.fit)
    left = [k for k in kept if k < len(TRUTH) - 2]
    prior = whole.fit.root[:, left]
    folds, cv = split.training_folds, np.zeros(len(X))
    for k in range(5):
        inside = folds != k
        A = np.vstack([X[inside][:, :, left].reshape(-1, len(left)), prior])
        beta = np.linalg.lstsq(A, np.append(y[inside].ravel(), np.zeros(len(prior))), rcond=1e-15)[
            0
        ]
        cv[~inside] = np.square(y[~inside] - X[~inside][:, :, left] @ beta).sum(1)
    ecc = rows["gear-eccentricity:2"]
    assert ecc.cv_rms_without_mm == pytest.approx(np.sqrt(cv.mean()), rel=1e-6)
    A = np.vstack([X[:, :, left].reshape(-1, len(left)), prior])
    beta = np.linalg.lstsq(A, np.append(y.ravel(), np.zeros(len(prior))), rcond=1e-15)[0]
    away, far = compute_design(
        split.problem.take(~split.estimation & ~split.outlying), MODEL.terms, whole.fit.at()
    )
    missed = far + away @ whole.fit.theta - away[:, :, left] @ beta
    assert ecc.held_out_rms_without_mm == pytest.approx(
        np.sqrt(np.square(missed).sum(1).mean()), rel=1e-6
    )
    theta = whole.fit.theta.copy()
    theta[-2:] = 0
    problem = split.problem.take(~split.outlying)
    moved = np.linalg.norm(
        residuals(problem, MODEL.terms, theta) - whole.fit.residuals(problem), axis=1
    )
    assert (ecc.mean_mm, ecc.max_mm) == pytest.approx((moved.mean(), moved.max()), rel=1e-9)
    sizes = [s.mean_mm for s in judged(split, whole.fit, NAMES, rng)]
    assert sizes == sorted(sizes, reverse=True)


@pytest.mark.slow
def test_stability_tells_effects_from_none(rng: np.random.Generator) -> None:
    """A strong effect stays in every half, an absent one in about 5 % of them over many studies."""
    model = Model(
        (one(1, "tx"), one(1, "rz"), one(2, "rz", sin(q(1))), one(3, "rz", sin(2.0 * q(2))))
    )
    at, absent = drawn(ARM, rng, 30), []
    for _ in range(200):
        problem = planted(at, model.terms, np.array([1.0, 1e-3, 1e-3, 0.0]), rng, 0.1)
        fitted = fit(problem, model)
        strong, none, nothing = measure_stability(
            problem, np.arange(30), fitted, [[2], [3], []], rng, 20
        )
        assert strong == 1.0
        assert nothing is None
        absent.append(none)
    assert 0.03 < np.mean(np.array(absent, float)) < 0.07


@pytest.mark.integration
def test_stability_of_the_study_itself(split: Split, rng: np.random.Generator) -> None:
    fitted = fit(split.training, MODEL)
    shares = {s.mechanism: s.stability for s in judged(split, fitted, NAMES, rng)}
    assert shares["gear-eccentricity:2"] == 1.0
    few = (
        split.problem.data.block < 6
    )  # too few configurations for a half to carry the model: undefined, not nought
    small = Split(
        split.problem.take(few),
        split.estimation[few],
        np.zeros(int(few.sum()), bool),
        split.folds[few],
        False,
    )
    tiny = fit(small.training, Model((one(1, "tx"), one(1, "rz"))))
    assert measure_stability(small.training, np.arange(6), tiny, [[0]], rng) != [None]
    pairs = draw_half_samples(rng, 10, 7)
    assert pairs.shape == (10, 3)
    assert all(len(set(a) | set(b)) == 6 for a, b in zip(pairs[::2], pairs[1::2], strict=True))


@pytest.mark.integration
def test_catalogue_says_sign_and_size(rng: np.random.Generator) -> None:
    wrong = TRUTH.copy()
    wrong[-3:] = -2e-4, 0.5, 0.0
    data = study_of(planted(drawn(ARM, rng, 40), MODEL.terms, wrong, rng, 0.1))
    rows = {s.mechanism: s.catalogue for s in judged(data, fit(data.training, MODEL), NAMES, rng)}
    assert rows["joint-compliance:2"] == "c2 has the other sign"
    assert rows["gear-eccentricity:2"] == "e2s is larger than usual"
    assert rows["geometric"] == "as expected"


@pytest.mark.integration
def test_mechanisms_of_one_name_are_numbered(split: Split, rng: np.random.Generator) -> None:
    """In the order of the model, whatever the order of the table."""
    fitted = fit(split.training, MODEL)
    names = ("geometric", "wave", "wave")
    told = judged(split, fitted, names, rng)
    numbers = {one.parameters: one.number for one in told}
    *_, compliance, eccentricity = MODEL.mechanisms
    assert numbers[tuple(term.symbol for term in compliance.terms)] == 1
    assert numbers[tuple(term.symbol for term in eccentricity.terms)] == 2
    assert [one.number for one in told if one.mechanism == "geometric"] == [None]


def test_no_held_out_and_no_freedom(rng: np.random.Generator) -> None:
    data = study_of(planted(drawn(ARM, rng, 12), BASE.terms, np.zeros(len(BASE.terms)), rng, 0.1))
    (only,) = judged(data, fit(data.training, BASE), ("geometric",), rng)
    assert only.held_out_rms_mm is None
    assert only.held_out_rms_without_mm is None
    assert only.cv_rms_without_mm is not None


# -- bootstrap
# ------------------------------------------------------------------------------------------------------------


@pytest.mark.integration
@pytest.mark.parametrize("many", [bootstrap.MANY_UNITS, 0], ids=("signs", "normal"))
def test_bootstrap_is_the_cluster_robust_formula(
    rng: np.random.Generator, monkeypatch: pytest.MonkeyPatch, many: int
) -> None:
    """Against CR2 written out with dense matrices (Bell & McCaffrey 2002), two targets a
    configuration; of many units, too, whose signs are not drawn one by one."""
    monkeypatch.setattr(bootstrap, "MANY_UNITS", many)
    bare = drawn(ARM, rng, 40)
    pairs = replace(
        bare.data,
        configuration=np.arange(40) // 2,
        block=np.arange(40) // 2,
        q=bare.data.q[np.arange(40) // 2 * 2],
    )
    model = Model((one(1, "tx"), one(1, "rz"), one(2, "rz"), one(2, "rz", sin(q(1)))))
    at = planted(replace(bare, data=pairs), model.terms, np.zeros(4))
    lump = np.repeat(rng.normal(0, 0.1, (20, 3)), 2, axis=0)
    at = replace(at, data=replace(at.data, position=at.data.position + lump))
    fitted = fit(at, model)
    found = run_bootstrap(fold_by_unit(at, model.terms, at.data.block, fitted.at()), fitted, rng)
    X, r = compute_design(at, model.terms, fitted.at())
    X, r = X.reshape(-1, 4), r.ravel()
    inverse = np.linalg.inv(X.T @ X)
    meat = np.zeros((4, 4))
    for k in range(20):
        rows = slice(6 * k, 6 * k + 6)
        score = (
            X[rows].T
            @ np.linalg.inv(np.real(sqrtm(np.eye(6) - X[rows] @ inverse @ X[rows].T)))
            @ r[rows]
        )
        meat += np.outer(score, score)
    expected = np.sqrt(np.diag(inverse @ meat @ inverse))
    assert np.allclose(found.errors, expected, rtol=4 / np.sqrt(2 * 999))
    assert (
        np.median(found.errors / fitted.standard_errors) > 1.15
    )  # what a configuration's two targets share counts once
    assert (found.units > 5).all()
    assert (found.units <= 20).all()
    assert set(np.unique(draw_signs(rng, 3, 5))) == {-1.0, 1.0}


@pytest.mark.integration
def test_three_answers_agree_or_are_flagged(rng: np.random.Generator) -> None:
    """Equal noise: no parameter is flagged. Noise that grows along the arm's turn: the one it hurts
    is."""
    model = Model((one(1, "tx"), one(1, "rz"), one(2, "rz", Named("current_A", "A"))))
    at = drawn(ARM, rng, 120)
    even = study_of(planted(at, model.terms, np.zeros(3), rng, 0.1))
    fitted = fit(even.training, model)
    found = describe_parameters(even, fitted, bootstrap_parameters(even, fitted, rng))
    assert not any(p.differ for p in found)
    assert note_differences(found) == ()
    assert np.allclose([p.bootstrap_error / p.standard_error for p in found], 1, atol=0.3)
    position = (
        even.problem.data.position
        + rng.normal(0, 0.5, (120, 3)) * np.square(at.data.covariates["current_A"])[:, None]
    )
    uneven = study_of(replace(at, data=replace(at.data, position=position)))
    again = fit(uneven.training, model)
    flagged = describe_parameters(uneven, again, bootstrap_parameters(uneven, again, rng))
    assert [p.symbol for p in flagged if p.differ] == [flagged[-1].symbol]
    assert flagged[-1].symbol in note_differences(flagged)[0].sentence


@pytest.mark.slow
def test_intervals_where_the_noise_grows(rng: np.random.Generator) -> None:
    """Noise that grows with what drives the last parameter: least squares' interval holds it far
    too seldom, the reported one as often as it says; its F test finds it far too often, the
    reported p does not."""
    model = Model((one(1, "tx"), one(1, "rz"), one(2, "rz", Named("current_A", "A"))))
    plain, reported, p = 0, 0, []
    for _ in range(200):
        at = drawn(ARM, rng, 60)
        noise = (
            rng.normal(0, 0.1, (60, 3))
            * (0.1 + np.square(at.data.covariates["current_A"]))[:, None]
        )
        data = study_of(
            replace(
                at,
                data=replace(
                    at.data, position=planted(at, model.terms, np.zeros(3)).data.position + noise
                ),
            )
        )
        fitted = fit(data.training, model)
        boot = bootstrap_parameters(data, fitted, rng)
        last = describe_parameters(data, fitted, boot)[-1]
        plain += abs(last.estimate) < 1.96 * last.standard_error
        reported += last.low < 0 < last.high
        p.append(compare_nested(fitted, [2], boot)[1])
    assert plain < 0.85 * 200
    assert binom.cdf(reported, 200, 0.95) > 1e-4
    assert reported < 200
    assert (
        binom.sf(sum(one_p <= 0.05 for one_p in p) - 1, 200, 0.08) > 1e-4
    )  # of F alone more than 30 of 200
    assert min(p) >= 1 / 1000


@pytest.mark.integration
def test_shrunk_parameters_have_their_prior_in_the_bootstrap(rng: np.random.Generator) -> None:
    model = Model((one(1, "tx"), one(1, "rz"), one(2, "rz", sin(q(1)))))
    at = drawn(ARM, rng, 60)
    free = fit(planted(at, model.terms, np.zeros(3), rng, 0.1), model)
    strong = np.array([0.0, 0.0, 1 / (free.factor[2] @ free.factor[2])])
    problem = planted(at, model.terms, np.zeros(3), rng, 0.1)
    fitted = fit(problem, model, precision=strong)
    found = run_bootstrap(
        fold_by_unit(problem, model.terms, problem.data.block, fitted.at()), fitted, rng
    )
    assert np.allclose(found.errors, linear_posterior(fitted).spread, rtol=0.25)


@pytest.mark.parametrize("many", [bootstrap.MANY_UNITS, 0], ids=("signs", "normal"))
def test_draws_do_not_hang_on_the_factorisation(
    rng: np.random.Generator, monkeypatch: pytest.MonkeyPatch, many: int
) -> None:
    """Another sign of the factor's columns is the same covariance, and gives the same draws."""
    monkeypatch.setattr(bootstrap, "MANY_UNITS", many)
    model = Model((one(1, "tx"), one(1, "rz"), one(2, "rz", sin(q(1)))))
    problem = planted(drawn(ARM, rng, 30), model.terms, np.zeros(3), rng, 0.1)
    fitted = fit(problem, model, precision=np.array([0.0, 0.0, 1e4]))
    turned = replace(fitted, factor=fitted.factor * [1.0, -1.0, 1.0])
    once, again = (
        run_bootstrap(
            fold_by_unit(problem, model.terms, problem.data.block, fitted.at()),
            f,
            np.random.default_rng(2),
        )
        for f in (fitted, turned)
    )
    np.testing.assert_allclose(again.draws, once.draws, atol=1e-12)


# -- correlation
# -----------------------------------------------------------------------------------------------------------


@pytest.mark.integration
def test_correlation_is_that_of_draws(split: Split, rng: np.random.Generator) -> None:
    fitted = fit(split.training, MODEL)
    found = correlate_parameters(fitted)
    kept = list(fitted.found.kept)
    draws = linear_posterior(fitted).draw(rng, 20_000).theta[:, kept]
    assert np.abs(np.corrcoef(draws.T) - found.matrix).max() < 5 / np.sqrt(20_000)
    assert len(found.symbols) == len(set(found.symbols)) == len(kept)
    assert "c2 of joint-compliance:2" in found.symbols
    strong = {
        (a, b)
        for i, a in enumerate(found.symbols)
        for j, b in enumerate(found.symbols)
        if i < j and abs(found.matrix[i, j]) > 0.9 and not {kept[i], kept[j]} & set(fitted.leaning)
    }
    assert {(p.a, p.b) for p in found.pairs} == strong
    assert all(any({p.a, p.b} <= set(c) for c in found.clusters) for p in found.pairs)


@pytest.mark.integration
def test_pairs_are_said_in_words(rng: np.random.Generator) -> None:
    model = Model(
        (
            one(1, "tx"),
            one(2, "rz", sin(q(1))),
            one(2, "rz", sin(q(1) + 0.05)),
            one(1, "ty"),
            one(3, "rz"),
        )
    )
    fitted = fit(planted(drawn(ARM, rng, 30), model.terms, np.zeros(5), rng, 0.1), model)
    found = correlate_parameters(fitted)
    (pair,) = found.pairs
    assert pair.r < -0.99
    assert "rises as" in pair.sentence
    assert found.clusters == ((pair.a, pair.b),)
    assert label_terms(model)[1:3] == (
        "k2rz of frame 2 rz · sin(q1)",
        "k2rz of frame 2 rz · sin(q1+0.05)",
    )


@pytest.mark.integration
def test_nothing_fitted_has_no_tables(rng: np.random.Generator) -> None:
    data = study_of(drawn(ARM, rng, 12))
    bare = Model(())
    fitted = fit(data.training, bare)
    found = assess_confidence(data, fitted, (), 3)
    assert (found.parameters, found.significance, found.correlation.symbols) == ((), (), ())
    nothing = build_log_posterior(data, fitted, bare, BUILTIN)
    assert nothing is None
    assert sample_confidence(found, data, nothing, 3) is found


@pytest.mark.integration
def test_tables_are_the_same_again(split: Split) -> None:
    fitted = fit(split.training, MODEL)
    found, again = (assess_confidence(split, fitted, NAMES, 3).to_dict() for _ in range(2))
    assert found["sampling"] is None
    assert to_json(found) == to_json(again)
    assert [p["symbol"] for p in found["parameters"]] == found["correlation"]["symbols"]
    assert all(p["low"] < p["estimate"] < p["high"] for p in found["parameters"])
