"""Ranks of sizes: exact where all orders can be listed, and no more often small than chance has it."""

from __future__ import annotations

from itertools import combinations

import numpy as np
import pytest

from modelsel.fitting.error_sizes import Comparison


def compare(is_larger: list[bool], unit: list[int], stratum: list[int]) -> Comparison:
    return Comparison(np.array(is_larger), np.array(unit), np.array(stratum))


def test_the_p_value_is_that_of_all_orders() -> None:
    """Seven of fourteen: by chance their ranks add up to as much in so many of 3,432 choices."""
    compared = compare([True] * 7 + [False] * 7, list(range(14)), [0] * 14)
    values = np.array([14, 13, 12, 11, 9, 6, 5, 10, 8, 7, 4, 3, 2, 1], float)
    total = values[:7].sum()
    sums = [sum(chosen) for chosen in combinations(range(1, 15), 7)]
    exact = np.mean([each >= total for each in sums])
    assert compared.compute_p(values) == pytest.approx(exact, abs=0.01)
    assert compared.compute_p(-values) > 0.9


def test_only_units_of_one_stratum_are_compared(rng: np.random.Generator) -> None:
    """What all rows of a configuration have in common counts for none of them."""
    m = 40
    target, visit = np.arange(3 * m) % 3, np.arange(3 * m) // 3
    compared = Comparison(target == 1, np.arange(3 * m), visit)
    values = rng.normal(size=3 * m)
    common = rng.normal(0, 100, m)[visit]
    assert compared.compute_p(values) == pytest.approx(compared.compute_p(values + common))
    louder = values + 2 * (target == 1)
    assert compared.compute_p(louder + common) < 1e-4


def test_strata_of_one_kind_are_compared_with_each_other(rng: np.random.Generator) -> None:
    """A group that measured postures of its own is compared as a whole."""
    values = rng.normal(size=60)
    is_larger = np.arange(60) < 30
    alone = Comparison(is_larger, np.arange(60), np.arange(60))
    pooled = Comparison(is_larger, np.arange(60), np.zeros(60, int))
    assert alone.compute_p(values) == pytest.approx(pooled.compute_p(values))


def test_rows_of_one_unit_count_once(rng: np.random.Generator) -> None:
    values = rng.normal(size=40)
    once = Comparison(np.arange(40) < 20, np.arange(40), np.zeros(40, int))
    rows = np.arange(40).repeat(3)
    thrice = once.take(rows)
    assert thrice.compute_p(values[rows]) == pytest.approx(once.compute_p(values))


def test_nothing_to_compare_with_is_no_evidence() -> None:
    compared = compare([True] * 5, list(range(5)), [0] * 5)
    assert compared.compute_p(np.arange(5.0)) == 1.0


def test_chance_gives_no_smaller_values_than_it_may(rng: np.random.Generator) -> None:
    """Heavy tails do not matter: of 2,000 comparisons 20 are expected below 1 %."""
    target = np.arange(120) % 3
    compared = Comparison(target == 0, np.arange(120), np.arange(120) // 3)
    p = np.array([compared.compute_p(rng.standard_cauchy(120)) for _ in range(2000)])
    assert (p < 0.01).sum() < 20 + 4 * np.sqrt(20)
    assert 0.45 < p.mean() < 0.55
