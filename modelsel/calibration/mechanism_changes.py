"""What mechanisms do in two campaigns, beyond the geometry that both fitted along: the same, more,
less, or named in one alone.

A name alone proves no change: another campaign has other noise, names what it can see, and may call
one motion differently. So sizes are compared along the motion that both have in common, with their
standard errors, and a mechanism came or went only if the campaign without it would have named it.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from .._typing import Array
from ..mechanisms.geometry import SETUP
from ..mechanisms.terms import Term
from .calibration import Calibration

LEVEL = 0.05
GEOMETRY = ("geometric", SETUP)
RENAMED = 0.95  # cosine of two motions that are one under two names
SEEN = 1.28  # standard errors beyond the level's own: a change so large is seen with 90 %
NAMED = 5.4  # standard errors from which a search among thousands names an effect with 90 %


@dataclass(frozen=True)
class MechanismChange:
    """A mechanism named in one campaign alone, under two names, or with terms that changed: what it
    moved the target by in each campaign (rms mm, beyond what the geometry follows), `p` that chance
    alone gives the difference (None: named in one campaign alone), and from where a difference
    would have been seen, or the other campaign would have named it."""

    name: str
    what: str
    before_mm: float
    after_mm: float
    p: float | None
    seen_mm: float


def two_sided(z: float) -> float:
    """How often chance goes beyond z, to either side."""
    from scipy.special import ndtr

    return float(2 * ndtr(-abs(z)))


def quantile(p: float) -> float:
    """The z beyond which, to either side, chance goes with probability p."""
    from scipy.special import ndtri

    return float(-ndtri(p / 2))


@dataclass(frozen=True, eq=False)
class Motions:
    """What mechanisms of two campaigns move the target by at common configurations, X (m, 3, p) of
    all terms; theta (2, p), factors of its covariances, `surer`: the second campaign's standard
    errors over the first's."""

    campaigns: tuple[Calibration, Calibration]
    terms: tuple[Term, ...]
    theta: Array
    factors: list[Array]
    X: Array
    surer: float

    @cached_property
    def beyond(self) -> Array:
        """X (3 m, p) without what the geometry and the set-up follow: both campaigns have fitted
        these along."""
        X = self.X.reshape(-1, len(self.terms))
        geometry = {
            t.key
            for c in self.campaigns
            for m in c.model.mechanisms
            if m.name in GEOMETRY
            for t in m.terms
        }
        own = X[:, [k for k, t in enumerate(self.terms) if t.key in geometry]]
        U, s, _ = np.linalg.svd(
            own / np.maximum(np.linalg.norm(own, axis=0), 1e-300), full_matrices=False
        )
        Q = U[:, s > 1e-9 * s.max(initial=1.0)]
        return np.asarray(X - Q @ (Q.T @ X))

    def named(self, k: int) -> dict[str, list[int]]:
        """The mechanisms of campaign k (0 or 1) but the geometry: places of their terms."""
        place = {t.key: i for i, t in reversed(list(enumerate(self.terms)))}
        return {
            m.name: [place[t.key] for t in m.terms]
            for m in self.campaigns[k].model.mechanisms
            if m.name not in GEOMETRY
        }

    def whole(self, k: int, own: list[int]) -> Array:
        """(3 m,) the motion by the terms `own` in campaign k."""
        return np.asarray(self.X[:, :, own] @ self.theta[k, own]).ravel()

    def size(self, k: int, own: list[int], along: Array) -> tuple[float, float]:
        """(rms size, its standard error) [mm] along a direction (3 m,) of what the terms do beyond
        the geometry."""
        slope = along @ self.beyond[:, own] / (np.linalg.norm(along) or 1.0) / np.sqrt(len(self.X))
        return float(slope @ self.theta[k, own]), float(
            np.linalg.norm(slope @ self.factors[k][own])
        )

    def motion(self, k: int, own: list[int]) -> Array:
        """(3 m,) what the terms do beyond the geometry."""
        return np.asarray(self.beyond[:, own] @ self.theta[k, own])


def mechanisms(found: Motions, moved: set[str]) -> tuple[MechanismChange, ...]:
    """What is named in one campaign alone, and what is in both under two names or with terms that
    `moved`: every mechanism but the geometry. One that went and one that came and moves the target
    alike are one motion under two names."""
    before, after = found.named(0), found.named(1)
    went, came = [n for n in before if n not in after], [n for n in after if n not in before]
    pairs = [(n, n, n) for n in before if n in after and n in moved]
    for name in list(went):
        like = [
            n
            for n in came
            if _cosine(found.whole(0, before[name]), found.whole(1, after[n])) > RENAMED
        ]
        if like:
            went.remove(name)
            came.remove(like[0])
            pairs.append((f"{name} (now {like[0]}, which moves the arm alike)", name, like[0]))
    out = []
    for called, first, second in pairs:
        m = [found.motion(0, before[first]), found.motion(1, after[second])]
        along = sum((x / (np.linalg.norm(x) or 1.0) for x in m), np.zeros(len(m[0])))
        (x, sx), (y, sy) = found.size(0, before[first], along), found.size(1, after[second], along)
        error = float(np.hypot(sx, sy)) or 1e-300
        p = min(len(pairs) * two_sided((y - x) / error), 1.0)
        what = (
            ("grew" if y > x else "shrank")
            if p <= LEVEL
            else "changed"
            if first in moved
            else "did not change"
        )
        out.append(
            MechanismChange(called, what, x, y, p, (quantile(LEVEL / len(pairs)) + SEEN) * error)
        )
    for k, names, own, certain in ((0, went, before, "went"), (1, came, after, "came")):
        for name in names:
            size, error = found.size(k, own[name], found.motion(k, own[name]))
            seen = NAMED * error * (found.surer if k == 0 else 1 / found.surer)
            what = certain if size > seen else f"may have {'gone' if k == 0 else 'come'}"
            out.append(
                MechanismChange(name, what, size if k == 0 else 0.0, size if k else 0.0, None, seen)
            )
    return tuple(out)


def _cosine(a: Array, b: Array) -> float:
    size = float(np.linalg.norm(a) * np.linalg.norm(b))
    return float(a @ b) / size if size else 0.0


def told(m: MechanismChange) -> str:
    """One mechanism in words that go no further than the evidence."""
    if m.p is None:
        here, there = ("first", "second") if m.before_mm else ("second", "first")
        size = f"{max(m.before_mm, m.after_mm):.3g} mm rms at the target"
        if m.what in ("came", "went"):
            return f"{m.name} {m.what}: {size}; the {there} campaign would have named it from {m.seen_mm:.2g} mm on."
        return (
            f"{m.name} is named in the {here} campaign alone, with {size}; the {there} would have named it only from "
            f"{m.seen_mm:.2g} mm on: whether it {'came' if m.after_mm else 'went'} is not told."
        )
    sizes = f"{m.before_mm:.3g} to {m.after_mm:.3g} mm rms at the target (p = {m.p:.2g})"
    if m.what in ("grew", "shrank"):
        return f"{m.name} {m.what}: {sizes}."
    if m.what == "changed":
        return f"{m.name} changed in its terms, not in its size beyond chance: {sizes}."
    return f"{m.name} did not change beyond chance: {sizes}; a change of {m.seen_mm:.2g} mm would have been seen."
