"""The point at which a model is linearised."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from .._typing import Array
from ..mechanisms.terms import FIXTURE_AXES, FixtureTerm, Term


@dataclass(frozen=True, eq=False)
class Linearisation:
    """A point of a model: its terms and their values theta (p,), in the terms' units."""

    terms: Sequence[Term]
    theta: Array

    def feature_changes(self, count: int) -> Array:
        """Return the changes (F, 7) of the numbers of `count` features."""
        return add_feature_changes(count, self.terms, self.theta)


def add_feature_changes(count: int, terms: Sequence[Term], theta: Array) -> Array:
    """Add up the changes (..., F, 7) of the numbers of `count` features at parameters theta
    (..., p) of the terms."""
    out = np.zeros((*theta.shape[:-1], count, len(FIXTURE_AXES)))
    for k, term in enumerate(terms):
        if isinstance(term, FixtureTerm):
            out[..., term.feature, FIXTURE_AXES.index(term.axis)] += theta[..., k]
    return out
