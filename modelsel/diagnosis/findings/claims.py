"""Claims: how much of a finding is proven, level by level.

Place ("joint 4 turns"), drivers ("with its gravity torque"), shape ("in proportion to it"), cause
("its drive is compliant"). The probability of a level is the share of all explanations of the effect
that agree with it so far: those of the credible set, and shapes that no list has
(`unlisted_shapes`). Findings of one place are weighed together, too: one shape that no list has may
explain what several listed ones approximate. A finding claims the deepest level that holds."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from itertools import permutations
from typing import NamedTuple

import numpy as np

from ..._typing import Array
from ...fitting.problem import Problem
from ...mechanisms.motors import is_joint_motion
from ...mechanisms.terms import Mechanism
from ..candidates.candidate import Candidate
from ..candidates.signatures import LEVELS
from ..inference.evidence import MIN_LOG_ODDS, compute_factors, sum_evidence
from ..inference.sign_constraints import find_contrary_terms
from ..rivals.common_steps import generate_common_steps
from ..rivals.contenders import Contenders, gather_contenders
from ..rivals.finding_groups import FindingGroup, list_finding_groups
from ..rivals.joined_warm_ups import generate_joined_warm_ups
from ..rivals.stepped_waves import join_waves
from ..rivals.unlisted_shapes import Price, Rival, list_rivals
from ..search.mechanism_families import weigh_families
from ..search.state import Search
from ..search.views import View
from ..shapes.candidate_kinds import CandidateKind
from ..shapes.distinct_places import Place, find_alike
from .effects import Claim, find_level
from .sentences import has_contrary_signs
from .sure_drivers import sum_by_driver
from .told_explanations import find_agreed, find_constant, sum_constants
from .torque_functions import list_together
from .wave_aliases import list_aliases, weigh_aliases

# levels that findings of one place lose to one shape for all: their drivers stay the same
SHAPED = [LEVELS.index(level) >= LEVELS.index("shape") for level in LEVELS]

DRIVEN = LEVELS.index("drivers")

# displacement of a part of a joint's own function over another's up to which that one's shape stays:
# without it 0.97 of both together is left
SMALL_BESIDE = 0.25

# shapes of a part of a joint's range: a few add up to nearly any function
PIECES = (
    CandidateKind.RAMP,
    CandidateKind.JUMP,
    CandidateKind.BUMP,
    CandidateKind.KINK,
    CandidateKind.FREE_FUNCTION,
)


class Weighed(NamedTuple):
    """The probability (4,) of every level of effects by their candidates, that of each name that they
    depend on, candidates that tell some effects better: (the effects, the candidate), and further
    constants of these."""

    levels: dict[int, Array]
    drivers: dict[int, dict[str, float]]
    better: list[tuple[tuple[int, ...], Candidate]]
    constants: tuple[Candidate, ...] = ()


class WeighedAlone(NamedTuple):
    """The probability (4,) of each level of an effect, that of each name that it depends on, and what
    should be told instead, if anything: the rival that is clearly more probable, or the explanation on
    whose place and drivers most agree."""

    levels: Array
    drivers: dict[str, float]
    better: Candidate | None


def weigh_claims(search: Search, view: View, chosen: Sequence[int]) -> Weighed:
    """Weigh how deep each effect of a model is proven, given all the others."""
    levels: dict[int, Array] = {}
    drivers: dict[int, dict[str, float]] = {}
    better: list[tuple[tuple[int, ...], Candidate]] = []
    rivals = {g: list_rivals_beside(search, view, g) for g in chosen}
    groups = list_finding_groups(search.problem, {g: _price_together(search, g) for g in chosen})
    common = list(generate_common_steps(search, chosen))
    groups += [*common, *generate_joined_warm_ups(search, view, chosen)]
    contenders = _gather_all(search, view, rivals.values(), groups)
    for g in chosen:
        levels[g], drivers[g], shape = weigh_alone(search, g, rivals[g], contenders)
        if shape is not None:
            better.append(((g,), shape))
    for g, share in weigh_families(search, chosen, view).items():
        levels[g] = levels[g] * share
        drivers[g] = {name: share * p for name, p in drivers[g].items()}
    for g, share in weigh_families(search, chosen, view, one_place=True).items():
        levels[g] = np.where(SHAPED, levels[g] * share, levels[g])
    effects = {g: search.candidates[g] for g in chosen}
    joined = join_waves(search.problem, effects)
    better[:0] = [*joined, *list_together(search, view, chosen)]
    for group in groups:
        shares, shape = weigh_together(search, group, contenders)
        for g in group.members:
            levels[g] = levels[g] * shares
            drivers[g] = {name: shares[DRIVEN] * p for name, p in drivers[g].items()}
        if shape is not None:
            better.insert(0, (group.members, shape))
    for g, share in weigh_own_functions(search, view, chosen, levels).items():
        levels[g] = np.where(SHAPED, levels[g] * share, levels[g])
    for g, share in weigh_aliases(search, chosen).items():
        levels[g] = np.where(SHAPED, levels[g] * share, levels[g])
    constants = tuple(step for group in common for step in group.shapes)
    return Weighed(levels, drivers, better, constants)


def _gather_all(
    search: Search, view: View, rivals: Iterable[Sequence[Rival]], groups: Sequence[FindingGroup]
) -> Contenders:
    """Gather the rivals of all effects, and what stands in the place of several of them."""
    alone = [rival.candidate for own in rivals for rival in own]
    together = [one for group in groups for one in group.every]
    return gather_contenders(search, view, [*alone, *together])


def weigh_own_functions(
    search: Search, view: View, chosen: Sequence[int], levels: Mapping[int, Array]
) -> dict[int, float]:
    """Weigh how sure the shapes are of what else turns a joint with its own angle.

    Together these are one function of that angle: of one part the shape is proven only with those
    of the others, unless they are small beside it. Several pieces are a function of any shape,
    unless all are jumps."""
    shape = SHAPED.index(True)
    place = search.traits.signatures[0]
    own = [g for g in chosen if _is_own_function(search, g)]
    size = {g: _measure_displacement(search, g, view) for g in own}
    shares: dict[int, float] = {}
    for g, h in permutations(size, 2):
        if place[g] != place[h]:
            continue
        if _are_pieces(search, g, h):
            shares[g] = 0.0
        elif size[h] > SMALL_BESIDE * size[g]:
            least = shares.get(g, 1.0)
            level = levels[h][shape]
            shares[g] = min(least, float(level))
    return shares


def _measure_displacement(search: Search, g: int, view: View) -> float:
    """Measure how far [whitened] an effect moves all coordinates together."""
    displacement = search.compute_displacement(g, view)
    norm = np.linalg.norm(displacement)
    return float(norm)


def _are_pieces(search: Search, *both: int) -> bool:
    """Whether two functions of one angle are pieces of it that are not both jumps."""
    kinds = {search.candidates[g].kind for g in both}
    only_jumps = kinds == {CandidateKind.JUMP}
    return kinds <= set(PIECES) and not only_jumps


def _is_own_function(search: Search, g: int) -> bool:
    """Return whether a candidate turns one joint by a function of its own angle, or by one of any shape
    of that and more."""
    candidate = search.candidates[g]
    joint = find_moved_joint(search.problem, candidate)
    if joint is None:
        return False
    drivers = candidate.mechanism.names()
    own = {f"q{joint}"}
    has_any_shape = candidate.kind is CandidateKind.SHAPE
    return own <= drivers if has_any_shape else drivers == own


def list_rivals_beside(search: Search, view: View, g: int) -> list[Rival]:
    """List the rivals of an effect, without those that another effect rules out."""
    taken = search.list_bumped_beside(g, view)
    every = list_rivals(search.problem, search.candidates[g], price_rivals(search, g))
    return [one for one in every if one.candidate.bumped_joint not in taken]


def _price_together(search: Search, g: int) -> Candidate:
    """Give a candidate the prior probability of its whole question."""
    price = price_rivals(search, g)
    return replace(search.candidates[g], prior=max(price))


def price_rivals(search: Search, g: int) -> Price:
    """Price the rivals of a candidate by all candidates of its question, and by a cell of the error map."""
    candidates = search.candidates
    finding = sum_constants(candidates, g)
    cell = search.traits.cell_prior or finding
    return Price(finding, cell)


def weigh_alone(
    search: Search, g: int, rivals: Sequence[Rival], contenders: Contenders
) -> WeighedAlone:
    """Weigh an effect of a model against its credible set and its rivals, which are among the
    contenders."""
    own = search.candidates[g]
    view = contenders.view
    # not kept with the name: of all effects and models they would be many
    scan, response = search.scan_without(g, view)
    listed = compute_factors(scan, response)
    named = search.rename(g, view).named
    log_prior = np.where(np.isfinite(named.log_probability), search.log_prior, -np.inf)
    others = [rival.candidate for rival in rivals]
    joint = listed
    if others:
        joint = np.hstack([listed, contenders.weigh([own], others)])
        log_prior = np.append(log_prior, np.log([other.prior for other in others]))
    value, logs = sum_evidence(joint, log_prior)
    if not np.isfinite(value):
        return WeighedAlone(np.zeros(len(LEVELS)), {}, None)
    count = len(search.candidates)
    probability = np.exp(logs - value)
    of_listed = [float(probability[:count][mask].sum()) for mask in _agree(search, g)]
    of_rivals = [_sum_agreeing(rivals, probability[count:], level) for level in LEVELS]
    levels = np.add(of_listed, of_rivals)
    if _is_contrary(own.mechanism, view):
        levels[-1] = 0.0
    weighed = WeighedAlone(levels, sum_by_driver(search, g, probability, rivals), None)
    # what differs in its constant alone is asked last, whatever the priors
    unlike = [k for k, rival in enumerate(rivals) if rival.agrees != "shape"]
    best = max(unlike, key=lambda k: logs[count + k], default=-1)
    most = max(probability[:count].max(), of_listed[SHAPED.index(True)])
    if unlike and probability[count + best] > np.exp(MIN_LOG_ODDS) * most:
        return weighed._replace(better=others[best])
    agreed = find_agreed(search.traits.signatures, g, probability[:count], levels)
    if agreed is not None:
        return weighed._replace(better=search.candidates[agreed])
    known = np.isfinite(log_prior)
    evidence = np.full_like(logs, -np.inf)
    np.subtract(logs, log_prior, out=evidence, where=known)
    constant = find_constant((*search.candidates, *others), g, evidence)
    return weighed._replace(better=constant)


def _is_contrary(mechanism: Mechanism, view: View) -> bool:
    """Whether a mechanism is fitted with a sign that is not its own."""
    fitted = view.fitted
    terms = fitted.locate(mechanism)
    estimate = fitted.theta[terms]
    if has_contrary_signs(mechanism, estimate):
        return True
    error = fitted.standard_errors[terms]
    contrary = find_contrary_terms(mechanism, estimate, error)
    return bool(contrary.any())


def _agree(search: Search, g: int) -> list[Array]:
    """Mask (4, G) the candidates that agree with candidate g up to each level, and other forms of it."""
    masks: list[Array] = []
    form = search.traits.forms[g]
    other_forms = (search.traits.forms == form) & (form >= 0)
    agree = np.ones(len(search.candidates), bool)
    for known in search.traits.signatures:
        own = known[g]
        says = own >= 0
        same = known == own
        agree = agree & same & says
        masks.append(agree | other_forms)
    return masks


def _sum_agreeing(rivals: Sequence[Rival], probability: Array, level: str) -> float:
    """Sum the probabilities (A,) of the rivals that agree with a finding up to a level."""
    start = LEVELS.index(level)
    as_deep = LEVELS[start:]
    agreeing = [rival.agrees in as_deep for rival in rivals]
    total = probability[agreeing].sum()
    return float(total)


def weigh_together(
    search: Search, group: FindingGroup, contenders: Contenders
) -> tuple[Array, Candidate | None]:
    """Weigh several findings of one place against one shape that no list has.

    Returns the share (4,) of every level that is left to the findings, and the shape if it is clearly
    more probable."""
    which = group.every
    effects = [search.candidates[g] for g in group.members]
    factors = contenders.weigh(effects, which)
    value, logs = sum_evidence(factors, np.log([candidate.prior for candidate in which]))
    shares = np.ones(len(LEVELS))
    if not np.isfinite(value):
        return shares, None
    probability = np.exp(logs - value)
    shares[SHAPED] = probability[0]
    own = 1 + len(group.shapes)
    shares[DRIVEN] = probability[:own].sum()
    best = int(np.argmax(logs))
    is_better = best > 0 and logs[best] - logs[0] > MIN_LOG_ODDS
    return shares, which[best] if is_better else None


def build_claim(problem: Problem, told: Candidate, levels: Array) -> Claim:
    """Claim the deepest level that holds; the place where none does.

    `told`: the candidate without the screws that hardly move the target."""
    # what a level says holds no more than what it builds on
    nested = np.minimum.accumulate(np.minimum(levels, 1.0))
    bounded = tuple(float(p) for p in nested)
    acts = tuple(told.mechanism.names_by_place().items())
    moves_joints = all(is_joint_motion(problem.robot, place) for place, _ in acts)
    alike: tuple[Place, ...] = ()
    if len(acts) == 1:
        ((place, _),) = acts
        alike = find_alike(problem.robot, place)
    claim = Claim(find_level(bounded), bounded, moves_joints, acts, alike)
    return replace(claim, waves=list_aliases(problem, told))


def find_moved_joint(problem: Problem, candidate: Candidate) -> int | None:
    """Find the one joint along whose motion alone a candidate acts; None for any other."""
    places = list(candidate.mechanism.names_by_place())
    if len(places) != 1:
        return None
    (place,) = places
    frame, _ = place
    return frame if is_joint_motion(problem.robot, place) else None
