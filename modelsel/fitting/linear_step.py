"""One linear step from a fit, computed from triangular factors alone: the table of subsets needs it of
many models, without their rows."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from .._typing import Array
from ..exceptions import NotEstimable
from .design import Model
from .identifiability import Identified, identify, solve
from .least_squares import Fit, cost, factor_of
from .prior import WeakPrior, prior_root, weak_prior, with_prior
from .reduction import Reduction
from .solver import MORE_ROWS


@dataclass(frozen=True, eq=False)
class Step:
    """One linear step from a known point, computed from reductions alone: where it leads, and what is
    fitted there. `fit` gives the fit once the reduction at theta is known; `prior` (k, p+1): the prior's
    rows [columns | response] where the step starts."""

    model: Model
    theta: Array
    found: Identified
    size_mm: float
    weak: WeakPrior
    prior: Array

    def fit(self, reduction: Reduction) -> Fit:
        """Return the fit, from the reduction at theta."""
        full = with_prior(reduction, prior_root(self.model.terms, None, self.weak), self.theta)
        return Fit(
            self.model,
            self.theta,
            self.found,
            factor_of(full, self.found.kept),
            cost(reduction),
            reduction.rows,
            1,
            self.size_mm,
            reduction,
            None,
            self.weak,
        )


def one_step(model: Model, base: Fit, here: Reduction, weight: float) -> Step:
    """Take the linear step of a model that extends a `base`, from the base's fit.

    What is fitted of the base stays; the prior of usual sizes follows the noise that the model itself
    leaves. `here`: the model's reduction at the base's fit; `weight` [1/mm] of one coordinate. Raises
    NotEstimable."""
    number = {term.key: k for k, term in enumerate(base.terms)}
    place = [number.get(term.key, -1) for term in model.terms]
    theta = np.array([0.0 if k < 0 else base.theta[k] for k in place])
    kept = _kept(place, base, here)
    if here.rows <= len(kept) - base.weak.held:
        raise NotEstimable(
            f"{here.rows} measured coordinates cannot determine the {len(kept) - base.weak.held} parameters of "
            f"{' + '.join(model.names)}: {MORE_ROWS}"
        )
    weak = base.weak.placed(place)
    if weak.rows is not None:
        _, _, rss = solve(_with_rows(here, _prior(weak, theta)), kept)
        freedom = here.rows - len(kept) + weak.count
        sigma = float(np.sqrt(rss / max(freedom, 1.0)))
        weak = weak_prior(here, kept, model, theta, sigma, catalogue=True)
    prior = _prior(weak, theta)
    delta = np.zeros(len(theta))
    delta[list(kept)], _, _ = solve(_with_rows(here, prior), kept)
    triangle = here.R[:-1, :-1]
    found = Identified(kept, np.linalg.norm(triangle, axis=0), triangle, kept)
    size_mm = float(np.linalg.norm(triangle @ delta)) / weight
    return Step(model, theta + delta, found, size_mm, weak, prior)


def _kept(place: Sequence[int], base: Fit, here: Reduction) -> tuple[int, ...]:
    """List the terms that the base fits, and the new ones that do not depend on others."""
    old = [j for j, k in enumerate(place) if k in base.found.kept]
    new = [j for j, k in enumerate(place) if k < 0]
    tried = [*old, *new]
    represent = {tried[i] for i in identify(here.select(tried)).kept}
    return tuple(sorted({*old, *(represent & {*new})}))


def _prior(weak: WeakPrior, theta: Array) -> Array:
    root = weak.rows
    if root is None:
        count = len(theta)
        root = np.zeros((0, count))
    response = -root @ theta
    return np.column_stack([root, response])


def _with_rows(reduction: Reduction, rows: Array) -> Reduction:
    count = reduction.rows
    stacked = reduction.add(rows)
    return Reduction(stacked.R, count)
