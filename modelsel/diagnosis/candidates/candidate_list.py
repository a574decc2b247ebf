"""Candidates: the explanations that a diagnosis weighs against each other.

A candidate is one explanation: one effect with coefficients of its own. The candidates are the
registered mechanisms that the base lacks, the unregistered explanations: every cell of the error
map (place x cause), waves and free functions of single joints, and what a study adds
(`OwnCandidates`). The registered mechanisms share REGISTERED of the prior probability, evenly by
name unless `options.weights` has others (the constants of a scanned mechanism divide the share of
its name); the unregistered explanations share the rest. What a study gives a prior of its own has
that, and the others share what it leaves."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from itertools import chain

import numpy as np

from ..._typing import Array
from ...fitting.design import Model
from ...fitting.problem import Problem
from ...mechanisms.terms import Mechanism
from ...selection.comparison import MAX_CANDIDATES
from ..shapes.arm_shapes import find_still_readings, generate_arm_shapes
from ..shapes.candidate_kinds import CandidateKind
from ..shapes.joint_shapes import generate_joint_shapes
from ..shapes.late_temperatures import generate_campaign_cells, is_late
from ..shapes.target_cells import generate_target_cells
from ..shapes.unregistered import (
    Unregistered,
    build_cell_causes,
    generate_unregistered,
    list_distinct_places,
)
from .candidate import Candidate, collect_screws
from .options import DEFAULT_OPTIONS, DiagnosisOptions
from .own_candidates import OwnCandidates, Screws, list_stated_names, select_beyond
from .prior_weights import share_constants, weigh_names
from .scanned_constants import drop_equal_constants
from .usable_names import list_lacking

# share of the prior probability that the registered mechanisms have together
REGISTERED = 0.6


def exceeds_cell_limit(problem: Problem, options: DiagnosisOptions = DEFAULT_OPTIONS) -> bool:
    """Return whether the whole error map would have more than `max_cells` cells."""
    places = list_distinct_places(problem)
    causes = build_cell_causes(problem)
    cells = len(places) * len(causes)
    return cells > options.max_cells


def build_candidates(
    problem: Problem,
    base: Model,
    mechanisms: Sequence[Mechanism],
    cells: bool = True,
    options: DiagnosisOptions = DEFAULT_OPTIONS,
) -> tuple[Candidate, ...]:
    """List every explanation that the data could carry beyond the base; priors sum to one.

    With `cells=False` the given `mechanisms`, and what `options.own` adds, are the only
    candidates."""
    registered = _select_applicable(problem, base, mechanisms)
    one_sided = _find_one_sided(registered)
    screws = {collect_screws(m) for m in registered}
    present = frozenset(term.key for term in base.terms)
    own = select_beyond(options.own, screws - one_sided.keys(), present)
    taken = (screws - one_sided.keys()) | _collect_own(own)
    unregistered = _list_own_cells(own)
    if cells:
        within = exceeds_cell_limit(problem, options)
        offered = chain(
            generate_unregistered(problem, adjacent_only=within),
            generate_target_cells(problem, list_stated_names(own)),
            generate_campaign_cells(problem),
            generate_joint_shapes(problem),
            generate_arm_shapes(problem),
        )
        unregistered |= _select_new(offered, base, taken, find_still_readings(problem))
    registered += [
        m for group in own if group.named and group.prior is None for m in group.mechanisms
    ]
    alone = not registered and not unregistered
    stated = tuple(group for group in own if group.prior is not None)
    left = 0.0 if alone else 1 - sum(group.prior or 0.0 for group in stated)
    share = left * _share_of_registered(bool(registered), bool(unregistered))
    return (
        *_weigh_registered(registered, share, dict(options.weights), asked=not cells),
        *_weigh_stated(stated, left, asked=not cells),
        *_weigh_unregistered(unregistered, left - share, one_sided, asked=not cells),
    )


def _collect_own(own: Iterable[OwnCandidates]) -> set[Screws]:
    return {collect_screws(m) for group in own for m in group.mechanisms}


def _list_own_cells(own: Iterable[OwnCandidates]) -> dict[Screws, Unregistered]:
    """List what a study adds to the error map without a prior of its own: as likely as a cell."""
    cells = {}
    for group in own:
        if group.prior is not None or group.named:
            continue
        for m in group.mechanisms:
            cells[collect_screws(m)] = Unregistered(m, CandidateKind.CELL, weight=1.0)
    return cells


def _weigh_stated(groups: Sequence[OwnCandidates], left: float, asked: bool) -> Iterable[Candidate]:
    """Weigh what has priors of its own, of which `left` is left to the others."""
    total = sum(group.prior or 0.0 for group in groups)
    for group in groups:
        kind = CandidateKind.MECHANISM if group.named else CandidateKind.CELL
        share = (group.prior or 0.0) / total * (1 - left)
        for m in group.mechanisms:
            yield Candidate(
                mechanism=m, kind=kind, prior=share / len(group.mechanisms), asked=asked
            )


def find_cell_prior(found: Sequence[Candidate]) -> float:
    """Find the prior probability of a cell of the error map, 0 where there are none."""
    priors = []
    for one in found:
        is_cell = one.kind is CandidateKind.CELL
        if is_cell and not is_late(one.mechanism):
            priors.append(one.prior)
    return min(priors, default=0.0)


def _select_applicable(
    problem: Problem, base: Model, mechanisms: Sequence[Mechanism]
) -> list[Mechanism]:
    """Select the mechanisms whose causes the data have and whose terms the base lacks."""
    present = {term.key for term in base.terms}
    applicable = []
    for m, lacking in zip(mechanisms, list_lacking(problem, mechanisms), strict=True):
        if not lacking and not collect_screws(m) <= present:
            applicable.append(m)
    return drop_equal_constants(problem, applicable)


def _find_one_sided(mechanisms: Sequence[Mechanism]) -> dict[Screws, tuple[Mechanism, ...]]:
    """Map screws to the mechanisms that have them, where these all allow the same one sign.

    With the other sign the screws are an unregistered explanation."""
    same: dict[Screws, list[Mechanism]] = {}
    for m in mechanisms:
        screws = collect_screws(m)
        same.setdefault(screws, []).append(m)
    one_sided = {}
    for screws, group in same.items():
        variants = tuple(group)
        if _allow_one_sign(variants):
            one_sided[screws] = variants
    return one_sided


def _allow_one_sign(mechanisms: Sequence[Mechanism]) -> bool:
    signs = {m.signs for m in mechanisms}
    if len(signs) != 1:
        return False
    (own,) = signs
    return 0 not in own


def _select_new(
    offered: Iterable[Unregistered], base: Model, taken: set[Screws], still: frozenset[str]
) -> dict[Screws, Unregistered]:
    """Select the explanations that neither the base nor an earlier one (nor `taken`) has, and that need
    no reading of a joint which stood still."""
    present = {term.key for term in base.terms}
    new: dict[Screws, Unregistered] = {}
    for explanation in offered:
        mechanism = explanation.mechanism
        screws = collect_screws(mechanism)
        is_new = screws not in taken and not screws <= present
        names = mechanism.names()
        # with a constant reading beside it, a wave of one joint would have several names
        if is_new and still.isdisjoint(names):
            new.setdefault(screws, explanation)
    return new


def _share_of_registered(any_registered: bool, any_unregistered: bool) -> float:
    if not any_registered:
        return 0.0
    return REGISTERED if any_unregistered else 1.0


def _weigh_registered(
    mechanisms: Sequence[Mechanism], share: float, weights: Mapping[str, float], asked: bool
) -> Iterable[Candidate]:
    weight = weigh_names(mechanisms, weights)
    total = sum(weight.values())
    parts = share_constants(mechanisms)
    for m, part in zip(mechanisms, parts, strict=True):
        share_of_name = share * weight[m.name] / total
        yield Candidate(
            mechanism=m, kind=CandidateKind.MECHANISM, prior=share_of_name * part, asked=asked
        )


def _weigh_unregistered(
    explanations: Mapping[Screws, Unregistered],
    share: float,
    one_sided: Mapping[Screws, tuple[Mechanism, ...]],
    asked: bool,
) -> Iterable[Candidate]:
    total = sum(e.weight for e in explanations.values())
    for screws, e in explanations.items():
        yield Candidate(
            mechanism=e.mechanism,
            kind=e.kind,
            prior=share * e.weight / total,
            but_for_sign=one_sided.get(screws, ()),
            asked=asked,
        )


def choose_strongest(
    found: Sequence[Candidate],
    single_f: Array,
    named: Sequence[Candidate] = (),
    most: int = MAX_CANDIDATES,
) -> tuple[tuple[Mechanism, ...], tuple[str, ...]]:
    """Choose the registered mechanisms that a comparison of subsets should include.

    Returns at most `most` of them in the registry's order (the `named`, then those of the largest
    F statistic alone, `single_f` (G,)) and the names of the others. Of a scanned mechanism the best
    constant, or the named one, represents it. A mechanism that is the union of others
    (gravity-twist of joint2-twist and joint3-twist), or a part of a named one, is left out."""
    best = _find_best_constants(found, single_f, named)
    best.sort(key=lambda pair: -pair[0])
    ranked = [g for _, g in best]
    forced = {g for f, g in best if f == np.inf}
    screws = {g: found[g].screws for g in ranked}

    def is_redundant(g: int) -> bool:
        own = screws[g]
        if g in forced:
            return False
        if any(own < screws[h] for h in forced):
            return True
        union: Screws = frozenset()
        for h in ranked:
            if screws[h] < own:
                union |= screws[h]
        return own == union

    needed = [g for g in ranked if not is_redundant(g)]
    chosen = needed[:most]
    mechanisms = [found[g].mechanism for g in sorted(chosen)]
    aside = [found[g].mechanism.name for g in ranked if g not in chosen]
    return tuple(mechanisms), tuple(aside)


def _find_best_constants(
    found: Sequence[Candidate], single_f: Array, named: Sequence[Candidate]
) -> list[tuple[float, int]]:
    """Find (F, index) of the best candidate of every registered name.

    F is infinite for the `named`."""
    best: dict[str, tuple[float, int]] = {}
    for g, candidate in enumerate(found):
        if not candidate.registered:
            continue
        f = float(single_f[g])
        if any(candidate is other for other in named):
            f = np.inf
        name = candidate.mechanism.name
        largest, _ = best.get(name, (0.0, -1))
        if f > largest:
            best[name] = (f, g)
    return list(best.values())
