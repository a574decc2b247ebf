"""The working state of the stepwise search: all candidates, the null distribution, and the fits of
models with their views, names and p-values."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from copy import copy
from typing import NamedTuple
from weakref import WeakKeyDictionary

import numpy as np

from ..._typing import Array, Index
from ...exceptions import NotEstimable
from ...fitting.design import Model
from ...fitting.iteration import COARSE_MM
from ...fitting.least_squares import Fit
from ...fitting.problem import Problem
from ...fitting.shrinkage import fit_shrunk
from ..candidates.candidate import Candidate
from ..candidates.options import DEFAULT_OPTIONS
from ..columns.candidate_columns import Columns, build_columns, flatten_measured
from ..columns.kept_causes import KeptCauses
from ..inference.credible_sets import (
    CredibleSet,
    Question,
    ask,
    compute_own_evidence,
    include_candidate,
    rename_effect,
)
from ..inference.evidence import MIN_LOG_ODDS, Chance, compute_familywise_p, draw_null
from ..inference.joint_curves import collect_curves, find_better_curve, see_rest
from ..inference.residual_tests import adjust_residual, compute_flip_p, draw_flips, partition_rows
from ..inference.scan import Response, Scan
from ..inference.screening import build_scan_for
from ..inference.simulation_counts import FLIP_DRAWS, NULL_DRAWS
from ..shapes.candidate_kinds import CandidateKind
from .candidate_traits import Traits
from .views import View, Views, build_view

# largest family-wise p-value of an effect
LEVEL = 0.05
# numbers in the candidates' columns from which a study is large
LARGE_STUDY = 3e6


def extend_model(base: Model, chosen: Sequence[Candidate]) -> Model:
    """Extend the base by the mechanisms of some candidates."""
    return base + tuple(dict.fromkeys(c.mechanism for c in chosen))


class Renamed(NamedTuple):
    """An effect named again, given all others, and the log evidence for it and its like."""

    named: CredibleSet
    evidence: float


class Search:
    """What the steps of the search share: the data, the candidates and the null distribution.

    A candidate is known by its number g among `candidates`. `first`: the view of the base, whose scan
    the null distribution is drawn from; `causes`: values that other searches in the same rows have
    computed.

    An effect's name, given the others, is remembered as long as the view of their model lives:
    neither a view nor the candidates change."""

    def __init__(
        self,
        problem: Problem,
        base: Model,
        candidates: tuple[Candidate, ...],
        rng: np.random.Generator,
        base_fit: Fit,
        memory_mb: float = DEFAULT_OPTIONS.memory_mb,
        causes: KeptCauses | None = None,
    ):
        self.problem = problem
        self.base = base
        self.rng = rng
        self.memory_mb = memory_mb
        self.causes = KeptCauses() if causes is None else causes
        self._see(candidates, base_fit)
        is_large = self.columns.screws.size >= LARGE_STUDY
        self.flip_draws = FLIP_DRAWS[is_large]
        null_draws = NULL_DRAWS[is_large]
        self.null, self.smallest_p = draw_null(self.first.scan, self.log_prior, null_draws, rng)
        self.bound = float(np.quantile(self.null, 1 - LEVEL))

    def _see(
        self, candidates: tuple[Candidate, ...], base_fit: Fit, before: Columns | None = None
    ) -> None:
        """Compute the columns of the candidates and the view of the base; `before`: the columns of
        the first of them."""
        self.candidates = candidates
        self.columns: Columns = build_columns(
            self.problem, candidates, base_fit.at(), self.memory_mb, self.causes, before
        )
        self.log_prior = np.log([c.prior for c in candidates])
        self.curves = collect_curves(candidates, self.columns, self.log_prior)
        self.first = build_view(self.problem, self.columns, base_fit)
        self.views = Views(self.problem, self.columns, self.first)
        self.traits = Traits(self.problem, candidates, self.first)
        # candidates that the base has already: what a refit leaks of them is no cause
        self.dead = np.flatnonzero(self.first.scan.sizes == 0)
        self._renamed: WeakKeyDictionary[View, dict[int, Renamed]] = WeakKeyDictionary()

    def offer(self, more: Sequence[Candidate]) -> Search:
        """Offer further candidates beside the others, with the same null distribution."""
        new = copy(self)
        new._see(self.candidates + tuple(more), self.first.fitted, self.columns)
        return new

    def fit_model(
        self, chosen: Sequence[int], start: Fit | None, step_mm: float = COARSE_MM
    ) -> View:
        """Fit the base with the chosen candidates. Raises NotEstimable."""
        effects = [self.candidates[g] for g in chosen]
        model = extend_model(self.base, effects)
        return self.views.build(fit_shrunk(self.problem, model, start, step_mm))

    def try_fit(
        self, chosen: Sequence[int], start: Fit | None, step_mm: float = COARSE_MM
    ) -> View | None:
        """Fit the base with the chosen candidates; None where the data do not determine them."""
        try:
            return self.fit_model(chosen, start, step_mm)
        except NotEstimable:
            return None

    def is_unbounded(self, g: int, view: View) -> bool:
        """Return whether the fit leaves an effect's size open.

        Then a term, or its standard error, is beyond what a small screw can be."""
        fitted = view.fitted
        terms = fitted.locate(self.candidates[g].mechanism)
        estimate = fitted.theta[terms]
        size = np.abs(estimate)
        error = fitted.standard_errors[terms]
        most = self.columns.largest_terms(g)
        is_large = size > most
        is_open = error > most
        return bool(is_large.any() or is_open.any())

    def compute_displacement(self, g: int, view: View) -> Array:
        """Compute (N,) what an effect, as fitted, does to the target beyond the base; whitened."""
        Q, own = self.first.Q, view.mask_terms(self.candidates[g])
        moved = view.A.move(np.flatnonzero(own), view.fitted.theta[own])
        return np.asarray(moved - Q @ (Q.T @ moved))

    def name_strongest(self, view: View, known: Sequence[int]) -> CredibleSet:
        """Name what explains most of the residual, beside candidates that are `known`."""
        return self.ask_rest(view).answer(self.list_set_aside(known))

    def ask_rest(self, view: View) -> Question:
        """Ask what explains the residual of a model."""
        return ask(view.scan, self.candidates, self.log_prior, view.response)

    def list_set_aside(self, known: Sequence[int]) -> Index:
        """List what explains nothing beside `known` candidates: these have had their turn, what
        the fit drops of them is no cause."""
        taken = np.array(known, dtype=np.intp)
        bumps = self._list_bumps(self.traits.bumped[taken])
        close = self.traits.close_steps.list_beside(known)
        return np.concatenate([self.dead, taken, bumps, close])

    def _list_bumps(self, joints: Index) -> Index:
        """List the candidates that let some joints err around one reading."""
        of_these = np.isin(self.traits.bumped, joints[joints > 0])
        return np.flatnonzero(of_these)

    def compute_sign_p(self, view: View, known: Sequence[int], observed: float) -> float:
        """Compute how often the residual's own rows have as much evidence when signs are drawn.

        Signs are drawn for whole postures, and for whole groups where their rows go together; the
        largest of these p-values is returned."""
        log_prior = self.log_prior.copy()
        excluded = self.list_set_aside(known)
        log_prior[excluded] = -np.inf
        p = []
        for unit in self.expand_partitions(view):
            adjusted = adjust_residual(view.scan.Q, view.residual, unit)
            flips = draw_flips(view.scan, log_prior, adjusted, unit, self.flip_draws, self.rng)
            p.append(compute_flip_p(flips, observed, self.flip_draws, LEVEL))
        return max(p)

    def expand_partitions(self, view: View) -> list[Index]:
        """Expand every partition of the rows to coordinates (N,).

        Equal numbers change sign together; -1 where a row is the prior's."""
        problem = self.problem
        fitted_residual = view.fitted.residuals(problem)
        residual = fitted_residual[:, :3]
        units = partition_rows(problem.data, residual, self.rng)
        coordinates = len(view.residual)
        return [self.expand_unit(unit, coordinates) for unit in units]

    def expand_unit(self, unit: Index, coordinates: int) -> Index:
        """Expand the numbers of units of rows (m,) to coordinates (N,); -1 where a row is the prior's."""
        problem = self.problem
        tiled_shape = 1, problem.components, 1
        every = np.tile(unit, tiled_shape)
        parts = []
        for rows in problem.blocks():
            of_rows = every[:, :, rows]
            flat = flatten_measured(problem, rows, of_rows)
            own = flat[0]
            parts.append(own)
        measured = np.concatenate(parts)
        prior_rows = coordinates - len(measured)
        of_prior = np.full(prior_rows, -1)
        return np.append(measured, of_prior)

    def draw_final_nulls(self, view: View, weakest: float) -> list[Array]:
        """Draw the nulls that the final effects are held against, the `weakest` of that evidence.

        Returns sorted evidences of each null, or bounds of them below the weakest effect's. The
        nulls are equal normal noise, and the signs of what `view` leaves. Where the model of `view`
        has every candidate already, evidences beyond the base are taken."""
        seen = view.scan
        if not seen.sizes.any():
            seen = self.first.scan
        nulls = [self.null]
        for chances in self._flip_rest(view, seen):
            parts = [chance.below(weakest) for chance in chances]
            evidences = np.concatenate(parts)
            evidences.sort()
            nulls.append(evidences)
        return nulls

    def compute_map_p(self, view: View) -> Array:
        """Compute family-wise p-values (G,) of every candidate alone on the base: the largest by equal
        normal noise, and by the signs of what `view` leaves."""
        scan = self.first.scan
        response = self.first.response
        p = compute_familywise_p(scan, response, self.smallest_p)
        for chances in self._flip_rest(view, scan):
            parts = [chance.smallest_p for chance in chances]
            smallest = np.concatenate(parts)
            smallest.sort()
            p_by_signs = compute_familywise_p(scan, response, smallest)
            p = np.maximum(p, p_by_signs)
        return p

    def _flip_rest(self, view: View, seen: Scan) -> Iterator[Iterator[Chance]]:
        """Flip the signs of what a view leaves, in every partition, as another scan sees it."""
        rows = len(seen.Q)
        Q = view.scan.Q
        draws = self.flip_draws
        for unit in self.expand_partitions(view):
            adjusted = adjust_residual(Q, view.residual, unit)
            e = adjusted[:rows]
            seen_unit = unit[:rows]
            yield draw_flips(seen, self.log_prior, e, seen_unit, draws, self.rng)

    def scan_without(self, g: int, view: View) -> tuple[Scan, Response]:
        """Scan from a model without effect g for what explains it: (scan, residual with it put
        back); what cannot matter beside it has no directions."""
        released = view.release(self.candidates[g])
        return build_scan_for(view.scan, released, view.response, g, self.log_prior)

    def rename(self, g: int, view: View) -> Renamed:
        """Name effect g again, given all others; remembered while the view lives."""
        answers = self._renamed.setdefault(view, {})
        if g in answers:
            return answers[g]
        scan, response = self.scan_without(g, view)
        question = ask(scan, self.candidates, self.log_prior, response)
        renamed = rename_effect(question, g, without=self._exclude_beside(g, view))
        evidence = compute_own_evidence(question, renamed, g)
        named = include_candidate(question, renamed, g)
        answers[g] = Renamed(named, evidence)
        return answers[g]

    def _exclude_beside(self, g: int, view: View) -> Index:
        """List what no name of effect g may be: what the base has, and what another effect rules
        out."""
        bumps = self._list_bumps(self.list_bumped_beside(g, view))
        chosen = self._list_chosen(view)
        same = self.traits.nested_names.list_other_names(g, chosen)
        others = bumps[bumps != g]
        close = self.traits.close_steps.list_beside([other for other in chosen if other != g])
        return np.concatenate([self.dead, others, same, close])

    def _list_chosen(self, view: View) -> list[int]:
        """List the candidates that are in a model."""
        numbers = self.traits.numbers
        mechanisms = view.model.mechanisms
        known = [m for m in mechanisms if m in numbers]
        return [numbers[m] for m in known]

    def list_bumped_beside(self, g: int, view: View) -> Index:
        """List the joints that effects of a model beside candidate g let err around one reading."""
        beside = self._list_chosen(view)
        joints = [
            self.traits.bumped[other]
            for other in beside
            if other != g and self.traits.bumped[other]
        ]
        return np.array(joints, dtype=np.intp)

    def generate_better_curves(
        self, chosen: Sequence[int], view: View, moved: Sequence[int]
    ) -> Iterator[tuple[list[int], str]]:
        """Generate models in which a joint's own-angle effects are explained better together, of
        joints that have one of the effects which `moved`.

        Yields the chosen candidates, and what changed in words."""
        for curve in self.curves.values():
            now = [g for g in chosen if g in curve.which]
            if not np.isin(now, moved).any():
                continue
            effects = [self.candidates[g] for g in now]
            start = see_rest(curve, view.scan, view.response, view.release(*effects))
            best = find_better_curve(start, now, MIN_LOG_ODDS)
            if best is None:
                continue
            rest = [g for g in chosen if g not in now]
            before = self._join_names(now)
            after = self._join_names(best)
            yield [*rest, *best], f"{before} -> {after}"

    def _join_names(self, members: Sequence[int]) -> str:
        return " & ".join(self.candidates[g].mechanism.name for g in members)

    def add(self, chosen: Sequence[int], g: int) -> list[int]:
        """Add candidate g; a free function of a joint replaces one with other knots, a form of
        what yields another form of that."""
        subject = self._find_subject(g)
        return [*(k for k in chosen if self._find_subject(k) != subject), g]

    def _find_subject(self, g: int) -> tuple[str, int]:
        candidate = self.candidates[g]
        if candidate.kind is CandidateKind.FREE_FUNCTION:
            first_term = candidate.mechanism.terms[0]
            screw = first_term.screws[0]
            return "joint", screw.frame
        number = int(self.traits.single[g])
        if number:
            return "single", number
        return "candidate", g
