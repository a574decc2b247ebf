"""A calibration on another day: does it still hold on new data, and what differs between two
campaigns?

Neither refits what was calibrated. New data are judged by T = rᵀ V⁻¹ r, V = noise + parameters'
covariance of all rows together, which under no change is a χ² (F where the noise was estimated); a
set-up that may have moved is projected out."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from .._linalg import RANK_TOLERANCE, orthonormal_basis, project_out
from .._typing import Array, Index
from ..diagnosis.mistaken_rows import describe_slips
from ..exceptions import DataError, sentence_list
from ..fitting.noise import Floor
from ..fitting.noise_check import (
    CLEARLY_TOO_LARGE,
    Lack,
    describe_lack,
    lack,
    name_likeliest_mistake,
)
from ..fitting.problem import Problem
from ..measurements.columns import MIN_UNCERTAINTY
from ..measurements.measurements import Measurements
from ..robot.rigid import rotation_vector
from ..setup.placement import fit_rigid_transform
from ..setup.robust_weights import compute_cauchy_weights, compute_scale
from .calibration import Calibration
from .prediction import compute_pose, predict, propagate_uncertainty

MAX_P = 0.01  # below it a calibration is called drifted
MIN_FACTOR = 1.1  # of the errors to those expected, for a calibration called drifted
MAX_ROW_P = 0.05  # corrected for the number of rows: below it a row is beyond noise
MAX_ROUNDS = 12  # of a registration
MIN_SCALE_MM = 1e-6  # of a registration's weights
MAX_LISTED = 10
MIN_CONFIGURATIONS = 4  # that a placement needs
MIN_HALF_RATIO = 1.5  # of mean squared errors in two halves of a joint's range, to be named
MIN_HALF_ROWS = 5
STATED_KEYS = "floor_mm or sx_mm, sy_mm, sz_mm of its study"
# a stated uncertainty is not believed above so many times what the study's own held-out
# configurations showed
MAX_OVERSTATEMENT = 3.0


@dataclass(frozen=True, eq=False)
class Verdict:
    """New data against a calibration: `factor` of the errors to those expected, the test's p,
    `worst` rows (their index in the data) beyond what noise explains, the residual (m, 3) and its
    standardised length (m,)."""

    factor: float
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

    @property
    def drifted(self) -> bool:
        """Whether the data contradict the calibration."""
        return self.p <= MAX_P and self.factor >= MIN_FACTOR


@dataclass(frozen=True, eq=False)
class Registration:
    """A set-up found again from new data: the problem with it; how far the tracker [mm, rad] and
    the targets [mm] moved; columns (m, 3, k) of what was left free."""

    problem: Problem
    moved: tuple[float, float, float]
    free: Array


def register_again(c: Calibration, at: Problem) -> Registration:
    """Find one placement and the targets' offsets from new data; the calibrated arm stays as it is.
    Robust. Raises DataError."""
    count = at.data.configurations
    if count < MIN_CONFIGURATIONS:
        raise DataError(
            f"the file has {count} configurations, and --register needs {MIN_CONFIGURATIONS}.",
            remedy="Measure more.",
        )
    registration = _register_at(c, at, at)
    if "range_mm" in c.needs():  # the beam is as long as where the tracker now stands
        return _register_at(c, at, registration.problem)
    return registration


def _register_at(c: Calibration, start: Problem, at: Problem) -> Registration:
    """Register the problem `start`, with the model's causes taken where `at` has the tracker.

    Alternates Kabsch's placement with Cauchy-weighted offsets of the targets.
    """
    pose = compute_pose(at, c.terms, c.theta)
    origins, measured = pose.target.T, start.data.position
    axes = pose.axes[-1, :3].transpose(2, 1, 0)  # of the target's frame, as columns
    seen, target = np.unique(start.data.target, return_inverse=True)
    offset, weight = np.zeros((len(seen), 3)), np.ones(len(measured))
    for k in range(MAX_ROUNDS):
        points = origins + np.einsum("mij,mj->mi", axes, offset[target])
        R, t = fit_rigid_transform(measured, points, weight)
        free = _setup_columns(R, points, axes, target)
        residual = measured - points @ R.T - t
        step = _weighted_step(free, residual, weight)
        if k < MAX_ROUNDS - 1:  # the placement follows by the next Kabsch
            offset += step[6:].reshape(-1, 3)
        weight = _cauchy_weights(residual - free @ step)
    return Registration(
        _place(start, R, t, np.einsum("ij,mjk,mk->mi", R, axes, offset[target])),
        (*_placement_shift(start, R, t, origins.mean(0)), _largest(offset[seen < len(c.targets)])),
        free,
    )


def _weighted_step(free: Array, residual: Array, weight: Array) -> Array:
    """Solve the weighted least-squares step (k,) of what is free."""
    scale = np.sqrt(weight)[:, None, None]
    columns = (free * scale).reshape(-1, free.shape[2])
    response = (residual * scale[:, 0]).ravel()
    return np.asarray(np.linalg.lstsq(columns, response, rcond=RANK_TOLERANCE)[0])


def _cauchy_weights(residual: Array) -> Array:
    """Return weights (m,) that fall beyond three median lengths of the residual (m, 3)."""
    size = np.linalg.norm(residual, axis=1)
    return compute_cauchy_weights(size, compute_scale(size, MIN_SCALE_MM))


def _place(start: Problem, R: Array, t: Array, offsets: Array) -> Problem:
    """Return the problem with one placement for all groups, the targets' offsets (m, 3) taken from
    the measured positions."""
    groups = len(start.placement[0])
    placement = np.tile(R, (groups, 1, 1)), np.tile(t, (groups, 1))
    data = replace(start.data, position=start.data.position - offsets)
    return replace(start, placement=placement, data=data)


def _placement_shift(start: Problem, R: Array, t: Array, middle: Array) -> tuple[float, float]:
    """Return how far a new placement is from that of the first group: mm at the middle of the
    workspace, rad."""
    group = start.data.group[0]
    R_before, t_before = start.placement[0][group], start.placement[1][group]
    shift = R @ middle + t - R_before @ middle - t_before
    turn = rotation_vector((R @ R_before.T)[None])[0]
    return float(np.linalg.norm(shift)), float(np.linalg.norm(turn))


def _largest(offset: Array) -> float:
    """Return the largest length of offsets (k, 3); zero where there are none."""
    return float(np.linalg.norm(offset, axis=1).max(initial=0.0))


def _setup_columns(R: Array, points: Array, axes: Array, target: Index) -> Array:
    """Return columns (m, 3, 6 + 3 T) [mm per mm, rad]: shift and turn of the placement, offset of
    every target."""
    count = int(target.max()) + 1
    columns = np.zeros((len(points), 3, 6 + 3 * count))
    columns[:, :, :3] = np.eye(3)
    centred = (points - points.mean(0)) @ R.T
    for axis in range(3):
        columns[:, :, 3 + axis] = np.cross(np.eye(3)[axis], centred)
    for k in range(count):
        rows = target == k
        columns[rows, :, 6 + 3 * k : 9 + 3 * k] = (R @ axes)[rows]
    return columns


def expected_noise(c: Calibration) -> tuple[float, float]:
    """Return the standard deviation [mm] of one coordinate that new data should show, and its
    degrees of freedom.

    The noise floor, or what the study's own held-out configurations showed where that is more, or
    where it contradicts a stated floor.
    """
    held_out = _held_out_noise(c)
    floor = held_out if _is_overstated(c) else c.floor.coordinate_mm
    return max(floor, held_out, MIN_UNCERTAINTY), c.floor.freedom


def _held_out_noise(c: Calibration) -> float:
    """Return the standard deviation [mm] of one held-out coordinate; zero where none is known."""
    return 0.0 if c.held_out_rms_mm is None else float(c.held_out_rms_mm / np.sqrt(3))


def _is_overstated(c: Calibration) -> bool:
    """Whether the study's own held-out configurations contradict its stated noise."""
    held_out = _held_out_noise(c)
    stated = bool(np.isinf(c.floor.freedom))
    return held_out > 0 and stated and c.floor.coordinate_mm > MAX_OVERSTATEMENT * held_out


def _list_doubts(c: Calibration, data: Measurements, residual: Array, found: Lack) -> list[str]:
    """List what seems mistaken in the uncertainties that the calibration or the data state; `found`:
    errors over those expected."""
    left = float(np.sqrt(np.square(residual).mean()))
    doubts = []
    if _is_overstated(c):
        doubts.append(_describe_overstatement(c))
    elif found.far and found.factor < 1:
        stated = describe_lack(
            "The calibration", expected_noise(c)[0], left, found, model="new data leave"
        )
        doubts.append(f"{stated} {name_likeliest_mistake(1 / found.factor, STATED_KEYS)}")
    if data.sigma is not None:
        doubts += _doubt_row_uncertainties(data.sigma, residual, found)
    return doubts


def _describe_overstatement(c: Calibration) -> str:
    held_out = _held_out_noise(c)
    ratio = c.floor.coordinate_mm / held_out
    return (
        f"The calibration's stated uncertainty of one coordinate ({c.floor.coordinate_mm:.3g} mm) is {ratio:.3g} times"
        f" what its own held-out configurations showed ({held_out:.3g} mm), which is expected here instead. "
        f"{name_likeliest_mistake(ratio, STATED_KEYS)}"
    )


def _doubt_row_uncertainties(sigma: Array, residual: Array, found: Lack) -> list[str]:
    """List the doubt about uncertainties (m, 3) that the new data state, where there is one."""
    stated = Floor(float(np.sqrt(np.square(sigma).mean())), "stated")
    ratio = lack(stated, float(np.sqrt(np.square(residual / sigma).mean())), residual.size)
    if not ratio.far or (ratio.factor >= 1 and found.factor >= MIN_FACTOR):
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


def _find_new_targets(c: Calibration, data: Measurements) -> tuple[str, ...]:
    """List the targets of the data that were not calibrated; a calibration of one target takes any
    name for it."""
    if len(c.targets) == 1:
        return ()
    return tuple(name for name in data.targets if name not in c.targets)


def _add_new_targets(c: Calibration, data: Measurements) -> Calibration:
    """Add the targets that were not calibrated at the mean of those that were: where they are is
    found from the data."""
    names = _find_new_targets(c, data)
    tools = np.concatenate([c.tools, np.tile(c.tools.mean(0), (len(names), 1))])
    rotations = c.tool_rotations
    if rotations is not None:
        rotations = np.concatenate([rotations, np.tile(np.eye(3), (len(names), 1, 1))])
    return replace(c, targets=(*c.targets, *names), tools=tools, tool_rotations=rotations)


def judge(c: Calibration, data: Measurements, free_setup: bool) -> Verdict:
    """Judge a stored calibration on new measurements; with `free_setup` the tracker and the targets
    are found again first. Raises DataError."""
    registration = _register_data(c, data) if free_setup else None
    problem = c.problem(data) if registration is None else registration.problem
    free = np.zeros((len(data), 3, 0)) if registration is None else registration.free
    residual = problem.data.position - predict(c, problem)
    sigma, freedom = expected_noise(c)
    spread = propagate_uncertainty(c, problem)
    test = _test_residual(residual / sigma, spread / sigma, free)
    size = _standardise(residual, spread, sigma)
    beyond = np.flatnonzero(_chi2_p(3, size**2) < MAX_ROW_P / len(size))
    expected = float(_expected_rms(spread, sigma) * np.sqrt(test.count / residual.size))
    found = lack(replace(c.floor, freedom=freedom), test.factor, test.count)
    p = test.p(freedom)
    doubts = _list_doubts(c, data, residual, found)
    if not free_setup and p <= MAX_P:
        rows = np.isin(np.arange(len(size)), beyond)
        doubts += describe_slips(
            problem, lambda other: other.data.position - predict(c, other), rows, expected
        )
    return Verdict(
        factor=test.factor,
        p=p,
        rms_mm=float(np.sqrt(np.square(residual).sum(1).mean())),
        expected_rms_mm=expected,
        worst=tuple(beyond[np.argsort(-size[beyond], kind="stable")].tolist()),
        residual=residual,
        size=size,
        moved=None if registration is None else registration.moved,
        doubts=tuple(doubts),
        small=found.outside and found.factor < 1 / CLEARLY_TOO_LARGE,
        new_targets=_find_new_targets(c, data) if free_setup else (),
    )


def _register_data(c: Calibration, data: Measurements) -> Registration:
    """Register the arm to new data as one group, whatever groups these have."""
    one_group = replace(data, groups=c.groups[:1], group=np.zeros(len(data), np.intp))
    return register_again(c, _add_new_targets(c, data).problem(one_group))


@dataclass(frozen=True)
class _ResidualTest:
    """The statistic T = rᵀ V⁻¹ r of whitened residuals and its degrees of freedom."""

    T: float
    count: int

    @property
    def factor(self) -> float:
        """Errors over those expected."""
        return float(np.sqrt(self.T / self.count))

    def p(self, freedom: float) -> float:
        """Probability of a larger T under no change: χ², or F where the noise has a finite
        `freedom`."""
        from scipy.special import fdtrc

        if not np.isfinite(freedom):
            return float(_chi2_p(self.count, self.T))
        return float(fdtrc(self.count, freedom, self.T / self.count))


def _chi2_p(count: int, value: Any) -> Any:
    from scipy.special import chdtrc

    return chdtrc(count, value)


def _test_residual(residual: Array, spread: Array, free: Array) -> _ResidualTest:
    """Test residuals (m, 3) in units of the noise, with parameters' factors `spread` (m, 3, r) and
    `free` columns (m, 3, k) projected out."""
    r, W = residual.ravel(), spread.reshape(residual.size, -1)
    basis = orthonormal_basis(free.reshape(residual.size, free.shape[2]))
    r, W = project_out(r, basis), project_out(W, basis)
    inner = np.eye(W.shape[1]) + W.T @ W  # Woodbury: V⁻¹ = I − W (I + WᵀW)⁻¹ Wᵀ
    explained = (W.T @ r) @ np.linalg.solve(inner, W.T @ r)
    return _ResidualTest(float(r @ r - explained), len(r) - basis.shape[1])


def _expected_rms(spread: Array, sigma: float) -> float:
    """Return the rms length [mm] that noise and the parameters' uncertainty leave."""
    return float(np.sqrt((3 * sigma**2 + np.square(spread).sum((1, 2))).mean()))


def _standardise(residual: Array, spread: Array, sigma: float) -> Array:
    """Return lengths (m,) of residuals (m, 3) in standard deviations of each row."""
    covariance = sigma**2 * np.eye(3) + np.einsum("mcr,mdr->mcd", spread, spread)
    whitened = np.linalg.solve(np.linalg.cholesky(covariance), residual[:, :, None])
    return np.asarray(np.linalg.norm(whitened[:, :, 0], axis=1))


def describe_verdict(data: Measurements, verdict: Verdict) -> list[str]:
    """Describe the verdict in one sentence, then what belongs to it."""
    sentences = [_summarise_verdict(data, verdict)]
    if verdict.worst:
        sentences.append(_list_worst(data, verdict))
    if verdict.new_targets:
        names = sentence_list([f'"{name}"' for name in verdict.new_targets])
        sentences.append(
            f"Target {names} was not calibrated: its place was found from the new data and cannot be judged."
        )
    if verdict.moved is not None:
        shift, turn, offset = verdict.moved
        sentences.append(
            f"Registered again: the tracker is {shift:.3g} mm and {turn * 1e3:.3g} mrad from where it was, and the "
            f"target {offset:.3g} mm on the flange; errors of the arm that move the target as these do cannot be judged."
        )
    return sentences


def _summarise_verdict(data: Measurements, verdict: Verdict) -> str:
    figures = (
        f"{verdict.rms_mm:.3f} mm rms where {verdict.expected_rms_mm:.3f} mm are expected, a factor of "
        f"{verdict.factor:.2f} (p = {verdict.p:.2g})"
    )
    if verdict.drifted:
        count = len(verdict.worst)
        rows = f"{count} of {len(data)} rows show it" if count else "no single row shows it"
        remedy = (
            " If the tracker or the target was moved, --register finds them again and keeps the arm."
            if verdict.moved is None
            else ""
        )
        return f"The calibration has drifted: {figures}; {rows}{_locate_errors(data, verdict)}.{remedy}"
    if verdict.small:
        return f"Drift cannot be judged, since the stated uncertainty is far above the errors: {figures}."
    return f"The calibration is still valid within noise: {figures}."


def _list_worst(data: Measurements, verdict: Verdict) -> str:
    rows = [
        f"{data.where.named(int(data.row[k]))} ({verdict.size[k]:.1f} sd)"
        for k in verdict.worst[:MAX_LISTED]
    ]
    more = " …" if len(verdict.worst) > MAX_LISTED else ""
    return f"Beyond noise: {', '.join(rows)}{more}."


def _locate_errors(data: Measurements, verdict: Verdict) -> str:
    """Return the joint whose lower or upper half holds clearly more of the errors, in words; empty
    where there is none."""
    squares = verdict.size**2
    largest, words = MIN_HALF_RATIO, ""
    for j, readings in enumerate(data.q.T, 1):
        middle = float(np.median(readings))
        above = readings > middle
        if min(above.sum(), (~above).sum()) < MIN_HALF_ROWS:
            continue
        high, low = float(squares[above].mean()), float(squares[~above].mean())
        for ratio, side in ((high / low, "above"), (low / high, "below")):
            if ratio > largest:
                largest = ratio
                words = f", most of it where q{j} is {side} {middle:.3g}"
    return words
