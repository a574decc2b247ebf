"""How good the chosen model is: its lack of fit against a known noise floor, and where it has the features that rows
share."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from ..._typing import Array
from ...diagnosis.findings.sentences import format_length
from ...diagnosis.unexplained import MIN_FLOOR_FREEDOM, STATED_FLOOR_FREEDOM
from ...fitting.design import whitened
from ...fitting.least_squares import Fit
from ...fitting.noise import LACKING, Floor
from ...fitting.observation import LENGTH
from ...fitting.problem import Problem
from ...measurements.measurements import Measurements
from ...measurements.repeats import find_repeats
from ...mechanisms.terms import FixtureTerm
from ...notices import Note
from ...robot.rigid import rotation_matrix
from ...selection.evaluation import Evaluation, Split
from .finding_notes import MAX_SURPRISE_P, MIN_SURPRISE

Triple = tuple[float, float, float]


@dataclass(frozen=True)
class LackOfFit:
    """A model compared with the noise floor (methods.md A.8): F of what it leaves over the floor's
    variance, its p, the floor [mm], and the standard deviation of one coordinate [mm] that the
    floor does not explain, with a 95 % interval; `expected_mm`: the standard deviation of one coordinate by the floor
    and what else does not repeat, where that is counted."""

    f: float
    p: float
    floor_mm: float
    unexplained_mm: float
    low_mm: float
    high_mm: float
    expected_mm: float | None = None


@dataclass(frozen=True)
class _Variances:
    """Sums of squares in `unit_mm` squared: what a model leaves with its degrees of freedom, the `pure` variance of
    repeats with its own, and the share of an unexplained variance that the former see; `expected_mm`: see
    `LackOfFit`."""

    unit_mm: float
    total: float
    freedom: float
    pure: float
    pure_freedom: float
    share: float = 1.0
    expected_mm: float | None = None


def measure_lack_of_fit(chosen: Evaluation, floor: Floor | None, split: Split) -> LackOfFit | None:
    """Test whether a model leaves more on the rows that fit than a floor that is known without it.

    Of repeats: the classical test of lack of fit against the pure error of these rows. None where the floor is
    estimated from the residuals, or rests on too little."""
    from scipy.special import fdtrc, fdtri

    if floor is None or floor.source == "estimated":
        return None
    training = split.training.beside_instrument()
    parts = _variances(chosen, floor, training)
    if parts.freedom < 1 or parts.pure_freedom < MIN_FLOOR_FREEDOM or parts.pure <= 0:
        return None
    f = max(parts.total / parts.freedom / parts.pure, 0.0)
    sigma = parts.unit_mm * np.sqrt(parts.pure)
    bounds = [fdtri(parts.freedom, parts.pure_freedom, q) for q in (0.975, 0.025)]
    ratios = np.array([f, f / bounds[0], f / bounds[1]])
    scale = sigma if parts.expected_mm is None else parts.expected_mm
    unexplained = scale * np.sqrt(np.maximum(ratios - 1, 0.0) / parts.share)
    p = float(fdtrc(parts.freedom, parts.pure_freedom, f))
    most_likely, low, high = unexplained.tolist()
    return LackOfFit(f, p, float(sigma), most_likely, low, high, parts.expected_mm)


def _variances(chosen: Evaluation, floor: Floor, training: Problem) -> _Variances:
    """Split what a model leaves on the training rows into lack of fit and pure error."""
    counted = training.components_measured[:, :3]
    residuals = chosen.fit.residuals(training)
    white = whitened(training, residuals)[:, :3]
    total = float(np.square(np.where(counted, white, 0.0)).sum())
    freedom = chosen.fit.freedom * int(counted.sum()) / training.coordinates
    if floor.source != "repeats":
        known = floor.freedom if np.isfinite(floor.freedom) else STATED_FLOOR_FREEDOM
        expected_mm = None
        if training.whitening.stated is not None:
            # rows share errors: what they leave [mm] for every unit of what is expected
            left = float(np.square(np.where(counted, residuals[:, :3], 0.0)).sum())
            expected_mm = float(np.sqrt(left / total))
        of_floor = floor.coordinate_mm, total, freedom, 1.0, float(known)
        return _Variances(*of_floor, expected_mm=expected_mm)
    within, known = sum_pure_error(training, residuals)
    coordinates = 3 * len(training)
    # rows of a posture all have what is unexplained
    share = coordinates / (coordinates - known)
    # the rows have the weight of repeats before a model was known
    stated = training.whitening.as_stated()
    unit_mm = 1 / stated.typical_weight()
    lacking = total - within
    pure = within / max(known, 1)
    return _Variances(unit_mm, lacking, freedom - known, pure, known, share)


def sum_pure_error(problem: Problem, residuals: Array) -> tuple[float, float]:
    """Return (sum of squares, degrees of freedom) of whitened residuals (m, c) of positions at equal readings of one
    target, about their means: a model knows what differs from one repeat to the next."""
    repeats = find_repeats(problem.data, problem.placed, is_predicted=True)
    # about the means first: rows that share errors are mixed
    deviations = repeats.deviate(residuals[:, :3])
    padded = np.pad(deviations, ((0, 0), (0, problem.components - 3)))
    squares = np.square(whitened(problem, padded)[:, :3])
    return float(squares.sum()), float(repeats.freedom)


def lack_of_fit_notes(lack: LackOfFit | None, stated: bool = True) -> tuple[Note, ...]:
    """Return the warning about a model that leaves clearly more than the noise floor, or clearly less than one that
    is `stated`."""
    if lack is None:
        return ()
    too_little = 1 - lack.p <= MAX_SURPRISE_P and lack.f * MIN_SURPRISE**2 <= 1
    if stated and too_little:
        return (Note(LACKING, _overstated_sentence(lack)),)
    expected_mm = lack.floor_mm if lack.expected_mm is None else lack.expected_mm
    total = np.hypot(lack.unexplained_mm, expected_mm)
    if lack.p > MAX_SURPRISE_P or total < MIN_SURPRISE * expected_mm:
        return ()
    return (Note(LACKING, _unexplained_sentence(lack)),)


def _overstated_sentence(lack: LackOfFit) -> str:
    residual = lack.floor_mm * float(np.sqrt(lack.f))
    return (
        "The chosen model leaves less than the noise floor (lack-of-fit test: F = "
        f"{lack.f:.3g}, so little by chance with probability below {MAX_SURPRISE_P:g}): of the floor of "
        f"{format_length(lack.floor_mm)} per coordinate it leaves {format_length(residual)}. The figure is too large."
    )


def _unexplained_sentence(lack: LackOfFit) -> str:
    interval = f"{format_length(lack.low_mm)} to {format_length(lack.high_mm)}"
    beyond = f"the floor of {format_length(lack.floor_mm)} per coordinate"
    if lack.expected_mm is not None:
        beyond += f", and {format_length(lack.expected_mm)} with what else does not repeat"
    return (
        "The chosen model leaves more than the noise floor explains (lack-of-fit test: F = "
        f"{lack.f:.3g}, by chance with probability {lack.p:.1g}): beyond {beyond}, "
        f"{format_length(lack.unexplained_mm)} (95 %: {interval}) is unexplained. Either the model lacks something, "
        "or the floor leaves out a part of the noise: what rows measured together share, or what changes "
        "from one approach to the next."
    )


def describe_noise(floor: Floor, measured: Measurements) -> dict[str, Any]:
    """Return the result's noise floor; with rows that are no points also the mean and the rms length [mm] of
    a row's noise."""
    noise: dict[str, Any] = {"coordinate_mm": floor.coordinate_mm, "source": floor.source}
    if measured.gauges is not None:
        is_single = measured.gauges.coordinates.sum(1) == 1
        single = float(is_single.mean())
        # mean lengths of one and of three standard normal coordinates
        one, three = np.sqrt(2 / np.pi), np.sqrt(8 / np.pi)
        mean_length = float(single * one + (1 - single) * three)
        noise["mean_mm"] = floor.coordinate_mm * mean_length
        noise["rms_mm"] = floor.coordinate_mm * float(np.sqrt(single + 3 * (1 - single)))
    return noise


@dataclass(frozen=True)
class LocatedFeature:
    """A feature as the chosen model has it, in the tracker's frame: its place (of a plane: a point
    of it), a plane's normal, a length that readings leave out or a ball-bar's own; `fitted`: what
    was not known."""

    name: str
    kind: str
    position_mm: Triple
    normal: Triple | None
    length_mm: float | None
    fitted: tuple[str, ...]


def locate_features(problem: Problem, fitted: Fit) -> tuple[LocatedFeature, ...]:
    """Locate every feature that has a place, of a problem with rows that are no points."""
    gauges = problem.data.gauges
    if gauges is None:
        return ()
    values = fitted.at().feature_changes(len(gauges.features))
    return tuple(
        _locate_feature(problem, fitted, index, values[index])
        for index, feature in enumerate(gauges.features)
        if feature.kind != "distance"
    )


def _locate_feature(problem: Problem, fitted: Fit, index: int, values: Array) -> LocatedFeature:
    """Locate one feature; `values`: what the fit adds to its place, its angles and its length."""
    assert problem.data.gauges is not None
    feature, fixtures = problem.data.gauges.features[index], problem.fixtures
    position, normal = fixtures.centre[index] + values[:3], None
    if feature.kind == "plane":
        tilt = rotation_matrix(0, values[3]) @ rotation_matrix(1, values[4])
        direction = tilt @ np.array([0.0, 0.0, 1.0]) @ fixtures.axes[index]
        position = fixtures.centre[index] + values[2] * direction
        normal = _triple(direction)
    length = float(fixtures.length[index] + values[LENGTH])
    return LocatedFeature(
        feature.name,
        feature.kind,
        _triple(position),
        normal,
        length or None,
        _fitted_symbols(fitted, index),
    )


def _fitted_symbols(fitted: Fit, index: int) -> tuple[str, ...]:
    """Return the symbols of a feature's terms in a fit."""
    terms = [term for term in fitted.terms if isinstance(term, FixtureTerm)]
    return tuple(term.symbol for term in terms if term.feature == index)


def _triple(vector: Array) -> Triple:
    x, y, z = vector.tolist()
    return x, y, z
