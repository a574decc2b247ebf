"""Joint offsets: zeros that are off by any angle and links that the nominal arm has wrong, fitted
exactly together with the set-up.

One number of the arm at a time is fitted on the exact chain (`offset_fits`), a zero from the angles
at which an affine map from the tracker would do best; then a second, a third and a fourth from where
the best ended."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import product

import numpy as np

from .._typing import Array
from ..fitting.problem import Problem
from .linear_scores import score_linearly
from .offset_arms import Arm, build_nominal_arm
from .offset_fits import fit_offsets, measure_arms, place_arms
from .offset_words import REST_RANGE, describe_offsets
from .simple_mistakes import Mistake

# angles of a joint's zero that are tried, and how many of the best are fitted from
ANGLE_STEP = np.pi / 18
PEAKS = 2
# share to which each more number must bring what is left for a next to be looked for
MIN_FALL = 0.8
# numbers of the arm that are wrong at once, and links among them
MAX_PARTS = 4
MAX_LINKS = 2
# resting joints whose angles are looked for together, and the angles that are tried
MAX_RESTING = 3
THIRDS = (-2 * np.pi / 3, 0.0, 2 * np.pi / 3)


def _link_numbers(n: int, j: int) -> list[int]:
    """List the indices of the lengths of joint j's link among the numbers of an arm."""
    first = n + 3 * j
    beyond = first + 3
    numbers = range(first, beyond)
    return list(numbers)


def fit_each_zero(problem: Problem, set_up: bool) -> Iterator[tuple[Mistake, Arm]]:
    """Fit every joint's zero, off by any angle, one at a time."""
    nominal = build_nominal_arm(problem)
    starts = []
    free = []
    for j, slides in enumerate(problem.robot.prismatic):
        peaks = [] if slides else _find_peaks(problem, j, set_up)
        starts += [nominal, *peaks]
        free += [[j]] * (1 + len(peaks))
    fitted = fit_offsets(problem, starts, free, set_up)
    misfits = measure_arms(problem, fitted)
    for j in range(problem.robot.n):
        of_joint = [k for k, numbers in enumerate(free) if numbers == [j]]
        best = min(of_joint, key=misfits.__getitem__)
        yield from _describe(problem, fitted[best])


def _find_peaks(problem: Problem, j: int, set_up: bool) -> list[Arm]:
    """Find the arms with a zero of joint j, among angles all around, that promise most, and place
    them where the placement is free."""
    n = problem.robot.n
    nominal = build_nominal_arm(problem)
    unit = np.eye(n)[j]
    arms = []
    for step in range(1, 36):
        angle = step * ANGLE_STEP
        zeros = angle * unit
        arm = replace(nominal, zeros=zeros)
        arms.append(arm)
    if not set_up:
        misfit = measure_arms(problem, arms)
        return _select_least(arms, misfit)
    mistakes = []
    for arm in arms:
        mistake = Mistake(words="", look="", A=np.eye(n), c=arm.zeros, B=np.eye(3))
        mistakes.append(mistake)
    misfit, _ = score_linearly(problem, mistakes)
    peaks = _select_least(arms, misfit)
    return place_arms(problem, peaks)


def _select_least(arms: Sequence[Arm], misfit: Array) -> list[Arm]:
    """Select the PEAKS arms of the least misfit."""
    likeliest = np.argsort(misfit, kind="stable")
    return [arms[k] for k in likeliest[:PEAKS]]


def fit_each_link(problem: Problem, set_up: bool) -> Iterator[tuple[Mistake, Arm]]:
    """Fit every link's a b c, off by any length, one link at a time."""
    n = problem.robot.n
    nominal = build_nominal_arm(problem)
    # a set-up found from the rows takes up the first link
    first = 1 if set_up else 0
    free = [_link_numbers(n, j) for j in range(first, n)]
    count = len(free)
    starts = [nominal] * count
    fitted = fit_offsets(problem, starts, free, set_up)
    for arm in fitted:
        yield from _describe(problem, arm)


def fit_several(
    problem: Problem, good: float, first: Sequence[Arm], links: bool = True
) -> Iterator[tuple[Mistake, Arm]]:
    """Fit several offsets at once that leave no more than `good` [mm]: zeros, those of joints that
    rest, then, with `links`, links too.

    Starts from the best of the arms that were fitted `first`, and always adds the offset that
    leaves least."""
    n = problem.robot.n
    zeros = [[j] for j in range(n)]
    of_zeros = [arm for arm in first if not arm.links.any()]
    resting = _fit_resting(problem)
    best, misfit = _fit_best(problem, good, of_zeros, zeros, resting)
    if misfit > good and links:
        frames = [_link_numbers(n, j) for j in range(1, n)]
        best, misfit = _fit_best(problem, good, first, [*zeros, *frames], [])
    if misfit <= good:
        yield from _describe(problem, best)


def _fit_best(
    problem: Problem,
    good: float,
    first: Sequence[Arm],
    groups: Sequence[list[int]],
    others: Sequence[Arm],
) -> tuple[Arm, float]:
    """Add offsets, of `groups` of numbers, to the best of the arms `first`: (the best of these and of
    `others`, what it leaves [mm])."""
    starts = first or [build_nominal_arm(problem)]
    before = measure_arms(problem, starts)
    candidates = []
    nearest = _select_least(starts, before)
    for start in nearest:
        arm = _add_offsets(problem, good, start, groups)
        candidates.append(arm)
    candidates += others
    misfits = measure_arms(problem, candidates)
    best = int(misfits.argmin())
    left = float(misfits[best])
    return candidates[best], left


def _add_offsets(problem: Problem, good: float, arm: Arm, groups: Sequence[list[int]]) -> Arm:
    """Add the group of numbers that leaves least, one after the other, until what is left is good or
    falls no more."""
    offsets = arm.offsets()
    taken = [group for group in groups if offsets[group].any()]
    before = np.inf
    misfit = float(measure_arms(problem, [arm])[0])
    while len(taken) < MAX_PARTS and good < misfit < MIN_FALL * before:
        linked = [len(group) > 1 for group in taken]
        links = sum(linked)
        offered = []
        for group in groups:
            is_link = len(group) > 1
            is_allowed = not is_link or links < MAX_LINKS
            is_untaken = group not in taken
            if is_allowed and is_untaken:
                offered.append(group)
        if not offered:
            break
        present = [k for group in taken for k in group]
        numbers = [[*present, *group] for group in offered]
        fitted = fit_offsets(problem, [arm] * len(numbers), numbers, True)
        misfits = measure_arms(problem, fitted)
        best = int(misfits.argmin())
        arm = fitted[best]
        taken.append(offered[best])
        before = misfit
        misfit = float(misfits[best])
    return arm


def _fit_resting(problem: Problem) -> list[Arm]:
    """Fit joints that rest between others that move, from all combinations of angles: readings that
    were not recorded."""
    resting = _find_resting(problem)
    count = len(resting)
    if not 2 <= count <= MAX_RESTING:
        return []
    identity = np.eye(problem.robot.n)
    nominal = build_nominal_arm(problem)
    turned = []
    for angles in product(THIRDS, repeat=count):
        zeros = identity[resting].T @ np.array(angles)
        turned.append(replace(nominal, zeros=zeros))
    starts = place_arms(problem, turned)
    return fit_offsets(problem, starts, [resting] * len(starts), True)


def _find_resting(problem: Problem) -> list[int]:
    """Find the turning joints that rest between the first and the last that moves."""
    spread = np.ptp(problem.data.q, axis=0)
    is_moving = spread >= REST_RANGE
    moving = np.flatnonzero(is_moving).tolist()
    if not moving:
        return []
    slides = problem.robot.prismatic
    resting = []
    for j in range(moving[0], moving[-1]):
        rests = j not in moving
        if rests and not slides[j]:
            resting.append(j)
    return resting


def _describe(problem: Problem, arm: Arm) -> Iterator[tuple[Mistake, Arm]]:
    """Pair an arm with its offsets as a mistake; nothing where these are too small to be one."""
    mistake = describe_offsets(problem, arm.zeros, arm.links)
    if mistake is not None:
        yield mistake, arm
