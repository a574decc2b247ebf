"""4,096 sub-models with exact grouped ten-fold cross-validation, against scikit-learn and a loop of
numpy's lstsq."""

from __future__ import annotations

import time

import numpy as np

from modelsel.selection.cross_validation import pad_blocks
from modelsel.selection.subsets import Subsets, sweep_subsets

from .timing import interleaved

SIZES = (4, 4, 4, 4, 3, 3, 3, 3, 3, 2, 2, 2)  # 37 columns of 12 groups, and 13 of the base
M, BASE, FOLDS, SAMPLE = 200, 13, 10, 24


def problem(condition: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(X (600, 50), y, fold of every row): independent columns, of which two copy two others but
    for 1/condition of them; folds keep a configuration whole."""
    rng = np.random.default_rng(5)
    X = rng.normal(size=(3 * M, BASE + sum(SIZES)))
    for copy, of in ((20, 2), (40, 30)):
        X[:, copy] = X[:, of] + 2 / condition * X[:, copy]
    y = X @ rng.normal(size=X.shape[1]) + 0.01 * rng.normal(size=3 * M)
    return X, y, np.repeat(rng.permutation(M) % FOLDS, 3)


def groups() -> list[list[int]]:
    ends = BASE + np.cumsum(SIZES)
    return [list(range(end - size, end)) for end, size in zip(ends, SIZES)]


def ours(X: np.ndarray, y: np.ndarray, fold: np.ndarray) -> Subsets:
    folded = pad_blocks(
        [np.column_stack([X, y])[fold == k] for k in range(FOLDS)],
        [int((fold == k).sum()) for k in range(FOLDS)],
    )
    return sweep_subsets(folded, range(BASE), groups())


def columns(members: np.ndarray) -> list[int]:
    return [*range(BASE), *(c for g in np.flatnonzero(members) for c in groups()[g])]


def householder(X: np.ndarray, y: np.ndarray, fold: np.ndarray, members: np.ndarray) -> np.ndarray:
    """Held-out sums of squares by Householder's factorisation in long double: the referee."""
    out = []
    for k in range(FOLDS):
        A = np.column_stack([X[:, columns(members)], y]).astype(np.longdouble)
        train, test = A[fold != k].copy(), A[fold == k]
        p = A.shape[1] - 1
        for j in range(p):
            v = train[j:, j].copy()
            v[0] += np.copysign(np.sqrt((v * v).sum()), v[0])
            train[j:, j:] -= np.outer(v, 2 / (v * v).sum() * (v @ train[j:, j:]))
        beta = np.zeros(p, np.longdouble)
        for j in range(p - 1, -1, -1):
            beta[j] = (train[j, p] - train[j, j + 1 : p] @ beta[j + 1 :]) / train[j, j]
        left = test[:, p] - test[:, :p] @ beta
        out.append(float((left * left).sum()))
    return np.array(out)


def worst_error(condition: float) -> float:
    """Largest relative error of held-out sums of squares over models spread over the 4,096."""
    X, y, fold = problem(condition)
    found = ours(X, y, fold)
    some = np.linspace(0, len(found.members) - 1, SAMPLE).astype(int)
    return max(
        float(np.abs(found.held_out[s] / householder(X, y, fold, found.members[s]) - 1).max())
        for s in some
    )


def run() -> dict[str, float]:
    from sklearn.linear_model import LinearRegression
    from sklearn.model_selection import GroupKFold, cross_val_score

    X, y, fold = problem(30.0)
    members = ours(X, y, fold).members
    some = members[np.linspace(0, len(members) - 1, SAMPLE).astype(int)]

    def sklearn() -> None:
        for row in some:
            cross_val_score(
                LinearRegression(fit_intercept=False),
                X[:, columns(row)],
                y,
                groups=fold,
                cv=GroupKFold(FOLDS),
                scoring="neg_mean_squared_error",
            )

    def lstsq() -> None:
        for row in some:
            A = X[:, columns(row)]
            for k in range(FOLDS):
                beta = np.linalg.lstsq(A[fold != k], y[fold != k], rcond=None)[0]
                np.square(y[fold == k] - A[fold == k] @ beta).sum()

    seconds = interleaved({"ours": lambda: ours(X, y, fold), "sklearn": sklearn, "lstsq": lstsq}, 3)
    rate = len(members) / seconds["ours"]
    return {
        "subsets_vs_sklearn": rate * seconds["sklearn"] / len(some),
        "subsets_vs_lstsq": rate * seconds["lstsq"] / len(some),
        "subsets_models_per_second": rate,
        "subsets_error_condition_30": worst_error(30.0),
        "subsets_error_condition_1e8": worst_error(1e8),
    }


def growth() -> list[tuple[int, float]]:
    """(candidates, seconds) of all subsets."""
    X, y, fold = problem(30.0)
    out = []
    for count in (4, 6, 8, 10, 12):
        keep = [*range(BASE), *(c for g in groups()[:count] for c in g)]
        folded = pad_blocks(
            [np.column_stack([X[:, keep], y])[fold == k] for k in range(FOLDS)], [60] * FOLDS
        )
        start = time.process_time()
        sweep_subsets(folded, range(BASE), groups()[:count])
        out.append((count, time.process_time() - start))
    return out
