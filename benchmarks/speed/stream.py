"""Design and fit of many configurations: the streaming reduction against scikit-learn on the stored
matrix, and against dgemm."""

from __future__ import annotations

import time
import tracemalloc

import numpy as np

from modelsel.fitting.design import assemble
from modelsel.fitting.identifiability import identify, solve
from modelsel.fitting.reduction import reduce_problem

from .timing import arm_scene, interleaved

M = 1_000_000


def gemm_rate() -> float:
    """Flops a second of a product of two 1500 x 1500 matrices."""
    A = np.random.default_rng(0).normal(size=(1500, 1500))
    return 2 * 1500**3 / interleaved({"dgemm": lambda: A @ A}, 5)["dgemm"]


def run(m: int = M) -> dict[str, float]:
    from sklearn.linear_model import LinearRegression

    problem, model = arm_scene(m)
    p = len(model.terms)

    def ours() -> None:
        reduction = reduce_problem(problem, model.terms)
        solve(reduction, identify(reduction).kept)

    def sklearn() -> None:
        block = assemble(problem, model.terms)
        A, y = np.ascontiguousarray(block[:-1].reshape(p, -1).T), block[-1].ravel()
        LinearRegression(fit_intercept=False).fit(A, y)

    seconds = interleaved({"ours": ours}, 3) | interleaved({"sklearn": sklearn}, 1)
    tracemalloc.start()
    ours()
    beyond = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    flops = 2 * 3 * m * (p + 1) ** 2
    return {
        "stream_vs_sklearn": seconds["sklearn"] / seconds["ours"],
        "stream_of_gemm": flops / gemm_rate() / seconds["ours"],
        "stream_us_per_configuration": seconds["ours"] / m * 1e6,
        "stream_mb_beyond_inputs": beyond / 1e6,
        "stream_configurations": float(m),
    }


def growth() -> list[tuple[int, float]]:
    """(configurations, seconds) of the streaming fit."""
    out = []
    for m in (200, 2_000, 20_000, 200_000):
        problem, model = arm_scene(m)
        start = time.process_time()
        reduce_problem(problem, model.terms)
        out.append((m, time.process_time() - start))
    return out


def growth_parameters() -> list[tuple[int, float]]:
    """(parameters, seconds) of the streaming fit of 50,000 configurations."""
    problem, model = arm_scene(50_000)
    out = []
    for p in (6, 12, 20, 30, 43):
        start = time.process_time()
        reduce_problem(problem, model.terms[:p])
        out.append((p, time.process_time() - start))
    return out
