"""Variances by restricted likelihood: lme4's published examples, NIST's certified analyses of
variance, statsmodels, the analysis of variance of balanced data, finite differences."""

from __future__ import annotations

import csv
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from builders import seeds
from scipy.stats import f, multivariate_normal

from modelsel._typing import Array
from modelsel.fitting import largest_likelihood
from modelsel.fitting.largest_likelihood import maximise_likelihood
from modelsel.fitting.noise import compute_interval
from modelsel.fitting.part_trials import compute_p
from modelsel.fitting.restricted_likelihood import Likelihood, LinearModel, evaluate_likelihood
from modelsel.fitting.shared_errors import SharedError

FOLDER = Path(__file__).parent / "mixed"


def read(name: str) -> dict[str, list[str]]:
    lines = (FOLDER / f"{name}.csv").read_text().splitlines()
    rows = list(csv.DictReader(lines[1:]))
    return {key: [row[key] for row in rows] for key in rows[0]}


def model_of(X: Array, y: Array) -> LinearModel:
    """A model of columns (m, p) and a response (m,), one coordinate a row."""
    return LinearModel(np.ascontiguousarray(X.T[:, None]), y[None], float(len(y) - X.shape[1]))


def part_of(labels: object, loading: Array | None = None, variance: float = 1.0) -> SharedError:
    """A random effect of the labels, times a loading (m,)."""
    level = np.unique(np.asarray(labels), return_inverse=True)[1].astype(np.intp)
    moved = np.ones(len(level)) if loading is None else loading
    return SharedError(moved[:, None, None], level, variance)


def estimates(model: LinearModel, parts: list[SharedError]) -> list[float]:
    """Variances of the parts, then of what is left."""
    at = maximise_likelihood(model, parts)
    return [*(part.variance * at.phi for part in at.parts), at.phi]


def criterion(model: LinearModel, parts: list[SharedError], X: Array) -> float:
    """What R calls the REML criterion: minus twice the log likelihood, with its constants."""
    at = maximise_likelihood(model, parts)
    n = model.freedom
    return float(n * np.log(2 * np.pi / n) + n - at.log)


def sleep() -> tuple[Array, Array, list[str]]:
    data = read("sleepstudy")
    days = np.array(data["day"], float)
    return (
        np.stack([np.ones(len(days)), days], 1),
        np.array(data["reaction"], float),
        data["subject"],
    )


# -- published: Bates, Maechler, Bolker & Walker (2015), J. Stat. Software 67(1), and lme4's manual


def test_dyestuff() -> None:
    data = read("dyestuff")
    y = np.array(data["yield"], float)
    X = np.ones((len(y), 1))
    got = estimates(model_of(X, y), [part_of(data["batch"])])
    np.testing.assert_allclose(got, [1764.05, 2451.25], atol=0.005)
    assert criterion(model_of(X, y), [part_of(data["batch"])], X) == pytest.approx(
        319.6543, abs=5e-5
    )


def test_a_guess_beyond_all_bounds_ends_where_another_one_does() -> None:
    """What leaves next to nothing guesses variances of no measurement."""
    data = read("dyestuff")
    y = np.array(data["yield"], float)
    X = np.ones((len(y), 1))
    got = estimates(model_of(X, y), [part_of(data["batch"], variance=1e25)])
    np.testing.assert_allclose(got, [1764.05, 2451.25], atol=0.05)


def test_penicillin_whose_effects_are_crossed() -> None:
    data = read("penicillin")
    y = np.array(data["diameter"], float)
    X = np.ones((len(y), 1))
    parts = [part_of(data["plate"]), part_of(data["sample"])]
    got = np.sqrt(estimates(model_of(X, y), parts))
    np.testing.assert_allclose(got, [0.8467, 1.9316, 0.5499], atol=5e-5)
    assert criterion(model_of(X, y), parts, X) == pytest.approx(330.8606, abs=5e-5)


def test_sleepstudy_with_a_slope_of_every_subject() -> None:
    X, y, subject = sleep()
    # the slopes' variance is in other units than the intercepts'
    parts = [part_of(subject), part_of(subject, X[:, 1], 0.1)]
    got = estimates(model_of(X, y), parts)
    np.testing.assert_allclose(got, [627.57, 35.86, 653.58], atol=0.005)
    assert criterion(model_of(X, y), parts, X) == pytest.approx(1743.7, abs=0.05)


# NIST's analyses of variance and the digits of their variances, from the data that scipy ships: of
# the last two, the data themselves have no more. Left out: levels of 2,001 rows, which are cut.
CERTIFIED = {
    "SiRstv": 5,
    "SmLs01": 7,
    "SmLs02": 7,
    "AtmWtAg": 4,
    "SmLs04": 7,
    "SmLs05": 7,
    "SmLs07": 3,
    "SmLs08": 3,
}


@pytest.mark.parametrize("name", CERTIFIED)
def test_certified_analysis_of_variance(name: str) -> None:
    file = files("scipy.stats") / "tests" / "data" / "nist_anova" / f"{name}.dat"
    lines = file.read_text(encoding="utf-8").splitlines()
    # (of, degrees of freedom, sum of squares, mean square, F)
    table = {line.split()[0]: line.split() for line in lines[:60] if line.strip()}
    between, within = float(table["Between"][-2]), float(table["Within"][-1])
    rows = np.array([line.split() for line in lines[60:] if line.strip()], float)
    level, y = rows.T
    # a fit sees what is off a nominal value
    y = y - y[0]
    each = len(y) / len(np.unique(level))
    got = estimates(model_of(np.ones((len(y), 1)), y), [part_of(level)])
    certified = [(between - within) / each, within]
    np.testing.assert_allclose(got, certified, rtol=10.0 ** -CERTIFIED[name])


# -- other referees


@seeds(1, 2, 3)
def test_balanced_data_give_the_analysis_of_variance(rng: np.random.Generator) -> None:
    groups, each = int(rng.integers(8, 40)), int(rng.integers(2, 9))
    level = np.repeat(np.arange(groups), each)
    y = 3.0 + rng.normal(0, 1.0 + rng.random(), groups)[level] + rng.normal(size=len(level))
    means = y.reshape(groups, each).mean(1)
    within = np.square(y - means[level]).sum() / (groups * (each - 1))
    between = each * np.square(means - y.mean()).sum() / (groups - 1)
    order = rng.permutation(len(y))
    got = estimates(model_of(np.ones((len(y), 1)), y[order]), [part_of(level[order])])
    np.testing.assert_allclose(got, [(between - within) / each, within], rtol=1e-5)


@seeds(1, 2, 3)
def test_a_part_that_is_less_than_chance_is_none(rng: np.random.Generator) -> None:
    """Groups whose means differ less than by chance have a variance of nought."""
    y = rng.normal(size=(20, 4))
    y -= 0.9 * y.mean(1, keepdims=True)
    at = maximise_likelihood(
        model_of(np.ones((80, 1)), y.ravel()), [part_of(np.repeat(np.arange(20), 4))]
    )
    assert at.parts == ()
    assert at.phi == pytest.approx(y.var(ddof=1))


@pytest.mark.integration
@seeds(1, 2, 3)
def test_unbalanced_data_give_what_statsmodels_gives(rng: np.random.Generator) -> None:
    from statsmodels.regression.mixed_linear_model import MixedLM, VCSpec

    m = int(rng.integers(80, 160))
    group = np.sort(rng.integers(0, 15, m))
    X = np.stack([np.ones(m), rng.normal(size=m)], 1)
    slope = rng.normal(0, 0.7, 15)[group] * X[:, 1]
    y = X @ [1.0, -2.0] + rng.normal(0, 1.3, 15)[group] + slope + rng.normal(size=m)
    own = [X[group == g] for g in np.unique(group)]
    names = ["intercept", "slope"]
    columns = [[[name] for _ in own] for name in names]
    loadings = [[one[:, k : k + 1] for one in own] for k in range(2)]
    peer = MixedLM(y, X, group, exog_vc=VCSpec(names, columns, loadings)).fit()
    got = estimates(model_of(X, y), [part_of(group), part_of(group, X[:, 1])])
    theirs = [*peer.vcomp, peer.scale]
    np.testing.assert_allclose(got, theirs, rtol=1e-4)


# -- the likelihood itself


def mixed_case(rng: np.random.Generator) -> tuple[LinearModel, list[SharedError]]:
    """Three coordinates a row, two parts that share levels by others, and one that lasts."""
    m, c, p = 36, 3, 4
    model = LinearModel(rng.normal(size=(p, c, m)), rng.normal(size=(c, m)), float(c * m - p))
    visit = np.repeat(np.arange(m // 2), 2)
    parts = [
        SharedError(rng.normal(size=(m, c, 1)), visit, 0.7),
        SharedError(rng.normal(size=(m, c, 3)), rng.permutation(visit % 5), 0.2),
    ]
    stretch = np.repeat([0, 1], m // 2)
    lasting = SharedError(rng.normal(size=(m, c, 3)), stretch, 0.4, np.arange(m) * 1.0, 3.0)
    return model, [*parts, lasting]


def covariance_of(parts: list[SharedError], m: int, c: int) -> Array:
    """The covariance (c·m, c·m) of rows, written out: one draw after the other."""
    total = np.eye(c * m)
    stretch = next((part.level for part in parts if part.time is not None), np.zeros(m))
    for part in parts:
        for i in range(m):
            for j in range(m):
                if part.level[i] != part.level[j] or stretch[i] != stretch[j]:
                    continue
                alike = 1.0
                if part.time is not None:
                    alike = np.exp(-abs(part.time[i] - part.time[j]) / part.length)
                own = part.variance * alike * part.loading[i] @ part.loading[j].T
                total[i * c : (i + 1) * c, j * c : (j + 1) * c] += own
    return total


def flat(values: Array) -> Array:
    """Values (..., c, m) row by row, (..., m·c)."""
    return np.moveaxis(values, -1, -2).reshape(*values.shape[:-2], -1)


@seeds(1, 2)
def test_it_is_the_density_of_what_no_column_holds(rng: np.random.Generator) -> None:
    """Twice the log likelihood at two variances differs as that of the contrasts does."""
    model, parts = mixed_case(rng)
    X, y = flat(model.columns).T, flat(model.response)
    contrasts = np.linalg.qr(X, mode="complete")[0][:, X.shape[1] :]
    logs = []
    for factor in (1.0, 2.5):
        own = [
            SharedError(p.loading, p.level, factor * p.variance, p.time, p.length) for p in parts
        ]
        at = evaluate_likelihood(model, own)
        H = at.phi * covariance_of(own, *reversed(model.response.shape))
        density = multivariate_normal(cov=contrasts.T @ H @ contrasts).logpdf(contrasts.T @ y)
        logs.append(at.log - 2 * density)
    assert logs[0] == pytest.approx(logs[1], abs=1e-8)


@seeds(1, 2)
def test_its_slope_is_that_of_finite_differences(rng: np.random.Generator) -> None:
    model, parts = mixed_case(rng)
    at = evaluate_likelihood(model, parts)
    for k in range(len(parts)):
        logs = []
        for step in (1e-5, -1e-5):
            moved = list(at.parts)
            own = moved[k]
            variance = own.variance + step
            moved[k] = SharedError(own.loading, own.level, variance, own.time, own.length)
            logs.append(evaluate_likelihood(model, moved).log)
        assert at.slope(at.parts[k])[0] == pytest.approx((logs[0] - logs[1]) / 2e-5, rel=1e-6)


def test_no_point_of_a_search_is_evaluated_twice(
    rng: np.random.Generator, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Neither where it begins nor where it ends; what it returns is the likelihood there."""
    labels = np.repeat(np.arange(12), 5)
    y = 2.0 * rng.normal(size=12)[labels] + rng.normal(size=60)
    model, parts = model_of(np.ones((60, 1)), y), [part_of(labels)]
    seen: list[tuple[float, ...]] = []

    def evaluate(*given: Any) -> Likelihood:
        seen.append(tuple(part.variance for part in given[1]))
        return evaluate_likelihood(*given)

    monkeypatch.setattr(largest_likelihood, "evaluate_likelihood", evaluate)
    at = maximise_likelihood(model, parts)
    assert len(set(seen)) == len(seen) > 2
    assert at.log == pytest.approx(evaluate_likelihood(model, at.parts).log, rel=1e-12)
    assert at.log > evaluate_likelihood(model, parts).log


@seeds(1, 2, 3)
def test_newton_steps_end_where_the_library_does_with_fewer_likelihoods(
    rng: np.random.Generator, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Also where one of the parts is none, and where a guess is far off."""
    sizes = rng.uniform(0.5, 3.0, 2)
    first, second, none = (rng.integers(0, 15, 120) for _ in range(3))
    y = sizes[0] * rng.normal(size=15)[first] + sizes[1] * rng.normal(size=15)[second]
    model = model_of(np.ones((120, 1)), y + rng.normal(size=120))
    guesses = 10 ** rng.uniform(-3, 1, 3)
    labels = (first, second, none)
    parts = [part_of(*own) for own in zip(labels, [None] * 3, guesses.tolist(), strict=True)]
    counts = []

    def evaluate(*given: Any) -> Likelihood:
        counts[-1] += 1
        return evaluate_likelihood(*given)

    monkeypatch.setattr(largest_likelihood, "evaluate_likelihood", evaluate)
    ends = []
    for steps in (largest_likelihood.MOST_NEWTON_STEPS, 0):
        monkeypatch.setattr(largest_likelihood, "MOST_NEWTON_STEPS", steps)
        counts.append(0)
        ends.append(maximise_likelihood(model, parts))
    by_newton, by_library = ends
    assert by_newton.log >= by_library.log - 1e-9
    variances = [part.variance for part in by_newton.parts]
    assert variances == pytest.approx([part.variance for part in by_library.parts], rel=1e-4)
    assert counts[0] < counts[1]


@pytest.mark.filterwarnings("ignore::RuntimeWarning")
def test_a_model_that_leaves_nothing_ends(rng: np.random.Generator) -> None:
    """Its columns hold the response: no size of a part is better than another."""
    X = rng.normal(size=(60, 2))
    model = model_of(X, X @ np.array([1.0, 2.0]))
    at = maximise_likelihood(model, [part_of(np.repeat(np.arange(12), 5))])
    assert len(at.parts) <= 1


@seeds(1, 2)
def test_the_slope_of_a_part_that_is_not_there_yet(rng: np.random.Generator) -> None:
    """A part whose draws no block joins is judged beside the others: at nought, one-sided."""
    model, parts = mixed_case(rng)
    kept, new = parts[1:2], parts[0]
    inside = SharedError(new.loading, kept[0].level, 0.0)
    at = evaluate_likelihood(model, kept)
    steps = np.array([1e-5, 2e-5])
    logs = [
        evaluate_likelihood(model, [*kept, SharedError(new.loading, inside.level, step)]).log
        for step in steps
    ]
    by_hand = (4 * (logs[0] - at.log) - (logs[1] - at.log)) / 2e-5
    assert at.slope(inside)[0] == pytest.approx(by_hand, rel=1e-5)


def test_the_information_is_the_curvature_of_balanced_data() -> None:
    """Of one part in many groups, the average information is the likelihood's curvature at its
    maximum, to a tenth."""
    rng = np.random.default_rng(5)
    level = np.repeat(np.arange(300), 3)
    y = rng.normal(size=300)[level] + rng.normal(size=900)
    at = maximise_likelihood(model_of(np.ones((900, 1)), y), [part_of(level)])
    part, model = at.parts[0], at.model
    logs = [
        evaluate_likelihood(model, [part_of(level, variance=part.variance * s)]).log
        for s in (0.99, 1.0, 1.01)
    ]
    curvature = (2 * logs[1] - logs[0] - logs[2]) / (0.01 * part.variance) ** 2
    information = float(at.information(at.slope(part)[1])[0, 0])
    assert information == pytest.approx(curvature, rel=0.1)


# -- intervals and tests


def test_chance_gains_as_much_as_is_said() -> None:
    """Nothing shared: the restricted likelihood ratio of balanced data is that of the F test, and
    exceeds its 1 % point at most so often."""
    groups, each = 30, 3
    level = np.repeat(np.arange(groups), each)
    quantiles = np.linspace(0.0005, 0.9995, 1000)
    ratios = f.ppf(quantiles, groups - 1, groups * (each - 1))
    free, inner = groups - 1, groups * (each - 1)
    total = (free * ratios + inner) / (free + inner)
    gains = np.where(
        ratios > 1, (free + inner) * np.log(total) - free * np.log(np.maximum(ratios, 1)), 0.0
    )
    said = np.array([compute_p(gain) for gain in gains])
    assert 0.005 <= np.mean(said <= 0.01) <= 0.012
    # and the gain that is found is that of the formula
    rng = np.random.default_rng(2)
    y = rng.normal(size=len(level)) + 0.6 * rng.normal(size=groups)[level]
    model = model_of(np.ones((len(y), 1)), y)
    means = y.reshape(groups, each).mean(1)
    ratio = (each * means.var(ddof=1)) / (np.square(y - means[level]).sum() / inner)
    gain = maximise_likelihood(model, [part_of(level)]).log - evaluate_likelihood(model, ()).log
    whole = (free + inner) * np.log((free * ratio + inner) / (free + inner)) - free * np.log(ratio)
    assert gain == pytest.approx(whole, abs=1e-6)


@pytest.mark.parametrize("freedom", [3, 20, 300])
def test_an_interval_of_a_standard_deviation_holds_it(freedom: int) -> None:
    """Over samples of so many degrees of freedom, in 95 % of them."""
    rng = np.random.default_rng(freedom)
    scales = np.sqrt(rng.chisquare(freedom, 4000) / freedom)
    ends = np.array([compute_interval(scale, freedom) for scale in scales])
    held = np.mean((ends[:, 0] <= 1) & (ends[:, 1] >= 1))
    assert abs(held - 0.95) < 0.014  # four standard errors
