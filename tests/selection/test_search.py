"""All subsets against brute-force least squares; criteria against hand values, statsmodels and
plain integrals."""

from __future__ import annotations

from itertools import combinations, pairwise
from math import comb, log

import numpy as np
import pytest
from builders import drawn, planted, seeds
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import integrate, stats

from modelsel.diagnosis.candidates.candidate import Candidate
from modelsel.diagnosis.columns.candidate_columns import build_columns, stack_design
from modelsel.diagnosis.inference.evidence import compute_single_f
from modelsel.diagnosis.inference.scan import build_scan, compute_basis
from modelsel.diagnosis.shapes.candidate_kinds import CandidateKind
from modelsel.fitting.design import Model, compute_design
from modelsel.fitting.least_squares import fit
from modelsel.mechanisms.causes import ONE
from modelsel.mechanisms.registry import mechanism
from modelsel.mechanisms.terms import Mechanism, Screw, Term
from modelsel.robot.files import load_robot
from modelsel.selection import criteria
from modelsel.selection.comparison import _even_out
from modelsel.selection.cross_validation import FoldedData, fold, pad_blocks
from modelsel.selection.orthogonal_subsets import refine_subsets
from modelsel.selection.splits import assign_folds
from modelsel.selection.subsets import sweep_subsets

N, K = 48, 4


def folded(X: np.ndarray, y: np.ndarray, fold_of: np.ndarray) -> FoldedData:
    blocks = [np.column_stack([X, y])[fold_of == k] for k in range(fold_of.max() + 1)]
    return pad_blocks(blocks, [len(b) for b in blocks])


def referee(
    X: np.ndarray, y: np.ndarray, fold_of: np.ndarray, columns: list[int]
) -> tuple[float, int, list[float]]:
    """(rss, rank, held-out sums of squares) of one subset: a pseudo-inverse of the unit columns,
    fold by fold."""
    A = (
        X[:, columns] / np.maximum(np.linalg.norm(X[:, columns], axis=0), 1e-300)
        if columns
        else np.zeros((len(y), 0))
    )

    def left(train: np.ndarray, test: np.ndarray) -> float:
        beta = np.linalg.pinv(A[train], rcond=1e-10) @ y[train]
        return float(np.square(y[test] - A[test] @ beta).sum())

    everything = np.ones(len(y), bool)
    rank = np.linalg.matrix_rank(A, tol=1e-10) if columns else 0
    return (
        left(everything, everything),
        int(rank),
        [left(fold_of != k, fold_of == k) for k in range(fold_of.max() + 1)],
    )


def compare_all(
    X: np.ndarray,
    y: np.ndarray,
    fold_of: np.ndarray,
    base: list[int],
    groups: list[list[int]],
    message: str,
) -> None:
    found = sweep_subsets(folded(X, y, fold_of), base, groups)
    assert len(found.members) == 2 ** len(groups)
    assert len({tuple(m) for m in found.members.tolist()}) == 2 ** len(groups)
    assert not found.members[0].any()
    for members, rss, rank, held, pivot in zip(
        found.members, found.rss, found.rank, found.held_out, found.pivot, strict=True
    ):
        columns = list(
            dict.fromkeys([*base, *(c for g in np.flatnonzero(members) for c in groups[g])])
        )
        want = referee(X, y, fold_of, columns)
        assert rank == want[1], f"{message}: {columns}"
        certified = max(1e-10, 50 * np.finfo(float).eps / pivot)  # the pivot certifies the figures
        np.testing.assert_allclose(
            [rss, *held], [want[0], *want[2]], rtol=certified, err_msg=f"{message}: {columns}"
        )


@settings(max_examples=50)
@given(
    st.integers(0, 10**6), st.integers(0, 3), st.lists(st.integers(1, 3), min_size=1, max_size=4)
)
def test_every_subset(seed, base, widths) -> None:
    """Any base, groups of any width, folds of unequal height, columns of any scale."""
    rng = np.random.default_rng(seed)
    p = base + sum(widths)
    X, y = rng.normal(size=(N, p)) * 10.0 ** rng.integers(-5, 6, p), 1e-2 * rng.normal(size=N)
    fold_of = np.r_[np.arange(K), rng.integers(0, K, N - K)] if seed % 2 else rng.permutation(N) % K
    ends = np.cumsum([base, *widths])
    groups = [list(range(a, b)) for a, b in pairwise(ends)]
    if np.bincount(fold_of).max() < N - p - 5:
        compare_all(X, y, fold_of, list(range(base)), groups, f"seed {seed}")


@seeds(1, 2, 3)
def test_dependent_and_shared_columns(rng) -> None:
    """Groups that share a column, repeat each other, hold nothing new, nearly repeat, or rest on
    one fold."""
    X = rng.normal(size=(N, 10))
    X[:, 5] = X[:, 3] - 2 * X[:, 4]  # in group 0's span
    X[:, 6] = 0.01 * X[:, 3] + X[:, 4]  # so too, and nearly a column of it
    X[:, 7] = 0
    fold_of = np.arange(N) % K
    X[fold_of != 2, 8] = 0  # seen by fold 2 alone: the others cannot estimate it
    y = X[:, :5] @ rng.normal(size=5) + rng.normal(size=N)
    compare_all(X, y, fold_of, [0, 1], [[3, 4], [4, 9], [5], [6, 2], [7], [8]], "dependent")


@seeds(1, 2, 3)
@pytest.mark.parametrize("group", [[2], [2, 3]], ids=["alone", "with another"])
def test_columns_that_the_base_spans(group, rng) -> None:
    """As a shifted joint zero on top of the geometric base: what is left of the column is rounding,
    and must not count."""
    X = rng.normal(size=(N, 5))
    X[:, 2] = X[:, 0] - 2 * X[:, 1]
    compare_all(
        X,
        X[:, 0] + rng.normal(size=N),
        np.arange(N) % K,
        [0, 1],
        [group, [4]],
        "in the base's span",
    )


def test_groups_that_saturate(rng) -> None:
    """More columns than the training rows of a fold carry: the whole set is fitted exactly, the
    rank says so."""
    X, y = rng.normal(size=(12, 12)), rng.normal(size=12)
    found = sweep_subsets(
        folded(X, y, np.arange(12) % 3), [0], [list(range(1, 6)), list(range(6, 12))]
    )
    whole = found.members.all(1)
    assert found.rank[whole] == 12
    assert found.rss[whole] < 1e-12


@seeds(1, 2)
def test_subsets_of_mechanisms(rng) -> None:
    """The paper's arm: every subset of four mechanisms on the geometric base, from the problem's own
    folds."""
    names = ("joint2-twist", "joint3-twist", "backlash:3", "wrist-coupling:6")
    some = [mechanism(n, load_robot("puma760")) for n in names]
    geometric = mechanism("geometric", load_robot("puma760"))
    terms = Model((geometric, *some)).terms
    at = planted(drawn("puma760", rng, 50), terms, rng.normal(size=len(terms)) * 1e-4, rng, 0.1)
    fold_of = assign_folds(at.data, 5, rng)
    X, r = compute_design(at, terms)
    X, y, rows = X.reshape(150, -1), r.ravel(), fold_of.repeat(3)
    from modelsel.fitting.identifiability import identify

    reduced = fold(at, terms, fold_of)
    base = list(identify(reduced.select(range(len(geometric.terms))).total).kept)
    ends = np.cumsum([len(geometric.terms), *(len(m.terms) for m in some)])
    groups = [list(range(a, b)) for a, b in pairwise(ends)]
    found = sweep_subsets(reduced, base, groups)
    for members, rss, rank, held in zip(
        found.members, found.rss, found.rank, found.held_out, strict=True
    ):
        want = referee(
            X, y, rows, [*base, *(c for g in np.flatnonzero(members) for c in groups[g])]
        )
        assert rank == want[1]
        np.testing.assert_allclose([rss, *held], [want[0], *want[2]], rtol=1e-8)


@pytest.mark.integration
def test_single_f_is_the_nested_f_test(rng) -> None:
    """Every candidate alone on top of the fitted base, as statsmodels has it; nought for one that
    the base spans."""
    import statsmodels.api as sm

    base = Model((mechanism("geometric", load_robot("puma760")),))
    twice = Mechanism("twice", (Term("z", (Screw(3, "rz", 2.0 * ONE),)),))
    some = (
        *(
            mechanism(n, load_robot("puma760"))
            for n in ("joint2-twist", "backlash:3", "wrist-coupling:6")
        ),
        twice,
    )
    at = planted(drawn("puma760", rng, 50), base.terms, rng.normal(size=39) * 1e-3, rng, 0.1)
    fitted = fit(at, base, held="nothing")
    offered = tuple(Candidate(m, CandidateKind.MECHANISM, 0.25) for m in some)
    A, r = stack_design(at, base.terms, fitted.at())
    A = A[:, list(fitted.found.kept)]
    seen = build_scan(build_columns(at, offered, fitted.at()), compute_basis(A))
    found = compute_single_f(seen, seen.see(r - A @ np.linalg.lstsq(A, r, rcond=None)[0]))
    small = sm.OLS(r, A).fit()
    both = [np.column_stack([A, stack_design(at, m.terms, fitted.at())[0]]) for m in some[:3]]
    want = [sm.OLS(r, X).fit().compare_f_test(small)[0] for X in both]
    np.testing.assert_allclose(found, [*want, 0.0], rtol=1e-7)


def test_subsets_of_twins_are_told_apart_by_no_rounding(rng) -> None:
    """Sums of squares that differ in their last digits are equal; others keep ten digits."""
    values = np.array([3.0, 3.0 * (1 + 4e-16), 3.0 * (1 + 1e-8), 1e-20, 0.0, np.inf])
    even = _even_out(values)
    assert even[0] == even[1] < even[2]
    np.testing.assert_allclose(even, values, rtol=1e-10)


@pytest.mark.parametrize("size", [1e-100, 1e-9, 1.0, 1e12, 1e100])
def test_single_f_of_a_candidate_that_explains_all(size, rng) -> None:
    """What it leaves is rounding, whatever the unit: F is huge and finite, largest there, and no
    warning (an error here)."""
    at = drawn("puma760", rng, 30)
    fitted = fit(at, Model((mechanism("geometric", at.robot),)))
    offered = [
        Candidate(m, CandidateKind.MECHANISM, 0.5)
        for m in (mechanism("wrist-coupling:5", at.robot), mechanism("backlash:3", at.robot))
    ]
    cols = build_columns(at, offered, fitted.at())
    A, _ = stack_design(at, fitted.terms, fitted.at())
    Q = compute_basis(A)
    r = cols.expand(1)[0]
    r = r - Q @ (Q.T @ r)
    seen = build_scan(cols, Q)
    f = compute_single_f(seen, seen.see(size * r / np.linalg.norm(r)))
    assert np.isfinite(f).all()
    assert f.argmax() == 1
    assert f[1] > 1e10


# -- criteria
# ---------------------------------------------------------------------------------------------------------


def test_hand_values() -> None:
    """n = 20, RSS = 5, r = 3, K = 4: written out from methods.md A.3."""
    assert criteria.aic(5.0, 20, 3) == pytest.approx(20 * log(0.25) + 8, rel=1e-14)
    assert criteria.aicc(5.0, 20, 3) == pytest.approx(
        20 * log(0.25) + 8 + 2 * 4 * 5 / 15, rel=1e-14
    )
    assert criteria.bic(5.0, 20, 3) == pytest.approx(20 * log(0.25) + 4 * log(20), rel=1e-14)
    assert criteria.bic(5.0, 20, 3, count=7) == pytest.approx(
        20 * log(0.25) + 4 * log(7), rel=1e-14
    )
    assert criteria.gcv(5.0, 20, 3) == pytest.approx(100 / 17**2, rel=1e-14)
    assert criteria.ebic(5.0, 20, 3, 2, 10) == pytest.approx(
        20 * log(0.25) + 4 * log(20) + 2 * log(comb(10, 2)), rel=1e-13
    )
    assert criteria.aic(5.0, 20, 3, sigma=0.5) == pytest.approx(20 + 6, rel=1e-14)  # = Cp + n
    assert criteria.aicc(5.0, 20, 3, sigma=0.5) == pytest.approx(26, rel=1e-14)
    assert criteria.bic(5.0, 20, 3, sigma=0.5) == pytest.approx(20 + 3 * log(20), rel=1e-14)


def test_saturated_is_infinite() -> None:
    assert np.isinf(criteria.aicc([1.0, 1.0, 1.0], 6, [4, 5, 6])).all()
    assert np.isinf(criteria.gcv([1.0, 1.0], 6, [6, 7])).all()
    assert np.isfinite(criteria.aicc(1.0, 6, 3))


@pytest.mark.integration
def test_differences_are_statsmodels(rng) -> None:
    """Constants apart (2 pi, sigma counted or not), models rank alike."""
    import statsmodels.api as sm

    X, y = rng.normal(size=(40, 6)), rng.normal(size=40)
    fits = [sm.OLS(y, X[:, :k]).fit() for k in range(1, 7)]
    rss, rank = np.array([f.ssr for f in fits]), np.arange(1, 7)
    for ours, theirs in ((criteria.aic, "aic"), (criteria.bic, "bic")):
        want = [getattr(f, theirs) for f in fits]
        np.testing.assert_allclose(
            np.diff(ours(rss, 40, rank)), np.diff(want), rtol=1e-9, atol=1e-10
        )


def test_evidence_is_the_integral(rng) -> None:
    """ln Bayes factor of the g-prior, g = n, against the integral over sigma of the marginal
    densities."""
    n, X, base = 9, rng.normal(size=(9, 2)), np.ones((9, 1))
    y = X @ [0.7, -0.4] + rng.normal(size=9)
    U = np.linalg.svd(base)[0][:, 1:]  # what the base leaves
    left, Z = U.T @ y, U.T @ X
    hat = Z @ np.linalg.inv(Z.T @ Z) @ Z.T

    def marginal(spread: np.ndarray) -> float:
        inner = lambda u: stats.multivariate_normal(np.zeros(8), np.exp(u) * spread).pdf(left)  # noqa: E731 - flat in ln sigma²
        return integrate.quad(inner, -12, 12, epsabs=0, epsrel=1e-10, limit=200)[0]

    want = log(marginal(np.eye(8) + n * hat) / marginal(np.eye(8)))
    rss, rss_base = left @ left - left @ hat @ left, left @ left
    assert criteria.log_evidence(rss, rss_base, n, 1, 2) == pytest.approx(want, rel=1e-8)
    assert criteria.log_evidence(rss_base, rss_base, n, 1, 0) == pytest.approx(0, abs=1e-12)


def test_evidence_where_the_noise_is_known(rng) -> None:
    """Against the two normal densities of what the base leaves, at one standard deviation."""
    n, X, base = 9, rng.normal(size=(9, 2)), np.ones((9, 1))
    y, sigma = X @ [0.7, -0.4] + rng.normal(size=9), 0.8
    U = np.linalg.svd(base)[0][:, 1:]
    left, Z = U.T @ y, U.T @ X
    hat = Z @ np.linalg.inv(Z.T @ Z) @ Z.T
    logs = [
        stats.multivariate_normal(np.zeros(8), sigma**2 * (np.eye(8) + g * hat)).logpdf(left)
        for g in (n, 0)
    ]
    found = criteria.log_evidence(left @ left - left @ hat @ left, left @ left, n, 1, 2, sigma)
    assert found == pytest.approx(logs[0] - logs[1], rel=1e-10)


def test_weights() -> None:
    want = np.array([1, np.exp(-1), 0]) / (1 + np.exp(-1))
    np.testing.assert_allclose(criteria.normalise_weights([10.0, 12.0, np.inf]), want, rtol=1e-14)
    np.testing.assert_allclose(
        criteria.normalise_weights([-1e6, -1e6 + 2 * log(3)]), [0.75, 0.25], rtol=1e-9
    )
    np.testing.assert_allclose(criteria.normalise_weights([np.inf, np.inf]), [0.5, 0.5])
    assert criteria.normalise_weights([]).shape == (0,)


def test_every_size_of_table() -> None:
    """Members are all subsets, each once."""
    rng = np.random.default_rng(5)
    found = sweep_subsets(
        folded(rng.normal(size=(N, 6)), rng.normal(size=N), np.arange(N) % K),
        [0],
        [[k] for k in range(1, 6)],
    )
    want = {frozenset(c) for size in range(6) for c in combinations(range(5), size)}
    assert {frozenset(np.flatnonzero(m).tolist()) for m in found.members} == want


def test_nearly_dependent_columns_are_told_apart(rng) -> None:
    """A column that copies another but for 1e-8 of it: no sweep of products sees it, orthogonal
    factors do (condition 1e8)."""
    X = rng.normal(size=(120, 7))
    X[:, 5] = X[:, 1] + 2e-8 * X[:, 5]
    y = X @ rng.normal(size=7) + 0.1 * rng.normal(size=120)
    fold_of = np.arange(120) % 5
    folded = pad_blocks([np.column_stack([X, y])[fold_of == k] for k in range(5)], [24] * 5)
    found = sweep_subsets(folded, [0, 1], [[2, 3], [4, 5], [6]])
    assert found.rank.tolist() == [2 + members @ [2, 2, 1] for members in found.members.astype(int)]
    for members, held_out in zip(found.members, found.held_out, strict=True):
        columns = [0, 1, *(c for g in np.flatnonzero(members) for c in ([2, 3], [4, 5], [6])[g])]
        for k in range(5):
            beta = np.linalg.lstsq(X[fold_of != k][:, columns], y[fold_of != k], rcond=1e-12)[0]
            left = y[fold_of == k] - X[fold_of == k][:, columns] @ beta
            assert held_out[k] == pytest.approx(float(left @ left), rel=1e-7)


def test_a_base_column_that_one_fold_has_alone(rng) -> None:
    """Without its fold nothing but rounding is left of it: it stays as it is fitted, and no figure
    overflows."""
    blocks = rng.normal(size=(3, 5, 4))
    blocks[1:, :, 0] *= 1e-180
    found = sweep_subsets(FoldedData(blocks, np.full(3, 5)), [0], [[1], [2]])
    blocks[1:, :, 0] = 0
    alone = sweep_subsets(FoldedData(blocks, np.full(3, 5)), [0], [[1], [2]])
    np.testing.assert_allclose(found.held_out, alone.held_out, rtol=1e-9)
    assert np.isfinite(found.held_out).all()


@seeds(1, 2, 3)
def test_given_subsets_by_triangles(rng) -> None:
    """Every subset by the tree of triangles alone: nearly dependent, dependent and shared columns,
    wide groups last."""
    base, near = rng.normal(size=(N, 2)), rng.normal(size=(N, 6))
    near[:, 1] = near[:, 0] + 1e-7 * rng.normal(size=N)
    X = np.column_stack(
        [base, near, near[:, 0] - near[:, 2], base[:, 0] + near[:, 3]]
    ) * 10.0 ** rng.integers(-4, 5, 10)
    groups = [[2], [3], [4, 3], [8], [5, 9, 6], [7, 2]]
    y, fold_of = near @ rng.normal(size=6) + 1e-2 * rng.normal(size=N), rng.permutation(N) % K
    members = rng.permutation(
        (np.arange(2 ** len(groups))[:, None] >> np.arange(len(groups))) % 2 == 1
    )
    refined = refine_subsets(folded(X, y, fold_of), [0, 1], groups, members)
    figures = zip(refined.rank, refined.rss, refined.held_out, strict=True)
    for some, found in zip(members, figures, strict=True):
        columns = list(dict.fromkeys([0, 1, *(c for g in np.flatnonzero(some) for c in groups[g])]))
        want = referee(X, y, fold_of, columns)
        assert found[0] == want[1], columns
        np.testing.assert_allclose(
            [found[1], *found[2]], [want[0], *want[2]], rtol=1e-6, err_msg=str(columns)
        )


@seeds(5, 6)
def test_a_column_that_one_fold_has_alone_is_said(rng) -> None:
    X, fold_of = rng.normal(size=(N, 3)), np.arange(N) % K
    X[fold_of != 1, 2] = 0.0
    held_out = refine_subsets(
        folded(X, rng.normal(size=N), fold_of),
        [0],
        [[1], [2]],
        np.array([[True, False], [True, True]]),
    ).held_out
    assert np.isfinite(held_out[0]).all()
    assert np.isnan(held_out[1]).tolist() == [False, True, False, False]
