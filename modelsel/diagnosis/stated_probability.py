"""The one probability that a finding is told with: that of the deepest level which is proven, or,
where none is, of the deepest that any explanation agrees with."""

from __future__ import annotations

from collections.abc import Sequence

from .signatures import LEVELS, PROVEN


def find_stated_level(levels: Sequence[float]) -> int:
    """Find the level, by its place in LEVELS, whose probability is told, from those (4,) of all."""
    held = [k for k, p in enumerate(levels) if p >= PROVEN]
    return held[-1] if held else find_named_level(levels)


def find_named_level(levels: Sequence[float]) -> int:
    """Find the level that a finding's name says: the cause, or the deepest that any explanation
    agrees with, as no registered mechanism does."""
    possible = [k for k, p in enumerate(levels) if p > 0]
    return possible[-1] if possible else 0


def scale_listed(levels: Sequence[float], of_name: float) -> float:
    """Return by what the probabilities of listed explanations are to be multiplied, so that those
    of the name, `of_name` together, are as probable as the level that it says."""
    if not levels or of_name <= 0:
        return 1.0
    named = find_named_level(levels)
    share = levels[named] / of_name
    return min(share, 1.0)


def describe_level_probability(levels: Sequence[float]) -> str:
    """Describe the probability that is told, and of what it is where that is not the name: "0.96",
    "0.99 for the drivers, 0.89 for the cause"."""
    stated, named = find_stated_level(levels), find_named_level(levels)
    if stated == named:
        return f"{levels[named]:.2f}"
    told = f"{levels[stated]:.2f} for the {LEVELS[stated]}"
    return f"{told}, {levels[named]:.2f} for the {LEVELS[named]}"
