"""Waves of the drives beyond those that every search offers: 61 to 330 a turn.

Strain-wave gears err twice a turn of their motor, which is 100 to 320 times a turn of the joint, and a
large gear has as many teeth. As candidates of every search such waves would double the columns, and
take their share of the prior. So what a search has left is screened for them (`wave_screen`), given the
errors of the instrument alone: as part of a joint that does not repeat, a wave would be explained
away. Where one is beyond chance, the best few numbers are offered, and the search goes on with them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from .._typing import Array, Mask
from ..fitting.problem import Problem
from ..mechanisms.drives import HIGH_WAVES, WAVES, gear_ripple
from ..mechanisms.motors import is_coupled
from ..mechanisms.terms import Mechanism
from ..mechanisms.waves import find_common_wave
from .candidates.candidate import Candidate
from .candidates.candidate_list import find_cell_prior
from .findings.wave_aliases import list_aliases
from .inference.wave_screen import Counts, see_remains
from .reshaping import go_on_with
from .search.stepwise import Exploration
from .shapes.candidate_kinds import CandidateKind
from .shapes.shape_constants import find_own_wave
from .shapes.unregistered import RARE_WEIGHT, build_wave

RIPPLE = "gear-ripple"
# numbers that are screened: whole ones, and halves between, of gears ahead of the joint
STEP = 0.5
FIRST, LAST = HIGH_WAVES[0], HIGH_WAVES[-1]
STEPS = round((LAST - FIRST) / STEP)
SCREENED = Counts(float(FIRST), STEP, STEPS + 1)
# how often chance alone lets any of all waves of all drives pass the screen
LEVEL = 0.01
# numbers beside the best one that are offered: so far off, at such distances
AROUND, QUARTER = 1.0, 0.25
# log odds against the best number up to which others are offered, and how many of these at most
COMPARABLE, MOST_OTHERS = 12.0, 8
# differences of log odds that are rounding
ROUNDING = 1e-6
# waves a turn from which a chosen wave's harmonics are told from others, and the least of these: a motor
# may err once and twice a turn
FEWEST_WAVES, LEAST_MULTIPLE = 10, 3
# waves that are looked for one after the other
MOST_WAVES = 8


class _Ripple(NamedTuple):
    """A drive whose ripple is scanned: one of its candidates, and the prior probability of all of them."""

    one: Candidate
    prior: float


def find_high_waves(
    explored: Exploration, problem: Problem
) -> tuple[Exploration, tuple[Candidate, ...]]:
    """Go on with the high waves that a search has left, one after the other.

    `problem`: that of the search, weighed by the errors of the instrument alone. Returns the search, and
    what it was offered: nothing where it has found none of it."""
    offered: list[Candidate] = []
    for _ in range(MOST_WAVES):
        more = list_high_waves(explored, problem)
        if not more:
            break
        further = go_on_with(explored, more)
        if not set(more) & set(further.chosen):
            break
        explored = further
        offered += more
    return explored, tuple(offered)


def list_high_waves(explored: Exploration, problem: Problem) -> list[Candidate]:
    """List the high waves that explain more of what a search has left than chance would, as candidates.

    With J drives and K numbers each, J K waves are tried: one is beyond chance where so much is explained
    with a probability of less than LEVEL / (J K), so that any of them is by chance in less than LEVEL of
    all searches (Bonferroni's bound; neighbouring numbers hardly differ, so that it is far less). That
    holds for independent, equally normal errors of the rows, or of the drive; of unequal ones the signs of the
    residual's own rows are the referee, drawn for the waves of that drive. Whether a wave is named, the
    search decides by its own rules. Nor is a wave offered that explains less than a tenth of what is left along its drive's motion:
    the noise would hardly be less, and many rows show some beyond chance wherever a model errs a little.
    Multiples of a wave that the search has chosen, three times as many or more, are left to shapes of that
    wave, such as a square one. Drives whose ripple is not scanned are left out; so are all where distances are measured between two
    configurations, where a turn of the drive has two readings in one row."""
    search = explored.search
    ripples = find_ripples(problem, search.candidates)
    if not ripples or problem.origin is not None:
        return []
    remains = see_remains(problem, explored.fitted, list(ripples))
    known = {candidate.mechanism for candidate in search.candidates}
    cell = find_cell_prior(search.candidates)
    more: list[Candidate] = []
    bound = compute_bound(len(ripples))
    block = problem.data.block
    for joint, own in remains.items():
        chance = own.compute_chance(SCREENED, bound)
        if not chance.any():
            continue
        if own.compute_sign_p(SCREENED, block) > LEVEL:
            continue
        ripple = ripples[joint]
        chance[_find_multiples(explored, joint, own.angles)] = 0.0
        numbers = _choose_numbers(problem, joint, chance)
        for number in numbers:
            candidate = _build_candidate(problem, joint, number, ripple, cell)
            is_new = candidate.mechanism not in known
            if candidate.prior and is_new:
                more.append(candidate)
    return more


def _find_multiples(explored: Exploration, joint: int, angles: Array) -> Mask:
    """Find (K,) the numbers that are whole multiples, LEAST_MULTIPLE or more, of a wave that a search has
    chosen for a joint: what is no sine has such harmonics. Over a part of a turn, `angles` (m,), numbers
    beside them look much the same."""
    numbers = SCREENED.values
    width = 2 * np.pi / max(np.ptp(angles), STEP)
    found = np.zeros(len(numbers), bool)
    for candidate in explored.chosen:
        own, count = find_own_wave(candidate.mechanism)
        if own != joint or not FEWEST_WAVES <= count <= WAVES[-1]:
            continue
        multiple = numbers / count
        nearest = np.round(multiple)
        distance = np.abs(numbers - nearest * count)
        is_near = distance <= width
        found |= is_near & (nearest >= LEAST_MULTIPLE)
    return found


def compute_bound(drives: int) -> float:
    """Compute the logarithm of the probability below which a wave of one of some drives is beyond chance."""
    tried = drives * SCREENED.number
    level = LEVEL / tried
    bound = np.log(level)
    return float(bound)


def find_ripples(problem: Problem, found: Sequence[Candidate]) -> Mapping[int, _Ripple]:
    """Find the drives whose ripple is scanned: with more than one number, as the built-in mechanism."""
    by_name: dict[str, list[Candidate]] = {}
    for one in found:
        mechanism = one.mechanism
        if one.registered and mechanism.stem == RIPPLE:
            own = by_name.setdefault(mechanism.name, [])
            own.append(one)
    ripples: dict[int, _Ripple] = {}
    for own in by_name.values():
        first, *others = own
        joint = _find_rippling(problem, first)
        if joint and others:
            priors = [one.prior for one in own]
            total = sum(priors)
            ripple = _Ripple(first, total)
            ripples[joint] = ripple
    return ripples


def _find_rippling(problem: Problem, one: Candidate) -> int:
    """Find the drive of which a candidate is a ripple as it is built in; 0 of any other."""
    mechanism = one.mechanism
    causes = []
    for term in mechanism.terms:
        first = term.screws[0]
        causes.append(first.cause)
    wave = find_common_wave(causes)
    _, _, joint = mechanism.name.partition(":")
    if wave is None or not joint.isdecimal():
        return 0
    number = int(joint)
    _, count = wave
    built = gear_ripple(problem.robot, number, count)
    if mechanism != built:
        return 0
    return number


def _choose_numbers(problem: Problem, joint: int, chance: Array) -> list[float]:
    """Choose the numbers that are offered: the best one and those around it, and others that explain
    nearly as much, but for those that do the same at these readings. Of these the lowest is told, with the
    others' numbers."""
    best = float(chance.min())
    if not best:
        return []
    is_best = chance <= best * (1 - ROUNDING)
    numbers = SCREENED.values
    top = float(numbers[is_best][0])
    around = np.arange(top - AROUND, top + AROUND + QUARTER, QUARTER)
    inside = around[(around >= FIRST) & (around <= LAST)].tolist()
    aside = set(_list_alike(problem, joint, inside))
    others: list[float] = []
    for k in np.argsort(chance, kind="stable"):
        number = float(numbers[k])
        if chance[k] > best + COMPARABLE or len(others) == MOST_OTHERS:
            break
        if number.is_integer() and number not in aside:
            others.append(number)
            aside.update(_list_alike(problem, joint, [number]))
    return [*inside, *others]


def _list_alike(problem: Problem, joint: int, numbers: Sequence[float]) -> Iterator[float]:
    """List some numbers of waves, and those that do the same at all readings."""
    for number in numbers:
        yield number
        if number.is_integer():
            yield from list_aliases(problem, _build_ripple(problem, joint, number))


def _build_ripple(problem: Problem, joint: int, number: float) -> Candidate:
    robot = problem.robot
    mechanism = gear_ripple(robot, joint, number)
    kind = CandidateKind.MECHANISM
    return Candidate(mechanism, kind, 0.0)


def _build_candidate(
    problem: Problem, joint: int, number: float, ripple: _Ripple, cell: float
) -> Candidate:
    """Build the candidate of a drive's wave. The whole numbers share as much as the name of the ripple
    has beside them, and those between weigh as much less as lower ones do."""
    robot = problem.robot
    count = len(HIGH_WAVES)
    if number.is_integer():
        whole = int(number)
        mechanism: Mechanism = gear_ripple(robot, joint, whole)
        prior = ripple.prior / count
        return replace(ripple.one, mechanism=mechanism, prior=prior)
    between = build_wave(joint, number)
    prior = 0.0
    if not is_coupled(robot, joint):
        share = len(WAVES) / count
        prior = cell * RARE_WEIGHT * share
    return Candidate(between, CandidateKind.JOINT_WAVE, prior)
