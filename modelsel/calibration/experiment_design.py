"""What to measure next: configurations that tell rival explanations apart, or that determine the
parameters best.

Rivals: if i is true, rival j beside all other terms still explains all but Δ_ij = min |X_i θ_i − B
β − X_j θ_j|² / σ² of it. That is to be large (T-optimality: Atkinson & Fedorov 1975), and says how
surely the right one is named. Parameters: D, A and the observability indices O1 to O5 of the
singular values (Sun & Hollerbach 2008)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from .._linalg import TINY
from .._typing import Array
from ..mechanisms.terms import Term
from .plan_pool import Pool

PRIOR_MM = 10.0  # what a term that nothing is known of may move the target, rms: its prior
MIN_POOL_CHI2 = 1.0  # χ² over a whole pool below which no choice from it tells two apart
MAX_RIVALS = 6  # of one effect, the most probable


@dataclass(frozen=True)
class Rivals:
    """Explanations of one effect: their terms with their estimates, their probabilities (summing to
    1), and the other terms of the model, which stay free whichever is true."""

    names: tuple[str, ...]
    terms: tuple[tuple[Term, ...], ...]
    estimates: tuple[Array, ...] = field(repr=False)
    probability: Array = field(repr=False)
    others: tuple[Term, ...] = field(repr=False)


# -- rivals
# --------------------------------------------------------------------------------------------------------------------


class _Pair:
    """One true rival against another: what the other leaves, known rows and new ones."""

    def __init__(self, p: Pool, rivals: Rivals, i: int, j: int):
        columns = list(dict.fromkeys([*p.of(rivals.others), *p.of(rivals.terms[j])]))
        truth = p.of(rivals.terms[i])
        base = p.of(rivals.others)
        self.A, self.y = (
            p.possible[:, :, columns] / p.sigma,
            p.possible[:, :, truth] @ rivals.estimates[i] / p.sigma,
        )
        known, seen = (
            p.known[:, :, columns].reshape(-1, len(columns)) / p.sigma,
            (p.known[:, :, truth] @ rivals.estimates[i] / p.sigma).ravel(),
        )
        scale = np.sqrt(
            np.square(p.possible[:, :, columns]).sum(1).mean(0)
            + np.square(p.known[:, :, columns]).sum(1).mean(0)
        )
        self.G = known.T @ known + np.diag((scale / PRIOR_MM) ** 2 + 1e-12)
        self.b, self.total = known.T @ seen, float(seen @ seen)
        self.base = [columns.index(k) for k in base]

    def add_all(self) -> None:
        """Add the whole pool to what is measured."""
        self.G = self.G + np.einsum("pri,prj->ij", self.A, self.A)
        self.b = self.b + np.einsum("pri,pr->i", self.A, self.y)
        self.total += float(np.square(self.y).sum())

    def add(self, k: int) -> None:
        """Add a configuration of the pool to what is measured."""
        self.G = self.G + self.A[k].T @ self.A[k]
        self.b = self.b + self.A[k].T @ self.y[k]
        self.total += float(self.y[k] @ self.y[k])

    def compute_rest(self, columns: Sequence[int] | slice) -> float:
        """Compute the χ² of the true displacement that some columns cannot follow."""
        inner = self.G[columns][:, columns]
        return max(
            self.total - float(self.b[columns] @ np.linalg.solve(inner, self.b[columns])), 0.0
        )

    def compute_probability(self) -> float:
        """Compute the probability that the true rival is named with what is measured now."""
        size = self.compute_rest(self.base)
        left = self.compute_rest(slice(None))
        probability = _naming_probability(np.array(size), np.array(left))
        return float(probability)

    def with_each(self) -> tuple[Array, Array]:
        """Return that probability (P,) and Δ (P,) with each configuration of the pool added."""
        out = []
        for columns in (self.base, list(range(len(self.b)))):
            inner = np.linalg.inv(self.G[np.ix_(columns, columns)])
            A = self.A[:, :, columns]
            e = self.y - A @ (inner @ self.b[columns])
            H = np.eye(A.shape[1]) + A @ inner @ A.transpose(0, 2, 1)
            out.append(
                self.compute_rest(columns)
                + np.einsum("pr,pr->p", e, np.linalg.solve(H, e[:, :, None])[:, :, 0])
            )
        return _naming_probability(out[0], out[1]), out[1]


def _naming_probability(size: Array, left: Array) -> Array:
    """P(the true one fits better) = Φ(a)Φ(b) + Φ(−a)Φ(−b), a, b = δ √((1 ∓ ρ)/2), δ² = size, 1 − ρ²
    = left/size."""
    from scipy.special import ndtr

    rho = np.sqrt(np.clip(1 - left / np.maximum(size, TINY), 0, 1))
    # a from `left` itself: 1 − ρ of two that are nearly alike would cancel
    a, b = np.sqrt(left / (2 * (1 + rho))), np.sqrt(size * (1 + rho) / 2)
    return np.asarray(ndtr(a) * ndtr(b) + ndtr(-a) * ndtr(-b))


def merge_indistinct(p: Pool, rivals: Rivals) -> tuple[Rivals | None, tuple[str, ...]]:
    """Merge rivals that the whole pool would not tell from a more probable one.

    Returns the rivals left, with the probabilities summed (None where one is left), and which were
    merged."""
    kept = list[int]()
    twins = list[str]()
    weight = rivals.probability.copy()
    names = rivals.names
    for j, name in enumerate(names):
        for i in kept:
            pair = _Pair(p, rivals, j, i)
            pair.add_all()
            chi2 = pair.compute_rest(slice(None))
            if chi2 < MIN_POOL_CHI2:
                weight[i] += weight[j]
                # another constant of the same name is no news
                if name != names[i]:
                    twins.append(f"{name} and {names[i]}")
                break
        else:
            kept.append(j)
    merged = tuple(twins)
    if len(kept) < 2:
        return None, merged
    distinct = Rivals(
        tuple(names[k] for k in kept),
        tuple(rivals.terms[k] for k in kept),
        tuple(rivals.estimates[k] for k in kept),
        weight[kept],
        rivals.others,
    )
    return distinct, merged


def _build_pairs(p: Pool, sets: Sequence[Rivals]) -> list[tuple[float, list[_Pair]]]:
    """Pair every rival, as the true one with its probability, with every other of its effect."""
    return [
        (float(r.probability[i]), [_Pair(p, r, i, j) for j in range(len(r.names)) if j != i])
        for r in sets
        for i in range(len(r.names))
    ]


def _mean_naming_probability(pairs: list[tuple[float, list[_Pair]]], sets: int) -> float:
    total = 0.0
    for weight, against in pairs:
        nearest = min(pair.compute_probability() for pair in against)
        total += weight * nearest
    return total / sets


def choose_for_rivals(p: Pool, sets: Sequence[Rivals], count: int) -> tuple[list[int], list[float]]:
    """Choose the configurations that tell rivals apart, in the order to measure them.

    Returns them with the probability that the true rival is told from its nearest, before the first
    and after each. Greedy: each raises that probability
    most; exchanging them afterwards gained nothing."""
    pairs = _build_pairs(p, sets)
    chosen: list[int] = []
    before = compute_naming_probability(p, sets, chosen)
    probabilities = [before]
    for _ in range(min(count, len(p.possible))):
        configuration = _choose_next(pairs, chosen)
        chosen.append(configuration)
        for _, against in pairs:
            for pair in against:
                pair.add(configuration)
        after = compute_naming_probability(p, sets, chosen)
        probabilities.append(after)
    return chosen, probabilities


def _choose_next(pairs: list[tuple[float, list[_Pair]]], blocked: Sequence[int]) -> int:
    """Choose the configuration that tells rivals best, beside what is in the pairs already."""
    value: Array = np.zeros(1)
    for weight, against in pairs:
        probabilities, distances = [], []
        for pair in against:
            probability, distance = pair.with_each()
            probabilities.append(probability)
            distances.append(distance)
        right = np.min(probabilities, axis=0)
        apart = np.min(distances, axis=0)
        # the farther apart, where all are sure
        farness = np.tanh(apart / 1e3)
        preference = 1e-3 * farness
        worth = right + preference
        value = value + weight * worth
    value[list(blocked)] = -np.inf
    return int(np.argmax(value))


def compute_naming_probability(p: Pool, sets: Sequence[Rivals], rows: Sequence[int]) -> float:
    """Compute the probability that the true rival is told from its nearest, with some
    configurations of the pool measured."""
    pairs = _build_pairs(p, sets)
    for _, against in pairs:
        for pair in against:
            for k in rows:
                pair.add(k)
    return _mean_naming_probability(pairs, len(sets))


# -- parameters
# ----------------------------------------------------------------------------------------------------------------


# the indices of observability in words, all of singular values of the scaled Jacobian
INDEX_WORDS = {
    "o1": "all parameters together",
    "o2": "smallest over largest singular value",
    "o3": "least determined direction",
    "o4": "O2 times O3",
    "o5": "harmonic mean over all directions",
}


def _indices(information: Array, configurations: int) -> dict[str, Array]:
    """Criteria, larger is better, of informations (…, p, p) of unit-scaled columns: D and A as -log
    det and -log trace of the covariance; O1 … O5 from the singular values (Sun & Hollerbach 2008,
    table I)."""
    eigenvalues = np.linalg.eigvalsh(information)
    squares = np.maximum(eigenvalues, TINY)
    s = np.sqrt(squares)
    low = s[..., 0]
    high = s[..., -1]
    log_determinant = np.log(squares).sum(-1)
    trace = (1 / squares).sum(-1)
    geometric_mean = np.exp(np.log(s).mean(-1))
    inverse_sum = (1 / s).sum(-1)
    return {
        "d": log_determinant,
        "a": -np.log(trace),
        "o1": geometric_mean / np.sqrt(configurations),
        "o2": low / high,
        "o3": low,
        "o4": low**2 / high,
        "o5": 1 / inverse_sum,
    }


def scale_columns(p: Pool, terms: Sequence[Term]) -> tuple[Array, Array]:
    """Return the known information (k, k) and the pool's columns (P, r, k): every term in units of
    what moves the target by 1 mm rms over the pool, so that mm and rad compare; in units of the
    noise."""
    columns = p.of(terms)
    size = np.sqrt(np.square(p.possible[:, :, columns]).sum(1).mean(0))
    X = p.possible[:, :, columns] / np.maximum(size, 1e-12) / p.sigma
    K = p.known[:, :, columns].reshape(-1, len(columns)) / np.maximum(size, 1e-12) / p.sigma
    return K.T @ K, X


def compute_indices(p: Pool, terms: Sequence[Term], rows: Sequence[int]) -> dict[str, float]:
    """Compute every criterion with configurations of the pool measured beside the known ones."""
    information, X = scale_columns(p, terms)
    configurations = list(rows)
    count = len(information)
    added = X[configurations].reshape(-1, count)
    total = information + added.T @ added
    indices = _indices(total, p.configurations + len(rows))
    figures = {}
    for criterion, value in indices.items():
        figures[criterion] = float(value)
    return figures


def choose_for_parameters(p: Pool, terms: Sequence[Term], count: int, criterion: str) -> list[int]:
    """Choose the configurations that determine parameters best, in the order to measure them:
    greedy, then each exchanged once for a better one, where there is one (Fedorov 1972)."""
    information, X = scale_columns(p, terms)
    gains = X.transpose(0, 2, 1) @ X
    known = p.configurations

    def best(inner: Array, blocked: Sequence[int]) -> int:
        configurations = known + len(blocked) + 1
        value = _evaluate_additions(inner, X, gains, criterion, configurations)
        value[list(blocked)] = -np.inf
        return int(np.argmax(value))

    chosen: list[int] = []
    inner = information
    for _ in range(min(count, len(X))):
        added = best(inner, chosen)
        chosen.append(added)
        inner = inner + gains[added]
    for i, old in enumerate(list(chosen)):
        without = inner - gains[old]
        others = [k for k in chosen if k != old]
        chosen[i] = best(without, others)
        inner = without + gains[chosen[i]]
    return chosen


def _evaluate_additions(
    inner: Array, X: Array, gains: Array, criterion: str, configurations: int
) -> Array:
    """Evaluate the criterion (P,) with each configuration added; D and A by the determinant lemma."""
    if criterion in ("d", "o1", "a"):
        C = np.linalg.inv(inner)
        XC = X @ C
        H = np.eye(X.shape[1]) + XC @ X.transpose(0, 2, 1)
        if criterion == "a":
            return np.asarray(
                np.trace(np.linalg.solve(H, XC @ XC.transpose(0, 2, 1)), axis1=1, axis2=2)
            )
        return np.asarray(np.linalg.slogdet(H)[1])
    return np.concatenate(
        [
            _indices(inner + part, configurations)[criterion]
            for part in np.array_split(gains, max(1, len(gains) // 256))
        ]
    )


def count_more_needed(limit_mm: float, configurations: int, size_mm: float) -> int:
    """Count the configurations still needed until an effect of a size (rms mm at the target, beyond
    the model) is found with 90 %: the limit falls with the square root of the number of
    configurations."""
    ratio = limit_mm / size_mm
    needed = configurations * ratio**2
    total = int(np.ceil(needed))
    more = total - configurations
    return max(0, more)
