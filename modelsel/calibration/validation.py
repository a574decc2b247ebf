"""A calibration on another day: does it still hold on new data, and what differs between two
campaigns?

Neither refits what was calibrated. New data are judged by T = rᵀ V⁻¹ r, V = noise + parameters'
covariance of all rows together, which under no change is a χ² (F where the noise was estimated); a
set-up that may have moved is projected out."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from .._typing import Array, Index
from ..exceptions import sentence_list, write_rounded
from ..fitting.noise import Floor
from ..fitting.noise_check import (
    CLEARLY_TOO_LARGE,
    Lack,
    describe_lack,
    lack,
    name_likeliest_mistake,
)
from ..fitting.problem import Problem
from ..measurements.measurements import Measurements
from .calibration import Calibration
from .drift_statistic import compute_chi2_p, compute_statistic, standardise_residual
from .expected_noise import (
    MIN_FACTOR,
    STATED_KEYS,
    describe_overstatement,
    expect_noise,
    is_overstated,
)
from .known_names import list_unknown_targets
from .louder_noise import is_louder_noise
from .mistaken_data import (
    REGISTER_AGAIN,
    check_near_arm,
    describe_wrong_registered_rows,
    describe_wrong_rows,
    describe_wrong_setup,
)
from .prediction import measure_turn, predict, propagate_uncertainty
from .reregistration import register_again

MAX_P = 0.01  # below it a calibration is called drifted
MAX_ROW_P = 0.05  # corrected for the number of rows: below it a row is beyond noise
FINE_MM = 10.0  # a length below is told to micrometres
MAX_EXACT_FACTOR = 100.0  # a factor below is told to hundredths
MIN_EXACT_P = 1e-12  # a p below is told to be below
# a row further off [standard deviations] is no noise, as of a study's held-out rows; a greater share
# of them is no bad shots
MAX_ROW_SD = 8.0
MAX_FAR_SHARE = 0.05
MAX_LISTED = 10
LOUDER = (
    "look at the instrument, at what holds the target and at how well the arm repeats, or for an effect "
    "that is new, with a study of these data."
)
MIN_HALF_RATIO = 1.5  # of mean squared errors in two halves of a joint's range, to be named
MIN_HALF_ROWS = 5


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

    @property
    def factor(self) -> float:
        """The errors over those expected."""
        expected = self.expected_rms_mm
        return self.rms_mm / expected

    @property
    def drifted(self) -> bool:
        """Whether the data contradict the calibration."""
        improbable = self.p <= MAX_P
        large = self.whitened_factor >= MIN_FACTOR
        return improbable and large


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
    share = is_far.mean()
    if not verdict.drifted or verdict.mistaken:
        return verdict
    if not 0 < share <= MAX_FAR_SHARE:
        return verdict
    others = np.flatnonzero(~is_far)
    kept = data.take(others)
    rest = _judge_rows(c, kept, free_setup)
    if rest.drifted:
        return verdict
    worst_first = np.argsort(-size, kind="stable")
    count = int(is_far.sum())
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
    sigma, freedom = expect_noise(c, spread)
    test = compute_statistic(residual / sigma, spread / sigma, free)
    size = standardise_residual(residual, spread, sigma)
    row_p = compute_chi2_p(3, size**2)
    beyond = np.flatnonzero(row_p < MAX_ROW_P / len(size))
    expected = sigma * float(np.sqrt(test.expected / len(data)))
    floor = replace(c.floor, freedom=freedom)
    found = lack(floor, test.factor, test.count)
    p = test.p(freedom)
    doubts = _list_doubts(c, data, residual, found, sigma)
    slips: tuple[str, ...] = ()
    if p <= MAX_P:
        suspects = None if free_setup else beyond
        slips = _find_slips(c, bound, residual, suspects, expected)
    if p <= MAX_P and not slips:
        doubts += describe_wrong_setup(bound, residual)
    patternless = False
    if p <= MAX_P and test.factor >= MIN_FACTOR and not doubts and not slips:
        noise = replace(floor, coordinate_mm=sigma)
        patternless = is_louder_noise(c, problem, residual, spread, noise, free)
    squares = np.square(residual)
    mean_square = squares.sum(1).mean()
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
    )


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


def describe_verdict(data: Measurements, verdict: Verdict) -> list[str]:
    """Describe the verdict in one sentence, then what belongs to it."""
    sentences = [_summarise_verdict(data, verdict)]
    if verdict.worst and not verdict.mistaken:
        sentences.append(_list_worst(data, verdict))
    if verdict.new_targets:
        names = sentence_list([f'"{name}"' for name in verdict.new_targets])
        subject, place = f"Target {names} was", "its place was"
        if len(verdict.new_targets) > 1:
            subject, place = f"Targets {names} were", "their places were"
        sentences.append(
            f"{subject} not calibrated: {place} found from the new data and cannot be judged."
        )
    if verdict.turned_rad is not None:
        sentences.append(
            f"The measured orientations are {write_rounded(verdict.turned_rad * 1e3)} mrad rms from the calibrated "
            "ones. They are not judged: a calibration does not say how well orientations are measured."
        )
    if verdict.moved is not None:
        shift, turn, offset = verdict.moved
        sentences.append(
            f"Registered again: the tracker is {write_rounded(shift)} mm and {write_rounded(turn * 1e3)} mrad from where it was, and the "
            f"target moved by {write_rounded(offset)} mm on the flange; errors of the arm that move the target as these do cannot be judged."
        )
    return sentences


def _summarise_verdict(data: Measurements, verdict: Verdict) -> str:
    factor, p = verdict.factor, verdict.p
    times = f"{factor:.2f}" if factor < MAX_EXACT_FACTOR else f"{factor:,.0f}"
    chance = f"p = {p:.2g}" if p >= MIN_EXACT_P else f"p < {MIN_EXACT_P:g}"
    rms, least = _write_mm(verdict.rms_mm), _write_mm(verdict.expected_rms_mm)
    expected = f"{rms} mm rms where {least} mm are expected"
    figures = f"{expected}, a factor of {times} ({chance})"
    if verdict.drifted and verdict.mistaken:
        return (
            "Whether the calibration still holds cannot be said before the data are corrected: as "
            f"they are, {expected}."
        )
    if verdict.drifted and verdict.patternless:
        return (
            f"The errors of the new data are larger than the calibration expects: {figures}. No change of the set-up, of the "
            f"geometry, of a joint's zero or its play, or of a calibrated effect explains them: {LOUDER}"
        )
    if verdict.drifted:
        count = len(verdict.worst)
        rows = "no single row shows it"
        if count:
            verb = "shows" if count == 1 else "show"
            rows = f"{count:,} of {len(data):,} rows {verb} it"
        place = _locate_errors(data, verdict)
        remedy = ""
        if verdict.moved is None:
            remedy = f" {REGISTER_AGAIN}"
        return f"The calibration has drifted: {figures}; {rows}{place}.{remedy}"
    if verdict.small:
        return f"Drift cannot be judged, since the stated uncertainty is far above the errors: {figures}."
    count = len(verdict.left_out)
    if count:
        rows = "a row that is" if count == 1 else f"{count} rows that are"
        return f"The calibration is still valid within noise, without {rows} far off: {figures}."
    return f"The calibration is still valid within noise: {figures}."


def _write_mm(length: float) -> str:
    """Write a length [mm] to micrometres; one of 10 mm or more with three digits."""
    return f"{length:.3f}" if length < FINE_MM else write_rounded(length)


def _list_worst(data: Measurements, verdict: Verdict) -> str:
    rows = []
    for k in verdict.worst[:MAX_LISTED]:
        row = int(data.row[k])
        words = [data.where.label([row], 1), data.where.named(row)]
        named = ", ".join(filter(None, words))
        size = verdict.size[k]
        shown = f"{size:.1f}" if size < MAX_EXACT_FACTOR else write_rounded(size)
        rows.append(f"{named} ({shown} sd)")
    listed = ", ".join(rows)
    more = ""
    if len(verdict.worst) > MAX_LISTED:
        more = " …"
    if verdict.left_out:
        return (
            f"Far off, and left out: {listed}. A bad shot is likelier than an arm that changed there "
            "alone: measure it again."
        )
    return f"Beyond noise: {listed}{more}."


def _locate_errors(data: Measurements, verdict: Verdict) -> str:
    """Return the joint whose lower or upper half holds clearly more of the errors, in words; empty
    where there is none."""
    squares = verdict.size**2
    largest = MIN_HALF_RATIO
    words = ""
    for j, readings in enumerate(data.readings.T, 1):
        middle = float(np.median(readings))
        above = readings > middle
        below = ~above
        rows = min(above.sum(), below.sum())
        if rows < MIN_HALF_ROWS:
            continue
        of_upper = squares[above]
        of_lower = squares[below]
        high = float(of_upper.mean())
        low = float(of_lower.mean())
        for ratio, side in ((high / low, "above"), (low / high, "below")):
            if ratio > largest:
                largest = ratio
                place = _write_reading(data, j, middle)
                words = f", most of it where q{j} is {side} {place}"
    return words


def _write_reading(data: Measurements, joint: int, value: float) -> str:
    """Write a reading as people read it: in degrees, or in mm of a joint that slides."""
    slides = False
    if data.prismatic:
        slides = data.prismatic[joint - 1]
    if slides:
        return f"{value:.3g} mm"
    degrees = np.degrees(value)
    return f"{degrees:.3g} deg"
