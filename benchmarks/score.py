"""One case run by modelsel and by its rivals, scored alike: everything is judged by what it does to
the target."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from hidden_arm import geometry, holds, said
from hidden_oracle import critical_p, held_by, naming_limit
from searches import search_separated

from modelsel.diagnosis.candidates.candidate import Candidate
from modelsel.diagnosis.candidates.candidate_list import build_candidates
from modelsel.fitting.design import Model
from modelsel.fitting.least_squares import fit
from modelsel.mechanisms.registry import every, mechanism

from .cases import EXPLAINS, NOISE, Array, Case, draw, oracle_error, powers
from .listed import find_listed, is_rightly_told
from .rivals import as_candidates, bench, forward, lasso, stlsq

ABOUT = 0.7  # share of an effect's norm from which a finding counts as being about it
TWIN = 0.97
BEST = 6  # candidates that hold most on the campaign's rows, tried on the fresh ones


class Judge:
    """Holds every explanation against what was planted, on the fresh configurations, with the arm's
    own screws."""

    def __init__(self, case: Case, problem: object):
        self.case, self.problem = case, problem
        self.J = case.arm.screws(case.fresh.q)
        self.Q = geometry(self.J)
        self.truths = [e.displacement(case.fresh) for e in case.effects]
        self.known: dict[str, list[float]] = {}

    def held(self, candidate: Candidate) -> list[float]:
        """Share of every planted effect's norm that a candidate's columns hold beyond the
        geometry."""
        key = repr(candidate.mechanism.terms)
        if key not in self.known:
            A = said(candidate.mechanism, self.problem, self.J) if self.truths else np.zeros((0, 0))
            self.known[key] = [holds(A, b, self.Q) for b in self.truths]
        return self.known[key]

    def match(self, tops: Sequence[Candidate]) -> list[tuple[int, float]]:
        """(finding, share it holds) of every planted effect; -1 where no finding is about it. The
        best go first; a finding that stands for one effect already stands for another only where it
        explains that too."""
        H = np.array([self.held(c) for c in tops]).reshape(len(tops), len(self.truths))
        out = [(-1, 0.0)] * len(self.truths)
        for f, t in sorted(np.ndindex(H.shape), key=lambda ft: -H[ft]):
            if (
                H[f, t] > ABOUT
                and out[t][0] < 0
                and (H[f, t] > EXPLAINS or f not in [k for k, _ in out])
            ):
                out[t] = (f, float(H[f, t]))
        return out


def score(judge: Judge, tops: Sequence[Candidate], error: Array) -> dict[str, Any]:
    """What every method is scored by."""
    match = judge.match(tops)
    found = [f >= 0 for f, _ in match]
    return {
        "findings": len(tops),
        "found": found,
        "right": [h > EXPLAINS for _, h in match],
        "held": [h for _, h in match],
        "extra": len(tops) - len({f for f, _ in match if f >= 0}),
        "said": [tops[f].mechanism.name if f >= 0 else "" for f, _ in match],
        "error": float(np.sqrt(np.mean(np.square(error)))),
    }


def run(
    seed: Sequence[int],
    count: int | None = None,
    rivals: bool = True,
    configurations: int | None = None,
) -> dict[str, Any]:
    """One case: its make-up, what the oracle could do, and every method's score."""
    case = draw(seed, count, configurations)
    problem, fresh = case.problem(), case.unseen()
    base = Model((mechanism("geometric", problem.robot),))
    start = time.perf_counter()
    found = build_candidates(problem, base, every(problem.robot))
    extension = search_separated(problem, base, found, seed[-1])
    seconds = {"modelsel": time.perf_counter() - start}
    judge = Judge(case, fresh)
    out: dict[str, Any] = {
        "seed": list(seed),
        "robot": case.robot,
        "m": case.state.m,
        "kinds": [e.kind for e in case.effects],
        "words": [e.words for e in case.effects],
        "sizes": case.sizes,
        "methods": {},
        "p": extension.left_p,
    }
    effects = extension.effects
    tops = [e.named.entries[0].candidate for e in effects]
    mine = score(judge, tops, extension.fit.residuals(fresh)[:, :3])
    match = judge.match(tops)
    mine["covered"] = [
        f >= 0 and any(judge.held(e.candidate)[t] > EXPLAINS for e in effects[f].named.entries)
        for t, (f, _) in enumerate(match)
    ]
    mine["set"] = [
        len(effects[f].named.entries) + effects[f].named.more if f >= 0 else 0 for f, _ in match
    ]
    mine["unlike"] = [
        1 + sum(not e.alike for e in effects[f].named.entries) if f >= 0 else 0 for f, _ in match
    ]
    mine["verdict"] = [effects[f].named.verdict if f >= 0 else "" for f, _ in match]
    mine["probability"] = [
        effects[f].named.entries[0].probability if f >= 0 else 0.0 for f, _ in match
    ]
    mine["entries"] = [
        [(e.candidate.mechanism.name, round(e.probability, 4)) for e in x.named.entries[:6]]
        for x in effects
    ]
    rng = np.random.default_rng([*seed, 3])
    truths = [find_listed(effect, case.fresh, rng) for effect in case.effects]
    mine["told"] = [
        f >= 0 and is_rightly_told(effects[f], judge.held(effects[f].candidate), truths, fresh)
        for f, _ in match
    ]
    mine["path"] = list(extension.path)
    out["methods"]["modelsel"] = mine
    if not rivals and not case.effects:
        return out
    table = bench(problem, fresh, base, fit(problem, base), found)
    p_critical = critical_p(table.first, np.random.default_rng([*seed, 2]))
    power, delta = powers(case, p_critical)
    H = [held_by(e.displacement(case.state), table.first) for e in case.effects]
    rival = [float(h[h < TWIN].max()) for h in H]
    small = [
        min((int(table.first.sizes[g]) for g in np.flatnonzero(h > TWIN)), default=0) for h in H
    ]
    best = [max(judge.held(found[g])[t] for g in np.argsort(-h)[:BEST]) for t, h in enumerate(H)]
    out |= {
        "p_critical": p_critical,
        "power": power,
        "delta": delta,
        "best": best,
        "rival": rival,
        "rival_name": [found[int(np.where(h < TWIN, h, 0).argmax())].mechanism.name for h in H],
        "limit": [naming_limit(d, r) for d, r in zip(delta, rival, strict=True)],
        "twins": [
            int(((h > TWIN) & (table.first.sizes <= k)).sum())
            for h, k in zip(H, small, strict=True)
        ],
        "oracle_error": float(np.sqrt(np.mean(np.square(oracle_error(case))))),
        "noise": NOISE,
    }
    if rivals:
        others: dict[str, Callable[[], tuple[Sequence[int], Array]]] = {
            name: lambda kind=kind: _forward(table, kind, p_critical)  # type: ignore[misc]
            for name, kind in (
                ("BIC", "BIC"),
                ("AIC", "AIC"),
                ("EBIC(1)", "EBIC"),
                ("max-test", "max-test"),
            )
        }
        others |= {"LassoCV": lambda: _lasso(table), "STLSQ": lambda: _stlsq(table)}
        for name, method in others.items():
            start = time.perf_counter()
            groups, error = method()
            seconds[name] = time.perf_counter() - start
            out["methods"][name] = score(judge, [found[g] for g in groups], error)
    out["seconds"] = seconds
    return out


def _forward(table: Any, kind: str, p_critical: float) -> tuple[Sequence[int], Array]:
    chosen = forward(table, kind, p_critical)
    return chosen, table.predict(table.rows_of(chosen))


def _lasso(table: Any) -> tuple[Sequence[int], Array]:
    rows, beta = lasso(table)
    return as_candidates(table, rows), table.predict(rows, beta)


def _stlsq(table: Any) -> tuple[Sequence[int], Array]:
    rows = stlsq(table)
    return as_candidates(table, rows), table.predict(rows)
