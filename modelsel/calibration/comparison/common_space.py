"""Two campaigns in one set of representatives, on configurations that both have seen.

Where both have measured several targets of the same names, each of these has an offset of its own,
counted from where the first campaign's study has it on the flange."""

from __future__ import annotations

from collections.abc import Hashable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from ..._linalg import orthonormal_basis, project_out
from ..._typing import Array, Index
from ...fitting.design import compute_design
from ...fitting.identifiability import identify
from ...fitting.problem import Problem
from ...fitting.reduction import reduce
from ...mechanisms.geometry import build_setup
from ...mechanisms.terms import Mechanism, Term, terms_of
from ..calibration import Calibration
from ..constant_part import sample_workspace
from .common_names import CommonNames, number_together, renumber
from .target_offsets import count_from, find_offsets

CONFIGURATIONS = 300  # drawn from what both campaigns have seen
MIN_CONFIGURATIONS = 60  # of each target


@dataclass(frozen=True, eq=False)
class CommonSpace:
    """Both campaigns in one set of representatives.

    `campaigns` number their `targets` and their groups alike; `X` (m, 3, p) columns of all terms at
    common configurations; `turns` (m, 3, p) how they turn the target [rad], where both campaigns have
    measured orientations, else of no row; `theta` (2, p) and `factors` of the campaigns' covariances; `kept` places
    of the representatives, `relation` (p, r) from all terms to them; `placing` the terms that a new
    placement, or another target, takes up; `offsets` (targets, 3) places of the terms that move one
    of several targets that both have measured; `open_directions` (r, d): how the representatives may
    differ because one campaign alone has a mechanism, or calls it so, one standard deviation each.
    """

    campaigns: tuple[Calibration, Calibration]
    targets: CommonNames
    terms: tuple[Term, ...]
    placing: tuple[Term, ...]
    theta: Array
    factors: list[Array]
    X: Array
    turns: Array
    kept: Index
    relation: Array
    offsets: Index
    open_directions: Array | None = None

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
        """Rms displacement (p,) of the target per unit of every term [mm], beyond what a new placement
        takes up."""
        coordinates = self._flatten()
        beyond = self._project_out_placing(coordinates)
        return self._measure(beyond)

    @cached_property
    def turning(self) -> Array:
        """Rms turning (p,) of the target per unit of every term [rad], beyond what a new placement
        takes up; zero where orientations are not compared."""
        count = len(self.terms)
        coordinates = self.turns.reshape(-1, count)
        beyond = self._project_out_placing(coordinates)
        return self._measure(beyond)

    def _project_out_placing(self, columns: Array) -> Array:
        """Project out of columns (k, p) of all terms what a new placement takes up."""
        taken_up = [place for place, term in enumerate(self.terms) if term in self.placing]
        placing = columns[:, taken_up]
        basis = orthonormal_basis(placing)
        return project_out(columns, basis)

    @cached_property
    def whole_displacement(self) -> Array:
        """Rms displacement (p,) of the target per unit of every term [mm], in a placement that stays."""
        coordinates = self._flatten()
        return self._measure(coordinates)

    def _flatten(self) -> Array:
        """Return the columns (3m, p) of all terms, coordinate by coordinate."""
        count = len(self.terms)
        return self.X.reshape(-1, count)

    def _measure(self, columns: Array) -> Array:
        """Measure the rms length (p,) over the configurations of columns (3m, p)."""
        lengths = np.linalg.norm(columns, axis=0)
        count = len(self.X)
        rms = lengths / np.sqrt(count)
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
        if self.open_directions is not None:
            factors.append(self.open_directions)
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
    shared = targets.shared.tolist()
    separate = find_offsets(a, b, shared)
    b = count_from(a, b, separate)
    ranges = _intersect_ranges(a, b)
    common = replace(a, ranges=ranges, model=a.model + b.model.mechanisms)
    count = max(CONFIGURATIONS // max(len(separate), 1), MIN_CONFIGURATIONS)
    sampled = sample_workspace(common, targets.sampled, count, groups.sampled)
    problem = _spread_over_campaign(sampled, ranges)
    if separate:
        problem = _spread_over_targets(problem, targets.shared)
    oriented = _measure_orientations(a, b)
    if oriented:
        problem = _observe_orientations(problem)
    placing = _build_placing(a, b, targets, bool(separate), oriented)
    terms = _order_terms(placing, a, b)
    columns = compute_design(problem, terms)[0]
    X, turns = columns[:, :3], columns[:, 3:]
    # a radian weighs as much as it moves at the end of the arm
    scaled = np.concatenate([X, a.robot.reach * turns], 1)
    rows = scaled.reshape(-1, len(terms))
    nothing = np.zeros(len(rows))
    reduced = reduce(rows, nothing)
    identified = identify(reduced)
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
        turns,
        np.array(identified.exact, dtype=np.intp),
        identified.relation,
        _place_offsets(terms, separate),
    )


def _measure_orientations(a: Calibration, b: Calibration) -> bool:
    """Whether both campaigns have measured orientations."""
    first, second = a.tool_rotations, b.tool_rotations
    return first is not None and second is not None


def _observe_orientations(at: Problem) -> Problem:
    """Measure the orientation, too, in every configuration: as that of frame 0, since where the
    target turns to does not depend on it."""
    count = len(at)
    rotation = np.tile(np.eye(3), (count, 1, 1))
    data = replace(at.data, rotation=rotation)
    return replace(at, data=data)


def _order_terms(placing: Mechanism, a: Calibration, b: Calibration) -> tuple[Term, ...]:
    """Order all terms: those of a new placement, those that both campaigns fitted, the others. An
    earlier one represents the later ones that depend on it, so that what both have is compared."""
    mechanisms = (placing, *a.model.mechanisms, *b.model.mechanisms)
    first = {term.key for term in a.terms}
    second = {term.key for term in b.terms}
    in_both = first & second
    ordered = list(placing.terms)
    others = []
    for term in terms_of(mechanisms):
        if term in placing.terms:
            continue
        if term.key in in_both:
            ordered.append(term)
        else:
            others.append(term)
    return (*ordered, *others)


def _place_offsets(terms: Sequence[Term], separate: Sequence[Sequence[Term]]) -> Index:
    """Return the places (targets, 3) of the targets' offsets among all terms."""
    numbered = enumerate(terms)
    place_of = {term.key: k for k, term in numbered}
    places = []
    for own in separate:
        for term in own:
            place = place_of[term.key]
            places.append(place)
    flat = np.array(places, dtype=np.intp)
    return flat.reshape(-1, 3)


def _build_placing(
    a: Calibration, b: Calibration, targets: CommonNames, separate: bool, oriented: bool
) -> Mechanism:
    """Build the terms that take up what a new placement of the tracker and the target, or where no
    target is common, another target, would also do. Of several targets compared one by one
    (`separate`) no place is taken up: what they do together is told."""
    robot = a.robot
    setup = build_setup(robot, 1, 1, True, oriented)
    is_registered = a.registered or b.registered
    flange = robot.n + 1
    placing = []
    for term in setup.terms:
        (screw,) = term.screws
        taken_up = is_registered
        if screw.frame == flange:
            is_open = is_registered or not len(targets.shared)
            is_turn = screw.axis.startswith("r")
            taken_up = is_open and (is_turn or not separate)
        if taken_up:
            placing.append(term)
    return replace(setup, terms=tuple(placing))


def _spread_over_targets(at: Problem, shared: Index) -> Problem:
    """Measure every configuration with every target that both campaigns have."""
    count = len(at)
    rows = np.arange(count)
    every = np.tile(rows, len(shared))
    repeated = at.take(every)
    target = np.repeat(shared, count)
    data = replace(repeated.data, target=target)
    return replace(repeated, data=data)


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
