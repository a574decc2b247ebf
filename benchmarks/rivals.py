"""What a user would do otherwise, on the same candidates: forward selection by criteria or by the
exact max-test, LassoCV, sequentially thresholded least squares. Each returns chosen findings
(candidates) and its prediction of fresh configurations."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import betaincc, gammaln

from modelsel.diagnosis.candidates.candidate import Candidate
from modelsel.diagnosis.columns.candidate_columns import Columns, build_columns, stack_design
from modelsel.diagnosis.inference.scan import Scan, build_scan, compute_basis
from modelsel.fitting.design import Model
from modelsel.fitting.least_squares import Fit
from modelsel.fitting.problem import Problem

MOST = 40  # groups at which forward selection gives up
FOLDS = 5
Array = np.ndarray


@dataclass(frozen=True, eq=False)
class Bench:
    """The common table: candidates' columns (C, N), geometry A (N, p), residual r (N,), and the
    same of fresh rows."""

    found: tuple[Candidate, ...]
    cols: Columns
    first: Scan
    A: Array
    r: Array
    ahead: Array
    ahead_r: Array
    fresh: Problem
    at: Fit
    configuration: Array  # (N,) of every row

    def predict(self, rows: Sequence[int], beta: Array | None = None) -> Array:
        """(N_fresh,) error on fresh configurations with columns `rows`: refitted with the
        geometry, or at given beta."""
        X = self.cols.screws.expand(np.array(rows, np.intp)).T
        A = self.A if beta is not None else np.hstack([self.A, X])
        y = self.r if beta is None else self.r - X @ beta
        size = np.maximum(np.linalg.norm(A, axis=0), 1e-300)
        theta = np.linalg.lstsq(A / size, y, rcond=1e-8)[0] / size
        F = self.fresh_columns(rows)
        if beta is not None:
            theta = np.r_[theta, beta]
        return np.asarray(self.ahead_r - np.hstack([self.ahead, F]) @ theta)

    def fresh_columns(self, rows: Sequence[int]) -> Array:
        """(N_fresh, k) columns `rows` at the fresh configurations."""
        if not len(rows):
            return np.zeros((len(self.ahead_r), 0))
        owner = {int(i): (g, k) for g, s in enumerate(self.cols.slices) for k, i in enumerate(s)}
        terms = [self.found[g].mechanism.terms[k] for g, k in (owner[int(i)] for i in rows)]
        return stack_design(self.fresh, terms, self.at.at())[0]

    def rows_of(self, groups: Sequence[int]) -> list[int]:
        """Columns of some candidates, each once."""
        return list(dict.fromkeys(int(i) for g in groups for i in self.cols.slices[g]))


def bench(
    problem: Problem, fresh: Problem, base: Model, base_fit: Fit, found: tuple[Candidate, ...]
) -> Bench:
    """All columns, linearised at the fitted base."""
    cols = build_columns(problem, found, base_fit.at())
    A, r = stack_design(problem, base.terms, base_fit.at())
    B, s = stack_design(fresh, base.terms, base_fit.at())
    Q = compute_basis(A[:, list(base_fit.found.kept)])
    kept = list(base_fit.found.kept)
    return Bench(
        found,
        cols,
        build_scan(cols, Q),
        A[:, kept],
        r - Q @ (Q.T @ r),
        B[:, kept],
        s - 0,
        fresh,
        base_fit,
        np.tile(np.arange(len(problem)), 3),
    )


def _penalty(kind: str, rows: int, groups: int) -> object:
    def of(k: Array, s: int) -> Array:
        if kind == "AIC":
            return 2.0 * k
        more = (
            2.0 * (gammaln(groups + 1) - gammaln(s + 1) - gammaln(groups - s + 1))
            if kind == "EBIC"
            else 0.0
        )
        return k * np.log(rows) + more

    return of


def forward(table: Bench, kind: str, p_critical: float = 0.0) -> list[int]:
    """Greedy forward selection over groups by BIC, AIC, EBIC(1), or by the exact max-test's p
    ("max-test") at the critical value of the first scan; stops where nothing improves, or after
    MOST groups."""
    r, seen, Q = table.r, table.first, table.first.Q
    rows, chosen, used = len(r), list[int](), 0.0
    penalty = _penalty(kind, rows, len(seen.sizes))
    while len(chosen) < MOST:
        strength, rss = seen.strength(seen.see(r).column)[0][:, 0], float(r @ r)
        k, share = seen.sizes, np.minimum(strength / rss, 1 - 1e-12)
        free = seen.freedom
        fits = (k > 0) & (k < free - 5)
        if kind == "max-test":
            score = np.where(fits, betaincc(k / 2, np.maximum(free - k, 1) / 2, share), 2.0)
            g = int(score.argmin())
            if score[g] > p_critical:
                break
        else:
            gain = (
                rows * np.log1p(-share)
                + penalty(used + k, len(chosen) + 1)
                - penalty(np.array(used), len(chosen))
            )  # type: ignore[operator]
            gain = np.where(fits, gain, np.inf)
            g = int(gain.argmin())
            if gain[g] >= 0:
                break
        chosen.append(g)
        used += float(k[g])
        X = table.cols.expand(g).T
        Q = np.hstack([Q, basis_beyond(X, Q)])
        r = r - Q @ (Q.T @ r)
        seen = build_scan(table.cols, Q)
    return chosen


def basis_beyond(X: Array, Q: Array) -> Array:
    """Orthonormal basis of X's columns beyond Q's span, directions below 3e-3 of a column's norm
    dropped."""
    Z = X / np.maximum(np.linalg.norm(X, axis=0), 1e-300)
    Z = Z - Q @ (Q.T @ Z)
    U, S, _ = np.linalg.svd(Z, full_matrices=False)
    U = U[:, S > 3e-3]
    return np.asarray(np.linalg.qr(U - Q @ (Q.T @ U))[0])


def _projected(table: Bench) -> tuple[Array, Array]:
    """(N, C') unit columns beyond the geometry, and which columns they are."""
    Q, XT = table.first.Q, table.cols.screws.expand(np.arange(table.cols.screws.count))
    P = XT - (XT @ Q) @ Q.T
    size, left = np.linalg.norm(XT, axis=1), np.linalg.norm(P, axis=1)
    keep = np.flatnonzero(left > 3e-3 * size)
    return np.asfortranarray((P[keep] / left[keep, None]).T), keep


def lasso(table: Bench) -> tuple[list[int], Array]:
    """(columns, coefficients) of scikit-learn's LassoCV on unit columns beyond the geometry, folds
    by configuration."""
    from sklearn.linear_model import LassoCV

    P, keep = _projected(table)
    fold = (
        np.random.default_rng(0).permutation(table.configuration.max() + 1)[table.configuration]
        % FOLDS
    )
    splits = [(np.flatnonzero(fold != f), np.flatnonzero(fold == f)) for f in range(FOLDS)]
    scale = np.sqrt(len(table.r))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        model = LassoCV(
            eps=3e-2,
            alphas=16,
            cv=splits,
            fit_intercept=False,
            tol=2e-3,
            max_iter=300,
            precompute=False,
        )
        model.fit(P * scale, table.r)
    on = np.flatnonzero(model.coef_)
    return [int(keep[i]) for i in on], model.coef_[on] * scale / _left(table, keep[on])


def _left(table: Bench, rows: Array) -> Array:
    X, Q = table.cols.screws.expand(rows), table.first.Q
    return np.linalg.norm(X - (X @ Q) @ Q.T, axis=1)


def stlsq(table: Bench) -> list[int]:
    """Columns of sequentially thresholded least squares (Brunton, Proctor & Kutz 2016),
    ridge-started; the threshold of smallest BIC (Mangan et al. 2017)."""
    P, keep = _projected(table)
    r, n = table.r, len(table.r)
    start = P.T @ np.linalg.solve(P @ P.T + 1.0 * np.eye(n), r)
    best, out = n * np.log(r @ r), list[int]()
    for share in np.logspace(-1.5, -0.1, 8):
        on = np.flatnonzero(np.abs(start) >= share * np.abs(start).max())
        threshold = None
        for _ in range(10):
            if not len(on) or len(on) > n // 2:
                on = on[np.argsort(-np.abs(start[on]))[: n // 2]]
            beta = np.linalg.lstsq(P[:, on], r, rcond=1e-6)[0]
            threshold = share * np.abs(beta).max() if threshold is None else threshold
            stay = np.abs(beta) > threshold
            if stay.all() or not stay.any():
                break
            on = on[stay]
        rss = float(np.square(r - P[:, on] @ np.linalg.lstsq(P[:, on], r, rcond=1e-6)[0]).sum())
        score = n * np.log(max(rss, 1e-12)) + len(on) * np.log(n)
        if score < best:
            best, out = score, [int(keep[i]) for i in on]
    return out


def as_candidates(table: Bench, rows: Sequence[int]) -> list[int]:
    """Chosen columns as candidates, generously: a sine or a cosine counts as its pair, a spline as
    its free function, any other column as the smallest candidate that has it."""
    owner: dict[int, int] = {}
    for g in sorted(
        range(len(table.found)), key=lambda g: (len(table.cols.slices[g]), -table.found[g].prior)
    ):
        for i in table.cols.slices[g]:
            owner.setdefault(int(i), g)
    return list(dict.fromkeys(owner[i] for i in rows))
