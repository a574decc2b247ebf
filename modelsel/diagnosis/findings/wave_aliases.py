"""Waves that the readings cannot tell apart.

Where a joint's readings stand on a grid of angles, waves of several numbers a turn are the same at
all of them (aliasing: Shannon 1949, Proc. IRE 37, 10): every 10°, 8 a turn, 28 and 44. The number is
then no more proven than one of them, and off the grid they differ."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..._typing import Array
from ...fitting.problem import Problem
from ...mechanisms.drives import HIGH_WAVES, WAVES
from ..candidates.candidate import Candidate
from ..inference.credible_sets import ALIKE
from ..search.state import Search
from ..shapes.shape_constants import find_own_wave

# largest number of waves a turn that is looked for, and the one up to which each is as likely as a lower
# one: two a turn of its motor, by strain-wave gears of up to 80 to 1
MOST_WAVES, USUAL_WAVES = HIGH_WAVES[-1], 160
RIPPLE = "gear-ripple"
TURN = 2 * np.pi


def list_aliases(problem: Problem, candidate: Candidate) -> tuple[int, ...]:
    """List the numbers of waves a turn that do the same at all readings as a wave of a joint's own
    angle; none for any other candidate. Neighbours, which the range of the readings does not tell
    apart, are not among them."""
    joint, count = find_own_wave(candidate.mechanism)
    if not count or problem.robot.joints[joint - 1].prismatic:
        return ()
    angles = problem.data.q[:, joint - 1]
    span = float(np.ptp(angles))
    if not span:
        return ()
    numbers = np.arange(1.0, MOST_WAVES + 1)
    is_other = np.abs(numbers - count) > TURN / span
    share = _compute_share(angles, count, numbers)
    alike = numbers[is_other & (share > ALIKE**2)]
    return tuple(int(number) for number in alike)


def _compute_share(angles: Array, count: float, numbers: Array) -> Array:
    """Compute how much (W,) of the waves of some numbers a wave of one number explains at the angles;
    0 of those that are constant there."""
    basis, _ = np.linalg.qr(_centre_waves(angles, np.array([count])))
    waves = _centre_waves(angles, numbers)
    squares = np.square(waves).sum(0)
    within = np.square(basis.T @ waves).sum(0)
    whole = squares.reshape(2, -1).sum(0)
    explained = within.reshape(2, -1).sum(0)
    varies = whole > ALIKE * len(angles) / 2
    share: Array = np.zeros(len(numbers))
    np.divide(explained, whole, out=share, where=varies)
    return share


def _centre_waves(angles: Array, numbers: Array) -> Array:
    """Build the cosines, then the sines (m, 2 W), of waves of some numbers, less their means."""
    phases = np.outer(angles, numbers)
    waves = np.hstack([np.cos(phases), np.sin(phases)])
    return np.asarray(waves - waves.mean(0))


def weigh_aliases(search: Search, chosen: Sequence[int]) -> dict[int, float]:
    """Weigh how sure the numbers of waves are that some effects have: their prior probability among
    that of all that do the same.

    Numbers that are candidates of another name are weighed as such; of a wave that was screened, all are
    alike."""
    shares = {}
    for g in chosen:
        own = search.candidates[g]
        aliases = list_aliases(search.problem, own)
        if not aliases:
            continue
        others = _price_numbers(search, own, aliases)
        total = own.prior + others
        shares[g] = own.prior / total
    return shares


def _price_numbers(search: Search, own: Candidate, numbers: Sequence[int]) -> float:
    """Price the numbers of waves that do the same as a candidate and are none themselves."""
    joint, count = find_own_wave(own.mechanism)
    ripple = f"{RIPPLE}:{joint}"
    last = WAVES[-1]
    is_ripple = own.registered_name == ripple
    counted = [n for n in numbers if is_ripple or n > last]
    if count > last:
        return own.prior * len(counted)
    priors = (c.prior for c in search.candidates if c.registered_name == ripple)
    prior = max(priors, default=0.0)
    weights = map(_weigh_number, counted)
    return prior * sum(weights)


def _weigh_number(number: int) -> float:
    """Weigh a number of waves beside one that is looked for in every search: as what is screened, if it is
    higher than usual."""
    if number <= USUAL_WAVES:
        return 1.0
    lower = len(WAVES)
    higher = len(HIGH_WAVES)
    return lower / higher
