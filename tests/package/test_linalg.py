"""The algebra that the whole package shares."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components as by_scipy

from modelsel._linalg import connected_components


@pytest.mark.parametrize("edges", [0, 5, 60, 400])
def test_components_as_scipy_labels_them(rng, edges) -> None:
    count = 100
    pairs = rng.integers(0, count, (edges, 2))
    graph = coo_array((np.ones(edges), pairs.T), shape=(count, count))
    assert (connected_components(count, pairs) == by_scipy(graph, directed=False)[1]).all()


def test_a_chain_backwards_is_one_component() -> None:
    """The longest way from a node to the first of its component."""
    order = np.random.default_rng(1).permutation(20_000)
    label = connected_components(20_000, np.stack([order[:-1], order[1:]], 1))
    assert not label.any()
    assert connected_components(3, np.zeros((0, 2), np.intp)).tolist() == [0, 1, 2]
