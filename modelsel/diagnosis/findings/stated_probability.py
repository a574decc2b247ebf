"""The one probability that a finding is told with: that of the deepest level which is proven, or,
where none is, of the deepest that any explanation agrees with."""

from __future__ import annotations

from collections.abc import Sequence
from math import floor

from ..candidates.signatures import LEVELS, PROVEN
from ..inference.simulation_counts import FAULT_DRAWS, FLIP_DRAWS

# places of a probability that two would round up to PROVEN
FINE = 1000
# p above which nothing is found
MAX_CHANCE = 0.05
# p below which nobody reads the digits
LEAST_CHANCE = 1e-4
# share by which a p-value that was written may miss its bound
ROUNDING = 1e-6
# draws of which the least decides the p-value of a finding
SEARCH_DRAWS = (*FLIP_DRAWS, FAULT_DRAWS)


def format_probability(probability: float) -> str:
    """Return a probability with two decimals, with three where it is below PROVEN and two would say
    that it is not; one that they would write as nought is "below 0.01"."""
    written = f"{probability:.2f}"
    if float(written) == 0:
        return "below 0.01"
    if probability < PROVEN <= float(written):
        fine = floor(FINE * probability)
        written = f"{fine / FINE:.3f}"
    return written


def format_chance(p: float) -> str:
    """Return a p-value with two digits, with three where it is above MAX_CHANCE and two would say
    that it is not; of a tiny one that it is below LEAST_CHANCE."""
    if p < LEAST_CHANCE:
        return f"below {LEAST_CHANCE:.4f}"
    written = f"{p:.2g}"
    if p > MAX_CHANCE >= float(written):
        written = f"{p:.3g}"
    return written


def is_bound(p: float, draws: Sequence[int] = SEARCH_DRAWS) -> bool:
    """Return whether a p-value is the least that its simulation, of one of these numbers of draws, can
    tell: 1 / (draws + 1), where no draw did as well."""
    least = [1 / (count + 1) for count in draws]
    return any(abs(p - one) < ROUNDING * one for one in least)


def bound_chance(p: float) -> str:
    """Return the p-value of a search within a sentence: "0.024", "at most 0.0054"."""
    written = format_chance(p)
    if is_bound(p):
        return f"at most {written}"
    return written


def write_chance(p: float, draws: Sequence[int] = SEARCH_DRAWS) -> str:
    """Return a simulated p-value in brackets: "p = 0.024", "p ≤ 0.005", "p < 0.0001"."""
    if p < LEAST_CHANCE:
        return f"p < {LEAST_CHANCE:.4f}"
    written = format_chance(p)
    if is_bound(p, draws):
        return f"p ≤ {written}"
    return f"p = {written}"


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
        return format_probability(levels[named])
    proven = format_probability(levels[stated])
    other = format_probability(levels[named])
    return f"{proven} for the {LEVELS[stated]}, {other} for the {LEVELS[named]}"
