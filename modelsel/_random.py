"""Random streams: one seed per study, one independent stream per purpose."""

from __future__ import annotations

import numpy as np

PURPOSES = (
    "split",
    "folds",
    "gain",
    "naming",
    "simulate",
    "sampling",
    "null",
    "nested",
    "flips",
    "bootstrap",
    "halves",
    "scan",
    "workspace",
    "rounds",
)


def generator(seed: int, purpose: str) -> np.random.Generator:
    """Return the one stream of a purpose: every random choice derives from the study's seed, none from
    another's use of it."""
    return np.random.default_rng(np.random.SeedSequence([seed, PURPOSES.index(purpose)]))
