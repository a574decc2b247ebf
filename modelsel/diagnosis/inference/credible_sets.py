"""Credible sets: from the evidence of every candidate to the smallest set that explains an effect.

With Bayes factors BF_g and priors π_g the posterior probability of candidate g is
π_g BF_g / Σ_h π_h BF_h, at the variance ratio that makes the sum largest (empirical Bayes). The
credible set holds CREDIBLE of it (the single-effect regression of Wang, Sarkar, Carbonetto &
Stephens 2020, "SuSiE")."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from math import sqrt

import numpy as np

from ..._linalg import TINY
from ..._typing import Array, Index
from ..candidates.candidate import Candidate
from .evidence import compute_factors, sum_evidence
from .scan import Displacement, Response, Scan

# decimals of a log probability, beyond which it is rounding
DECIMALS = 7
# posterior probability that a set holds, and entries of it that are listed
CREDIBLE = 0.95
LISTED = 20
# cosine of two displacements beyond the model above which both move the target alike, and above
# which both explain the same effect
ALIKE = 0.97
RELATED = 0.5
# times that unrelated explanations are set aside when an effect is identified again
MAX_PASSES = 8
# probability that the explanations that move the target alike must have together to be "found"
SURE = 0.8

FOUND, NOT_TOLD_APART = "found", "cannot be told apart"


@dataclass(frozen=True)
class Entry:
    """An explanation in a credible set, with its probability.

    `alike`: it moves the target as the most probable one does; `estimate` (p,): its terms fitted
    alone; `place`: its index among all candidates."""

    candidate: Candidate
    probability: float
    alike: bool
    estimate: Array = field(repr=False, compare=False)
    place: int = field(repr=False, compare=False)


@dataclass(frozen=True, eq=False)
class CredibleSet:
    """The explanations of one effect, with their log evidence and the verdict.

    `entries`: those that are listed (`more` are not); `log_probability` (G,): of every candidate;
    `top`: the index of the most probable one."""

    evidence: float
    entries: tuple[Entry, ...]
    more: int
    verdict: str
    log_probability: Array = field(repr=False)
    top: int = -1

    def contains(self, g: int) -> bool:
        """Return whether candidate g is listed."""
        return any(entry.place == g for entry in self.entries)

    def sum_by_label(self) -> dict[str, float]:
        """Sum the probabilities of what is listed by its label, whatever its constants, the likeliest first."""
        weights: dict[str, float] = {}
        for entry in self.entries:
            label = entry.candidate.label
            before = weights.get(label, 0.0)
            weights[label] = before + entry.probability
        by_weight = sorted(weights, key=lambda label: -weights[label])
        return {label: weights[label] for label in by_weight}


@dataclass(frozen=True, eq=False)
class Question:
    """What credible sets of one response are asked for.

    The scan, the candidates, the response that the model's basis has been projected off, the log
    Bayes factors (ratios, G) and the log priors (G,); displacements are computed once each."""

    scan: Scan
    candidates: Sequence[Candidate]
    response: Response
    factors: Array
    log_prior: Array
    _displaced: dict[int, Displacement] = field(default_factory=dict, repr=False)

    def displace(self, g: int) -> Displacement:
        """Compute what candidate g, fitted alone, does to the target."""
        if g not in self._displaced:
            self._displaced[g] = self.scan.displace(g, self.response)
        return self._displaced[g]

    def is_related(self, g: int, other: int) -> bool:
        """Return whether two candidates explain the same effect."""
        return compute_cosine(self.displace(g), self.displace(other)) > RELATED

    def answer(self, without: Index | None) -> CredibleSet:
        """Build the credible set, leaving out the candidates `without`."""
        log_prior = self.log_prior.copy()
        if without is not None:
            log_prior[without] = -np.inf
        value, joint = sum_evidence(self.factors, log_prior)
        # with no evidence at all every candidate has probability 0
        log_probability = joint
        if np.isfinite(value):
            log_probability = joint - value
        probability = np.exp(log_probability)
        probability /= max(probability.sum(), np.finfo(float).tiny)
        # of explanations that are the same but for rounding, the first
        order = np.argsort(-np.round(log_probability, DECIMALS), kind="stable")
        cumulative = np.cumsum(probability[order])
        size = int(np.searchsorted(cumulative, CREDIBLE) + 1)
        count = min(max(size, 1), LISTED)
        listed = order[:count]
        entries = self._build_entries(listed, probability)
        return CredibleSet(
            evidence=value,
            entries=entries,
            more=max(size - len(listed), 0),
            verdict=_judge(entries),
            log_probability=log_probability,
            top=int(order[0]),
        )

    def _build_entries(self, listed: Index, probability: Array) -> tuple[Entry, ...]:
        strongest = int(listed[0])
        first = self.displace(strongest)
        entries = []
        for g in listed.tolist():
            entry = self._build_entry(g, probability, first)
            entries.append(entry)
        return tuple(entries)

    def _build_entry(self, g: int, probability: Array, first: Displacement) -> Entry:
        cosine = compute_cosine(first, self.displace(g))
        return Entry(
            candidate=self.candidates[g],
            probability=float(probability[g]),
            alike=cosine > ALIKE,
            estimate=self.scan.fit_alone(g, self.response),
            place=g,
        )


def _judge(entries: Sequence[Entry]) -> str:
    probabilities = [entry.probability for entry in entries if entry.alike]
    if sum(probabilities) >= SURE:
        return FOUND
    return NOT_TOLD_APART


def ask(
    seen: Scan, candidates: Sequence[Candidate], log_prior: Array, response: Response
) -> Question:
    """Ask what explains a response that the model's basis has been projected off."""
    return Question(
        scan=seen,
        candidates=candidates,
        response=response,
        factors=compute_factors(seen, response),
        log_prior=log_prior,
    )


def rename_effect(question: Question, g: int, without: Index) -> CredibleSet:
    """Name candidate g again, given all other effects, among the explanations of the same effect.

    What else may be left in the response belongs to another effect: explanations that are listed
    but unrelated to g are set aside until g is the most probable, or none is left."""
    named = question.answer(without)
    displacement = question.displace(g)
    square = displacement.dot(displacement)
    if square <= 0:
        return named  # the other effects absorb it completely
    aside = without.tolist()
    for _ in range(MAX_PASSES):
        places = [entry.place for entry in named.entries if entry.place != g]
        unrelated = [place for place in places if not question.is_related(g, place)]
        if not unrelated or named.top == g:
            break
        aside += unrelated
        set_aside = np.array(aside, dtype=np.intp)
        named = question.answer(set_aside)
    return named


def include_candidate(question: Question, named: CredibleSet, g: int) -> CredibleSet:
    """Include candidate g, which is in the model, in its own credible set.

    Where a search that went in a circle stopped at a name that its set does not list, the data do
    not tell, and the verdict says so."""
    if named.contains(g):
        return named
    estimate = question.scan.fit_alone(g, question.response)
    entry = Entry(
        candidate=question.candidates[g],
        probability=float(np.exp(named.log_probability[g])),
        alike=False,
        estimate=estimate,
        place=g,
    )
    kept = named.entries[: LISTED - 1]
    dropped = named.entries[LISTED - 1 :]
    more = max(named.more - 1, 0) + len(dropped)
    return replace(named, entries=(*kept, entry), verdict=NOT_TOLD_APART, more=more)


def compute_own_evidence(question: Question, named: CredibleSet, g: int) -> float:
    """Compute the log evidence of candidate g and the listed explanations of the same effect.

    What else may be left in the response does not count."""
    probability = np.exp(named.log_probability[g])
    for entry in named.entries:
        if entry.place != g and question.is_related(g, entry.place):
            probability += entry.probability
    positive = max(probability, TINY)
    log_probability = float(np.log(positive))
    return named.evidence + log_probability


def compute_cosine(a: Displacement, b: Displacement) -> float:
    """Compute the cosine between two displacements beyond the model; 0 where one vanishes."""
    size = a.dot(a) * b.dot(b)
    return a.dot(b) / sqrt(size) if size > 0 else 0.0
