"""What is left of a study's residuals: held-out outliers, the noise they show, what a further
effect would have had to be."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from .._typing import Array
from ..diagnosis.sentences import format_length
from ..diagnosis.unexplained import MIN_FLOOR_FREEDOM, STATED_FLOOR_FREEDOM
from ..fitting.design import fixture_values, whitened
from ..fitting.least_squares import Fit
from ..fitting.noise import LACKING, MEDIAN, Floor
from ..fitting.observation import LENGTH
from ..fitting.problem import Problem
from ..measurements.measurements import SAME_READING, Measurements
from ..mechanisms.causes import Member
from ..notices import Note
from ..robot.rigid import turn
from ..selection.evaluation import Evaluation, Split
from .finding_records import CLEARLY, RARELY


@dataclass(frozen=True)
class LackOfFit:
    """A model compared with the noise floor (methods.md A.8): F of what it leaves over the floor's
    variance, its p, the floor [mm], and the standard deviation of one coordinate [mm] that the
    floor does not explain, with a 95 % interval."""

    f: float
    p: float
    floor_mm: float
    unexplained_mm: float
    low_mm: float
    high_mm: float


def lack_of_fit(chosen: Evaluation, floor: Floor | None, split: Split) -> LackOfFit | None:
    """Whether a model leaves more on the rows that fit than a floor that is known without it; None
    where it is estimated from the residuals. Of repeats: the classical test of lack of fit against
    the pure error of these rows; of target pairs, whose floor rests on a median, on MEDIAN of their
    degrees of freedom."""
    from scipy.special import fdtrc, fdtri

    if floor is None or floor.source == "estimated":
        return None
    training = split.training()
    seen = (
        np.ones((len(training), 3), bool) if training.measured is None else training.measured[:, :3]
    )
    left = np.where(seen, whitened(training, chosen.fit.residuals(training))[:, :3], 0.0)
    total, freedom = (
        float(np.square(left).sum()),
        chosen.fit.freedom * int(seen.sum()) / training.coordinates,
    )
    pure, each, known = (
        1.0,
        1.0,
        float(np.where(np.isfinite(floor.freedom), MEDIAN * floor.freedom, STATED_FLOOR_FREEDOM)),
    )
    if floor.source == "repeats":
        within, known = pure_error(training)
        total, freedom, pure = total - within, freedom - known, within / max(known, 1)
        each = (
            3 * len(training) / (3 * len(training) - known)
        )  # rows of a posture, all with what is unexplained
    if freedom < 1 or known < MIN_FLOOR_FREEDOM or pure <= 0:
        return None
    f = max(total / freedom / pure, 0.0)
    sigma = floor.coordinate_mm * np.sqrt(pure)
    ratios = np.array([f, f / fdtri(freedom, known, 0.975), f / fdtri(freedom, known, 0.025)])
    unexplained = sigma * np.sqrt(np.maximum(ratios - 1, 0.0) / each)
    return LackOfFit(f, float(fdtrc(freedom, known, f)), float(sigma), *unexplained.tolist())


def pure_error(problem: Problem) -> tuple[float, float]:
    """(sum of squares, degrees of freedom) of whitened positions at equal readings of one target,
    about their means."""
    data = problem.data
    position = whitened(problem, np.pad(data.position, ((0, 0), (0, problem.components - 3))))[
        :, :3
    ]
    key = np.unique(data.block * len(data.targets) + data.target, return_inverse=True)[1].reshape(
        -1
    )
    count = np.bincount(key)
    low, high = (np.full((len(count), data.q.shape[1]), sign * np.inf) for sign in (1, -1))
    np.minimum.at(low, key, data.q)
    np.maximum.at(high, key, data.q)
    still = (high - low).max(
        1
    ) <= SAME_READING  # an arm read anew has moved its target, too: no repeat
    mean = np.stack([np.bincount(key, position[:, a]) / count for a in range(3)], 1)
    return float(np.square(position - mean[key])[still[key]].sum()), 3.0 * float(
        (count - 1)[still].sum()
    )


def lacking(found: LackOfFit | None, stated: bool = True) -> tuple[Note, ...]:
    """Where a model leaves clearly more than the noise floor, or clearly less than one that is
    `stated`."""
    if found is None:
        return ()
    if stated and 1 - found.p <= RARELY and found.f * CLEARLY**2 <= 1:
        return (
            Note(
                LACKING,
                "The chosen model leaves less than the noise floor (lack-of-fit test: F = "
                f"{found.f:.3g}, so little by chance with probability below {RARELY:g}): of the floor of "
                f"{format_length(found.floor_mm)} per coordinate it leaves {format_length(found.floor_mm * float(np.sqrt(found.f)))}. "
                "The figure is too large.",
            ),
        )
    if (
        found.p > RARELY
        or np.hypot(found.unexplained_mm, found.floor_mm) < CLEARLY * found.floor_mm
    ):
        return ()
    return (
        Note(
            LACKING,
            "The chosen model leaves more than the noise floor explains (lack-of-fit test: F = "
            f"{found.f:.3g}, by chance with probability {found.p:.1g}): beyond the floor of {format_length(found.floor_mm)} per "
            f"coordinate, {format_length(found.unexplained_mm)} (95 %: {format_length(found.low_mm)} to {format_length(found.high_mm)}) is "
            "unexplained. Either the model lacks something, or the floor leaves out a part of the noise: what rows measured "
            "together share, or what changes from one approach to the next.",
        ),
    )


def noise_dict(floor: Floor, measured: Measurements) -> dict[str, Any]:
    """The result's noise floor; with rows that are no points also the mean length [mm] of a row's
    noise."""
    out: dict[str, Any] = {"coordinate_mm": floor.coordinate_mm, "source": floor.source}
    if measured.gauges is not None:
        single = float((measured.gauges.coordinates.sum(1) == 1).mean())
        out["mean_mm"] = floor.coordinate_mm * float(
            single * np.sqrt(2 / np.pi) + (1 - single) * np.sqrt(8 / np.pi)
        )
    return out


@dataclass(frozen=True)
class Placed:
    """A feature as the chosen model has it, in the tracker's frame: its place (of a plane: a point
    of it), a plane's normal, a length that readings leave out or a ball-bar's own; `fitted`: what
    was not known."""

    name: str
    kind: str
    position_mm: tuple[float, float, float]
    normal: tuple[float, float, float] | None
    length_mm: float | None
    fitted: tuple[str, ...]


def features(problem: Problem, fitted: Fit) -> tuple[Placed, ...]:
    """Every feature that has a place, of a problem with rows that are no points."""
    gauges = problem.data.gauges
    if gauges is None:
        return ()
    values = fixture_values(len(gauges.features), fitted.terms, fitted.theta)
    out = []
    for k, f in enumerate(gauges.features):
        if f.kind == "distance":
            continue
        place, normal = problem.fixtures.centre[k] + values[k, :3], None
        if f.kind == "plane":
            local = turn(0, values[k, 3]) @ turn(1, values[k, 4]) @ np.array([0.0, 0.0, 1.0])
            normal = local @ problem.fixtures.axes[k]
            place = problem.fixtures.centre[k] + values[k, 2] * normal
        length = float(problem.fixtures.length[k] + values[k, LENGTH])
        symbols = tuple(
            t.symbol
            for t in fitted.terms
            if t.fixture and t.screws[0].cause == Member("feature", k)
        )
        out.append(
            Placed(
                f.name,
                f.kind,
                _three(place),
                None if normal is None else _three(normal),
                length or None,
                symbols,
            )
        )
    return tuple(out)


def _three(vector: Array) -> tuple[float, float, float]:
    x, y, z = vector.tolist()
    return x, y, z
