"""The scan of 3,000 groups of three columns, against a loop of nested F tests: the evidence of every
group, without a null on either side. A second figure counts the null on both: 2,000 draws, for each
of which the loop fits every group again (measured on some groups and draws, and scaled).

The groups are cells of an error map, waves at every place of an arm measured at 160 configurations;
ours is what naming runs. The columns exist for both beforehand; ours computes their Gram matrices."""

from __future__ import annotations

from dataclasses import replace
from itertools import islice

import numpy as np

from modelsel.diagnosis.candidates.candidate import Candidate
from modelsel.diagnosis.columns.candidate_columns import build_columns
from modelsel.diagnosis.inference.evidence import (
    compute_factors,
    compute_p_value,
    draw_null,
    sum_evidence,
)
from modelsel.diagnosis.inference.scan import Scan, build_scan, compute_basis
from modelsel.diagnosis.shapes.candidate_kinds import CandidateKind
from modelsel.diagnosis.shapes.unregistered import list_places
from modelsel.fitting.problem import Problem
from modelsel.mechanisms.causes import cos, q, sin
from modelsel.mechanisms.terms import Mechanism, Screw, Term

from .timing import arm_scene, interleaved

CONFIGURATIONS, BASE, GROUPS, DRAWS = 160, 29, 3000, 2000
SAMPLE = 60  # groups that the loop fits
DRAWN = 3  # null draws for which it fits them


def list_groups(problem: Problem) -> tuple[Candidate, ...]:
    """Sine and cosine of k turns of a joint, and the sine of as many of its neighbour, by place."""
    joints = problem.robot.n
    causes = [
        (sin(k * q(j)), cos(k * q(j)), sin((k + 0.5) * q(j % joints + 1)))
        for k in np.arange(1.0, 15.0)
        for j in range(1, joints + 1)
    ]
    cells = ((place, own) for own in causes for place in list_places(problem))
    found = []
    for place, own in islice(cells, GROUPS):
        terms = tuple(Term(f"m{k}", (Screw(*place, cause),)) for k, cause in enumerate(own))
        found.append(Candidate(Mechanism("cell", terms), CandidateKind.CELL, 1 / GROUPS))
    return tuple(found)


def run() -> dict[str, float]:
    import statsmodels.api as sm

    rng = np.random.default_rng(3)
    problem, _ = arm_scene(CONFIGURATIONS)
    given = build_columns(problem, list_groups(problem))
    rows, (block,) = given.rows, given.grams
    whole = given.screws.expand(block.index.ravel()).reshape(GROUPS, -1, rows)
    columns = [own.T for own in whole[:SAMPLE]]
    base, y = rng.normal(size=(rows, BASE)), rng.normal(size=rows)
    log_prior = np.full(GROUPS, -np.log(GROUPS))

    def alone() -> tuple[Scan, float]:
        """What the loop does: every group's own evidence, without a null."""
        gram = np.matmul(whole, whole.swapaxes(1, 2))
        cols = replace(given, grams=(replace(block, gram=gram),))
        Q = compute_basis(base)
        seen = build_scan(cols, Q)
        response = seen.see(y - Q @ (Q.T @ y))
        return seen, sum_evidence(compute_factors(seen, response), log_prior)[0]

    def ours() -> float:
        seen, value = alone()
        return compute_p_value(value, draw_null(seen, log_prior, DRAWS, rng)[0])

    def test_groups(response: np.ndarray) -> None:
        small = sm.OLS(response, base).fit()
        for own in columns:
            sm.OLS(response, np.column_stack([base, own])).fit().compare_f_test(small)

    draws = rng.normal(size=(DRAWN, rows))

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
