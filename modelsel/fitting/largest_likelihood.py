"""The variances at which the restricted likelihood of the parts of the errors is largest.

It is maximised over ρ ≥ 0, in the logarithms of the variances, by its exact slope: first in Newton
steps by the average information, which are near the maximum after few, then by L-BFGS-B from
there, which ends at once where they have arrived."""

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
# slopes at which Newton steps end: the last step, which is short, costs one likelihood
EXACT_SLOPE, ROUGH_SLOPE = 1e-7, 3e-2
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
    # a seventh of a second, which studies without such parts need not spend
    from scipy.optimize import minimize

    is_known = np.array([part.known is not None for part in every])
    is_sought = ~is_known & (np.arange(len(every)) >= len(held))
    unit = 1 / np.array([_mean_square(part) for part in every])
    least, most = LEAST * unit, _choose_most(every) * unit
    # where a model leaves next to nothing, a variance that is guessed from it can be beyond all bounds
    guessed = np.array([part.variance for part in every])
    every = _set_variances(every, np.where(is_sought, np.clip(guessed, least, most), guessed))
    options = EXACT if exact else ROUGH
    ascent = _begin(model, every, is_sought, np.log(np.stack([least, most], axis=1)))
    if not is_known.any():
        ascent.take_newton_steps(EXACT_SLOPE if exact else ROUGH_SLOPE)
    found = minimize(
        ascent.lose, ascent.x, jac=True, method="L-BFGS-B", bounds=ascent.bounds, options=options
    )
    ended = ascent.look(found.x)
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
    layout = lay_out(every)
    start = np.log([part.variance for part in every])
    first = evaluate_likelihood(model, every, layout)
    scale = _choose_scale(first, is_sought)
    steps = np.eye(len(every))[:, is_sought]
    low, high = (ends - start[:, None]).T
    bounds = np.stack([low, high], axis=1)[is_sought]
    if is_known.any():
        steps = np.column_stack([steps, -is_known.astype(float)])
        scale = np.append(scale, np.sqrt(model.freedom))
        bounds = np.vstack([bounds, [-high[is_known].min(), -low[is_known].max()]])

    def evaluate(x: Array) -> Likelihood:
        variance = np.exp(start + steps @ (x / scale))
        return evaluate_likelihood(model, _set_variances(every, variance), layout)

    moves = np.flatnonzero(is_sought | is_known)
    of_phi = bool(is_known.any())
    return _Ascent(
        evaluate, moves, steps[moves], of_phi, scale, bounds * scale[:, None], 0 * scale, first
    )


@dataclass
class _Ascent:
    """The search for the largest likelihood, with the best that it has seen: it begins and mostly
    ends there, which is not computed again.

    x: (s,) what it is sought over, logarithms of variances over those at the start, each times its
    `scale` (s,), within `bounds` (s, 2); moves: (k,) numbers of the parts whose variances change,
    and steps: (k, s) what their logarithms go by. `of_phi`: where variances are known, the last of
    x is the logarithm of φ."""

    evaluate: Callable[[Array], Likelihood]
    moves: Index
    steps: Array
    of_phi: bool
    scale: Array
    bounds: Array
    x: Array
    at: Likelihood
    _slope: tuple[Array, Array] | None = field(default=None, repr=False)

    def look(self, x: Array) -> Likelihood:
        """Return the likelihood at x."""
        is_here = np.array_equal(x, self.x)
        if is_here:
            return self.at
        at = self.evaluate(x)
        if not at.log < self.at.log:
            self.x, self.at, self._slope = x.copy(), at, None
        return at

    def lose(self, x: Array) -> tuple[float, Array]:
        """Compute what is minimised at x: less twice the log likelihood, and its slope (s,)."""
        at = self.look(x)
        slope, _ = self._differentiate(at)
        return -at.log, -slope

    def take_newton_steps(self, tolerance: float) -> None:
        """Take Newton steps as long as they raise the likelihood, and until its slope is below a
        tolerance."""
        low, high = self.bounds.T
        for _ in range(MOST_NEWTON_STEPS):
            slope, moved = self._differentiate(self.at)
            is_stuck = (self.x <= low) & (slope < 0) | (self.x >= high) & (slope > 0)
            free = np.flatnonzero(~is_stuck)
            if np.abs(slope[free]).max(initial=0.0) <= tolerance:
                return
            step = np.zeros(len(self.x))
            step[free] = self._choose_step(slope, moved, free)
            before = self.at.log
            after = self.look(np.clip(self.x + step, low, high))
            if not after.log > before:
                return

    def _choose_step(self, slope: Array, moved: Array, free: Index) -> Array:
        """Choose the step of those of x that are free, from the slope (s,) and V P y (m, c, s)."""
        variance = np.array([self.at.parts[k].variance for k in self.moves])
        unit = variance / self.scale
        information = self.at.information(moved) * np.outer(unit, unit)
        own = information[np.ix_(free, free)]
        newton = np.linalg.lstsq(own, slope[free], rcond=None)[0]
        scale = self.scale[free]
        return np.clip(newton, -LARGEST_FALL * scale, LARGEST_RISE * scale)

    def _differentiate(self, at: Likelihood) -> tuple[Array, Array]:
        """Compute the slope (s,) of twice the log likelihood, and V P y (m, c, k) of the parts whose
        variances change."""
        if at is self.at and self._slope is not None:
            return self._slope
        own = [at.slope(at.parts[k]) for k in self.moves]
        variance = np.array([at.parts[k].variance for k in self.moves])
        by_part = np.array([slope for slope, _ in own]) * variance
        slope = self.steps.T @ by_part
        if self.of_phi:
            slope[-1] -= at.model.freedom - at.square / at.phi
        known = slope / self.scale, np.concatenate([moved for _, moved in own], axis=2)
        if at is self.at:
            self._slope = known
        return known


def _choose_scale(at: Likelihood, is_sought: Mask) -> Array:
    """Choose (k,) what makes the likelihood about equally curved in the logarithms of the variances
    that are sought."""
    scale = []
    for k in np.flatnonzero(is_sought):
        part = at.parts[k]
        information = float(at.information(at.slope(part)[1])[0, 0])
        curvature = information * part.variance**2
        scale.append(np.sqrt(max(curvature, 1.0)))
    return np.array(scale)


def _choose_most(parts: Sequence[SharedError]) -> float:
    """Choose how many times the mean square of ε a part's may be."""
    if any(part.time is not None for part in parts):
        return MOST_OF_ALL
    levels = [len(np.unique(part.level)) for part in parts]
    draws = sum(count * part.loading.shape[2] for count, part in zip(levels, parts, strict=True))
    finest = parts[int(np.argmax(levels))]
    has_few = draws <= FEW_DRAWS * _count_motions(finest)
    return MOST_OF_FEW if has_few else MOST_OF_ALL


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
