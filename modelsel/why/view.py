"""A fitted model seen as projections: what lies beyond it, and beyond it without one of its effects, with no refit."""
from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from .._typing import Array
from ..fitting.design import Model
from ..fitting.least_squares import Fit, prior_root
from ..fitting.problem import Scene
from ..which.candidates import Candidate
from .errormap import Columns, Scan, basis, scan, scan_without, stacked
from .naming import Named


def models(base: Model, chosen: Sequence[Candidate]) -> Model:
    """The base and the mechanisms of some candidates."""
    return base + tuple(dict.fromkeys(c.mechanism for c in chosen))


@dataclass(frozen=True, eq=False)
class View:
    """A fitted model seen as projections: orthonormal Q, its R (A_kept = Q R), columns A (N, p), the fit's residual `raw` and r,
    its part off the model; the prior's rows of shrunk terms stand below the data's. What geometry can do at any size is taken by
    geometry: the columns `kept` are those that do not depend on others, and the prior of usual sizes has no say."""

    model: Model
    fitted: Fit
    kept: tuple[int, ...]
    A: Array
    Q: Array
    R: Array
    raw: Array
    r: Array
    seen: Scan
    asked: dict[int, tuple[Named, float]] = field(default_factory=dict, repr=False)      # what `_Search.again` has answered

    def own(self, *effects: Candidate) -> Array:
        """(p,) mask of the terms that these effects alone bring."""
        whose = [e.mechanism for e in effects]
        mine = {t.screws for m in whose for t in m.terms}
        shared = {t.screws for m in self.model.mechanisms if m not in whose for t in m.terms}
        return np.array([t.screws in mine and t.screws not in shared for t in self.model.terms])

    def freed(self, *effects: Candidate) -> tuple[Array, Array]:
        """(D (N, d), the residual with the effects put back): no refit, the directions that only they bring are Q R⁻ᵀ E."""
        own = self.own(*effects)
        E = np.eye(len(self.kept))[:, [i for i, k in enumerate(self.kept) if own[k]]]
        D: Array = self.Q @ basis(np.asarray(np.linalg.solve(self.R.T, E)))
        effect = self.A[:, own] @ self.fitted.theta[own]
        return D, self.r + D @ (D.T @ (self.raw + effect))

    def without(self, candidate: Candidate) -> tuple[Scan, Array]:
        """(the scan from the model without one effect, the residual with that effect put back)."""
        D, response = self.freed(candidate)
        return scan_without(self.seen, D), response


def view(scene: Scene, columns: Columns, model: Model, fitted: Fit) -> View:
    """A fitted model's projections, and every candidate beyond it."""
    A, r = stacked(scene, model.terms, fitted.at())
    if fitted.precision is not None:
        root = prior_root(fitted.terms, fitted.precision)
        A, r = np.vstack([A, root]), np.concatenate([r, -root @ fitted.theta])
    kept = fitted.representatives
    Q, R = np.linalg.qr(A[:, list(kept)])
    return View(model, fitted, kept, A, Q, R, r, r - Q @ (Q.T @ r), scan(columns, Q))
