"""What does not repeat: the variance components of a campaign's errors, and what identifies each.

Parts: the instrument; each joint, which repeats to a standard deviation of its own, one draw a visit,
shared by all targets; what the instrument has in one direction more than in others; what the rows of
one configuration share; what the rows of one group share; what lasts along the order of motion. A part
beyond the instrument is accepted if it raises the restricted likelihood by more than chance does at
LEVEL: without it, twice the gain is zero in half of all studies and otherwise chi-square (Self & Liang
1987; Stram & Lee 1994, Biometrics 50, 1171), which is conservative in small studies (Crainiceanu &
Ruppert 2004)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import compress
from typing import NamedTuple

import numpy as np

from .._linalg import TINY
from .._part_names import INSTRUMENT, is_of_instrument
from .._typing import Index, Mask
from .design import compute_design
from .largest_likelihood import maximise_likelihood
from .least_squares import Fit
from .noise import compute_interval
from .part_certainty import bound_instrument, count_freedom, measure_certainty
from .part_trials import LEVEL, change_length, compute_p, find_next
from .possible_parts import MIN_LEVELS, PossiblePart
from .problem import Problem
from .restricted_likelihood import Likelihood, LinearModel, evaluate_likelihood
from .shared_errors import MAX_BLOCK, SharedError, SharedErrors, group_blocks, keep_within, mix
from .whitening import Whitening

# parts beyond the instrument
MAX_PARTS = 6
# parts that are added at most, of which some may be dropped again
MOST_STEPS = 12
# a variance of so many standard errors is certain: the fit without its part is not tried
CERTAIN = 3.5
# a part with a larger p is doubtful: the instrument's interval also covers the fit without it
DOUBTFUL = 1e-3
# largest number of rows that the parts are estimated from
MAX_ROWS = 2048
# digits of the logarithm of a variance
DIGITS = 4
# largest number of a model's columns that are projected out of the rows
MANY_COLUMNS = 96
# largest factor between two variances, relative to the instrument's, that counts as no change
MAX_CHANGE = 1.3


@dataclass(frozen=True)
class ErrorPart:
    """A part of the errors.

    scale, low, high: its standard deviation and 95 % interval [unit]; share: of the mean square at
    the target that is left; at_target: its rms there [mm]; told_by: what in the data identifies it;
    length: correlation length of a lasting error [visits]; instead: labels of effects that would
    explain the data about as well."""

    name: str
    unit: str
    scale: float
    low: float
    high: float
    share: float
    at_target: float
    told_by: str
    length: float | None = None
    instead: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False)
class ErrorStructure:
    """The parts of a campaign's errors, the instrument first, and of the others what rows share."""

    parts: tuple[ErrorPart, ...] = ()
    shared: tuple[SharedError, ...] = ()

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the parts beyond the instrument."""
        return tuple(part.name for part in self.parts[1:])

    def tells(self, *by: str) -> bool:
        """Whether there is a part that one of `by` identifies."""
        return any(part.told_by in by for part in self.parts)

    def without(self, by: str) -> ErrorStructure:
        """Return the parts without those that `by` identifies."""
        return self._keep([part.told_by != by for part in self.parts])

    def without_instrument(self) -> ErrorStructure:
        """Return the parts without those that the instrument has in some directions or rows."""
        return self._keep([not is_of_instrument(part.name) for part in self.parts])

    def of_instrument(self) -> ErrorStructure:
        """Return the instrument's parts alone, which every row has by itself."""
        return self._keep([part.name.startswith(INSTRUMENT) for part in self.parts])

    def _keep(self, kept: list[bool]) -> ErrorStructure:
        """Keep some of the parts, the instrument's first among them."""
        parts = compress(self.parts, kept)
        shared = compress(self.shared, kept[1:])
        return ErrorStructure(tuple(parts), tuple(shared))

    def resembles(self, other: ErrorStructure) -> bool:
        """Whether both give the rows about the same weights."""
        if self.names != other.names:
            return False
        variances = (part.variance for part in self.shared)
        others = (part.variance for part in other.shared)
        return all(
            1 / MAX_CHANGE < a / b < MAX_CHANGE for a, b in zip(variances, others, strict=True)
        )

    def whiten(self, problem: Problem) -> Problem:
        """Whiten all rows of the problem that has these parts: their errors become independent."""
        if not self.shared:
            return problem
        stated = problem.whitening.as_stated()
        kept = keep_within(self.shared)
        blocks = [len(group_blocks(part.level)[-1][0]) for part in kept]
        if max(blocks) > 1:
            whitening = replace(stated, shared=SharedErrors(kept), stated=stated)
        else:
            whitening = _whiten_rows(stated, kept, len(problem), problem.components)
        others = self.without_instrument()
        if len(others.parts) < len(self.parts):
            whitened = others.whiten(problem.as_stated())
            whitening = replace(whitening, others=whitened.whitening)
        return replace(problem, whitening=whitening)


def _whiten_rows(
    stated: Whitening, parts: Sequence[SharedError], rows: int, components: int
) -> Whitening:
    """Whiten rows that share nothing with one another: a matrix each."""
    mixing = mix(parts)
    inverse = mixing.inverse[0]
    matrices = np.empty((rows, components, components))
    matrices[mixing.rows[0][:, 0]] = inverse
    if stated.matrices is not None:
        matrices = matrices @ stated.matrices
    return Whitening(stated.weight, matrices, stated=stated)


# -- which of them are there
# ------------------------------------------------------------------------------------------------------


class _LeftOut(NamedTuple):
    """The place of the part that was left out, the fit without it, and the p-value of what the part
    gains."""

    place: int
    without: Likelihood
    p: float


def find_structure(
    problem: Problem,
    training: Mask,
    fitted: Fit,
    candidates: Sequence[PossiblePart],
    before: ErrorStructure | None = None,
) -> ErrorStructure:
    """Find the parts that the errors of a fitted model have, in the rows (m,) it was fitted to.

    The `candidates` cover all rows of the problem; those of known variance are always included. Parts
    are added while the likelihood gains more than by chance; one that the others make dispensable is
    dropped. `before`: the parts that a similar model left in these rows, to start from. Without
    candidates the structure is empty, even of the instrument's part."""
    if not candidates:
        return ErrorStructure()
    rows = _choose_rows(problem, training)
    offered = [one.take(rows) for one in candidates]
    used = problem.take(rows)
    model = _build_model(used, fitted)
    if model.freedom < MIN_LEVELS:
        return ErrorStructure()
    known = [one for one in offered if one.error.known is not None]
    if before is None or not before.shared or known:
        chosen, at = known, _start_with_known(model, known)
    else:
        chosen, at = _go_on(model, offered, before)
    others: list[Likelihood] = []
    for _ in range(MOST_STEPS):
        if len(chosen) >= MAX_PARTS:
            break
        found, unsure = find_next(at, offered, chosen)
        if found is None:
            if unsure is not None:
                nearly = evaluate_likelihood(model, unsure)
                others.append(nearly)
            break
        chosen, at = _prune(*found)
    if chosen:
        ordered = _sort(at.parts, offered)
        at = maximise_likelihood(model, ordered)
        chosen = _match(offered, at)
    others += _fit_without_doubtful(chosen, at)
    return _describe(problem, at, chosen, candidates, offered, others)


def _start_with_known(model: LinearModel, known: Sequence[PossiblePart]) -> Likelihood:
    """Compute the likelihood with the parts of known variance alone."""
    none = evaluate_likelihood(model, ())
    start = [replace(one.error, variance=(one.error.known or 0.0) / none.phi) for one in known]
    return maximise_likelihood(model, start)


def _go_on(
    model: LinearModel, offered: Sequence[PossiblePart], before: ErrorStructure
) -> tuple[list[PossiblePart], Likelihood]:
    """Start from the parts of a similar model, and drop those that are no longer there."""
    variances = {
        (part.name, part.told_by, part.length): own.variance
        for part, own in zip(before.parts[1:], before.shared, strict=True)
    }
    chosen, start = [], []
    for one in offered:
        variance = variances.get((one.name, one.told_by, _length_of(one)))
        if variance is not None:
            chosen.append(one)
            start.append(replace(one.error, variance=variance))
    at = maximise_likelihood(model, start, exact=False)
    chosen, at = _prune(chosen, at, least=0)
    return change_length(at, offered, chosen)


def _choose_rows(problem: Problem, training: Mask) -> Index:
    """Choose the rows to estimate from: where there are many, stretches spread over the campaign."""
    rows = np.flatnonzero(training)
    if len(rows) <= MAX_ROWS:
        return rows
    order = rows[np.argsort(problem.data.progress[rows], kind="stable")]
    count = MAX_ROWS // MAX_BLOCK
    starts = np.linspace(0, len(rows) - MAX_BLOCK, count).astype(np.intp)
    chosen = order[(starts[:, None] + np.arange(MAX_BLOCK)).reshape(-1)]
    return np.unique(chosen)


def _build_model(problem: Problem, fitted: Fit) -> LinearModel:
    """Build the linear model at a fit. Of many columns, those of shrunk terms are left out, then all
    but the first; the residual is scaled up for the degrees of freedom that these took."""
    by_row = problem.as_stated()
    kept = list(fitted.representatives)
    if len(kept) > MANY_COLUMNS and fitted.precision is not None:
        kept = [k for k in kept if not fitted.precision[k]]
    kept = kept[:MANY_COLUMNS]
    X, residual = compute_design(by_row, [fitted.terms[k] for k in kept], fitted.at())
    N = by_row.coordinates
    taken = N - fitted.freedom * N / fitted.rows
    given_back = np.sqrt(max(N - len(kept), 1) / max(N - max(taken, len(kept)), 1))
    m, c, p = X.shape
    flat = X.reshape(m * c, p)
    # columns that hardly differ are no trouble once they are orthonormal
    Q = np.linalg.qr(flat / np.maximum(np.linalg.norm(flat, axis=0), TINY))[0]
    by_column = np.ascontiguousarray(Q.T.reshape(p, m, c).transpose(0, 2, 1))
    return LinearModel(by_column, residual.T * given_back, float(max(N - p, 1)))


def _prune(
    chosen: list[PossiblePart], at: Likelihood, least: int = 1
) -> tuple[list[PossiblePart], Likelihood]:
    """Drop the parts that the others make dispensable, the least likely first, to no fewer than
    `least`."""
    chosen = _match(chosen, at)
    while len(chosen) > least:
        trial = _leave_out_weakest(chosen, at, exact=False)
        if trial is None or trial.p <= LEVEL:
            break
        del chosen[trial.place]
        at = trial.without
        chosen = _match(chosen, at)
    return chosen, at


def _fit_without_doubtful(chosen: Sequence[PossiblePart], at: Likelihood) -> list[Likelihood]:
    """Fit without the least certain part; empty where no part is doubtful."""
    if not chosen:
        return []
    trial = _leave_out_weakest(chosen, at)
    if trial is None or trial.p <= DOUBTFUL:
        return []
    return [trial.without]


def _leave_out_weakest(
    chosen: Sequence[PossiblePart], at: Likelihood, exact: bool = True
) -> _LeftOut | None:
    """Leave out the least certain part; None where all are certain."""
    certainty = measure_certainty(at)
    k = int(np.argmin(certainty))
    if certainty[k] > CERTAIN:
        return None
    rest = list(at.parts)
    del rest[k]
    without = maximise_likelihood(at.model, rest, exact=exact)
    gain = at.log - without.log
    p = chosen[k].tests * compute_p(gain)
    return _LeftOut(k, without, p)


def _match(chosen: Sequence[PossiblePart], at: Likelihood) -> list[PossiblePart]:
    """Keep the candidates whose parts the likelihood still has."""
    return [one for one in chosen if any(one.error.is_like(part) for part in at.parts)]


def _sort(parts: Sequence[SharedError], offered: Sequence[PossiblePart]) -> list[SharedError]:
    """Sort parts in the order of the candidates, whatever the order in which they were found."""
    return [part for one in offered for part in parts if one.error.is_like(part)]


# -- how large they are
# ------------------------------------------------------------------------------------------------------


def _describe(
    problem: Problem,
    at: Likelihood,
    chosen: Sequence[PossiblePart],
    candidates: Sequence[PossiblePart],
    offered: Sequence[PossiblePart],
    others: Sequence[Likelihood],
) -> ErrorStructure:
    """Describe the parts: scales, intervals, shares. The instrument's interval holds that of the
    `others`, too: fits without a doubtful part, or with one that may be there."""
    variances = np.array([1.0, *(part.variance for part in at.parts)]) * at.phi
    squares = np.array([_square_of_instrument(problem), *(one.square for one in chosen)])
    total = float(variances @ squares)
    at_target = variances * squares
    shares = (at_target / total).tolist()
    rms = np.sqrt(at_target).tolist()
    instrument = float(np.sqrt(squares[0] / 3))
    scale = float(np.sqrt(at.phi) * instrument)
    low, high = bound_instrument([at, *others], instrument)
    parts = [ErrorPart("instrument", "mm", scale, low, high, shares[0], rms[0], "what is left")]
    freedom = count_freedom(at)
    for k, one in enumerate(chosen, 1):
        scale = float(np.sqrt(variances[k]))
        low, high = compute_interval(scale, freedom[k])
        sizes = scale, low, high, shares[k], rms[k]
        parts.append(ErrorPart(one.name, one.unit, *sizes, one.told_by, _length_of(one)))
    places = [offered.index(one) for one in chosen]
    shared = tuple(
        replace(candidates[k].error, variance=_round(part.variance))
        for k, part in zip(places, at.parts, strict=True)
    )
    return ErrorStructure(tuple(parts), shared)


def _round(variance: float) -> float:
    """Round a variance to the digits that the iteration determines, so that results are reproducible."""
    return float(np.exp(np.round(np.log(variance), DIGITS)))


def _length_of(one: PossiblePart) -> float | None:
    return one.error.length if one.error.time is not None else None


def _square_of_instrument(problem: Problem) -> float:
    """Compute the mean square [mm²] at the target of one whitened unit of the instrument."""
    whitening = problem.whitening.as_stated()
    matrices = whitening.matrices
    if matrices is None:
        return 3.0 / whitening.weight**2
    information = np.einsum("mji,mjk->mik", matrices, matrices) * whitening.weight**2
    covariance = np.linalg.inv(information)[:, :3, :3]
    return float(np.trace(covariance, axis1=1, axis2=2).mean())
