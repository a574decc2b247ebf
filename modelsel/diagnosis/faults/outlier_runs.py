"""Runs of outliers: rows far off one after the other, which a slip and its return may explain.

A step alone explains little of a short run, so that a search which adds one effect after the other
finds neither the step at its beginning nor the one at its end. Such pairs are proposed to it."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from ..._typing import Mask
from ...exceptions import NotEstimable
from ...fitting.design import Model
from ...fitting.error_structure import ErrorStructure
from ...fitting.least_squares import fit
from ...measurements.measurements import Measurements
from ...mechanisms.moved_targets import find_moved_targets
from ...mechanisms.step_moments import list_step_moments
from ...selection.evaluation import Split
from ...selection.structure_criterion import compute_criterion
from ..candidates.candidate import Candidate
from ..search.state import extend_model

# rows of a run at least: as outliers, two cost less than two steps, each with numbers of its own
MIN_RUN = 3

Steps = tuple[Candidate, ...]


class _Run(NamedTuple):
    """Outliers of one target that follow one another: their number, and the moments before the first
    and after the last (None at the end of the campaign)."""

    target: int
    rows: int
    begins: float
    ends: float | None


def propose_steps(
    split: Split, base: Model, candidates: Sequence[Candidate], outlying: Mask
) -> Steps:
    """Propose the steps that explain the runs among some outliers of the rows that a split uses, of
    every run those that fit best; none where there are no runs."""
    data = split.training.data
    runs = list(_generate_runs(data, outlying))
    runs.sort(key=lambda run: -run.rows)
    proposed: Steps = ()
    explained: list[_Run] = []
    for run in runs:
        if any(_overlap(run, other) for other in explained):
            continue
        pairs = _list_pairs(candidates, run)
        best = _choose_best(split, base, proposed, pairs)
        if best:
            proposed += tuple(one for one in best if one not in proposed)
            explained.append(run)
    return proposed


def _generate_runs(data: Measurements, outlying: Mask) -> Iterator[_Run]:
    """Generate the runs of outliers of every target, in the order of its rows."""
    for target in range(len(data.targets)):
        own = np.flatnonzero(data.target == target)
        order = np.argsort(data.progress[own], kind="stable")
        rows = own[order]
        progress = data.progress[rows].tolist()
        is_far = outlying[rows].astype(int)
        changes = np.diff(is_far, prepend=0, append=0)
        starts = np.flatnonzero(changes > 0)
        ends = np.flatnonzero(changes < 0)
        for start, end in zip(starts.tolist(), ends.tolist(), strict=True):
            if end - start < MIN_RUN or start == 0:
                continue
            begins = (progress[start - 1] + progress[start]) / 2
            stops = None
            if end < len(rows):
                stops = (progress[end - 1] + progress[end]) / 2
            yield _Run(target, end - start, begins, stops)


def find_short_runs(data: Measurements, steps: Steps, inside: Mask) -> Mask:
    """Find the rows (m,) `inside` that stand alone, or hardly more, between two steps of their target.

    A slip and its return fit such rows whatever they are, and would move the step of an outlier's
    neighbours to it."""
    alone = np.zeros(len(data), bool)
    for target in range(len(data.targets)):
        found = {_read_moment(step, target) for step in steps}
        moments = [moment for moment in found if moment is not None]
        edges = np.sort(moments)
        stretch = np.searchsorted(edges, data.progress)
        own = inside & (data.target == target)
        for place in range(1, len(edges)):
            between = own & (stretch == place)
            if between.sum() < MIN_RUN:
                alone |= between
    return alone


def _overlap(run: _Run, other: _Run) -> bool:
    """Return whether two runs have a part of the campaign in common."""
    later = max(run.begins, other.begins)
    ends = [one.ends for one in (run, other) if one.ends is not None]
    earlier = min(ends, default=np.inf)
    return later < earlier


def _list_pairs(candidates: Sequence[Candidate], run: _Run) -> list[Steps]:
    """List for every name of a step that moves a run's target those nearest to where it begins and
    ends."""
    by_name: dict[str, dict[float, Candidate]] = {}
    for candidate in candidates:
        moment = _read_moment(candidate, run.target)
        if moment is not None:
            by_name.setdefault(candidate.mechanism.name, {})[moment] = candidate
    pairs = []
    for steps in by_name.values():
        nearest = [_find_nearest(steps, at) for at in (run.begins, run.ends) if at is not None]
        pairs.append(tuple(dict.fromkeys(nearest)))
    return pairs


def _read_moment(candidate: Candidate, target: int) -> float | None:
    """Read the moment of a step that moves a target, or all; None of anything else."""
    mechanism = candidate.mechanism
    moments = list_step_moments(mechanism.terms)
    is_step = candidate.registered and candidate.fault is None and len(moments) == 1
    moved = [one.index for one in find_moved_targets(mechanism)]
    if not is_step or (moved and target not in moved):
        return None
    return float(moments.pop())


def _find_nearest(steps: dict[float, Candidate], at: float) -> Candidate:
    """Find the step whose moment is nearest to another one."""
    nearest = min(steps, key=lambda moment: abs(moment - at))
    return steps[nearest]


def _choose_best(split: Split, base: Model, before: Steps, pairs: Sequence[Steps]) -> Steps:
    """Choose the pair of steps that fits best beside those `before`; none where none can be fitted."""
    training = split.training
    every = np.ones(len(training), bool)
    independent = ErrorStructure()
    best: Steps = ()
    least = np.inf
    for pair in pairs:
        together = (*before, *pair)
        priors = [step.prior for step in together]
        log_prior = float(np.log(priors).sum())
        try:
            fitted = fit(training, extend_model(base, together))
        except NotEstimable:
            continue
        value = compute_criterion(training, every, fitted, independent, log_prior)
        if value < least:
            least = value
            best = pair
    return best
