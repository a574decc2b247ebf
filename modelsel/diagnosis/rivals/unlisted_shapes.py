"""Shapes that no list has, as rivals of a finding: what else could stand where an effect was named.

A rival is a free function of the finding's own drivers at its places, of one driver more or less or
another one there, or of its own drivers at another place; or the finding's own shape, changing along
the campaign. Beforehand, unlisted shapes of given drivers at a given place are half as probable
together as what is listed of these there: of the finding's own as the finding, whatever its constant,
elsewhere as a cell of the error map. What changes with some further driver is a tenth as probable as
the finding, what changes in size along the campaign a twentieth, and so is a link that moved beside a step.
To a wave, a bump and a warm-up come those with
constants near its own, which are one question with it; to a covariate what else changed when it did."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

from ...fitting.problem import Problem
from ...measurements.campaign.state_names import is_where_target_is
from ...mechanisms.terms import Mechanism
from ..candidates.candidate import Candidate
from ..candidates.signatures import leave_out_sides
from ..shapes.candidate_kinds import CandidateKind
from ..shapes.driver_functions import IN_TIME
from ..shapes.joint_bumps import generate_bumps, generate_finer_bumps
from ..shapes.late_temperatures import is_late
from ..shapes.time_waves import generate_finer_time_waves
from ..shapes.torque_powers import generate_powers
from ..shapes.unregistered import RARE_WEIGHT
from .changing_ripples import generate_loaded_ripples, generate_turning_ripples
from .changing_shapes import generate_changing
from .confounded_covariates import generate_confounded
from .covariate_shapes import (
    generate_by_covariates,
    generate_instead_of_time,
    generate_wave_products,
)
from .field_distortions import generate_distortions
from .finer_waves import generate_finer_waves
from .free_functions import (
    Drivers,
    generate_more_drivers,
    generate_other_drivers,
    generate_other_places,
    generate_shapes,
)
from .joint_drags import generate_drags_instead, generate_other_widths
from .kinks import generate_finer_kinks, generate_kinks
from .moved_links import find_moved_frame, generate_moved_links
from .pair_waves import generate_waves_together
from .simple_shapes import generate_products, generate_pulls, generate_saws, generate_soft_lags
from .soft_shapes import DISTINCT, generate_soft_springs, generate_soft_steps
from .stepped_waves import generate_other_moments, generate_stepped_waves
from .tool_falls import generate_falls
from .uneven_bases import generate_uneven_beside
from .warm_ups import generate_finer_warm_ups

# places times drivers from which a finding acts in too many ways for one free function
MAX_PARTS = 6
# simple shapes of a finding's drivers at its place
SIMPLE = {
    generate_bumps: CandidateKind.BUMP,
    generate_products: CandidateKind.SHAPE,
    generate_wave_products: CandidateKind.SHAPE,
    generate_soft_lags: CandidateKind.SOFT_LAG,
    generate_drags_instead: CandidateKind.HYSTERESIS,
    generate_saws: CandidateKind.SAW,
    generate_pulls: CandidateKind.PULL,
    generate_kinks: CandidateKind.KINK,
    generate_powers: CandidateKind.POWER,
    generate_waves_together: CandidateKind.WAVE,
    generate_distortions: CandidateKind.DISTORTION,
    generate_loaded_ripples: CandidateKind.RIPPLE,
    generate_turning_ripples: CandidateKind.RIPPLE,
}
# kinds with a constant that the data tell better than it is looked for, and what such shapes agree in
FINER = {
    CandidateKind.BUMP: (generate_finer_bumps, "drivers"),
    CandidateKind.HYSTERESIS: (generate_other_widths, "shape"),
    CandidateKind.KINK: (generate_finer_kinks, "shape"),
    CandidateKind.STEPPED_WAVE: (generate_other_moments, "shape"),
}
# kinds of waves, whose number may lie between those that are looked for
OF_ANY_NUMBER = (CandidateKind.JOINT_WAVE, CandidateKind.SLIDE_WAVE, CandidateKind.TIME_WAVE)
# prior probability of a finding whose shape changes with some further driver over that of the finding
MORE_DRIVERS = 0.1
# prior probability of all unlisted shapes of some drivers at a place over that of the listed ones
UNLISTED_ODDS = 0.5
# prior probability of a finding that changes along the campaign over that of the finding
CHANGING = 0.05
# prior probability that a link moved, over that of the step that it may pass for
MOVED_LINK = 0.05


@dataclass(frozen=True)
class Rival:
    """Another explanation of a finding, with what it agrees in: "shape" (all but its constant),
    "drivers" (and so the place), "place" (other drivers there), or "" (another place); `stands_for`: what
    it depends on, where its formula has the course of that in time instead."""

    candidate: Candidate
    agrees: str
    stands_for: Drivers | None = None


class Price(NamedTuple):
    """Prior probabilities that those of rivals are set against: of a finding with any constant of its
    shape, and of a listed explanation of one driver at any place."""

    finding: float
    cell: float


def list_rivals(problem: Problem, candidate: Candidate, price: Price | None = None) -> list[Rival]:
    """List the shapes that no list has beside a candidate, with their prior probabilities.

    None where the study considers no causes but those that it lists. `price`: by default the finding
    is as probable as any other."""
    parts = candidate.mechanism.names_by_place()
    if candidate.asked or not parts:
        return []
    price = price or Price(candidate.prior, candidate.prior)
    confounded = list(_list_confounded(problem, candidate, price.finding))
    share = _share_of_lag(candidate, price)
    most = max(price)
    alike = share * most
    if len(parts) > MAX_PARTS:
        return confounded
    own = candidate.mechanism
    more = list(generate_more_drivers(problem, own))
    changing = list(generate_changing(problem, own))
    stepped = list(generate_stepped_waves(problem, own))
    by_covariates = list(generate_by_covariates(problem, own))
    return [
        *_list_alike(problem, candidate, alike),
        *_list_falls(problem, candidate, most),
        *_list_moved_links(problem, candidate, price),
        *_list_finer_waves(problem, candidate),
        *_list_finer(problem, candidate),
        *_list_elsewhere(problem, candidate, price.cell, share),
        *_weigh(more, "place", MORE_DRIVERS * alike),
        # with this very constant
        *_weigh(changing, "place", CHANGING * candidate.prior),
        *_weigh(by_covariates, "place", CHANGING * candidate.prior),
        *_weigh(stepped, "place", CHANGING * most, CandidateKind.STEPPED_WAVE),
        *_list_instead_of_time(problem, candidate, price.finding),
        *confounded,
    ]


def _list_alike(problem: Problem, candidate: Candidate, prior: float) -> Iterator[Rival]:
    """List unlisted shapes of a finding's own drivers at its places: free functions, and simple ones."""
    own = candidate.mechanism
    drivers = own.names()
    free = [m for m in generate_shapes(problem, own.names_by_place()) if m != own]
    simple = [
        (kind, [m for m in generate(problem, own) if m != own]) for generate, kind in SIMPLE.items()
    ]
    springs = list(generate_soft_springs(problem, own))
    steps = list(generate_soft_steps(problem, own))
    sorts = 1 + sum(bool(mechanisms) for _, mechanisms in simple) + bool(springs or steps)
    share = UNLISTED_ODDS * prior / sorts
    yield from _weigh(free, "drivers", share)
    for kind, mechanisms in simple:
        yield from _weigh(mechanisms, _compare_drivers(mechanisms, drivers), share, kind)
    # all of the odds each: the exponent of the power that was found has cost it nothing, either
    yield from _weigh(springs, "drivers", UNLISTED_ODDS * prior * len(springs))
    yield from _weigh(steps, "drivers", DISTINCT * share)


def _list_falls(problem: Problem, candidate: Candidate, prior: float) -> Iterator[Rival]:
    """List falls of the target across the flange. In other directions than a found one's they are the
    same shape where they have its places."""
    own = candidate.mechanism
    places = own.names_by_place().keys()
    falls = [fall for fall in generate_falls(problem, own) if fall != own]
    agrees = "shape" if candidate.kind is CandidateKind.FALL else "place"
    for rival in _weigh(falls, "", UNLISTED_ODDS * prior, CandidateKind.FALL):
        own_places = rival.candidate.mechanism.names_by_place().keys()
        yield replace(rival, agrees=agrees) if own_places == places else rival


def _list_moved_links(problem: Problem, candidate: Candidate, price: Price) -> Iterator[Rival]:
    """List steps of what follows a link, about when a found step happened: of the same link they are the
    same shape."""
    own = candidate.mechanism
    kind = CandidateKind.MOVED_LINK
    frame = find_moved_frame(own)
    moved = list(generate_moved_links(problem, own))
    if own in moved:
        moved.remove(own)
    prior = MOVED_LINK * price.finding
    if candidate.kind is kind:
        # as each had been beside what it was found in place of
        prior = candidate.prior * len(moved)
    for rival in _weigh(moved, "", prior, kind):
        other = rival.candidate.mechanism
        is_own = find_moved_frame(other) == frame
        yield replace(rival, agrees="shape") if is_own else rival


def _share_of_lag(candidate: Candidate, price: Price) -> float:
    """Share what has a candidate's lag, as free functions of that late temperature do: all lags together
    are as probable as one that has none."""
    if not is_late(candidate.mechanism):
        return 1.0
    return candidate.prior / price.finding


def _list_elsewhere(
    problem: Problem, candidate: Candidate, prior: float, share: float
) -> Iterator[Rival]:
    """List free functions of other drivers, or, with a `share` of the prior, at other places."""
    own = candidate.mechanism
    odds = UNLISTED_ODDS * prior
    for mechanisms in generate_other_drivers(problem, own):
        yield from _weigh(mechanisms, "place", odds)
    for mechanisms in generate_other_places(problem, own):
        yield from _weigh(mechanisms, "", share * odds)
    agrees = "place" if candidate.kind is CandidateKind.UNEVEN_BASE else ""
    tilts = list(generate_uneven_beside(problem, own))
    yield from _weigh(tilts, agrees, odds, CandidateKind.UNEVEN_BASE)


def _list_instead_of_time(problem: Problem, candidate: Candidate, prior: float) -> Iterator[Rival]:
    """List covariates in the place of time: each as probable as the finding in time."""
    own = candidate.mechanism
    for mechanisms in generate_instead_of_time(problem, own):
        yield from _weigh(mechanisms, "place", prior)


def _list_confounded(problem: Problem, candidate: Candidate, prior: float) -> Iterator[Rival]:
    """List what else changed when a finding's covariate did: together as probable as the finding."""
    own = candidate.mechanism
    sorts = list(generate_confounded(problem, own))
    for mechanisms, kind, covariate in sorts:
        stands_for = None
        if covariate is not None:
            others = own.names() - IN_TIME
            stands_for = others | {covariate}
        share = prior / len(sorts)
        for rival in _weigh(mechanisms, "place", share, kind):
            yield replace(rival, stands_for=stands_for)


def _compare_drivers(mechanisms: Sequence[Mechanism], drivers: Drivers) -> str:
    """Say what shapes agree in with a finding of some drivers: "drivers", or "place" where they have
    others. A last move says its side, too; a side does not say how far the move was."""
    own = leave_out_sides(drivers)
    agree = all(_is_alike(leave_out_sides(m.names()), own) for m in mechanisms)
    return "drivers" if agree else "place"


def _is_alike(drivers: Drivers, others: Drivers) -> bool:
    """Return whether drivers are the same, or both only say where the target is."""
    if drivers == others:
        return True
    both = drivers | others
    return bool(drivers and others) and all(map(is_where_target_is, both))


def _list_finer_waves(problem: Problem, candidate: Candidate) -> Iterator[Rival]:
    """List waves of about as many a turn as a found one: the same shape, but for a registered ripple,
    whose whole number is likelier."""
    kind = candidate.kind
    agrees, prior = "shape", candidate.prior
    if candidate.registered:
        kind = CandidateKind.JOINT_WAVE
        agrees = "drivers"
        prior *= RARE_WEIGHT
    if kind not in OF_ANY_NUMBER:
        return
    own = candidate.mechanism
    waves = [*generate_finer_waves(problem, own), *generate_finer_time_waves(problem, own)]
    yield from _weigh(waves, agrees, prior, kind)


def _list_finer(problem: Problem, candidate: Candidate) -> Iterator[Rival]:
    """List what differs from a finding in its constant alone, and not much in that: the same shape, but
    for bumps, of which few readings leave their height, width and shape one question."""
    kind = candidate.kind
    own = candidate.mechanism
    prior = candidate.prior
    warm_ups = list(generate_finer_warm_ups(problem, own))
    yield from _weigh(warm_ups, "shape", prior, kind)
    if kind in FINER:
        generate, agrees = FINER[kind]
        finer = list(generate(problem, own))
        yield from _weigh(finer, agrees, prior, kind)


def _weigh(
    mechanisms: Sequence[Mechanism],
    agrees: str,
    prior: float,
    kind: CandidateKind = CandidateKind.SHAPE,
) -> Iterator[Rival]:
    for mechanism in mechanisms:
        count = len(mechanisms)
        share = prior / count
        candidate = Candidate(mechanism, kind, share)
        yield Rival(candidate, agrees)
