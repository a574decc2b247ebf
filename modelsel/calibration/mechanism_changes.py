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

from .._linalg import TINY, orthonormal_basis, project_out
from .._typing import Array
from ..mechanisms.geometry import SETUP
from ..mechanisms.terms import Term
from .calibration import Calibration

SIGNIFICANCE = 0.05
GEOMETRY_NAMES = ("geometric", SETUP)
MIN_COSINE = 0.95  # of two motions that are one under two names
POWER_QUANTILE = 1.28  # standard errors beyond the level's own: a change so large is seen with 90 %
NAMING_THRESHOLD = 5.4  # standard errors from which a search among thousands names with 90 %
SINGLE_WORDS = (("went", "may have gone"), ("came", "may have come"))  # certain, else possible
DEFINITE_CHANGES = ("came", "went", "grew", "shrank")


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


def two_sided_p(z: float) -> float:
    """Return the probability that chance goes beyond z, to either side."""
    from scipy.special import ndtr

    return float(2 * ndtr(-abs(z)))


def two_sided_quantile(p: float) -> float:
    """Return the z beyond which, to either side, chance goes with probability p."""
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
        mechanisms = [m for c in self.campaigns for m in c.model.mechanisms]
        shared = [m for m in mechanisms if m.name in GEOMETRY_NAMES]
        geometry = {t.key for m in shared for t in m.terms}
        fitted_along = X[:, [k for k, t in enumerate(self.terms) if t.key in geometry]]
        return project_out(X, orthonormal_basis(fitted_along))

    def named(self, k: int) -> dict[str, list[int]]:
        """The mechanisms of campaign k (0 or 1) but the geometry: places of their terms."""
        place = {t.key: i for i, t in reversed(list(enumerate(self.terms)))}
        return {
            m.name: [place[t.key] for t in m.terms]
            for m in self.campaigns[k].model.mechanisms
            if m.name not in GEOMETRY_NAMES
        }

    def whole(self, k: int, own: list[int]) -> Array:
        """(3 m,) the motion by the terms `own` in campaign k."""
        return np.asarray(self.X[:, :, own] @ self.theta[k, own]).ravel()

    def size(self, k: int, own: list[int], along: Array) -> tuple[float, float]:
        """(rms size, its standard error) [mm] along a direction (3 m,) of what the terms do beyond
        the geometry."""
        slope = _unit(along) @ self.beyond[:, own] / np.sqrt(len(self.X))
        error = np.linalg.norm(slope @ self.factors[k][own])
        return float(slope @ self.theta[k, own]), float(error)

    def motion(self, k: int, own: list[int]) -> Array:
        """(3 m,) what the terms do beyond the geometry."""
        return np.asarray(self.beyond[:, own] @ self.theta[k, own])


def compare_mechanisms(motions: Motions, moved: set[str]) -> tuple[MechanismChange, ...]:
    """Compare every mechanism but the geometry: those named in one campaign alone, those in both
    under two names, and those with terms that `moved`."""
    before, after = motions.named(0), motions.named(1)
    went = [name for name in before if name not in after]
    came = [name for name in after if name not in before]
    pairs = [_Pair(name, name, name) for name in before if name in after and name in moved]
    pairs += _match_renamed(motions, went, came)
    renamed_before = {pair.first for pair in pairs}
    renamed_after = {pair.second for pair in pairs}
    changes = [_compare_pair(motions, pair, pair.first in moved, len(pairs)) for pair in pairs]
    changes += [_judge_single(motions, 0, name) for name in went if name not in renamed_before]
    changes += [_judge_single(motions, 1, name) for name in came if name not in renamed_after]
    return tuple(changes)


@dataclass(frozen=True)
class _Pair:
    """One motion of both campaigns: what it is called, its name in the first and in the second."""

    label: str
    first: str
    second: str


def _match_renamed(motions: Motions, went: list[str], came: list[str]) -> list[_Pair]:
    """Match mechanisms that went with ones that came and move the target alike: one motion under
    two names."""
    before, after = motions.named(0), motions.named(1)
    unmatched, pairs = list(came), list[_Pair]()
    for name in went:
        motion = motions.whole(0, before[name])
        alike = [n for n in unmatched if _cosine(motion, motions.whole(1, after[n])) > MIN_COSINE]
        if alike:
            unmatched.remove(alike[0])
            label = f"{name} (now {alike[0]}, which moves the arm alike)"
            pairs.append(_Pair(label, name, alike[0]))
    return pairs


def _compare_pair(motions: Motions, pair: _Pair, moved: bool, count: int) -> MechanismChange:
    """Compare the sizes of one motion along the direction that both campaigns have in common; p is
    corrected for the number of pairs."""
    first, second = motions.named(0)[pair.first], motions.named(1)[pair.second]
    along = _unit(motions.motion(0, first)) + _unit(motions.motion(1, second))
    before, before_error = motions.size(0, first, along)
    after, after_error = motions.size(1, second, along)
    error = float(np.hypot(before_error, after_error)) or TINY
    p = min(count * two_sided_p((after - before) / error), 1.0)
    if p <= SIGNIFICANCE:
        what = "grew" if after > before else "shrank"
    else:
        what = "changed" if moved else "did not change"
    detectable = (two_sided_quantile(SIGNIFICANCE / count) + POWER_QUANTILE) * error
    return MechanismChange(pair.label, what, before, after, p, detectable)


def _judge_single(motions: Motions, campaign: int, name: str) -> MechanismChange:
    """Judge a mechanism that one campaign alone has named: it went or came only if the other would
    have named it."""
    places = motions.named(campaign)[name]
    size, error = motions.size(campaign, places, motions.motion(campaign, places))
    ratio = motions.surer if campaign == 0 else 1 / motions.surer
    detectable = NAMING_THRESHOLD * error * ratio
    certain, possible = SINGLE_WORDS[campaign]
    what = certain if size > detectable else possible
    before, after = (size, 0.0) if campaign == 0 else (0.0, size)
    return MechanismChange(name, what, before, after, None, detectable)


def _unit(vector: Array) -> Array:
    return np.asarray(vector / (np.linalg.norm(vector) or 1.0))


def _cosine(a: Array, b: Array) -> float:
    size = float(np.linalg.norm(a) * np.linalg.norm(b))
    return float(a @ b) / size if size else 0.0


def describe_change(change: MechanismChange) -> str:
    """Describe one mechanism in words that go no further than the evidence."""
    if change.p is None:
        return _describe_single(change)
    sizes = (
        f"{change.before_mm:.3g} to {change.after_mm:.3g} mm rms at the target (p = {change.p:.2g})"
    )
    if change.what in ("grew", "shrank"):
        return f"{change.name} {change.what}: {sizes}."
    if change.what == "changed":
        return f"The terms of {change.name} changed, its size did not beyond chance: {sizes}."
    return f"{change.name} did not change beyond chance: {sizes}; a change of {change.seen_mm:.2g} mm would have been seen."


def _describe_single(change: MechanismChange) -> str:
    """Describe a mechanism that one campaign alone has named."""
    named, other = ("first", "second") if change.before_mm else ("second", "first")
    size = f"{max(change.before_mm, change.after_mm):.3g} mm rms at the target"
    if change.what in DEFINITE_CHANGES:
        return (
            f"{change.name} {change.what}: {size}; the {other} campaign would have named it from "
            f"{change.seen_mm:.2g} mm on."
        )
    verb = "came" if change.after_mm else "went"
    return (
        f"{change.name} is named in the {named} campaign only, with {size}. The {other} would have named it only from "
        f"{change.seen_mm:.2g} mm on, so it cannot be said whether it {verb}."
    )
