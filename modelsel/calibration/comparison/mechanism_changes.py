"""What mechanisms do in two campaigns, beyond the geometry that both fitted along: the same, more,
less, or named in one alone.

A name alone proves no change: another campaign has other noise, names what it can see, and may call
one motion differently. So sizes are compared along the motion that both have in common, with their
standard errors, and a mechanism appeared or disappeared only if the campaign without it would have named it.
"""

from __future__ import annotations

import re
from collections.abc import Hashable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from ..._linalg import TINY, orthonormal_basis, project_out
from ..._short_numbers import round_numbers
from ..._typing import Array
from ...mechanisms.geometry import SETUP
from ...mechanisms.terms import Term
from ..calibration import Calibration

SIGNIFICANCE = 0.05
SIGNIFICANCE_BESIDE = 0.01  # of a size none of whose terms changed, asked beside all of these
GEOMETRY_NAMES = ("geometric", SETUP)
MIN_COSINE = 0.95  # of two motions beyond the geometry that are one under two names
MIN_COSINE_PERHAPS = 0.7  # of two that may be: half of that is common
POWER_QUANTILE = 1.28  # standard errors beyond the level's own: a change so large is seen with 90 %
NAMING_THRESHOLD = 5.4  # standard errors from which a search among thousands names with 90 %
MAY_BE_LESS = 1.64  # standard errors by which what one campaign has named may be smaller (95 %)
# certain, else possible
SINGLE_WORDS = (("disappeared", "may have disappeared"), ("appeared", "may have appeared"))
DEFINITE_CHANGES = ("appeared", "disappeared", "grew", "shrank")
NOT_COMPARABLE = "cannot be compared"  # the geometry follows all that a mechanism does
MIN_SHARE_BEYOND = 1e-6  # of a whole motion, beyond the geometry: what is less is rounding
MRAD = 1e3  # in a radian
CAMPAIGN_NAMES = ("first", "second")


@dataclass(frozen=True)
class MechanismChange:
    """A mechanism named in one campaign alone, under two names, or with terms that changed: what it
    moved the target by in each campaign (rms mm, beyond what the geometry follows; the whole motion
    where it cannot be compared), `p` that chance alone gives the difference (None: named in one
    campaign alone, or not compared), and from where a difference would have been detected, or the other
    campaign would have named it (None: not known). `labels`: what findings of it are called;
    `only_in`: "first" or "second" where that campaign alone has named it."""

    name: str
    labels: tuple[str, ...]
    what: str
    before_mm: float
    after_mm: float
    p: float | None
    seen_mm: float | None
    only_in: str | None = None
    # how far it turned the target in each campaign (rms), where both measured orientations
    turns_mrad: tuple[float, float] | None = None
    # of one named in one campaign alone: what the other alone has named, and moves the target much alike
    perhaps: str | None = None


def label_mechanism(name: str) -> str:
    """Return what a finding of a mechanism is called: of one that is not registered, place and
    cause."""
    label = re.sub(r"^(\d+ [tr][xyz]) (.+)$", r"frame \1 · \2", name)
    return round_numbers(label)


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
    all terms, and turn it by, `turns` (m, 3, p), of no row where orientations are not compared; theta
    (2, p), factors of its covariances, `surer`: the second campaign's standard errors over the
    first's."""

    campaigns: tuple[Calibration, Calibration]
    terms: tuple[Term, ...]
    theta: Array
    factors: list[Array]
    X: Array
    turns: Array
    surer: float

    @cached_property
    def beyond(self) -> Array:
        """X (3 m, p) without what the geometry and the set-up follow: both campaigns have fitted
        these along."""
        X = self.X.reshape(-1, len(self.terms))
        geometry = set[Hashable]()
        for campaign in self.campaigns:
            for mechanism in campaign.model.mechanisms:
                if mechanism.name not in GEOMETRY_NAMES:
                    continue
                for term in mechanism.terms:
                    geometry.add(term.key)
        fitted_along = [term.key in geometry for term in self.terms]
        columns = X[:, fitted_along]
        basis = orthonormal_basis(columns)
        return project_out(X, basis)

    def locate_mechanisms(self, k: int) -> dict[str, list[int]]:
        """Locate the mechanisms of campaign k (0 or 1) but the geometry: places of their terms."""
        place_of = dict[Hashable, int]()
        for column, term in enumerate(self.terms):
            place_of.setdefault(term.key, column)
        places = {}
        for mechanism in self.campaigns[k].model.mechanisms:
            name = mechanism.name
            if name in GEOMETRY_NAMES:
                continue
            columns = [place_of[term.key] for term in mechanism.terms]
            places[name] = columns
        return places

    def whole(self, k: int, own: list[int]) -> Array:
        """Return the motion (3 m,) by the terms `own` in campaign k."""
        columns = self.X[:, :, own]
        estimates = self.theta[k, own]
        motion = columns @ estimates
        return np.asarray(motion).ravel()

    def size(self, k: int, own: list[int], along: Array) -> tuple[float, float]:
        """Return the rms size and its standard error [mm] along a direction (3 m,) of what the
        terms do beyond the geometry."""
        columns = self.beyond[:, own]
        estimates = self.theta[k, own]
        direction = _unit(along)
        rows = np.sqrt(len(self.X))
        slope = direction @ columns / rows
        factor = self.factors[k][own]
        error = np.linalg.norm(slope @ factor)
        size = slope @ estimates
        return float(size), float(error)

    def motion(self, k: int, own: list[int]) -> Array:
        """Return the motion (3 m,) by the terms beyond the geometry."""
        columns = self.beyond[:, own]
        estimates = self.theta[k, own]
        motion = columns @ estimates
        return np.asarray(motion)

    def whole_size(self, k: int, own: list[int]) -> float:
        """Return the rms size [mm] of the whole motion by the terms in campaign k."""
        motion = self.whole(k, own)
        length = float(np.linalg.norm(motion))
        return length / float(np.sqrt(len(self.X)))

    def turn_size(self, k: int, own: list[int]) -> float:
        """Return the rms turn [mrad] of the target by the terms `own` in campaign k."""
        estimates = self.theta[k, own]
        turned = self.turns[:, :, own] @ estimates
        length = float(np.linalg.norm(turned))
        return MRAD * length / float(np.sqrt(len(self.X)))

    def is_followed(self, k: int, own: list[int]) -> bool:
        """Whether the geometry follows all that the terms do in campaign k: what is left of their
        motion, if there is one, is rounding."""
        beyond = float(np.linalg.norm(self.motion(k, own)))
        whole = float(np.linalg.norm(self.whole(k, own)))
        return beyond <= MIN_SHARE_BEYOND * whole


def compare_mechanisms(motions: Motions, moved: set[str]) -> tuple[MechanismChange, ...]:
    """Compare every mechanism but the geometry: those named in one campaign alone, those in both
    under two names, and of those in both under one name the ones whose size, or whose terms, `moved`.

    Where many terms share a motion, its size may have changed beyond chance though no term did."""
    before = motions.locate_mechanisms(0)
    after = motions.locate_mechanisms(1)
    disappeared = []
    pairs = []
    for name in before:
        if name not in after:
            disappeared.append(name)
        else:
            pairs.append(_Pair(label_mechanism(name), name, name))
    appeared = [name for name in after if name not in before]
    pairs += _match_renamed(motions, disappeared, appeared)
    changes = []
    renamed = set[str]()
    for pair in pairs:
        is_moved = pair.first in moved
        change = _compare_pair(motions, pair, is_moved, len(pairs))
        is_renamed = pair.first != pair.second
        is_sure = change.p is not None and change.p <= SIGNIFICANCE_BESIDE
        if is_moved or is_renamed or is_sure:
            turns = _measure_turns(motions, pair.first, pair.second)
            changes.append(replace(change, turns_mrad=turns))
        renamed |= {pair.first, pair.second}
    for campaign, names in enumerate((disappeared, appeared)):
        for name in names:
            if name in renamed:
                continue
            change = _judge_single(motions, campaign, name)
            named = (name, None) if campaign == 0 else (None, name)
            turns = _measure_turns(motions, *named)
            others = appeared if campaign == 0 else disappeared
            likest = _find_likest(motions, campaign, name, [o for o in others if o not in renamed])
            if likest is not None and change.what in DEFINITE_CHANGES:
                change = replace(change, what=SINGLE_WORDS[campaign][1])
            changes.append(replace(change, turns_mrad=turns, perhaps=likest))
    return tuple(changes)


def _find_likest(motions: Motions, campaign: int, name: str, others: list[str]) -> str | None:
    """Find which of the other campaign's mechanisms moves the target most like one of a campaign's;
    None where none is much alike. Campaigns call one error differently where neither is sure of it."""
    cosines = {}
    for other in others:
        named = (name, other) if campaign == 0 else (other, name)
        cosines[other] = _measure_likeness(motions, *named)
    likest = max(cosines, key=cosines.__getitem__, default=None)
    if likest is None:
        return None
    if cosines[likest] < MIN_COSINE_PERHAPS:
        return None
    return label_mechanism(likest)


def _measure_likeness(motions: Motions, first: str, second: str) -> float:
    """Measure the cosine between the motions of the first campaign's mechanism and of the second's
    beyond the geometry: all whose causes keep one sign are much alike with what it follows. Of two
    that it follows entirely, that of the whole motions."""
    places = motions.locate_mechanisms(0)
    other_places = motions.locate_mechanisms(1)
    own = places[first]
    other = other_places[second]
    is_followed = motions.is_followed(0, own)
    if is_followed != motions.is_followed(1, other):
        return 0.0
    if is_followed:
        before = motions.whole(0, own)
        after = motions.whole(1, other)
    else:
        before = motions.motion(0, own)
        after = motions.motion(1, other)
    return _cosine(before, after)


def _measure_turns(
    motions: Motions, first: str | None, second: str | None
) -> tuple[float, float] | None:
    """Measure how far a mechanism, by its name in each campaign, turns the target [mrad]; None where
    orientations are not compared."""
    if not motions.turns.size:
        return None
    sizes = []
    for campaign, name in enumerate((first, second)):
        places = motions.locate_mechanisms(campaign)
        size = 0.0 if name is None else motions.turn_size(campaign, places[name])
        sizes.append(size)
    before, after = sizes
    return before, after


@dataclass(frozen=True)
class _Pair:
    """One motion of both campaigns: what it is called, its name in the first and in the second."""

    label: str
    first: str
    second: str


def _match_renamed(motions: Motions, disappeared: list[str], appeared: list[str]) -> list[_Pair]:
    """Match mechanisms that disappeared with ones that appeared and move the target alike: one motion under
    two names."""
    unmatched = list(appeared)
    pairs = list[_Pair]()
    for name in disappeared:
        for candidate in unmatched:
            cosine = _measure_likeness(motions, name, candidate)
            if cosine > MIN_COSINE:
                first, second = label_mechanism(name), label_mechanism(candidate)
                label = f"{first} (now {second}, which moves the arm alike)"
                pairs.append(_Pair(label, name, candidate))
                unmatched.remove(candidate)
                break
    return pairs


def _compare_pair(motions: Motions, pair: _Pair, moved: bool, count: int) -> MechanismChange:
    """Compare the sizes of one motion along the direction that both campaigns have in common; p is
    corrected for the number of pairs."""
    first = motions.locate_mechanisms(0)[pair.first]
    second = motions.locate_mechanisms(1)[pair.second]
    labels = label_mechanism(pair.first), label_mechanism(pair.second)
    if motions.is_followed(0, first) and motions.is_followed(1, second):
        before = motions.whole_size(0, first)
        after = motions.whole_size(1, second)
        return MechanismChange(pair.label, labels, NOT_COMPARABLE, before, after, None, None)
    first_motion = motions.motion(0, first)
    second_motion = motions.motion(1, second)
    along = _unit(first_motion) + _unit(second_motion)
    before, before_error = motions.size(0, first, along)
    after, after_error = motions.size(1, second, along)
    error = float(np.hypot(before_error, after_error)) or TINY
    z = (after - before) / error
    p = min(count * two_sided_p(z), 1.0)
    what = "did not change"
    if p <= SIGNIFICANCE:
        what = "grew" if after > before else "shrank"
    elif moved:
        what = "changed"
    quantile = two_sided_quantile(SIGNIFICANCE / count)
    detectable = (quantile + POWER_QUANTILE) * error
    return MechanismChange(pair.label, labels, what, before, after, p, detectable)


def _judge_single(motions: Motions, campaign: int, name: str) -> MechanismChange:
    """Judge a mechanism that one campaign alone has named: it disappeared or appeared only if the other would
    have named it."""
    places = motions.locate_mechanisms(campaign)[name]
    size = motions.whole_size(campaign, places)
    what = NOT_COMPARABLE
    detectable = None
    if not motions.is_followed(campaign, places):
        along = motions.motion(campaign, places)
        size, error = motions.size(campaign, places, along)
        detectable = _naming_limit(motions, campaign, error)
        certain, possible = SINGLE_WORDS[campaign]
        is_certain = detectable is not None and size > detectable
        what = certain if is_certain else possible
    before = after = 0.0
    if campaign == 0:
        before = size
    else:
        after = size
    label = label_mechanism(name)
    only_in = CAMPAIGN_NAMES[campaign]
    return MechanismChange(label, (label,), what, before, after, None, detectable, only_in)


def _naming_limit(motions: Motions, campaign: int, error: float) -> float | None:
    """Return the size [mm] from which the other campaign would have named a motion whose standard
    error in `campaign` is `error`, which it may be smaller by; None where that error is zero: it says
    nothing of the other."""
    if not error:
        return None
    ratio = motions.surer if campaign == 0 else 1 / motions.surer
    of_other = NAMING_THRESHOLD * ratio * error
    of_own = MAY_BE_LESS * error
    return of_other + of_own


def _unit(vector: Array) -> Array:
    length = np.linalg.norm(vector)
    if not length:
        return vector / 1.0
    return np.asarray(vector / length)


def _cosine(a: Array, b: Array) -> float:
    first = np.linalg.norm(a)
    second = np.linalg.norm(b)
    size = float(first * second)
    if not size:
        return 0.0
    product = float(a @ b)
    return product / size
