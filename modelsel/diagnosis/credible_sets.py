"""Naming one effect: from the evidence of every candidate to a credible set and a verdict."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from .._typing import Array, Index
from .candidates import Candidate
from .evidence import compute_factors, sum_evidence
from .scan import Scan

CREDIBLE = 0.95
LISTED = 20
ALIKE = 0.97  # correlation of two displacements beyond the model: they move the target alike
RELATED = 0.5  # correlation above which two explanations speak of the same effect
PASSES = 8  # times that unrelated explanations are set aside when an effect is named again
SURE = 0.8  # probability that those who move it alike must hold together


@dataclass(frozen=True)
class Entry:
    """One explanation in a credible set; `alike` as the most probable one moves the target;
    `estimate` (p,) its terms alone; `place` among all candidates."""

    candidate: Candidate
    probability: float
    alike: bool
    estimate: Array = field(repr=False, compare=False)
    place: int = field(repr=False, compare=False)


@dataclass(frozen=True, eq=False)
class CredibleSet:
    """One effect named: its log evidence, the smallest set that holds CREDIBLE of the probability
    (at most LISTED listed, `more` not), the verdict, and the log probability of every candidate
    (G,)."""

    evidence: float
    entries: tuple[Entry, ...]
    more: int
    verdict: str
    log_probability: Array = field(repr=False)
    top: int = -1


def name(
    seen: Scan, candidates: tuple[Candidate, ...], response: Array, without: Index | None = None
) -> CredibleSet:
    """Name what explains a response (N,) that the model's basis has been projected off; `without`
    leaves candidates out."""
    return _named(
        seen,
        candidates,
        response,
        compute_factors(seen, response),
        np.log([c.prior for c in candidates]),
        without,
    )


def _named(
    seen: Scan,
    candidates: tuple[Candidate, ...],
    response: Array,
    known: Array,
    log_prior: Array,
    without: Index | None,
) -> CredibleSet:
    if without is not None:
        log_prior = log_prior.copy()
        log_prior[without] = -np.inf
    value, joint = sum_evidence(known, log_prior)
    relative = (
        joint - value if np.isfinite(value) else joint
    )  # no candidate may explain it: each has probability 0
    probability = np.exp(relative)
    probability /= max(probability.sum(), np.finfo(float).tiny)
    order = np.argsort(-probability, kind="stable")
    count = int(np.searchsorted(np.cumsum(probability[order]), CREDIBLE) + 1)
    shown = order[: min(max(count, 1), LISTED)]
    alike = _alike(seen, shown, response)
    entries = tuple(
        Entry(
            candidates[g],
            float(probability[g]),
            bool(a),
            coefficients(seen, int(g), response),
            int(g),
        )
        for g, a in zip(shown, alike, strict=True)
    )
    together = sum(e.probability for e in entries if e.alike)
    verdict = "found" if together >= SURE else "cannot be told apart"
    return CredibleSet(value, entries, max(count - len(shown), 0), verdict, relative, int(order[0]))


def coefficients(seen: Scan, g: int, response: Array) -> Array:
    """(k,) least-squares terms of candidate g, fitted alone beyond the model."""
    bucket = next(b for b in seen.buckets if g in b.block.which)
    at = int(np.flatnonzero(bucket.block.which == g)[0])
    W = bucket.W[at]
    own = seen.columns.XT[bucket.block.index[at]]
    return np.asarray(W.T @ (W @ (own @ response[: own.shape[1]])))


def compute_displacement(seen: Scan, g: int, response: Array) -> Array:
    """(N,) what candidate g, fitted alone beyond the model, makes of the response."""
    raw = seen.columns.sum_of(coefficients(seen, g, response), g, len(response))
    return np.asarray(raw - seen.Q @ (seen.Q.T @ raw))


def own_evidence(seen: Scan, named: CredibleSet, g: int, response: Array) -> float:
    """Log evidence of what moves the target as candidate g does: of the listed entries alike to it,
    and of itself. What else may be left in the response does not count for it."""
    mine = compute_displacement(seen, g, response)
    mass = np.exp(named.log_probability[g])
    for entry in named.entries:
        if (
            entry.place != g
            and similar(mine, compute_displacement(seen, entry.place, response)) > RELATED
        ):
            mass += entry.probability
    return named.evidence + float(np.log(max(mass, 1e-300)))


def name_again(
    seen: Scan, candidates: tuple[Candidate, ...], g: int, response: Array, without: Index
) -> CredibleSet:
    """Candidate g named given all else: among the explanations that speak of the same effect. What
    may be left beside it in the response belongs to another finding; `without` leaves candidates
    out from the start."""
    mine = compute_displacement(seen, g, response)
    strange: list[int] = without.tolist()
    known, log_prior = compute_factors(seen, response), np.log([c.prior for c in candidates])
    named = _named(seen, candidates, response, known, log_prior, without)
    for _ in range(
        PASSES if np.any(mine) else 0
    ):  # an effect that the others absorb whole has nothing of its own
        others = [
            e.place
            for e in named.entries
            if e.place != g
            and similar(mine, compute_displacement(seen, e.place, response)) <= RELATED
        ]
        if not others or named.top == g:
            break
        strange += others
        named = _named(
            seen, candidates, response, known, log_prior, np.array(strange, dtype=np.intp)
        )
    return named


def with_candidate(
    named: CredibleSet, seen: Scan, candidates: tuple[Candidate, ...], g: int, response: Array
) -> CredibleSet:
    """The same with candidate g, which stands in the model, in the set: where a search that went in
    a circle stopped at a name that its own set does not hold, the data do not tell, and that is
    said."""
    if any(e.place == g for e in named.entries):
        return named
    own = Entry(
        candidates[g],
        float(np.exp(named.log_probability[g])),
        False,
        coefficients(seen, g, response),
        g,
    )
    return replace(
        named,
        entries=(*named.entries[: LISTED - 1], own),
        verdict="cannot be told apart",
        more=max(named.more - 1, 0) + len(named.entries[LISTED - 1 :]),
    )


def similar(a: Array, b: Array) -> float:
    """Cosine between two displacements; nought where one vanishes."""
    size = np.linalg.norm(a) * np.linalg.norm(b)
    return float(a @ b / size) if size > 0 else 0.0


def _alike(seen: Scan, shown: Index, response: Array) -> Array:
    first = compute_displacement(seen, int(shown[0]), response)
    return np.array(
        [similar(first, compute_displacement(seen, int(g), response)) > ALIKE for g in shown]
    )
