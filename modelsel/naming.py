"""Naming one effect: from the evidence of every candidate to a credible set and a verdict."""
from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from .candidates import Candidate
from .errormap import Scan, evidence
from .rigid import Array

CREDIBLE = 0.95
LISTED = 20
ALIKE = 0.97       # correlation of two displacements beyond the model: they move the target alike
SURE = 0.8         # probability that those who move it alike must hold together


@dataclass(frozen=True)
class Entry:
    """One explanation in a credible set; `alike` as the most probable one moves the target."""

    candidate: Candidate
    probability: float
    alike: bool


@dataclass(frozen=True, eq=False)
class Named:
    """One effect named: its log evidence, the smallest set that holds CREDIBLE of the probability (at most LISTED listed,
    `more` not), the verdict, and the log probability of every candidate (G,)."""

    evidence: float
    entries: tuple[Entry, ...]
    more: int
    verdict: str
    log_probability: Array = field(repr=False)
    top: int = -1


def name(seen: Scan, candidates: tuple[Candidate, ...], response: Array) -> Named:
    """Name what explains a response (N,) that the model's basis has been projected off."""
    log_prior = np.log([c.prior for c in candidates])
    value, joint = evidence(seen, log_prior, response)
    probability = np.exp(joint - value)
    probability /= probability.sum()
    order = np.argsort(-probability, kind="stable")
    count = int(np.searchsorted(np.cumsum(probability[order]), CREDIBLE) + 1)
    shown = order[:min(max(count, 1), LISTED)]
    alike = _alike(seen, shown, response)
    entries = tuple(Entry(candidates[g], float(probability[g]), bool(a)) for g, a in zip(shown, alike, strict=True))
    together = sum(e.probability for e in entries if e.alike)
    verdict = "found" if together >= SURE else "cannot be told apart"
    return Named(value, entries, max(count - len(shown), 0), verdict, joint - value, int(order[0]))


def fitted_displacement(seen: Scan, g: int, response: Array) -> Array:
    """(N,) what candidate g, fitted alone beyond the model, makes of the response."""
    for bucket in seen.buckets:
        at = np.flatnonzero(bucket.which == g)
        if len(at):
            W, X = bucket.W[at[0]], seen.columns.XT[bucket.index[at[0]]]
            raw = (W.T @ (W @ (X @ response))) @ X
            return np.asarray(raw - seen.Q @ (seen.Q.T @ raw))
    raise IndexError(g)


def _alike(seen: Scan, shown: Array, response: Array) -> Array:
    first = fitted_displacement(seen, int(shown[0]), response)
    out = []
    for g in shown:
        other = fitted_displacement(seen, int(g), response)
        size = np.linalg.norm(first) * np.linalg.norm(other)
        out.append(size > 0 and float(first @ other) / size > ALIKE)
    return np.array(out)
