"""How surely the variances of the parts of the errors are known."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from .._linalg import TINY
from .._typing import Array
from .largest_likelihood import is_at_most
from .noise import compute_interval
from .restricted_likelihood import Likelihood

# factor by which a correlation length is changed, for the derivative by it
STEP = 1.05


def measure_certainty(at: Likelihood) -> Array:
    """Measure (k,) the parts' variances in units of their standard errors; infinite for known ones."""
    moved = np.concatenate([at.slope(part)[1] for part in at.parts], axis=2)
    variances = np.array([part.variance for part in at.parts])
    # the information is of twice the log likelihood
    certainty = 1 / np.sqrt(_compute_relative_variance(0.5 * at.information(moved), variances))
    is_known = [part.known is not None for part in at.parts]
    return np.where(is_known, np.inf, certainty)


def _compute_relative_variance(information: Array, variances: Array) -> Array:
    """Compute (k,) Var(σ²) / σ⁴ of variances from their information (k, k), whatever their units."""
    relative = information * np.outer(variances, variances)
    return np.maximum(np.diagonal(np.linalg.pinv(relative)), TINY)


def bound_instrument(fits: Sequence[Likelihood], instrument: float) -> tuple[float, float]:
    """Compute an interval of the instrument's scale that holds its interval of every fit, from
    nought where a part is as large as it may be."""
    ends = []
    for at in fits:
        scale = np.sqrt(at.phi) * instrument
        freedom = count_freedom(at)
        ends.append(compute_interval(float(scale), float(freedom[0])))
    low = 0.0 if is_at_most(fits[0].parts) else min(low for low, _ in ends)
    return low, max(high for _, high in ends)


def count_freedom(at: Likelihood) -> Array:
    """Count (k,) the degrees of freedom of variances, 2 σ⁴ / Var(σ²) (Satterthwaite 1946), with the
    length of a lasting error as a nuisance parameter; infinite for a known variance."""
    sought = [part for part in at.parts if part.known is None]
    ratios = [1.0, *(part.variance for part in sought)]
    moved = [at.innovations, *(at.slope(part)[1] for part in sought)]
    for part in sought:
        if part.time is not None:
            longer = replace(part, length=part.length * STEP).multiply(at.innovations)
            moved.append(longer - part.multiply(at.innovations))
            ratios.append(part.variance / np.log(STEP))
    stacked = np.concatenate(moved, axis=2)
    seen = np.einsum("mck,mcl->kl", stacked, at.solve(stacked))
    relative = _compute_relative_variance(0.5 * seen / at.phi, np.array(ratios))
    freedom = np.full(1 + len(at.parts), np.inf)
    is_sought = [True, *(part.known is None for part in at.parts)]
    freedom[is_sought] = 2 / relative[: 1 + len(sought)]
    return freedom
