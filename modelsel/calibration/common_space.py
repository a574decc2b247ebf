"""Two campaigns in one set of representatives, on configurations that both have seen."""

from __future__ import annotations

from collections.abc import Hashable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from .._typing import Array, Index
from ..fitting.design import compute_design
from ..fitting.identifiability import identify
from ..fitting.problem import Problem
from ..fitting.reduction import reduce
from ..mechanisms.geometry import build_setup
from ..mechanisms.terms import Mechanism, Term, terms_of
from .calibration import Calibration
from .common_names import CommonNames, number_together, renumber
from .constant_part import sample_workspace

CONFIGURATIONS = 300  # drawn from what both campaigns have seen


@dataclass(frozen=True, eq=False)
class CommonSpace:
    """Both campaigns in one set of representatives.

    `campaigns` number their `targets` and their groups alike; `X` (m, 3, p) columns of all terms at
    common configurations; `theta` (2, p) and `factors` of the campaigns' covariances; `kept` places
    of the representatives, `relation` (p, r) from all terms to them; `placing` the terms that a new
    placement, or another target, takes up.
    """

    campaigns: tuple[Calibration, Calibration]
    targets: CommonNames
    terms: tuple[Term, ...]
    placing: tuple[Term, ...]
    theta: Array
    factors: list[Array]
    X: Array
    kept: Index
    relation: Array

    @cached_property
    def shared(self) -> set[tuple[Hashable, ...]]:
        """Keys of the terms that both campaigns fitted."""
        keys = []
        for campaign in self.campaigns:
            own = {term.key for term in campaign.terms}
            keys.append(own)
        first, second = keys
        return first & second

    @cached_property
    def owner(self) -> dict[tuple[Hashable, ...], str]:
        """The mechanism of every term, by its screws; the first campaign's where both have it."""
        owner = {}
        for campaign in reversed(self.campaigns):
            for mechanism in reversed(campaign.model.mechanisms):
                for term in mechanism.terms:
                    owner[term.key] = mechanism.name
        return owner

    @cached_property
    def displacement(self) -> Array:
        """Rms displacement (p,) of the target per unit of every term [mm]."""
        squares = np.square(self.X)
        lengths = squares.sum(1)
        mean = lengths.mean(0)
        rms = np.sqrt(mean)
        return np.asarray(rms)

    @cached_property
    def estimates(self) -> Array:
        """Representatives (2, r) in both campaigns."""
        return np.asarray(self.theta @ self.relation)

    @cached_property
    def difference(self) -> Array:
        """Second campaign minus first (r,)."""
        before, after = self.estimates
        return np.asarray(after - before)

    @cached_property
    def difference_factor(self) -> Array:
        """Factor (r, k) of the difference's covariance."""
        relation = self.relation.T
        factors = []
        for factor in self.factors:
            own = relation @ factor
            factors.append(own)
        return np.concatenate(factors, 1)

    @cached_property
    def standard_errors(self) -> Array:
        """Standard errors (r,) of the difference."""
        factor = self.difference_factor
        squares = np.square(factor)
        variances = squares.sum(1)
        errors = np.sqrt(variances)
        return np.asarray(errors)

    def is_comparable(self, term: Term) -> bool:
        """Whether both campaigns fitted a term, and no new placement takes it up."""
        if term in self.placing:
            return False
        return term.key in self.shared


def build_common_space(a: Calibration, b: Calibration) -> CommonSpace:
    """Express both campaigns in one set of representatives, on configurations drawn from what both
    have seen, of a target that both have measured."""
    targets = number_together(a.targets, b.targets)
    groups = number_together(a.groups, b.groups)
    b = renumber(b, a, targets, groups)
    ranges = _intersect_ranges(a, b)
    common = replace(a, ranges=ranges, model=a.model + b.model.mechanisms)
    sampled = sample_workspace(common, targets.sampled, CONFIGURATIONS, groups.sampled)
    problem = _spread_over_campaign(sampled, ranges)
    placing = _build_placing(a, b, targets)
    terms = terms_of((placing, *a.model.mechanisms, *b.model.mechanisms))
    X = compute_design(problem, terms)[0]
    rows = X.reshape(-1, len(terms))
    identified = identify(reduce(rows, np.zeros(len(rows))))
    estimates = []
    factors = []
    for campaign in (a, b):
        theta, factor = _place_estimates(campaign, terms)
        estimates.append(theta)
        factors.append(factor)
    return CommonSpace(
        (a, b),
        targets,
        terms,
        placing.terms,
        np.array(estimates),
        factors,
        X,
        np.array(identified.exact, dtype=np.intp),
        identified.relation,
    )


def _build_placing(a: Calibration, b: Calibration, targets: CommonNames) -> Mechanism:
    """Build the terms that take up what a new placement of the tracker and the target, or where no
    target is common, another target, would also do."""
    robot = a.robot
    setup = build_setup(robot, 1, 1, True, False)
    if a.registered or b.registered:
        return setup
    placing = []
    if not len(targets.shared):
        flange = robot.n + 1
        for term in setup.terms:
            (screw,) = term.screws
            if screw.frame == flange:
                placing.append(term)
    return replace(setup, terms=tuple(placing))


def _spread_over_campaign(at: Problem, ranges: Mapping[str, tuple[float, float]]) -> Problem:
    """Spread the configurations over the course of a campaign: at one moment a drift is a constant
    shift, which the geometry would take up."""
    start, end = ranges.get("progress", (0.0, 1.0))
    progress = np.linspace(start, end, len(at.data))
    return replace(at, data=replace(at.data, progress=progress))


def _intersect_ranges(a: Calibration, b: Calibration) -> dict[str, tuple[float, float]]:
    """Return what both campaigns have seen of a value; of a value that one alone has, what it has
    seen."""
    ranges = {**b.ranges, **a.ranges}
    for name, first in a.ranges.items():
        if name not in b.ranges:
            continue
        second = b.ranges[name]
        lows, highs = zip(first, second, strict=True)
        low = max(lows)
        high = min(highs)
        ranges[name] = (low, max(high, low))
    return ranges


def _place_estimates(c: Calibration, terms: Sequence[Term]) -> tuple[Array, Array]:
    """Return a campaign's theta (p,) and covariance factor (p, r) among the terms of both; zero for
    the other's terms."""
    place = {term.key: k for k, term in enumerate(terms)}
    places = [place[term.key] for term in c.terms]
    count = len(terms)
    width = c.factor.shape[1]
    theta = np.zeros(count)
    theta[places] = c.theta
    shape = (count, width)
    factor = np.zeros(shape)
    factor[places] = c.factor
    return theta, factor
