"""Outliers and names in turn: which rows are far off depends on what was named, and the reverse."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from .._progress import News
from .._typing import Mask
from ..fitting.design import whitened
from ..fitting.possible_parts import PossiblePart, choose_parts, list_parts
from ..fitting.problem import Problem
from ..mechanisms.terms import Mechanism
from ..selection.evaluation import Split
from ..selection.structure_criterion import compute_trimmed_criterion
from .base_fits import BaseFits
from .candidates.candidate import Candidate
from .candidates.candidate_list import build_candidates
from .candidates.session_steps import place_steps
from .faults.outlier_runs import Steps, find_short_runs, propose_steps
from .faults.outliers import (
    GROSS_THRESHOLD,
    MAX_OUTLIER_SHARE,
    REFINED_THRESHOLD,
    find_far_rows,
    find_gross_outliers,
)
from .findings.outcome import Diagnosis
from .separation import VERY_STRONG, Inquiry, separate

# rounds of outliers and names in turn
MAX_ROUNDS = 3


@dataclass(frozen=True, eq=False)
class _Visited:
    """What was named without some outliers: the split weighed by the errors that were found, the
    diagnosis, and the candidates; `criterion`: of outliers, effects and errors together, smaller is
    better."""

    weighed: Split
    diagnosis: Diagnosis
    found: tuple[Candidate, ...]
    criterion: float

    @property
    def chosen(self) -> tuple[Candidate, ...]:
        """The candidates of its effects."""
        return tuple(effect.candidate for effect in self.diagnosis.effects)


@dataclass(frozen=True)
class _Rounds:
    """What the rounds work on: the split, the mechanisms whose steps are placed, the possible parts
    of the errors; and what they have listed and visited, by the outliers and what the search started
    from."""

    split: Split
    inquiry: Inquiry
    everything: tuple[Mechanism, ...]
    parts: tuple[PossiblePart, ...]
    fits: BaseFits
    listed: dict[bytes, tuple[Candidate, ...]] = field(default_factory=dict)
    visited: dict[tuple[bytes, Steps], _Visited] = field(default_factory=dict)

    def visit(self, outlying: Mask, known: Steps = ()) -> _Visited:
        """Name effects without some of the estimation rows, once; `known`: where the search starts."""
        rows = outlying.tobytes()
        key = rows, known
        if key not in self.visited:
            named = self._name(outlying, known)
            self.visited[key] = named
        return self.visited[key]

    def find_outliers(self, named: _Visited, outlying: Mask) -> Mask:
        """Find the estimation rows far off what was named without some of them, and those that two
        steps alone explain."""
        own = named.diagnosis.errors.of_instrument()
        weighed = own.whiten(self.split.problem)
        training = weighed.take(self.split.estimation)
        far = judge_rows(training, named.diagnosis, ~outlying)
        return far | find_short_runs(training.data, named.chosen, ~outlying)

    def propose(self, outlying: Mask) -> Steps:
        """Propose steps that explain some outliers to a search in all estimation rows."""
        none = np.zeros(len(outlying), bool)
        found = self._list_candidates(none)
        return propose_steps(self._mark(none), self.inquiry.base, found, outlying)

    def _name(self, outlying: Mask, known: Steps) -> _Visited:
        split = self._mark(outlying)
        found = self._list_candidates(outlying)
        base_fit = self.fits.fit(split)
        weighed, diagnosis = separate(split, self.inquiry, found, self.parts, base_fit, known)
        criterion = _judge(split, diagnosis)
        return _Visited(weighed, diagnosis, found, criterion)

    def _list_candidates(self, outlying: Mask) -> tuple[Candidate, ...]:
        """List the candidates that the rows without some outliers tell apart, once."""
        key = outlying.tobytes()
        if key not in self.listed:
            inquiry = self.inquiry
            split = self._mark(outlying)
            found = build_candidates(
                split.training, inquiry.base, self.everything, inquiry.cells, inquiry.options
            )
            count = len(found)
            inquiry.say(f"naming: {count} candidates")
            self.listed[key] = found
        return self.listed[key]

    def _mark(self, outlying: Mask) -> Split:
        """Mark outliers among the estimation rows."""
        marked = _expand_mask(self.split.estimation, outlying)
        return replace(self.split, outlying=marked)

    def choose(self, last: _Visited) -> _Visited:
        """Choose what was visited last, unless something else explains all rows clearly better: the
        rounds may end where outliers hide an effect of theirs, or go on in a circle."""
        best = min(self.visited.values(), key=lambda one: one.criterion)
        gain = last.criterion - best.criterion
        return best if gain > VERY_STRONG else last


def alternate(split: Split, inquiry: Inquiry) -> tuple[Split, Diagnosis, tuple[Candidate, ...]]:
    """Alternate outliers and names, until the outliers stay the same (at most MAX_ROUNDS).

    Where the extended model shows other outliers than the base did, effects are named once more
    without those. An effect of a few rows resembles outliers until it may be named: where a search in
    all rows leaves at most half as many, these are taken. Rows are judged by themselves, by what the
    instrument has in their directions, whatever errors they share."""
    training = split.problem.take(split.estimation)
    fits = BaseFits(inquiry.base)
    none = np.zeros(len(training), bool)
    every_row = replace(split, outlying=np.zeros(len(split.outlying), bool))
    outlying = find_gross_outliers(training, fits.fit(every_row))
    marked = replace(split, outlying=_expand_mask(split.estimation, outlying))
    inquiry.tell_base(marked.outlying, fits.fit(marked))
    listed = list_parts(split.problem, split.estimation)
    everything = place_steps(split.problem, split.estimation, inquiry.everything)
    parts = choose_parts(listed, inquiry.options.parts, inquiry.options.fixed_parts)
    rounds = _Rounds(split, inquiry, everything, parts, fits)
    known: Steps = ()
    for _ in range(MAX_ROUNDS):
        last = rounds.visit(outlying, known)
        again = rounds.find_outliers(last, outlying)
        known = ()
        if outlying.any():
            proposed = rounds.propose(outlying)
            with_all = rounds.visit(none, proposed)
            fewer = rounds.find_outliers(with_all, none)
            if not fewer.any():
                last = with_all
                break
            if fewer.sum() <= outlying.sum() / 2:
                again = fewer
                known = with_all.chosen if proposed else ()
        is_settled = (again == outlying).all()
        if is_settled or again.mean() > MAX_OUTLIER_SHARE:
            break
        outlying = again
    chosen = rounds.choose(last)
    diagnosis = chosen.diagnosis
    if diagnosis.dropped:
        labels = ", ".join(diagnosis.dropped)
        inquiry.say(News(f"dropped {labels}", kept=True))
    return chosen.weighed, diagnosis, diagnosis.offered or chosen.found


def _judge(split: Split, diagnosis: Diagnosis) -> float:
    """Judge outliers, effects and errors together. An outlier costs as much as a row just within the
    threshold does, so that marking what is nearer explains nothing."""
    priors = [effect.candidate.prior for effect in diagnosis.effects]
    log_prior = float(np.log(priors).sum())
    outlying = split.outlying & split.estimation
    return compute_trimmed_criterion(
        split.problem,
        split.used,
        outlying,
        diagnosis.fit,
        diagnosis.errors,
        log_prior,
        REFINED_THRESHOLD,
    )


def judge_rows(weighed: Problem, diagnosis: Diagnosis, inside: Mask) -> Mask:
    """Find rows (m,) far off the extended model.

    `weighed`: the rows, by what the instrument has in their directions. They are judged in robust
    standard deviations of those `inside`, to which the model was fitted."""
    residual = diagnosis.fit.residuals(weighed)
    size = whitened(weighed, residual)
    measured = weighed.measured
    if measured is not None:
        measured = measured[inside]
    reference = size[inside]
    threshold = REFINED_THRESHOLD if diagnosis.effects else GROSS_THRESHOLD
    return find_far_rows(size, reference, threshold, measured)


def _expand_mask(rows: Mask, marked: Mask) -> Mask:
    """Expand a mask of the selected rows to all rows (m,)."""
    mask = np.zeros(len(rows), bool)
    selected = np.flatnonzero(rows)
    mask[selected[marked]] = True
    return mask
