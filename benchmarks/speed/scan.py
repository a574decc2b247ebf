"""The scan of 3,000 groups of three columns with 2,000 null draws, against a loop of nested F tests
without any. Ours is what naming runs: the evidence of every group and its family-wise null. The
null alone is one product of 17 GFlop in single precision, so the ratio cannot exceed some 18 here;
like for like, without a null on either side, stands beside it."""

from __future__ import annotations

import numpy as np

from modelsel.diagnosis.candidate_columns import Block, Columns, compute_grams
from modelsel.diagnosis.evidence import compute_factors, compute_p_value, draw_null, sum_evidence
from modelsel.diagnosis.scan import Scan, build_scan, compute_basis

from .timing import interleaved

ROWS, BASE, GROUPS, SIZE, DRAWS, SAMPLE = 480, 29, 3000, 3, 2000, 60


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

    def loop() -> None:
        small = sm.OLS(y, base).fit()
        for g in range(SAMPLE):
            sm.OLS(y, np.column_stack([base, XT[index[g]].T])).fit().compare_f_test(small)

    seconds = interleaved({"ours": ours, "alone": alone, "loop": loop}, 3)
    whole = seconds["loop"] / SAMPLE * GROUPS
    return {
        "scan_vs_ftests": whole / seconds["ours"],
        "scan_seconds": seconds["ours"],
        "scan_without_null_vs_ftests": whole / seconds["alone"],
    }
