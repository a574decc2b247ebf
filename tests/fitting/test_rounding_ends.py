"""A fit ends where no step lowers its cost by more than rounding, however ill-conditioned its columns."""

from __future__ import annotations

import numpy as np
from builders import seeds
from certified import Regression, fitted


@seeds(1, 2, 3)
def test_a_fit_that_rounding_stops_does_not_go_on(rng: np.random.Generator) -> None:
    """A polynomial of degree ten far from the origin: condition 1e10. Steps to and fro at rounding took
    2,000 iterations a round, thirty rounds."""
    x = rng.permutation(np.linspace(-9.0, -3.0, 82))
    columns = np.vander(x, 11)
    response = np.sin(x) + rng.normal(0, 0.003, len(x))
    found = fitted(Regression(lambda b, X: X @ b, columns, response, np.zeros(11)))
    assert found.iterations < 40
    least = np.linalg.lstsq(columns, response, rcond=1e-15)[0]
    rest = np.square(response - columns @ least).sum()
    assert found.rss < rest * (1 + 1e-6)
