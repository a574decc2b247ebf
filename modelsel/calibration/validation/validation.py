"""A calibration on another day: does it still hold on new data, and what differs between two
campaigns?

Neither refits what was calibrated. New data are judged by T = rᵀ V⁻¹ r, V = noise + parameters'
covariance of all rows together, which under no change is a χ² (F where the noise was estimated); a
set-up that may have moved is projected out."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..._typing import Array, Index
from ...fitting.noise import Floor
from ...fitting.noise_check import (
    CLEARLY_TOO_LARGE,
    Lack,
    describe_lack,
    lack,
    name_likeliest_mistake,
)
from ...fitting.problem import Problem
from ...measurements.measurements import Measurements
from ..calibration import Calibration
from ..commands.command_notes import count_rows_beyond
from ..expected_noise import (
    MIN_FACTOR,
    STATED_KEYS,
    describe_overstatement,
    expect_noise,
    is_overstated,
)
from ..known_names import list_unknown_targets
from ..prediction import measure_turn, predict, propagate_uncertainty
from .drift_statistic import compute_chi2_p, compute_statistic, standardise_residual
from .louder_noise import find_quieter_noise, is_louder_noise
from .mistaken_data import (
    check_near_arm,
    describe_wrong_registered_rows,
    describe_wrong_rows,
    describe_wrong_setup,
)
from .reregistration import register_again

MAX_P = 0.01  # below it a calibration is called drifted
MAX_ROW_P = 0.05  # corrected for the number of rows: below it a row is beyond noise
# a row further off [standard deviations] is no noise, as of a study's held-out rows; a greater share
# of them is no bad shots; of a quick check of few rows, one may be
MAX_ROW_SD = 8.0
MAX_FAR_SHARE, FEWEST_ROWS = 0.05, 6


@dataclass(frozen=True, eq=False)
class Verdict:
    """New data against a calibration: the test's p and its `whitened_factor`, of the errors to those
    expected, each in units of its own uncertainty, `worst` rows (their index in the data) beyond what noise
    explains, the residual (m, 3) and its standardised length (m,)."""

    whitened_factor: float
    p: float
    rms_mm: float
    expected_rms_mm: float
    worst: tuple[int, ...]
    residual: Array
    size: Array
    # mm and rad of the tracker, mm of the target, where registered
    moved: tuple[float, float, float] | None
    doubts: tuple[str, ...] = ()  # what in the uncertainties or the rows looks mistaken
    small: bool = False  # errors far below what the stated uncertainty would leave
    new_targets: tuple[str, ...] = ()  # not calibrated, found from the new data
    mistaken: bool = False  # a mistake in the data's rows explains them
    left_out: tuple[int, ...] = ()  # a few rows far off, without which the data are judged
    turned_rad: float | None = None  # rms of measured orientations from the calibrated ones
    patternless: bool = False  # beyond what is expected, as louder noise is
    by_size: bool = False  # p is that of the errors' size
    beyond: int = 0  # rows beyond what the calibration has seen
    # noise [mm] that the study measured and that of the new data, expected where it is far below
    quieter: tuple[float, float] | None = None

    @property
    def factor(self) -> float:
        """The errors over those expected."""
        expected = self.expected_rms_mm
        return self.rms_mm / expected

    @property
    def drifted(self) -> bool:
        """Whether the data contradict the calibration."""
        improbable = self.p <= MAX_P
        factor = self.factor if self.by_size else self.whitened_factor
        return improbable and factor >= MIN_FACTOR


def _list_doubts(
    c: Calibration, data: Measurements, residual: Array, found: Lack, sigma: float
) -> list[str]:
    """List what seems mistaken in the uncertainties that the calibration or the data state;
    `found`: errors over those expected, with noise of `sigma` [mm]."""
    squares = np.square(residual)
    left = float(np.sqrt(squares.mean()))
    doubts = []
    if is_overstated(c):
        doubts.append(describe_overstatement(c))
    elif found.far and found.factor < 1:
        stated = describe_lack("The calibration", sigma, left, found, model="new data leave")
        mistake = name_likeliest_mistake(1 / found.factor, STATED_KEYS)
        doubts.append(f"{stated} {mistake}")
    if data.sigma is not None:
        doubts += _doubt_row_uncertainties(data.sigma, residual, found)
    return doubts


def _doubt_row_uncertainties(sigma: Array, residual: Array, found: Lack) -> list[str]:
    """List the doubt about uncertainties (m, 3) that the new data state, where there is one."""
    rms_sigma = float(np.sqrt(np.square(sigma).mean()))
    standardised = residual / sigma
    rms_ratio = float(np.sqrt(np.square(standardised).mean()))
    stated = Floor(rms_sigma, "stated")
    ratio = lack(stated, rms_ratio, residual.size)
    if not ratio.far:
        return []
    if ratio.factor >= 1 and found.factor >= MIN_FACTOR:
        return []
    left = float(np.sqrt(np.square(residual).mean()))
    sentence = describe_lack(
        "sx_mm, sy_mm, sz_mm of the new data",
        stated.coordinate_mm,
        left,
        ratio,
        model="new data leave",
    )
    cause = name_likeliest_mistake(1 / ratio.factor, "sx_mm, sy_mm, sz_mm")
    return [f"{sentence} {cause} This test does not use them."]


def _add_new_targets(c: Calibration, data: Measurements) -> Calibration:
    """Add the targets that were not calibrated at the mean of those that were: where they are is
    found from the data."""
    names = list_unknown_targets(data, c.targets)
    count = len(names)
    middle = c.tools.mean(0)
    added = np.tile(middle, (count, 1))
    tools = np.concatenate([c.tools, added])
    rotations = c.tool_rotations
    if rotations is not None:
        identities = np.tile(np.eye(3), (count, 1, 1))
        rotations = np.concatenate([rotations, identities])
    return replace(c, targets=(*c.targets, *names), tools=tools, tool_rotations=rotations)


def judge(c: Calibration, data: Measurements, free_setup: bool) -> Verdict:
    """Judge a stored calibration on new measurements; with `free_setup` the tracker and the targets
    are found again first. A few rows that are far off are left out where the others are within
    noise: a bad shot is likelier than an arm that changed in one place. Raises DataError, also for
    data that cannot be of this arm."""
    verdict = _judge_rows(c, data, free_setup)
    size = verdict.size
    is_far = size > MAX_ROW_SD
    count = int(is_far.sum())
    most = MAX_FAR_SHARE * len(is_far)
    if len(is_far) >= FEWEST_ROWS:
        most = max(most, 1.0)
    if not verdict.drifted or verdict.mistaken:
        return verdict
    if not 0 < count <= most:
        return verdict
    others = np.flatnonzero(~is_far)
    kept = data.take(others)
    rest = _judge_rows(c, kept, free_setup)
    if rest.drifted:
        return verdict
    worst_first = np.argsort(-size, kind="stable")
    chosen = worst_first[:count]
    rows = tuple(chosen.tolist())
    residual = verdict.residual
    return replace(rest, residual=residual, size=size, worst=rows, left_out=rows)


def _judge_rows(c: Calibration, data: Measurements, free_setup: bool) -> Verdict:
    """Judge a stored calibration on all rows of new measurements."""
    moved = None
    new_targets: tuple[str, ...] = ()
    free = np.zeros((len(data), 3, 0))
    if free_setup:
        bound = _bind_as_one_group(c, data)
        registration = register_again(c, bound)
        problem = registration.problem
        free = registration.free
        moved = registration.moved
        new_targets = list_unknown_targets(data, c.targets)
    else:
        bound = c.problem(data)
        problem = bound
    residual = problem.data.position - predict(c, problem)
    check_near_arm(c, bound, residual, free_setup)
    spread = propagate_uncertainty(c, problem)
    sigma, freedom, quieter = _expect_noise(c, problem, residual, spread, free)
    test = compute_statistic(residual / sigma, spread / sigma, free)
    size = standardise_residual(residual, spread, sigma)
    row_p = compute_chi2_p(3, size**2)
    beyond = np.flatnonzero(row_p < MAX_ROW_P / len(size))
    expected = sigma * float(np.sqrt(test.expected / len(data)))
    floor = replace(c.floor, freedom=freedom)
    found = lack(floor, test.factor, test.count)
    whitened_p = test.p(freedom)
    p = test.least_p(freedom)
    doubts = _list_doubts(c, data, residual, found, sigma)
    slips: tuple[str, ...] = ()
    if p <= MAX_P:
        suspects = None if free_setup else beyond
        slips = _find_slips(c, bound, residual, suspects, expected)
    if p <= MAX_P and not slips:
        doubts += describe_wrong_setup(bound, residual)
    patternless = False
    if whitened_p <= MAX_P and test.factor >= MIN_FACTOR and not doubts and not slips:
        noise = replace(floor, coordinate_mm=sigma)
        patternless = is_louder_noise(c, problem, residual, spread, noise, free)
    mean_square = np.square(residual).sum(1).mean()
    order = np.argsort(-size[beyond], kind="stable")
    worst = beyond[order].tolist()
    return Verdict(
        whitened_factor=test.factor,
        p=p,
        rms_mm=float(np.sqrt(mean_square)),
        expected_rms_mm=expected,
        worst=tuple(worst),
        residual=residual,
        size=size,
        moved=moved,
        doubts=(*doubts, *slips),
        small=found.outside and found.factor < 1 / CLEARLY_TOO_LARGE,
        new_targets=new_targets,
        mistaken=bool(slips),
        turned_rad=measure_turn(c, problem),
        patternless=patternless,
        by_size=p < whitened_p,
        beyond=count_rows_beyond(c, data),
        quieter=quieter,
    )


def _expect_noise(
    c: Calibration, at: Problem, residual: Array, spread: Array, free: Array
) -> tuple[float, float, tuple[float, float] | None]:
    """Return the noise [mm] that new data should show and its degrees of freedom; with the study's
    noise beside that of the data where theirs is far below, and is expected instead."""
    sigma, freedom = expect_noise(c, spread)
    studied = replace(c.floor, coordinate_mm=sigma)
    quieter = find_quieter_noise(c, at, residual, studied, free)
    if quieter is None:
        return sigma, freedom, None
    own, own_freedom = quieter
    return own, own_freedom, (sigma, own)


def _find_slips(
    c: Calibration, bound: Problem, residual: Array, beyond: Index | None, expected: float
) -> tuple[str, ...]:
    """Describe the slips in rows `beyond` noise; in any where the set-up was found from them
    (None)."""
    if beyond is None:
        return describe_wrong_registered_rows(bound)
    row_count = len(residual)
    numbers = np.arange(row_count)
    rows = np.isin(numbers, beyond)
    return describe_wrong_rows(c, bound, residual, rows, expected)


def _bind_as_one_group(c: Calibration, data: Measurements) -> Problem:
    """Bind new data to the calibrated set-up as one group, whatever groups these have."""
    group = np.zeros(len(data), np.intp)
    one_group = replace(data, groups=c.groups[:1], group=group)
    completed = _add_new_targets(c, data)
    return completed.problem(one_group)
