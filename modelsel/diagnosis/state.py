"""What the loop that extends a model shares and asks: fits, names, the null, the signs of the
residual's own rows."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np

from .._typing import Array, Index
from ..exceptions import NotEstimable
from ..fitting.design import Model
from ..fitting.least_squares import Fit, prior_root
from ..fitting.problem import Problem
from ..fitting.shrinkage import fit_shrunk
from .candidates import Candidate
from .credible_sets import CredibleSet, name, name_again, own_evidence, with_candidate
from .evidence import compute_familywise_p, draw_null
from .joint_curves import better, collect_curves
from .residual_tests import DRAWS as FLIPS
from .residual_tests import adjust_residual, compute_flip_p, draw_flips, partition_rows
from .scan import Columns, Scan, build_scan_without, columns, compute_basis, flat, scan, stacked

LEVEL = 0.05  # family-wise
MIN_LOG_ODDS = np.log(3)  # log odds at which a re-named effect changes its name
DRAWS = (999, 499)  # null draws for small and large studies
COARSE_MM = 1e-2  # step at which the fits on the way are good enough
LARGE = 3e6  # candidates' numbers beyond which a study is large


class Search:
    """What the loop shares: the training problem, all candidates with their columns, the null of the
    first scan."""

    def __init__(
        self,
        problem: Problem,
        base: Model,
        found: tuple[Candidate, ...],
        rng: np.random.Generator,
        base_fit: Fit,
    ):
        self.problem, self.base, self.found, self.rng = problem, base, found, rng
        self.columns: Columns = columns(problem, found, base_fit.at())
        self.log_prior = np.log([c.prior for c in found])
        self.curves = collect_curves(found, self.columns, self.log_prior)
        self.first = build_view(problem, self.columns, base, base_fit)
        self.dead = np.flatnonzero(
            self.first.seen.sizes == 0
        )  # the base has them: what a refit leaks of them is no cause
        large = self.columns.XT.size >= LARGE
        self.flips = FLIPS[large]
        self.null, self.least_p = draw_null(self.first.seen, self.log_prior, DRAWS[large], rng)
        self.bound = float(np.quantile(self.null, 1 - LEVEL))

    def fit(self, chosen: Sequence[int], start: Fit | None, step_mm: float = COARSE_MM) -> View:
        model = extend_model(self.base, [self.found[g] for g in chosen])
        return build_view(
            self.problem, self.columns, model, fit_shrunk(self.problem, model, start, step_mm)
        )

    def attempt(
        self, chosen: Sequence[int], start: Fit | None, step_mm: float = COARSE_MM
    ) -> View | None:
        """`fit`, or None where the data do not determine such a model."""
        try:
            return self.fit(chosen, start, step_mm)
        except NotEstimable:
            return None

    def unbounded(self, g: int, view: View) -> bool:
        """Whether the fit leaves an effect's size open: a term, or its standard error, is beyond
        what a small screw can be."""
        place = {t.key: k for k, t in enumerate(view.model.terms)}
        at = [place[t.key] for t in self.found[g].mechanism.terms]
        block = next(b for b in self.columns.grams if g in b.which)
        most = block.most[int(np.flatnonzero(block.which == g)[0])]
        return bool(
            (np.abs(view.fitted.theta[at]) > most).any()
            or (view.fitted.standard_errors[at] > most).any()
        )

    def displacement(self, g: int, view: View) -> Array:
        """(N,) what an effect, as fitted, does to the target beyond the base; whitened."""
        own, rows = view.own(self.found[g]), len(self.first.Q)
        moved = view.A[:rows, own] @ view.fitted.theta[own]
        return np.asarray(moved - self.first.Q @ (self.first.Q.T @ moved))

    def next(self, view: View, known: Sequence[int]) -> CredibleSet:
        """What explains most of the rest; `known` candidates have had their turn (what the fit
        drops of theirs is no cause)."""
        return name(
            view.seen, self.found, view.r, np.union1d(self.dead, np.array(known, dtype=np.intp))
        )

    def by_signs(self, view: View, known: Sequence[int], observed: float) -> float:
        """How often the residual's own rows, signs of whole postures (and of whole groups, where
        their rows go together) changed, have as much evidence beyond the model; the largest of
        these p."""
        log_prior = self.log_prior.copy()
        log_prior[np.union1d(self.dead, np.array(known, dtype=np.intp))] = -np.inf
        return max(
            compute_flip_p(
                draw_flips(
                    view.seen,
                    log_prior,
                    adjust_residual(view.seen.Q, view.r, unit),
                    unit,
                    self.flips,
                    self.rng,
                ),
                observed,
                self.flips,
                LEVEL,
            )
            for unit in self.in_units(view)
        )

    def in_units(self, view: View) -> list[Index]:
        """Which coordinates (N,) change sign together, -1 where a row is the prior's: a partition
        of every kind that `units` asks for."""
        problem, out = self.problem, []
        for own in partition_rows(problem.data, view.fitted.residuals(problem)[:, :3], self.rng):
            every = np.tile(own, (1, problem.components, 1))
            measured = np.concatenate(
                [flat(problem, rows, every[:, :, rows])[0] for rows in problem.blocks()]
            )
            out.append(np.append(measured, np.full(len(view.r) - len(measured), -1)))
        return out

    def by_chance(self, view: View) -> tuple[list[Array], Array]:
        """(sorted evidences where nothing is: by equal normal noise, and by the signs of what
        `view` leaves; (G,) family-wise p of every candidate alone on the base, the largest by any
        of these). Where the model of `view` has every candidate already, evidences beyond the base
        are taken."""
        first, rows = self.first, len(self.first.r)
        nothing, p = [self.null], compute_familywise_p(first.seen, first.r, self.least_p)
        for unit in self.in_units(view):
            e = adjust_residual(view.seen.Q, view.r, unit)
            base = list(
                draw_flips(first.seen, self.log_prior, e[:rows], unit[:rows], self.flips, self.rng)
            )
            own = draw_flips(view.seen, self.log_prior, e, unit, self.flips, self.rng)
            after = base if view is first or not view.seen.sizes.any() else own
            nothing.append(np.sort(np.concatenate([some for some, _ in after])))
            p = np.maximum(
                p,
                compute_familywise_p(
                    first.seen, first.r, np.sort(np.concatenate([few for _, few in base]))
                ),
            )
        return nothing, p

    def again(self, g: int, view: View) -> tuple[CredibleSet, float]:
        """Effect g given the others: (named again, the evidence for itself or its like)."""
        if g not in view.asked:
            seen, y = view.without(self.found[g])
            named = name_again(seen, self.found, g, y, self.dead)
            view.asked[g] = (
                with_candidate(named, seen, self.found, g, y),
                own_evidence(seen, named, g, y),
            )
        return view.asked[g]

    def redrawn(self, chosen: Sequence[int], view: View) -> Iterator[tuple[list[int], str]]:
        """(models in which a joint's own-angle effects are explained better together, what
        changed)."""
        for curve in self.curves.values():
            now = [g for g in chosen if g in curve.which]
            if not now:
                continue
            D, response = view.freed(*(self.found[g] for g in now))
            best = better(curve, view.Q - D @ (D.T @ view.Q), response, now, MIN_LOG_ODDS)
            if best is not None:
                names = (
                    " & ".join(self.found[g].mechanism.name for g in some) for some in (now, best)
                )
                yield [*(g for g in chosen if g not in now), *best], " -> ".join(names)

    def joined(self, chosen: Sequence[int], g: int) -> list[int]:
        """With candidate g; a finer free function of a joint takes the place of a coarser one."""

        def subject(k: int) -> object:
            mechanism = self.found[k].mechanism
            return (
                mechanism.terms[0].screws[0].frame if mechanism.name.startswith("free(") else (k,)
            )

        return [*(k for k in chosen if subject(k) != subject(g)), g]


# A fitted model seen as projections: what lies beyond it, and beyond it without one of its effects,
# with no refit.


def extend_model(base: Model, chosen: Sequence[Candidate]) -> Model:
    """The base and the mechanisms of some candidates."""
    return base + tuple(dict.fromkeys(c.mechanism for c in chosen))


@dataclass(frozen=True, eq=False)
class View:
    """A fitted model seen as projections: orthonormal Q, its R (A_kept = Q R), columns A (N, p),
    the fit's residual `raw` and r, its part off the model; the prior's rows of shrunk terms stand
    below the data's. What geometry can do at any size is taken by geometry: the columns `kept` are
    those that do not depend on others, and the prior of usual sizes has no say."""

    model: Model
    fitted: Fit
    kept: tuple[int, ...]
    A: Array
    Q: Array
    R: Array
    raw: Array
    r: Array
    seen: Scan
    asked: dict[int, tuple[CredibleSet, float]] = field(
        default_factory=dict, repr=False
    )  # what `_Search.again` has answered

    def own(self, *effects: Candidate) -> Array:
        """(p,) mask of the terms that these effects alone bring."""
        whose = [e.mechanism for e in effects]
        mine = {t.key for m in whose for t in m.terms}
        shared = {t.key for m in self.model.mechanisms if m not in whose for t in m.terms}
        return np.array([t.key in mine and t.key not in shared for t in self.model.terms])

    def freed(self, *effects: Candidate) -> tuple[Array, Array]:
        """(D (N, d), the residual with the effects put back): no refit, the directions that only
        they bring are Q R⁻ᵀ E."""
        own = self.own(*effects)
        E = np.eye(len(self.kept))[:, [i for i, k in enumerate(self.kept) if own[k]]]
        D: Array = self.Q @ compute_basis(np.asarray(np.linalg.solve(self.R.T, E)))
        effect = self.A[:, own] @ self.fitted.theta[own]
        return D, self.r + D @ (D.T @ (self.raw + effect))

    def without(self, candidate: Candidate) -> tuple[Scan, Array]:
        """(the scan from the model without one effect, the residual with that effect put back)."""
        D, response = self.freed(candidate)
        return build_scan_without(self.seen, D), response


def build_view(problem: Problem, columns: Columns, model: Model, fitted: Fit) -> View:
    """A fitted model's projections, and every candidate beyond it."""
    A, r = stacked(problem, model.terms, fitted.at())
    if fitted.precision is not None:
        root = prior_root(fitted.terms, fitted.precision)
        A, r = np.vstack([A, root]), np.concatenate([r, -root @ fitted.theta])
    kept = fitted.representatives
    Q, R = np.linalg.qr(A[:, list(kept)])
    return View(model, fitted, kept, A, Q, R, r, r - Q @ (Q.T @ r), scan(columns, Q))
