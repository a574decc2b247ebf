"""The fewest changes that explain a difference of parameters: orthogonal matching pursuit with the
difference's covariance, over single terms and over groups of directions that change together."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..._linalg import RANK_TOLERANCE, TINY, orthonormal_basis, project_out
from ..._typing import Array
from .mechanism_changes import SIGNIFICANCE

MIN_CHI2 = 9.0  # that a term must explain to be named
MAX_CHI2_LOSS = 2.0  # by how much less another term may explain and still do as well
MIN_FREE_NORM = 1e-6  # of a unit column beyond the chosen ones, to be another direction
# of the longest column: what is shorter is rounding, of a term that moves nothing that is tested
MIN_LENGTH = 1e-9


@dataclass(frozen=True, eq=False)
class Step:
    """A chosen term, or group where it is beyond the terms; the changes (d,) of its directions,
    their covariance factor (d, k), and the terms and groups that would do as well."""

    term: int
    changes: Array
    factor: Array
    alike: list[int]

    @property
    def change(self) -> float:
        """The change of a single term."""
        first = self.changes[0]
        return float(first)

    @property
    def standard_error(self) -> float:
        """The standard error of a single term's change."""
        first = self.factor[0]
        error = np.linalg.norm(first)
        return float(error)


@dataclass(frozen=True, eq=False)
class _Candidate:
    """A term or a group: its whitened directions (k, d), and an orthonormal basis of them."""

    columns: Array
    basis: Array


def select_fewest_terms(
    difference: Array,
    factor: Array,
    directions: Array,
    groups: Sequence[Array] = (),
    separate: Sequence[int] = (),
    moves: Array | None = None,
) -> list[Step]:
    """Select terms one after the other until what they leave of a difference is chance.

    `difference` (k,) has the covariance factor factorᵀ; `directions` (terms, k) is what a unit of
    each term changes; each of `groups` (d, k) changes in d directions at once, and is numbered after
    the terms. The groups at the places `separate` are also tried all at once, each on its own. `moves`
    (terms,): how far a unit of each term moves the target; of terms that explain alike the one is
    chosen that then moves it least.
    Generalised least squares by orthogonal matching pursuit; what later ones make superfluous is
    dropped.
    """
    from scipy.linalg import qr, solve_triangular

    count = len(difference)
    # factor factorᵀ = L Lᵀ
    R = qr(factor.T, mode="r")[0]
    L = R[:count].T
    response = solve_triangular(L, difference, lower=True)
    columns = solve_triangular(L, directions.T, lower=True)
    candidates = _build_single(columns)
    for group in groups:
        own = solve_triangular(L, group.T, lower=True)
        basis = orthonormal_basis(own)
        candidates.append(_Candidate(own, basis))
    parts = [len(columns.T) + place for place in separate]
    search = _Search(response, candidates, parts, moves)
    search.run()
    return search.solve()


def _build_single(columns: Array) -> list[_Candidate]:
    """Build the candidates of single terms from their whitened columns (k, terms); what is rounding
    beside the longest moves nothing."""
    lengths = np.linalg.norm(columns, axis=0)
    shortest = MIN_LENGTH * lengths.max(initial=0.0)
    candidates = []
    for column, length in zip(columns.T, lengths.tolist(), strict=True):
        own = column[:, None]
        basis = own[:, :0]
        if length > shortest:
            basis = own / length
        candidates.append(_Candidate(own, basis))
    return candidates


class _Search:
    """The terms chosen so far, and what would do as well as each when it was chosen."""

    def __init__(
        self,
        response: Array,
        candidates: list[_Candidate],
        separate: list[int],
        moves: Array | None,
    ) -> None:
        self.response = response
        self.candidates = candidates
        self.separate = separate
        self.moves = np.zeros(0) if moves is None else moves
        self.alike: dict[int, list[int]] = {}

    def run(self) -> None:
        """Choose until what is left is chance, nothing explains it, or the choice goes round in a circle."""
        from scipy.special import chdtrc

        count = len(self.response)
        visited = set[frozenset[int]]()
        while frozenset(self.alike) not in visited:
            visited.add(frozenset(self.alike))
            basis = self._span(list(self.alike))
            residual = project_out(self.response, basis)
            chi2 = float(residual @ residual)
            free = count - basis.shape[1]
            if free <= 0 or chdtrc(free, chi2) >= SIGNIFICANCE:
                return
            if not self._choose(basis, residual):
                return
            self._drop_superfluous()

    def _choose(self, basis: Array, residual: Array) -> bool:
        """Choose the best candidate, or all that may change separately; whether there is one."""
        gains = []
        scores = []
        for candidate in self.candidates:
            gain, dims = _explain(candidate.basis, basis, residual)
            gains.append(gain)
            score = _score(gain, dims)
            scores.append(score)
        most = max(scores)
        all_at_once = self._score_separate(basis, residual)
        if max(most, all_at_once) < MIN_CHI2:
            return False
        if all_at_once > most:
            for place in self.separate:
                self.alike.setdefault(place, [])
            return True
        best = scores.index(most)
        least = gains[best] - MAX_CHI2_LOSS
        alike = [place for place, gain in enumerate(gains) if gain > least]
        best = self._find_smallest(best, alike, basis, residual)
        rivals = [place for place in alike if place != best]
        is_new = best not in self.alike
        self.alike.setdefault(best, rivals)
        return is_new

    def _find_smallest(self, best: int, alike: Sequence[int], basis: Array, residual: Array) -> int:
        """Find the term that moves the target least, of those that explain a difference alike: a turn
        by 20 mrad is not told where a shift of 1 mm does the same."""
        count = len(self.moves)
        if best >= count:
            return best
        singles = []
        moved = []
        for place in alike:
            if place < count:
                change = self._estimate(place, basis, residual)
                size = abs(change) * float(self.moves[place])
                singles.append(place)
                moved.append(size)
        least = min(moved)
        smallest = moved.index(least)
        return singles[smallest]

    def _estimate(self, place: int, basis: Array, residual: Array) -> float:
        """Estimate the change of a single term beyond what is chosen."""
        candidate = self.candidates[place]
        beyond = project_out(candidate.columns, basis)
        column = beyond[:, 0]
        square = float(column @ column)
        explained = float(column @ residual)
        return explained / max(square, TINY)

    def _score_separate(self, basis: Array, residual: Array) -> float:
        """Score the groups that may change separately, all at once: each of them is named, and costs
        what a further term does."""
        count = len(self.separate)
        if count < 2:
            return -1.0
        whole = self._span(self.separate)
        gain, dims = _explain(whole, basis, residual)
        further = count - 1
        cost = MIN_CHI2 * further
        return _score(gain, dims) - cost

    def _drop_superfluous(self) -> None:
        """Drop what the others that are chosen explain, too."""
        for place in list(self.alike):
            others = list(self.alike)
            others.remove(place)
            basis = self._span(others)
            residual = project_out(self.response, basis)
            candidate = self.candidates[place]
            lost, dims = _explain(candidate.basis, basis, residual)
            score = _score(lost, dims)
            if score < MIN_CHI2:
                del self.alike[place]

    def _span(self, chosen: list[int]) -> Array:
        """Return an orthonormal basis of what candidates span."""
        rows = len(self.response)
        bases = [np.zeros((rows, 0))]
        for place in chosen:
            candidate = self.candidates[place]
            bases.append(candidate.basis)
        columns = np.column_stack(bases)
        return orthonormal_basis(columns)

    def solve(self) -> list[Step]:
        """Solve for the changes of what was chosen, all at once."""
        if not self.alike:
            return []
        columns = [self.candidates[place].columns for place in self.alike]
        stacked = np.column_stack(columns)
        lengths = np.linalg.norm(stacked, axis=0)
        lengths = np.maximum(lengths, TINY)
        unit = stacked / lengths
        inverse = np.linalg.pinv(unit, rcond=RANK_TOLERANCE)
        factor = inverse / lengths[:, None]
        steps = []
        start = 0
        for place, own in zip(self.alike, columns, strict=True):
            end = start + own.shape[1]
            rows = factor[start:end]
            changes = rows @ self.response
            step = Step(place, changes, rows, self.alike[place])
            steps.append(step)
            start = end
        return steps


def _explain(own: Array, basis: Array, residual: Array) -> tuple[float, int]:
    """Return the χ² that directions (k, d) explain beyond a basis, and how many are new."""
    beyond = project_out(own, basis)
    U, singular, _ = np.linalg.svd(beyond, full_matrices=False)
    is_new = singular > MIN_FREE_NORM
    new = U[:, is_new]
    explained = new.T @ residual
    chi2 = explained @ explained
    return float(chi2), new.shape[1]


def _score(gain: float, dims: int) -> float:
    """Return the χ² that is explained less what chance, and the choice of so many sizes, would have
    given: a group of three must explain more than a term."""
    if not dims:
        return -1.0
    each = max(gain / dims, 1.0)
    price = 1 + math.log(each)
    further = dims - 1
    return gain - further * price
