"""Whole studies of drawn arms with one reflector: no parameter beyond what the data and its usual
size allow, a longer tool is met as well as by an oracle, and no sentence contradicts a number.
`python -m benchmarks.drawn` runs hundreds."""

from __future__ import annotations

import numpy as np
import pytest
from drawn_arms import campaign
from drawn_studies import SEVEN, SIX, contradictions, missed, off, studied


@pytest.mark.parametrize(
    ("names", "effect"), [(SIX, 0.0), (SIX, 1e-3), (SEVEN, 0.0)], ids=["six", "six-effect", "seven"]
)
def test_drawn_studies(names, effect, rng) -> None:
    ours, best, away, size = [], [], [], []
    for seed in range(4):
        one = campaign(rng, names, effect=effect)
        result = studied(one, seed) if effect else studied(one, seed, candidates=[])
        q, where = one.later(rng)
        ours.append(missed(result, q, where))
        best.append(
            float(np.sqrt(np.square(one.oracle(q, result.split.used) - where).sum(1).mean()))
        )
        far, large = off(result, one)
        away.append(far)
        size.append(large.max())
        assert contradictions(result) == []
    assert np.sqrt(np.mean(np.square(ours))) <= 1.5 * np.sqrt(np.mean(np.square(best))), (
        ours,
        best,
    )
    assert np.mean(np.concatenate(away) < 4) >= 0.99
    assert max(size) < 10
