"""A calibration on another day: does it still hold on new data, and what differs between two
campaigns?

Neither refits what was calibrated. New data are judged by T = rᵀ V⁻¹ r, V = noise + parameters'
covariance of all rows together, which under no change is a χ² (F where the noise was estimated); a
set-up that may have moved is projected out."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from .._typing import Array, Index
from ..diagnosis.mistaken_rows import describe_slips
from ..exceptions import DataError, sentence_list
from ..fitting.noise import Floor
from ..fitting.noise_check import SMALLER, Lack, against, lack, likeliest
from ..fitting.problem import Problem
from ..measurements.columns import SMALLEST
from ..measurements.measurements import Measurements
from ..robot.rigid import rotation_vector
from ..setup.placement import fit_rigid_transform
from .calibration import Calibration, pose_of, predict, uncertainty

SURE = 0.01  # p below which a calibration is called drifted
NOTABLE = 1.1  # and the factor above which it is
ROUNDS = 12
LISTED = 10
LEAST = 4  # configurations that a placement needs
CLEARLY, ENOUGH = 1.5, 5
STATED = "floor_mm or sx_mm, sy_mm, sz_mm of its study"
# times what the study's own held-out configurations showed, from which a stated uncertainty is not
# believed
TOO_LARGE = 3.0


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
    moved: (
        tuple[float, float, float] | None
    )  # mm and rad of the tracker, mm of the target, where registered
    doubts: tuple[str, ...] = ()  # what in the uncertainties or the rows looks mistaken
    small: bool = False  # errors far below what the stated uncertainty would leave
    new_targets: tuple[str, ...] = ()  # that were not calibrated, found anew

    @property
    def drifted(self) -> bool:
        """Whether the data contradict the calibration."""
        return self.p <= SURE and self.factor >= NOTABLE


def register(c: Calibration, at: Problem) -> tuple[Problem, tuple[float, float, float], Array]:
    """(the problem with one placement and the targets' offsets found from the new data, how far they
    moved (mm, rad, mm), the columns (m, 3, k) of what was left free). Robust; the calibrated chain
    stays as it is. Raises DataError."""
    if at.data.configurations < LEAST:
        raise DataError(
            f"the file has {at.data.configurations} configurations, and --register needs {LEAST}.",
            remedy="Measure more.",
        )
    found = _registered(c, at, at)
    return (
        _registered(c, at, found[0]) if "range_mm" in c.needs() else found
    )  # the beam is as long as where it now stands


def _registered(
    c: Calibration, start: Problem, at: Problem
) -> tuple[Problem, tuple[float, float, float], Array]:
    """`register` of the problem `start`, what the model's causes look at taken where the problem `at`
    has the tracker."""
    pose = pose_of(at, c.terms, c.theta)
    o, x = pose.target.T, start.data.position
    axes = pose.axes[-1, :3].transpose(2, 1, 0)  # of the target's frame, as columns
    seen, which = np.unique(start.data.target, return_inverse=True)
    offset, weight = np.zeros((len(seen), 3)), np.ones(len(x))
    for k in range(ROUNDS):
        p = o + np.einsum("mij,mj->mi", axes, offset[which])
        R, t = fit_rigid_transform(x, p, weight)
        free = _setup_columns(R, p, axes, which)
        r = x - p @ R.T - t
        W = np.sqrt(weight)[:, None, None]
        step = np.linalg.lstsq(
            (free * W).reshape(-1, free.shape[2]), (r * W[:, 0]).ravel(), rcond=1e-9
        )[0]
        offset += (
            step[6:].reshape(-1, 3) if k < ROUNDS - 1 else 0.0
        )  # the offsets now, the placement by the next Kabsch
        size = np.linalg.norm(r - free @ step, axis=1)
        weight = 1 / (1 + (size / max(3 * float(np.median(size)), 1e-6)) ** 2)
    first, middle = start.data.group[0], o.mean(0)
    apart = R @ middle + t - start.placement[0][first] @ middle - start.placement[1][first]
    turn = rotation_vector((R @ start.placement[0][first].T)[None])[0]
    known = np.linalg.norm(offset[seen < len(c.targets)], axis=1)
    moved = float(np.linalg.norm(apart)), float(np.linalg.norm(turn)), float(known.max(initial=0.0))
    groups = len(start.placement[0])
    shifted = replace(start.data, position=x - np.einsum("ij,mjk,mk->mi", R, axes, offset[which]))
    return (
        start.anew(placement=(np.tile(R, (groups, 1, 1)), np.tile(t, (groups, 1))), data=shifted),
        moved,
        free,
    )


def _setup_columns(R: Array, p: Array, axes: Array, which: Index) -> Array:
    """(m, 3, 6 + 3 T) mm per mm and rad: shift and turn of the placement, offset of every
    target."""
    m, count = len(p), int(which.max()) + 1
    out = np.zeros((m, 3, 6 + 3 * count))
    out[:, :, :3] = np.eye(3)
    for a in range(3):
        out[:, :, 3 + a] = np.cross(np.eye(3)[a], (p - p.mean(0)) @ R.T)
    for i in range(count):
        out[which == i, :, 6 + 3 * i : 9 + 3 * i] = (R @ axes)[which == i]
    return out


def reference(c: Calibration) -> tuple[float, float]:
    """(standard deviation [mm] of one coordinate that new data should show, its degrees of
    freedom): the noise floor, or what the study's own held-out configurations showed where that is
    more, or where it contradicts a stated floor."""
    floor = c.floor.coordinate_mm
    held = 0.0 if c.held_out_rms_mm is None else c.held_out_rms_mm / np.sqrt(3)
    return max(held if _overstated(c) else floor, held, SMALLEST), c.floor.freedom


def _overstated(c: Calibration) -> bool:
    """Whether the study's own held-out configurations contradict its stated noise."""
    held = 0.0 if c.held_out_rms_mm is None else c.held_out_rms_mm / np.sqrt(3)
    return held > 0 and np.isinf(c.floor.freedom) and c.floor.coordinate_mm > TOO_LARGE * held


def _doubts(c: Calibration, data: Measurements, residual: Array, found: Lack) -> list[str]:
    """What is mistaken in the uncertainties that the calibration or the data state; `found`: errors
    over those expected."""
    out, left = [], float(np.sqrt(np.square(residual).mean()))
    if _overstated(c) and c.held_out_rms_mm is not None:
        held = c.held_out_rms_mm / np.sqrt(3)
        ratio = c.floor.coordinate_mm / held
        out.append(
            f"The calibration's stated uncertainty of one coordinate ({c.floor.coordinate_mm:.3g} mm) is {ratio:.3g} times"
            f" what its own held-out configurations showed ({held:.3g} mm), which is expected here instead. "
            f"{likeliest(ratio, STATED)}"
        )
    elif found.far and found.factor < 1:
        out.append(
            f"{against('The calibration', reference(c)[0], left, found, model='new data leave')} "
            f"{likeliest(1 / found.factor, STATED)}"
        )
    if data.sigma is not None:
        own = Floor(float(np.sqrt(np.square(data.sigma).mean())), "stated")
        asked = lack(own, float(np.sqrt(np.square(residual / data.sigma).mean())), residual.size)
        if asked.far and (asked.factor < 1 or found.factor < NOTABLE):
            said = against(
                "sx_mm, sy_mm, sz_mm of the new data",
                own.coordinate_mm,
                left,
                asked,
                model="new data leave",
            )
            out.append(
                f"{said} {likeliest(1 / asked.factor, 'sx_mm, sy_mm, sz_mm')} This test does not use them."
            )
    return out


def _with_new(c: Calibration, data: Measurements) -> Calibration:
    """With the targets of the data that were not calibrated, at the mean of those that were: where
    they sit is found anew."""
    new = (
        tuple(name for name in data.targets if name not in c.targets) if len(c.targets) > 1 else ()
    )
    tools = np.concatenate([c.tools, np.tile(c.tools.mean(0), (len(new), 1))])
    turned = (
        None
        if c.tool_rotations is None
        else np.concatenate([c.tool_rotations, np.tile(np.eye(3), (len(new), 1, 1))])
    )
    return replace(c, targets=(*c.targets, *new), tools=tools, tool_rotations=turned)


def judge(c: Calibration, data: Measurements, free_setup: bool) -> Verdict:
    """New measurements against a stored calibration. Raises DataError."""
    from scipy.special import chdtrc, fdtrc

    moved, free = None, np.zeros((len(data), 3, 0))
    if free_setup:
        one = replace(
            data, groups=c.groups[:1], group=np.zeros(len(data), np.intp)
        )  # its placement is found below
        at, moved, free = register(c, _with_new(c, data).problem(one))
    else:
        at = c.problem(data)
    residual = at.data.position - predict(c, at)
    sigma, freedom = reference(c)
    spread = uncertainty(c, at)
    r, W, S = (
        residual.ravel() / sigma,
        spread.reshape(residual.size, -1) / sigma,
        free.reshape(residual.size, free.shape[2]),
    )
    rank = 0
    if S.shape[1]:
        U, values, _ = np.linalg.svd(S / np.linalg.norm(S, axis=0), full_matrices=False)
        Q = U[:, values > 1e-7 * values[0]]
        r, W, rank = r - Q @ (Q.T @ r), W - Q @ (Q.T @ W), Q.shape[1]
    inner = np.eye(W.shape[1]) + W.T @ W  # Woodbury: V⁻¹ = I − W (I + WᵀW)⁻¹ Wᵀ
    T = float(r @ r - (W.T @ r) @ np.linalg.solve(inner, W.T @ r))
    count = len(r) - rank
    p = float(chdtrc(count, T) if not np.isfinite(freedom) else fdtrc(count, freedom, T / count))
    expected = np.sqrt((3 * sigma**2 + np.square(spread).sum((1, 2))).mean() * count / len(r))
    own = np.linalg.cholesky(sigma**2 * np.eye(3) + np.einsum("mcr,mdr->mcd", spread, spread))
    size = np.linalg.norm(np.linalg.solve(own, residual[:, :, None])[:, :, 0], axis=1)
    beyond = np.flatnonzero(chdtrc(3, size**2) < 0.05 / len(size))
    worst = tuple(beyond[np.argsort(-size[beyond], kind="stable")].tolist())
    found = lack(replace(c.floor, freedom=freedom), float(np.sqrt(T / count)), count)
    doubts = _doubts(c, data, residual, found)
    if not free_setup and p <= SURE:
        rows = np.isin(np.arange(len(size)), beyond)
        doubts += describe_slips(
            at, lambda other: other.data.position - predict(c, other), rows, float(expected)
        )
    return Verdict(
        float(np.sqrt(T / count)),
        p,
        float(np.sqrt(np.square(residual).sum(1).mean())),
        float(expected),
        worst,
        residual,
        size,
        moved,
        tuple(doubts),
        found.outside and found.factor < 1 / SMALLER,
        tuple(
            name
            for name in data.targets
            if free_setup and len(c.targets) > 1 and name not in c.targets
        ),
    )


def sentences(data: Measurements, found: Verdict) -> list[str]:
    """The verdict in one sentence, then what belongs to it."""
    about = (
        f"{found.rms_mm:.3f} mm rms where {found.expected_rms_mm:.3f} mm are expected, a factor of {found.factor:.2f} "
        f"(p = {found.p:.2g})"
    )
    shown = (
        f"{len(found.worst)} of {len(data)} rows show it"
        if found.worst
        else "no single row shows it"
    )
    anew = (
        " If the tracker or the target was moved, --register finds them anew and keeps the arm."
        if found.moved is None
        else ""
    )
    out = [
        f"The calibration has drifted: {about}; {shown}{_where(data, found)}.{anew}"
        if found.drifted
        else f"No drift can be told, since the stated uncertainty is far above the errors: {about}."
        if found.small
        else f"The calibration is still valid within noise: {about}."
    ]
    if found.worst:
        lines = ", ".join(
            f"{data.where.named(int(data.row[k]))} ({found.size[k]:.1f} sd)"
            for k in found.worst[:LISTED]
        )
        out.append(f"Beyond noise: {lines}{' …' if len(found.worst) > LISTED else ''}.")
    if found.moved is not None:
        shift, turn, offset = found.moved
        if found.new_targets:
            new = sentence_list([f'"{name}"' for name in found.new_targets])
            out.append(
                f"Target {new} was not calibrated: where it sits was found from the new data, and cannot be judged."
            )
        out.append(
            f"Registered anew: the tracker stands {shift:.3g} mm and {turn * 1e3:.3g} mrad from where it stood, and "
            f"the target {offset:.3g} mm on the flange; what moves the arm as these do cannot be judged."
        )
    return out


def _where(data: Measurements, found: Verdict) -> str:
    """Where the errors are: the joint whose lower or upper half holds clearly more of them."""
    square, best = found.size**2, (CLEARLY, "")
    for j, column in enumerate(data.q.T):
        middle = float(np.median(column))
        above = column > middle
        if min(above.sum(), (~above).sum()) < ENOUGH:
            continue
        high, low = float(square[above].mean()), float(square[~above].mean())
        for value, word in ((high / low, "above"), (low / high, "below")):
            if value > best[0]:
                best = (value, f", most of it where q{j + 1} is {word} {middle:.3g}")
    return best[1]
