"""Claims: how much of a finding is proven, level by level.

Place ("joint 4 turns"), drivers ("with its gravity torque"), shape ("in proportion to it"), cause
("its drive is compliant"). The probability of a level is the share of all explanations of the effect
that agree with it so far: those of the credible set, and shapes that no list has
(`unlisted_shapes`). Findings of one place are weighed together, too: one shape that no list has may
explain what several listed ones approximate. A finding claims the deepest level that holds."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from .._typing import Array
from .candidate_columns import build_columns
from .candidates import Candidate
from .effects import Claim
from .evidence import compute_factors, sum_evidence
from .mechanism_families import find_families, weigh_families
from .scan import Response, Scan, build_scan, build_scan_without
from .sentences import has_contrary_signs
from .signatures import LEVELS, PROVEN
from .state import MIN_LOG_ODDS, Search, View
from .unlisted_shapes import Company, Rival, list_company, list_rivals


class Weighed(NamedTuple):
    """The claims of effects by their candidates, and shapes that no list has which explain some
    effects better: (the effects, the shape)."""

    claims: dict[int, Claim]
    better: list[tuple[tuple[int, ...], Candidate]]


def weigh_claims(search: Search, view: View, chosen: Sequence[int]) -> Weighed:
    """Weigh how deep each effect of a model is proven, given all the others."""
    effects = {g: search.found[g] for g in chosen}
    rivals = {g: list_rivals(search.problem, candidate) for g, candidate in effects.items()}
    company = list_company(search.problem, effects)
    beside = _look_beside(search, view, rivals, company)
    claims: dict[int, Claim] = {}
    better: list[tuple[tuple[int, ...], Candidate]] = []
    for g in chosen:
        claims[g], shape = _weigh_alone(search, view, g, rivals[g], beside)
        if shape is not None:
            better.append(((g,), shape))
    for g, share in weigh_families(search, find_families(search.found), chosen, view).items():
        claims[g] = _conclude([p * share for p in claims[g].levels])
    for group in company:
        share, shape = _weigh_together(view, group, effects, beside)
        for g in group.members:
            claims[g] = _conclude(
                [p * share if k > 1 else p for k, p in enumerate(claims[g].levels)]
            )
        if shape is not None:
            better.insert(0, (group.members, shape))
    return Weighed(claims, better)


class _Beside(NamedTuple):
    """Candidates that are not among those of the search, seen from the fitted model, with their
    places."""

    scan: Scan | None
    response: Response | None
    place: dict[Candidate, int]

    def compute_factors(
        self, view: View, effects: Sequence[Candidate], which: Sequence[Candidate]
    ) -> Array:
        """Compute (ratios, A) log Bayes factors of some candidates where effects are taken out."""
        if self.scan is None or self.response is None or not which:
            return np.zeros((1, 0))
        released = view.release(*effects)
        without = build_scan_without(self.scan, released.directions)
        factors = compute_factors(without, released.see(self.response, without.back))
        return factors[:, [self.place[candidate] for candidate in which]]


def _look_beside(
    search: Search, view: View, rivals: dict[int, list[Rival]], company: Sequence[Company]
) -> _Beside:
    every = [rival.candidate for own in rivals.values() for rival in own]
    for group in company:
        every += [group.listed, *group.shapes]
    distinct = tuple(dict.fromkeys(every))
    if not distinct:
        return _Beside(None, None, {})
    columns = build_columns(search.problem, distinct, view.fitted.at(), search.memory_mb)
    scan = build_scan(columns, view.Q)
    place = {candidate: k for k, candidate in enumerate(distinct)}
    return _Beside(scan, scan.see(view.residual), place)


def _weigh_alone(
    search: Search, view: View, g: int, rivals: Sequence[Rival], beside: _Beside
) -> tuple[Claim, Candidate | None]:
    """Weigh an effect against its credible set and its rivals.

    Returns its claim, and the rival that is clearly more probable, if any is."""
    own = search.found[g]
    scan, response = view.scan_without(own)
    listed = compute_factors(scan, response)
    named = search.rename(g, view).named
    log_prior = np.where(np.isfinite(named.log_probability), search.log_prior, -np.inf)
    others = [rival.candidate for rival in rivals]
    joint = listed
    if others:
        joint = np.hstack([listed, beside.compute_factors(view, [own], others)])
        log_prior = np.append(log_prior, np.log([other.prior for other in others]))
    value, logs = sum_evidence(joint, log_prior)
    if not np.isfinite(value):
        return _conclude([0.0] * len(LEVELS)), None
    count = len(search.found)
    probability = np.exp(logs - value)
    of_listed = [float(probability[:count][mask].sum()) for mask in _agree(search, g)]
    of_rivals = [_sum_agreeing(rivals, probability[count:], level) for level in LEVELS]
    levels = [p + q for p, q in zip(of_listed, of_rivals, strict=True)]
    if has_contrary_signs(own.mechanism, view.fitted.theta[search.locate_terms(g, view)]):
        levels[-1] = 0.0
    best = int(np.argmax(logs[count:])) if others else -1
    is_better = others and logs[count + best] - logs[:count].max() > MIN_LOG_ODDS
    return _conclude(levels), others[best] if is_better else None


def _agree(search: Search, g: int) -> list[Array]:
    """Mask (4, G) the candidates that agree with candidate g up to each level."""
    return [(known == known[g]) & (known[g] >= 0) for known in search.signatures]


def _sum_agreeing(rivals: Sequence[Rival], probability: Array, level: str) -> float:
    """Sum the probabilities (A,) of the rivals that agree with a finding up to a level."""
    agrees = {"place": ("place", "drivers"), "drivers": ("drivers",)}.get(level, ())
    return float(sum(probability[k] for k, rival in enumerate(rivals) if rival.agrees in agrees))


def _weigh_together(
    view: View, group: Company, effects: dict[int, Candidate], beside: _Beside
) -> tuple[float, Candidate | None]:
    """Weigh several findings of one place against one shape that no list has.

    Returns the probability of the listed ones, and the shape if it is clearly more probable."""
    which = [group.listed, *group.shapes]
    factors = beside.compute_factors(view, [effects[g] for g in group.members], which)
    value, logs = sum_evidence(factors, np.log([candidate.prior for candidate in which]))
    if not np.isfinite(value):
        return 1.0, None
    best = int(np.argmax(logs))
    is_better = best > 0 and logs[best] - logs[0] > MIN_LOG_ODDS
    return float(np.exp(logs[0] - value)), which[best] if is_better else None


def _conclude(levels: Sequence[float]) -> Claim:
    """Claim the deepest level that holds; the place where none does."""
    bounded = tuple(min(float(p), 1.0) for p in levels)
    held = [level for level, p in zip(LEVELS, bounded, strict=True) if p >= PROVEN]
    return Claim(held[-1] if held else LEVELS[0], bounded)
