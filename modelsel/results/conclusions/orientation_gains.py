"""The gain of orientation on held-out rows, of findings that above all turn the target."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise

from ..._random import generator
from ..._typing import Array
from ...diagnosis.findings.outcome import Diagnosis
from ...selection.evaluation import Evaluation, Split, mark_oriented
from ...selection.gain import ResampledErrors, resample_errors
from ..numbers.quantities import MILLI
from ..numbers.workspace import Fitted
from ..runs.finding_records import Finding
from .finding_figures import bind_effects, find_mm_per_rad, find_worst, find_worst_turn


def add_orientation_gains(
    findings: Sequence[Finding],
    search: Diagnosis,
    split: Split,
    steps: Sequence[Evaluation],
    chosen: Evaluation,
    seed: int,
) -> tuple[Finding, ...]:
    """Return findings, those of which the turning prevails with their gain of orientation: it changes
    more than the position, each against what is left of it.

    `findings`: in the order of the `steps`, of which the first is the base."""
    if split.problem.components <= 3 or not findings:
        return tuple(findings)
    last = findings[-1].gain
    mm_per_rad = find_mm_per_rad(split, chosen, last)
    effects = [finding.effect for finding in findings]
    fitted = bind_effects(effects, search.fit, split, seed)
    resampled = _resample_orientations(split, steps, seed)
    added = []
    for finding, one, pair in zip(findings, fitted, pairwise(resampled), strict=True):
        before, after = pair
        told = finding
        if _prevails(one, mm_per_rad):
            gain = before.orientation_gain_of(after)
            told = replace(finding, orientation_gain=gain)
        added.append(told)
    return tuple(added)


def _prevails(fitted: Fitted, mm_per_rad: float) -> bool:
    """Return whether the turning of an effect prevails."""
    moved = find_worst(fitted).moved
    turned = find_worst_turn(fitted).moved
    turned_mm = turned.value / MILLI * mm_per_rad
    return turned_mm > moved.value


def _resample_orientations(
    split: Split, steps: Sequence[Evaluation], seed: int
) -> list[ResampledErrors]:
    """Draw the held-out configurations anew, as for the position, of the rows with an orientation;
    errors in mrad."""
    rows = mark_oriented(split) & ~split.estimation
    angles: list[Array] = []
    for step in steps:
        angle = MILLI * step.residual[rows, 3:]
        angles.append(angle)
    configurations = split.problem.data.block[rows]
    rng = generator(seed, "gain")
    return resample_errors(angles, configurations, rng)
