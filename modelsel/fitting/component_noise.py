"""Noise of positions against that of orientations, beside the parts that a campaign's errors have.

Where no uncertainty is stated, nothing but the residuals says how many mrad count as much as a mm,
and what a model lacks is in them. The restricted likelihood of a fitted model tells both scales, and
what rows share is not taken for either."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from .._typing import Mask
from .error_structure import find_structure
from .least_squares import Fit
from .possible_parts import PossiblePart
from .problem import Problem
from .shared_errors import SharedError

# components of a row: mm, and rad
POSITION, ROTATION = slice(0, 3), slice(3, 6)
# what tells the noise of some components apart
COMPONENTS = "components"


def compare_noise(
    problem: Problem, training: Mask, fitted: Fit, parts: Sequence[PossiblePart]
) -> float:
    """Estimate the noise of orientations over that of positions, each in units of its weight: 1 where
    the weights are right.

    `training` (m,): the rows that were fitted; `parts`: what else the errors may have."""
    problem = problem.as_stated()
    positions = _build_part(problem, "positions", POSITION)
    orientations = _build_part(problem, "orientations", ROTATION)
    offered = [positions, orientations, *parts]
    found = find_structure(problem, training, fitted, offered)
    variances = {}
    for name, shared in zip(found.names, found.shared, strict=True):
        variances[name] = 1 + shared.variance
    of_positions = variances.get(positions.name, 1.0)
    of_orientations = variances.get(orientations.name, 1.0)
    ratio = of_orientations / of_positions
    return float(np.sqrt(ratio))


def _build_part(problem: Problem, name: str, components: slice) -> PossiblePart:
    """Build the part of what every row's own components have more noise than they are weighed by."""
    rows = len(problem)
    count = problem.components
    identity = np.eye(count)
    chosen = identity[:, components]
    repeats = rows, 1, 1
    loading = np.tile(chosen, repeats)
    own_level = np.arange(rows)
    error = SharedError(loading, own_level)
    return PossiblePart(name, "1", error, 1.0, COMPONENTS)


def scale_noise(problem: Problem, components: slice, factor: float) -> Problem:
    """Weigh some components as if their noise were larger by a factor."""
    stated = problem.whitening.as_stated()
    matrices = stated.matrices
    assert matrices is not None  # where orientations are measured, rows have a matrix each
    scaled = matrices.copy()
    scaled[:, components] /= factor
    return replace(problem, whitening=replace(stated, matrices=scaled))
