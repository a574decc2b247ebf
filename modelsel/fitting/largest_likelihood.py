"""The variances at which the restricted likelihood of the parts of the errors is largest.

It is maximised over ρ ≥ 0, in the logarithms of the variances, by its exact slope: first in Newton
steps by the average information, which mostly arrive after few, else by L-BFGS-B from where they
end."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from .._linalg import TINY
from .._typing import Array, Index, Mask
from .restricted_likelihood import Likelihood, LinearModel, evaluate_likelihood, lay_out
from .shared_errors import SharedError

# of L-BFGS-B: changes of twice the log likelihood, and its slope, at which it ends
EXACT = {"maxiter": 60, "ftol": 1e-13, "gtol": 1e-5}
ROUGH = {"maxiter": 20, "ftol": 1e-7, "gtol": 3e-2}
# what the next Newton step would add to twice the log likelihood where they end, and the share of
# it that is rounding
EXACT_GAIN, ROUGH_GAIN = 1e-13, 1e-3
ROUNDING = 1e-12
# Newton steps at most, and by how much each may raise or lower the logarithm of a variance: beyond
# that the information, which is that of where it stands, says little
MOST_NEWTON_STEPS = 10
LARGEST_RISE, LARGEST_FALL = 2.0, 4.0
# times the mean square of ε that a part's is at most: where the parts have as many draws as the rows of a
# visit have coordinates, they explain whatever is left, and rows without noise would decide everything
MOST_OF_ALL = 30.0
# the same where the parts have at most so many draws for every coordinate, of which the targets of a
# visit, on one rigid body, have six at most
FEW_DRAWS = 0.7
OF_A_BODY = 6
MOST_OF_FEW = 1e4
# share of the most from which a part is at it
AT_MOST = 0.99
# the same where the maximum is sought at least, and below which a part is none
LEAST, NO_PART = 3e-7, 3e-5


def maximise_likelihood(
    model: LinearModel,
    parts: Sequence[SharedError],
    held: Sequence[SharedError] = (),
    exact: bool = True,
) -> Likelihood:
    """Maximise the restricted likelihood over the variances of parts, from those that they have.

    Parts that are `held` keep theirs; where parts are of known variance, φ is sought in their
    place. A part whose variance ends at nought is none of the result's. Unless `exact`, twice the
    log likelihood is within some hundredths of its maximum."""
    every = [*held, *parts]
    if not parts:
        return evaluate_likelihood(model, every)
    is_known = np.array([part.known is not None for part in every])
    is_sought = ~is_known & (np.arange(len(every)) >= len(held))
    unit = 1 / np.array([_mean_square(part) for part in every])
    least, most = LEAST * unit, _choose_most(every) * unit
    # where a model leaves next to nothing, a variance that is guessed from it can be beyond all bounds
    guessed = np.array([part.variance for part in every])
    every = _set_variances(every, np.where(is_sought, np.clip(guessed, least, most), guessed))
    ascent = _begin(model, every, is_sought, np.log(np.stack([least, most], axis=1)))
    ended = ascent.climb(exact)
    variance = np.array([part.variance for part in ended.parts])
    is_there = ~is_sought | (variance >= NO_PART * unit)
    if is_there.all():
        return ended
    there = [part for part, kept in zip(ended.parts, is_there, strict=True) if kept]
    return evaluate_likelihood(model, there)


def _begin(
    model: LinearModel, every: Sequence[SharedError], is_sought: Mask, ends: Array
) -> _Ascent:
    """Begin at the variances that the parts have; `ends` (k, 2): logarithms of the least and the
    most of each."""
    is_known = np.array([part.known is not None for part in every])
    of_phi = bool(is_known.any())
    layout = lay_out(every)
    variances = [part.variance for part in every]
    start = np.log(variances)
    first = evaluate_likelihood(model, every, layout)
    steps = np.eye(len(every))[:, is_sought]
    within = ends - start[:, None]
    bounds = within[is_sought]
    if of_phi:
        against = -is_known.astype(float)
        steps = np.column_stack([steps, against])
        low, high = within[is_known].T
        bounds = np.vstack([bounds, [-high.min(), -low.max()]])

    def evaluate(x: Array) -> Likelihood:
        variance = np.exp(start + steps @ x)
        return evaluate_likelihood(model, _set_variances(every, variance), layout)

    moves = np.flatnonzero(is_sought | is_known)
    return _Ascent(
        evaluate=evaluate,
        moves=moves,
        steps=steps[moves],
        of_phi=of_phi,
        bounds=bounds,
        x=np.zeros(len(bounds)),
        at=first,
    )


@dataclass
class _Ascent:
    """The search for the largest likelihood, with the best that it has seen: it begins and mostly
    ends there, which is not computed again.

    x: (s,) what it is sought over, logarithms of variances over those at the start, within `bounds`
    (s, 2); moves: (k,) numbers of the parts whose variances change, and steps: (k, s) what their
    logarithms go by. `of_phi`: where variances are known, the last of x is the logarithm of φ."""

    evaluate: Callable[[Array], Likelihood]
    moves: Index
    steps: Array
    of_phi: bool
    bounds: Array
    x: Array
    at: Likelihood
    _slopes: tuple[Array, Array] | None = field(default=None, repr=False)

    def climb(self, exact: bool) -> Likelihood:
        """Return the largest likelihood; unless `exact`, twice its logarithm to some hundredths."""
        tolerance = EXACT_GAIN if exact else ROUGH_GAIN
        has_arrived = not self.of_phi and self._take_newton_steps(tolerance)
        if has_arrived:
            return self.at
        # a seventh of a second, which most studies need not spend
        from scipy.optimize import minimize

        options = EXACT if exact else ROUGH
        start, scale = self.x, self._choose_scale()

        def lose(z: Array) -> tuple[float, Array]:
            loss, slope = self._lose(start + z / scale)
            return loss, slope / scale

        bounds = (self.bounds - start[:, None]) * scale[:, None]
        origin = np.zeros(len(start))
        found = minimize(lose, origin, jac=True, method="L-BFGS-B", bounds=bounds, options=options)
        return self._look(start + found.x / scale)

    def _look(self, x: Array) -> Likelihood:
        """Return the likelihood at x."""
        is_here = np.array_equal(x, self.x)
        if is_here:
            return self.at
        at = self.evaluate(x)
        if not at.log < self.at.log:
            self.x, self.at, self._slopes = x.copy(), at, None
        return at

    def _lose(self, x: Array) -> tuple[float, Array]:
        """Compute what is minimised at x: less twice the log likelihood, and its slope (s,)."""
        at = self._look(x)
        by_variance, _ = self._differentiate(at)
        by_part = by_variance * self._list_variances(at)
        slope = self.steps.T @ by_part
        if self.of_phi:
            expected = at.square / at.phi
            slope[-1] -= at.model.freedom - expected
        loss = -at.log
        return loss, -slope

    def _choose_scale(self) -> Array:
        """Choose (s,) what makes the likelihood about equally curved in each of x."""
        at = self.at
        _, moved = self._differentiate(at)
        information = np.diagonal(at.information(moved))
        curvature = information * self._list_variances(at) ** 2
        by_x = np.square(self.steps).T @ curvature
        if self.of_phi:
            by_x[-1] = at.model.freedom
        return np.sqrt(np.maximum(by_x, 1.0))

    def _take_newton_steps(self, tolerance: float) -> bool:
        """Take Newton steps as long as they raise the likelihood; returns whether the next one is
        expected to raise its logarithm by no more than a tolerance."""
        low, high = self.bounds.T
        for _ in range(MOST_NEWTON_STEPS):
            step, gain = self._choose_step()
            if gain <= tolerance:
                return True
            before = self.at.log
            further = self.x + step
            bounded = np.clip(further, low, high)
            after = self._look(bounded)
            if not after.log > before:
                return gain <= ROUNDING * abs(before)
        return False

    def _choose_step(self) -> tuple[Array, float]:
        """Choose the next step (s,) of x, and what it would add to twice the log likelihood if that
        were a parabola in the variances.

        The variance of a part that seems to be none has a slope, too: it may rise again."""
        slope, moved = self._differentiate(self.at)
        free = self._find_free(slope)
        information = self.at.information(moved[:, :, free])
        step = np.zeros(len(self.x))
        # where a model leaves nothing, no number says where to go
        if not np.isfinite(information).all():
            return step, np.inf
        squares = np.diagonal(information)
        unit = np.sqrt(np.maximum(squares, TINY))
        curvature = information / np.outer(unit, unit)
        by_unit = slope[free] / unit
        newton = np.linalg.lstsq(curvature, by_unit, rcond=None)[0]
        gain = float(by_unit @ newton)
        variances = self._list_variances(self.at)
        share = newton / unit / variances[free]
        # far below its size, a variance rises to where its slope tells that it is
        rise = np.log1p(np.maximum(share, 0.0))
        largest = np.maximum(LARGEST_RISE, rise)
        step[free] = np.clip(share, -LARGEST_FALL, largest)
        return step, gain

    def _find_free(self, slope: Array) -> Index:
        """Find those of x that may move: neither none nor at the most, with a slope (s,) to there."""
        low, high = self.bounds.T
        nearly_none = low + np.log(NO_PART / LEAST)
        stays_none = (self.x < nearly_none) & (slope < 0)
        stays_most = (self.x >= high) & (slope > 0)
        return np.flatnonzero(~(stays_none | stays_most))

    def _list_variances(self, at: Likelihood) -> Array:
        """List (k,) the variances of the parts whose variances change."""
        return np.array([at.parts[k].variance for k in self.moves])

    def _differentiate(self, at: Likelihood) -> tuple[Array, Array]:
        """Compute the slopes (k,) of twice the log likelihood by the variances that change, and V P y
        (m, c, k) of their parts."""
        if at is self.at and self._slopes is not None:
            return self._slopes
        own = [at.slope(at.parts[k]) for k in self.moves]
        slopes = np.array([slope for slope, _ in own])
        known = slopes, np.concatenate([moved for _, moved in own], axis=2)
        if at is self.at:
            self._slopes = known
        return known


def _choose_most(parts: Sequence[SharedError]) -> float:
    """Choose how many times the mean square of ε a part's may be."""
    if any(part.time is not None for part in parts):
        return MOST_OF_ALL
    levels = [_count_levels(part) for part in parts]
    draws = sum(count * part.loading.shape[2] for count, part in zip(levels, parts, strict=True))
    finest = parts[int(np.argmax(levels))]
    has_few = draws <= FEW_DRAWS * _count_motions(finest)
    return MOST_OF_FEW if has_few else MOST_OF_ALL


def _count_levels(part: SharedError) -> int:
    """Count the levels of a part that move rows: some have it at one target alone."""
    loading = part.loading
    is_moved = loading.any(axis=(1, 2))
    moved = part.level[is_moved]
    levels = np.unique(moved)
    return len(levels)


def _count_motions(part: SharedError) -> int:
    """Count the numbers that rows of each level can differ in from the model: their coordinates, and those
    of a rigid body at most, which the targets of a visit are on."""
    _, components, _ = part.loading.shape
    _, rows = np.unique(part.level, return_counts=True)
    return int(np.minimum(rows * components, OF_A_BODY).sum())


def is_at_most(parts: Sequence[SharedError]) -> bool:
    """Whether one of the parts is as large as it may be: ε could be smaller then, down to nothing."""
    sought = [part for part in parts if part.known is None]
    if not sought:
        return False
    largest = max(part.variance * _mean_square(part) for part in sought)
    return largest > AT_MOST * _choose_most(parts)


def _mean_square(part: SharedError) -> float:
    """Compute the mean square of a row's coordinate by draws of unit variance."""
    return max(float(np.square(part.loading).sum(2).mean()), TINY)


def _set_variances(parts: Sequence[SharedError], variance: Array) -> list[SharedError]:
    return [replace(part, variance=float(v)) for part, v in zip(parts, variance, strict=True)]
