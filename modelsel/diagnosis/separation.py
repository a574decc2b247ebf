"""Separate effects, which repeat, from errors that do not.

An effect that is not named yet resembles such errors: a joint that yields looks like one that does
not repeat. So the parts of the errors (`fitting.error_structure`) are first estimated at the base,
where they are largest, and effects are sought given these. The parts are then estimated again from
what the effects leave, and the search is repeated, until the parts stay the same.

Two kinds of part may still be effects that were not named: an error that lasts, and a part that only
the directions or the sizes of single rows' errors identify, of a joint, of the instrument, of a target
or of a group. Where such a part remains, the search is repeated without the former and with the latter, and an information criterion chooses among all
explanations."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np

from .._progress import News, keep_silent
from .._random import generator
from .._typing import Say
from ..fitting.design import Model
from ..fitting.error_structure import ErrorStructure, find_structure
from ..fitting.least_squares import Fit, fit
from ..fitting.possible_parts import ORDER, UNSURE, PossiblePart
from ..fitting.problem import Problem
from ..fitting.shrinkage import fit_shrunk
from ..fitting.splines import spline
from ..mechanisms.terms import Mechanism
from ..selection.evaluation import Split
from ..selection.structure_criterion import compute_criterion
from .base_fits import TellBase, keep_base
from .candidates.candidate import Candidate
from .candidates.options import DEFAULT_OPTIONS, DiagnosisOptions
from .columns.kept_causes import KeptCauses
from .conclusion import conclude, prove
from .findings.effects import Effect
from .findings.outcome import Diagnosis, build_empty
from .high_waves import find_high_waves
from .reshaping import improve_shapes, look_closer
from .search.state import Search, extend_model
from .search.stepwise import Exploration, explore
from .shapes.driver_functions import IN_TIME

# largest number of searches that continue from the parts which the one before has left: where there
# are some, and where there are none
MOST_WITH_PARTS, MOST_WITHOUT = 1, 2
# by how much the criterion must be lower for an error that lasts to be taken for effects, or for
# effects to be taken for an error that lasts:
# "very strong" evidence by Kass & Raftery 1995, J. Am. Stat. Assoc. 90:773, section 3.2
VERY_STRONG = 10.0
# the same where an effect takes any shape in time, as errors that last do: of 400 campaigns whose
# errors had a correlation of 0.9, thirty gained more than 10 by such an effect, three more than 25
OF_ANY_SHAPE = 25.0
# probability of errors that last in an effect's place from which they are told with it
WORTH_TELLING = 0.01


class Inquiry(NamedTuple):
    """The question that a diagnosis answers: the base, what may extend it, and the options.

    `everything`: mechanisms that may extend the base; `cells`: whether unregistered causes may, too;
    `tell_base` is told the outliers and the fitted base, before effects are looked for."""

    base: Model
    everything: tuple[Mechanism, ...]
    seed: int
    cells: bool
    say: Say = keep_silent
    options: DiagnosisOptions = DEFAULT_OPTIONS
    tell_base: TellBase = keep_base

    def search(
        self,
        problem: Problem,
        found: tuple[Candidate, ...],
        known: Sequence[Candidate],
        causes: KeptCauses,
        base_fit: Fit,
    ) -> Search:
        """Prepare the search for effects in a training problem, with the study's random stream of
        naming. `known`: chosen before, of which some may be shapes of an earlier search; `causes`:
        those of other searches in the same rows; `base_fit`: of the base to these."""
        rng = generator(self.seed, "naming")
        listed = {one.mechanism for one in found}
        shapes = tuple(one for one in known if one.mechanism not in listed)
        memory_mb = self.options.memory_mb
        return Search(problem, self.base, found + shapes, rng, base_fit, memory_mb, causes)


class _Explanation(NamedTuple):
    """One explanation of the data: effects and parts of the errors.

    `explored`: the search for effects; `given`: the parts it assumed; `left`: the parts estimated from
    what the effects leave; `criterion`: of effects and `left` together, smaller is better; `instead`:
    effects that explain an error which seems to last about as well."""

    explored: Exploration
    given: ErrorStructure
    left: ErrorStructure
    criterion: float
    instead: tuple[Candidate, ...] = ()

    @property
    def is_settled(self) -> bool:
        """Whether a search given the parts that are left would find the same."""
        return not self.explored.chosen or self.left.resembles(self.given)


@dataclass(frozen=True)
class _Separation:
    """What a separation works on: the rows, the candidates, the possible parts of the errors, and the base
    fitted to the rows as they are stated; `waves`: high ones that a search was offered and has found."""

    split: Split
    inquiry: Inquiry
    found: tuple[Candidate, ...]
    parts: tuple[PossiblePart, ...]
    base_fit: Fit
    causes: KeptCauses = field(default_factory=KeptCauses, repr=False)
    waves: dict[Candidate, None] = field(default_factory=dict, repr=False)

    def find_parts(
        self, fitted: Fit, *unsure: str, before: ErrorStructure | None = None
    ) -> ErrorStructure:
        """Find the parts that a fit leaves, without those that only what is `unsure` identifies;
        `before`: the parts of a similar fit, to start from."""
        self.inquiry.say(News("what does not repeat"))
        offered = [part for part in self.parts if part.told_by not in unsure]
        split = self.split
        return find_structure(split.problem, split.used, fitted, offered, before)

    def search(self, given: ErrorStructure, known: tuple[Candidate, ...] = ()) -> _Explanation:
        """Search for effects given parts of the errors, starting from the known effects."""
        self.inquiry.say(News("searching again" if known else "searching"))
        training, base_fit = self._weigh(given), self.base_fit
        if given.shared:
            base_fit = fit(training, self.inquiry.base, start=base_fit.theta)
        found = (*self.found, *self.waves)
        prepared = self.inquiry.search(training, found, known, self.causes, base_fit)
        explored = explore(prepared, known, self.inquiry.say)
        explored, waves = find_high_waves(explored, self._weigh(given.of_instrument()))
        self.waves.update(dict.fromkeys(waves))
        left = self.find_parts(explored.fitted, before=given)
        criterion = self._judge(explored.chosen, explored.fitted, left)
        return _Explanation(explored, given, left, criterion)

    def _weigh(self, errors: ErrorStructure) -> Problem:
        """Weigh the rows that the search uses by some parts of their errors."""
        split = self.split
        problem = errors.whiten(split.problem)
        weighed = replace(split, problem=problem)
        return weighed.training

    def _judge(self, chosen: Sequence[Candidate], fitted: Fit, left: ErrorStructure) -> float:
        log_prior = sum(float(np.log(candidate.prior)) for candidate in chosen)
        split = self.split
        return compute_criterion(split.problem, split.used, fitted, left, log_prior)

    def explain(self, known: tuple[Candidate, ...] = ()) -> _Explanation:
        """Explain the data by effects and errors; what may be either is decided by the criterion.
        `known`: effects that the search starts from."""
        sure = self.find_parts(self.base_fit, *UNSURE)
        best = self.search(sure, known)
        if best.left.shared:
            every = self.find_parts(self.base_fit, before=sure)
            if every.tells(*UNSURE):
                best = self._improve(best)
                best = min(
                    best, self.search(every, best.explored.chosen), key=lambda one: one.criterion
                )
        best = self._go_on(best)
        if not best.left.tells(ORDER):
            best = self._try_lasting(best)
        return self._hold_against_effects(best) if best.left.tells(ORDER) else best

    def _try_lasting(self, best: _Explanation) -> _Explanation:
        """Try errors that last in the place of effects in time, which may have explained them away
        before they were looked for."""
        others = tuple(one for one in best.explored.chosen if not _drifts(one))
        if len(others) == len(best.explored.chosen):
            return best
        left = self._find_without(best.explored.fitted, others)[1]
        if not left.tells(ORDER):
            return best
        return min(best, self.search(left, others), key=lambda one: one.criterion)

    def _find_without(self, fitted: Fit, others: Sequence[Candidate]) -> tuple[Fit, ErrorStructure]:
        """Fit the base with some of the effects of a fitted model, and find the parts that these
        leave."""
        smaller = extend_model(self.inquiry.base, others)
        without = fit_shrunk(self.split.training, smaller, fitted)
        return without, self.find_parts(without)

    def _hold_against_effects(self, best: _Explanation) -> _Explanation:
        """Compare an error that lasts with effects that could explain it.

        The effects take its place where they are clearly better; where neither is clearly better,
        those that depend on time are named as alternatives."""
        known = best.explored.chosen
        others = best.left.without(ORDER)
        repeating = self.search(others, known)
        gain = best.criterion - repeating.criterion
        more = [one for one in repeating.explored.chosen if one not in known]
        in_time = tuple(one for one in more if _is_in_time(one))
        is_free = any(spline(one.mechanism.terms[0]) for one in in_time)
        needed = OF_ANY_SHAPE if is_free else VERY_STRONG
        if gain > needed:
            return self._go_on(repeating)
        if gain < -VERY_STRONG:
            return best
        return best._replace(instead=in_time)

    def weigh_lasting(self, diagnosis: Diagnosis, errors: ErrorStructure) -> Diagnosis:
        """Weigh effects that depend on time against errors that last in their place, where the
        errors that are left have no such part."""
        effects = diagnosis.effects
        others = tuple(one for one in effects if not _drifts(one.candidate))
        if errors.tells(ORDER) or len(others) == len(effects):
            return diagnosis
        rest = [one.candidate for one in others]
        without, left = self._find_without(diagnosis.fit, rest)
        if not left.tells(ORDER):
            return diagnosis
        own = self._judge([one.candidate for one in effects], diagnosis.fit, errors)
        gain = self._judge(rest, without, left) - own
        share = 1 / (1 + np.exp(-gain / 2))
        return replace(diagnosis, effects=tuple(_share_with_lasting(one, share) for one in effects))

    def _improve(self, one: _Explanation) -> _Explanation:
        """Replace the effects of joints that seem not to repeat by the shapes that explain them best,
        and look closer there."""
        names = {f"joint {j}": j for j in range(1, self.split.problem.robot.n + 1)}
        joints = [names[name] for name in one.left.names if name in names]
        explored = improve_shapes(one.explored, joints)
        if self.inquiry.cells:
            explored = look_closer(explored, joints)
        if explored is one.explored:
            return one
        left = self.find_parts(explored.fitted, before=one.left)
        criterion = self._judge(explored.chosen, explored.fitted, left)
        return _Explanation(explored, one.given, left, criterion)

    def _go_on(self, best: _Explanation) -> _Explanation:
        """Repeat the search given the parts that the last one left, until these stay the same.

        The errors are largest at the base; effects explain some of them away."""
        last = best
        most = MOST_WITH_PARTS if best.left.shared else MOST_WITHOUT
        for _ in range(most):
            if last.is_settled:
                break
            last = self.search(last.left, last.explored.chosen)
            best = min(best, last, key=lambda one: one.criterion)
        return best


def separate(
    split: Split,
    inquiry: Inquiry,
    found: tuple[Candidate, ...],
    parts: tuple[PossiblePart, ...],
    base_fit: Fit,
    known: tuple[Candidate, ...] = (),
) -> tuple[Split, Diagnosis]:
    """Separate effects from errors that do not repeat, and weigh how much of each effect is proven.

    `base_fit`: of the base to the rows that the split uses; `known`: candidates from which the search
    starts, also such as are not among `found`. Returns the split, whitened by the errors that were
    found, and the diagnosis."""
    if not found:
        return split, build_empty(inquiry.base, base_fit)
    separation = _Separation(split, inquiry, found, parts, base_fit)
    best = separation.explain(known)
    inquiry.say(News("weighing what is proven"))
    diagnosis, errors = prove(conclude(best.explored)), best.left
    if [one.candidate for one in diagnosis.effects] != list(best.explored.chosen):
        errors = separation.find_parts(diagnosis.fit, before=errors)
    if best.instead:
        errors = _name_instead(errors, best.instead)
    diagnosis = separation.weigh_lasting(diagnosis, errors)
    weighed = replace(split, problem=errors.whiten(split.problem))
    if errors.shared or best.given.shared:
        diagnosis = _fit_again(diagnosis, weighed.training)
    return weighed, replace(diagnosis, errors=errors)


def _fit_again(diagnosis: Diagnosis, problem: Problem) -> Diagnosis:
    """Refit the model that was found, its rows weighted by the errors that it leaves.

    The search weighted them by the errors that it assumed."""
    if not diagnosis.effects:
        return diagnosis
    fitted = fit_shrunk(problem, diagnosis.model, diagnosis.fit, held="all")
    effects = []
    for effect in diagnosis.effects:
        own = fitted.locate(effect.candidate.mechanism)
        refitted = replace(
            effect, estimate=fitted.theta[own], standard_error=fitted.standard_errors[own]
        )
        effects.append(refitted)
    return replace(diagnosis, fit=fitted, effects=tuple(effects))


def _is_in_time(candidate: Candidate) -> bool:
    """Whether an effect depends on the course of the campaign, as errors that last seem to."""
    return bool(candidate.mechanism.names() & IN_TIME)


def _drifts(candidate: Candidate) -> bool:
    """Whether an effect in time goes on, as errors that last do; a step or a bump is over at once."""
    return _is_in_time(candidate) and candidate.fault is None


def _share_with_lasting(effect: Effect, share: float) -> Effect:
    """Share what an effect in time claims with errors that last."""
    claim = effect.claim
    if claim is None or not _drifts(effect.candidate):
        return effect
    lasting = 1 - share
    told = lasting if lasting >= WORTH_TELLING else 0.0
    return replace(effect, claim=claim.share(share), lasting=told)


def _name_instead(errors: ErrorStructure, effects: tuple[Candidate, ...]) -> ErrorStructure:
    """Record the effects that explain the data about as well as the part which lasts."""
    labels = tuple(one.label for one in effects)
    parts = [
        replace(part, instead=labels) if part.told_by == ORDER else part for part in errors.parts
    ]
    return replace(errors, parts=tuple(parts))
