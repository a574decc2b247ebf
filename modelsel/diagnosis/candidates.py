"""Candidates: the explanations that a diagnosis weighs against each other.

A candidate is one explanation: one effect with coefficients of its own. The candidates are the
registered mechanisms that the base lacks, and the unregistered explanations: every cell of the
error map (place x cause), waves and free functions of single joints. The registered mechanisms
share REGISTERED of the prior probability, evenly by name (the constants of a scanned mechanism
divide the share of its name); the unregistered explanations share the rest."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from .._typing import Array
from ..fitting.design import Model
from ..fitting.problem import Problem
from ..mechanisms.terms import Mechanism, TermKey
from ..selection.comparison import MAX_CANDIDATES
from .candidate_kinds import CandidateKind
from .data_faults import FaultKind, find_fault_kind
from .options import DEFAULT_OPTIONS, DiagnosisOptions
from .unregistered import Unregistered, build_cell_causes, generate_unregistered, list_places

# share of the prior probability that the registered mechanisms have together
REGISTERED = 0.6

Screws = frozenset[TermKey]


@dataclass(frozen=True)
class Candidate:
    """An explanation with its prior probability.

    `but_for_sign`: for a cell of the error map, the registered mechanisms with the same screws,
    which physics allows with one sign only; `asked`: the study considers no causes but those that
    it lists."""

    mechanism: Mechanism
    kind: CandidateKind
    prior: float
    but_for_sign: tuple[Mechanism, ...] = ()
    asked: bool = False

    @property
    def registered(self) -> bool:
        """Whether the registry has it."""
        return self.kind is CandidateKind.MECHANISM

    @property
    def registered_name(self) -> str | None:
        """The registered name; None for an unregistered explanation."""
        return self.mechanism.name if self.registered else None

    @property
    def fault(self) -> FaultKind | None:
        """The kind of data fault that it stands for; None for an error of the arm."""
        return find_fault_kind(self.mechanism) if self.registered else None

    @property
    def screws(self) -> Screws:
        """Its terms' screws, without their order."""
        return collect_screws(self.mechanism)

    @property
    def label(self) -> str:
        """A short name: the registered one, or place and cause."""
        if self.registered:
            return self.mechanism.name
        if self.kind is CandidateKind.FREE_FUNCTION:
            return self.mechanism.name.partition(" ")[0]
        screw = self.mechanism.terms[0].screws[0]
        return f"frame {screw.frame} {screw.axis} · {self.causes(' & ')}"

    def causes(self, conjunction: str) -> str:
        """Its causes in words, joined by a conjunction."""
        if self.kind is CandidateKind.WAVE_PRODUCT:
            first, second = sorted(self.mechanism.names())
            return f"waves of {first} times waves of {second}"
        screws = (screw for term in self.mechanism.terms for screw in term.screws)
        return conjunction.join(dict.fromkeys(str(screw.cause) for screw in screws))


def collect_screws(mechanism: Mechanism) -> Screws:
    """Return the screws of a mechanism's terms, by which two mechanisms do the same."""
    return frozenset(term.key for term in mechanism.terms)


def exceeds_cell_limit(problem: Problem, options: DiagnosisOptions = DEFAULT_OPTIONS) -> bool:
    """Return whether the whole error map would have more than `max_cells` cells."""
    places = list_places(problem)
    causes = build_cell_causes(problem)
    return len(places) * len(causes) > options.max_cells


def build_candidates(
    problem: Problem,
    base: Model,
    mechanisms: Sequence[Mechanism],
    cells: bool = True,
    options: DiagnosisOptions = DEFAULT_OPTIONS,
) -> tuple[Candidate, ...]:
    """List every explanation that the data could carry beyond the base; priors sum to one.

    With `cells=False` the given `mechanisms` are the only candidates."""
    registered = _select_applicable(problem, base, mechanisms)
    one_sided = _find_one_sided(registered)
    unregistered: list[Unregistered] = []
    if cells:
        taken = {collect_screws(m) for m in registered} - one_sided.keys()
        within = exceeds_cell_limit(problem, options)
        offered = generate_unregistered(problem, adjacent_only=within)
        unregistered = _select_new(offered, base, taken)
    share = _share_of_registered(bool(registered), bool(unregistered))
    return (
        *_weigh_registered(registered, share, asked=not cells),
        *_weigh_unregistered(unregistered, 1 - share, one_sided),
    )


def _select_applicable(
    problem: Problem, base: Model, mechanisms: Sequence[Mechanism]
) -> list[Mechanism]:
    """Select the mechanisms whose causes the data have and whose terms the base lacks."""
    available = problem.names().keys()
    present = {term.key for term in base.terms}
    applicable = [
        m for m in mechanisms if m.names() <= available and not collect_screws(m) <= present
    ]
    return _drop_equal_constants(problem, applicable)


def _drop_equal_constants(problem: Problem, mechanisms: Sequence[Mechanism]) -> list[Mechanism]:
    """Keep one of a scanned mechanism's constants that do the same on these rows, such as steps
    between the same two configurations."""
    distinct: dict[tuple[object, ...], Mechanism] = {}
    for m in mechanisms:
        screws = [screw for term in m.terms for screw in term.screws]
        places = ((s.frame, s.axis) for s in screws)
        values = (np.asarray(problem.cause(s.cause)).tobytes() for s in screws)
        distinct.setdefault((m.name, *places, *values), m)
    return list(distinct.values())


def _find_one_sided(mechanisms: Sequence[Mechanism]) -> dict[Screws, tuple[Mechanism, ...]]:
    """Map screws to the mechanisms that have them, where these all allow the same one sign: with
    the other sign the screws are an unregistered explanation."""
    same: dict[Screws, list[Mechanism]] = {}
    for m in mechanisms:
        same.setdefault(collect_screws(m), []).append(m)
    return {key: tuple(group) for key, group in same.items() if _allow_one_sign(group)}


def _allow_one_sign(mechanisms: Sequence[Mechanism]) -> bool:
    signs = {m.signs for m in mechanisms}
    has_free_sign = any(0 in own for own in signs)
    return len(signs) == 1 and not has_free_sign


def _select_new(
    offered: Iterable[Unregistered], base: Model, taken: set[Screws]
) -> list[Unregistered]:
    """Select the explanations that neither the base nor an earlier one (nor `taken`) has."""
    present = {term.key for term in base.terms}
    known = set(taken)
    new = []
    for explanation in offered:
        screws = collect_screws(explanation.mechanism)
        if screws not in known and not screws <= present:
            known.add(screws)
            new.append(explanation)
    return new


def _share_of_registered(any_registered: bool, any_unregistered: bool) -> float:
    if not any_registered:
        return 0.0
    return REGISTERED if any_unregistered else 1.0


def _weigh_registered(
    mechanisms: Sequence[Mechanism], share: float, asked: bool
) -> Iterable[Candidate]:
    constants = Counter(m.name for m in mechanisms)
    for m in mechanisms:
        prior = share / len(constants) / constants[m.name]
        yield Candidate(m, CandidateKind.MECHANISM, prior, asked=asked)


def _weigh_unregistered(
    explanations: Sequence[Unregistered],
    share: float,
    one_sided: Mapping[Screws, tuple[Mechanism, ...]],
) -> Iterable[Candidate]:
    total = sum(e.weight for e in explanations)
    for e in explanations:
        variants = one_sided.get(collect_screws(e.mechanism), ())
        yield Candidate(e.mechanism, e.kind, share * e.weight / total, variants)


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
    ranked = [g for _, g in sorted(best, key=lambda pair: -pair[0])]
    forced = {g for f, g in best if f == np.inf}
    screws = {g: found[g].screws for g in ranked}

    def is_redundant(g: int) -> bool:
        if g in forced:
            return False
        smaller = [screws[h] for h in ranked if screws[h] < screws[g]]
        is_part = any(screws[g] < screws[h] for h in forced)
        return is_part or screws[g] == frozenset().union(*smaller)

    chosen = [g for g in ranked if not is_redundant(g)][:most]
    aside = tuple(found[g].mechanism.name for g in ranked if g not in chosen)
    return tuple(found[g].mechanism for g in sorted(chosen)), aside


def _find_best_constants(
    found: Sequence[Candidate], single_f: Array, named: Sequence[Candidate]
) -> list[tuple[float, int]]:
    """Find (F, index) of the best candidate of every registered name; F is infinite for the
    `named`."""
    best: dict[str, tuple[float, int]] = {}
    for g, candidate in enumerate(found):
        is_named = any(candidate is other for other in named)
        f = np.inf if is_named else float(single_f[g])
        name = candidate.mechanism.name
        if candidate.registered and f > best.get(name, (0.0, -1))[0]:
            best[name] = (f, g)
    return list(best.values())
