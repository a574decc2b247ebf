"""Moments of steps that a model names without one: those that fit best.

A step of a base, or of a study's own model, stands where candidates do: of the moments that are
scanned at the one that explains most beyond the rest of its model, whatever rows are bad shots."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence

import numpy as np

from .._typing import Mask
from ..exceptions import NotEstimable
from ..fitting.design import Model
from ..fitting.least_squares import fit
from ..fitting.problem import Problem
from ..mechanisms.registry import Registry, build_mechanisms, join_mechanisms
from ..mechanisms.step_moments import list_step_moments
from ..mechanisms.terms import Mechanism
from ..robot.kinematics import Robot
from .candidates.candidate import Candidate
from .candidates.options import DEFAULT_OPTIONS
from .candidates.scanned_constants import drop_equal_constants
from .candidates.session_steps import place_steps
from .columns.candidate_columns import build_columns
from .columns.kept_causes import KeptCauses
from .faults.robust_moments import choose_beside_outliers
from .inference.evidence import compute_single_f
from .search.views import build_view
from .shapes.candidate_kinds import CandidateKind

# times that each of several steps is placed, given the others
ROUNDS = 2


def list_scanned_steps(name: str, robot: Robot, registry: Registry) -> tuple[Mechanism, ...]:
    """List the steps that a name without a moment stands for, at every moment; none for any other
    name. Raises StudyError for an unknown one."""
    built = build_mechanisms(name, robot, registry)
    constants: Counter[str] = Counter()
    for m in built:
        if not list_step_moments(m.terms):
            return ()
        constants[m.name] += 1
    most = max(constants.values(), default=1)
    if most == 1:
        return ()
    return built


def choose_step_moments(
    problem: Problem, estimation: Mask, others: Model, steps: Mapping[str, Sequence[Mechanism]]
) -> dict[str, Mechanism]:
    """Choose the moments of steps by their names, each listed at every moment, that fit the
    `estimation` rows (m,) best beside the `others` of their model. None where the data do not
    determine these."""
    training = problem.take(estimation)
    options: dict[tuple[str, str], list[Mechanism]] = {}
    for name, listed in steps.items():
        placed = place_steps(problem, estimation, listed)
        for m in drop_equal_constants(training, placed):
            options.setdefault((name, m.name), []).append(m)
    chosen: dict[tuple[str, str], Mechanism] = {}
    try:
        for _ in range(ROUNDS if len(options) > 1 else 1):
            for key, listed in options.items():
                beside = tuple(m for other, m in chosen.items() if other != key)
                chosen[key] = _choose_best(training, others + beside, listed)
    except NotEstimable:
        return {}
    joined = {}
    for name in steps:
        own = [m for (given, _), m in chosen.items() if given == name]
        if own:
            joined[name] = join_mechanisms(name, own)
    return joined


def _choose_best(problem: Problem, model: Model, options: Sequence[Mechanism]) -> Mechanism:
    """Choose the mechanism that explains most beyond a model. Raises NotEstimable."""
    fitted = fit(problem, model)
    count = len(options)
    found = tuple(Candidate(m, CandidateKind.MECHANISM, 1 / count) for m in options)
    causes = KeptCauses()
    columns = build_columns(problem, found, fitted.at(), DEFAULT_OPTIONS.memory_mb, causes, None)
    view = build_view(problem, columns, fitted)
    strength = compute_single_f(view.scan, view.response)
    best = int(np.argmax(strength))
    few = _draw_rows(problem)
    if few is not problem:
        columns = build_columns(few, found, fitted.at())
    chosen = choose_beside_outliers(few, fitted, columns, best)
    return options[chosen]


def _draw_rows(problem: Problem) -> Problem:
    """Draw as many rows as a diagnosis scans at most, where there are more."""
    count = len(problem)
    most = DEFAULT_OPTIONS.max_rows
    if count <= most:
        return problem
    rng = np.random.default_rng(0)
    drawn = rng.choice(count, most, replace=False)
    in_order = np.sort(drawn)
    return problem.take(in_order)
