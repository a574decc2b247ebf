"""The scan of 3,000 groups of three columns with 2,000 null draws, against a loop of nested F tests without any. Ours is what naming runs:
the evidence of every group and its family-wise null."""
from __future__ import annotations

import numpy as np

from modelsel.why.errormap import Block, Columns, basis, scan
from modelsel.why.evidence import evidence, factors, null, p_value

from .timing import interleaved

ROWS, BASE, GROUPS, SIZE, DRAWS, SAMPLE = 480, 29, 3000, 3, 2000, 60


def run() -> dict[str, float]:
    import statsmodels.api as sm
    rng = np.random.default_rng(3)
    XT = rng.normal(size=(GROUPS * SIZE, ROWS))
    base, y = rng.normal(size=(ROWS, BASE)), rng.normal(size=ROWS)
    index = np.arange(GROUPS * SIZE).reshape(GROUPS, SIZE)

    def ours() -> float:
        gram = np.einsum("nkr,nlr->nkl", XT[index], XT[index])
        cols = Columns(XT, tuple(index), (Block(np.arange(GROUPS), index, gram, np.full(index.shape, np.inf)),), np.zeros(GROUPS))
        Q = basis(base)
        seen = scan(cols, Q)
        left = y - Q @ (Q.T @ y)
        log_prior = np.full(GROUPS, -np.log(GROUPS))
        drawn, _ = null(seen, log_prior, DRAWS, rng)
        return p_value(evidence(factors(seen, left), log_prior)[0], drawn)

    def loop() -> None:
        small = sm.OLS(y, base).fit()
        for g in range(SAMPLE):
            sm.OLS(y, np.column_stack([base, XT[index[g]].T])).fit().compare_f_test(small)

    seconds = interleaved({"ours": ours, "loop": loop}, 3)
    return {"scan_vs_ftests": seconds["loop"] / SAMPLE * GROUPS / seconds["ours"], "scan_seconds": seconds["ours"]}

