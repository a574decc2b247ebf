"""The scan of 3,000 groups of three columns, against a loop of nested F tests: the evidence of every
group, without a null on either side. A second figure counts the null on both: 2,000 draws, for each
of which the loop fits every group again (measured on some groups and draws, and scaled). Our null
is one product of 17 GFlop in single precision; the loop's would take hours."""

from __future__ import annotations

import numpy as np

from modelsel.diagnosis.candidate_columns import Block, Columns, compute_grams
from modelsel.diagnosis.evidence import compute_factors, compute_p_value, draw_null, sum_evidence
from modelsel.diagnosis.scan import Scan, build_scan, compute_basis

from .timing import interleaved

ROWS, BASE, GROUPS, SIZE, DRAWS = 480, 29, 3000, 3, 2000
SAMPLE = 60  # groups that the loop fits
DRAWN = 3  # null draws for which it fits them


def run() -> dict[str, float]:
    import statsmodels.api as sm

    rng = np.random.default_rng(3)
    XT = rng.normal(size=(GROUPS * SIZE, ROWS))
    base, y = rng.normal(size=(ROWS, BASE)), rng.normal(size=ROWS)
    index = np.arange(GROUPS * SIZE).reshape(GROUPS, SIZE)

    log_prior = np.full(GROUPS, -np.log(GROUPS))

    def alone() -> tuple[Scan, float]:
        """What the loop does: every group's own evidence, without a null."""
        cols = Columns(
            XT,
            tuple(index),
            (
                Block(
                    np.arange(GROUPS), index, compute_grams(XT, index), np.full(index.shape, np.inf)
                ),
            ),
            tuple(np.zeros((GROUPS, SIZE))),
        )
        Q = compute_basis(base)
        seen = build_scan(cols, Q)
        return seen, sum_evidence(compute_factors(seen, y - Q @ (Q.T @ y)), log_prior)[0]

    def ours() -> float:
        seen, value = alone()
        return compute_p_value(value, draw_null(seen, log_prior, DRAWS, rng)[0])

    def test_groups(response: np.ndarray) -> None:
        small = sm.OLS(response, base).fit()
        for g in range(SAMPLE):
            large = sm.OLS(response, np.column_stack([base, XT[index[g]].T])).fit()
            large.compare_f_test(small)

    draws = rng.normal(size=(DRAWN, ROWS))

    def loop_null() -> None:
        for drawn in draws:
            test_groups(drawn)

    seconds = interleaved(
        {"ours": ours, "alone": alone, "loop": lambda: test_groups(y), "null": loop_null}, 3
    )
    tests = seconds["loop"] / SAMPLE * GROUPS
    null_tests = seconds["null"] / (SAMPLE * DRAWN) * GROUPS * DRAWS
    return {
        "scan_vs_ftests": tests / seconds["alone"],
        "scan_vs_ftests_with_null": (tests + null_tests) / seconds["ours"],
        "scan_seconds": seconds["alone"],
        "scan_with_null_seconds": seconds["ours"],
    }
