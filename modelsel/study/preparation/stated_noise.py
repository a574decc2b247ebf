"""Compare stated and measured uncertainties with what a fitted model leaves."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ..._typing import Array
from ...config.study_tables import NoiseTable
from ...diagnosis.unexplained import estimate_floor
from ...exceptions import sentence_list, write_rounded
from ...fitting.component_noise import POSITION, ROTATION
from ...fitting.design import whitened
from ...fitting.least_squares import Fit
from ...fitting.noise import Floor, from_repeats, from_target_pairs
from ...fitting.noise_check import NEAR_UNIT, Lack, describe_lack, lack, name_likeliest_mistake
from ...fitting.problem import Problem
from ...measurements.measurements import Measurements
from ...measurements.quantities.columns import MIN_UNCERTAINTY
from ...mechanisms.moved_targets import find_moved_targets
from ...notices import Note
from ...selection.evaluation import Evaluation, Split

LEFT = "the model leaves"
# where parts of the errors were found, which a stated uncertainty need not hold
LEFT_BESIDE_PARTS = "the model leaves beside the parts of the errors that were found"
# what an instrument's figures are in
INSTRUMENT_UNITS = (
    "Most likely one of those that are given is in another unit: range_mm is in millimetres, range_ppm in "
    "micrometres per metre, angle_urad in microradians, each as one standard deviation."
)


def check_stated_noise(
    split: Split, floor: Floor | None, fitted: Fit, parts_sought: bool = False
) -> tuple[Split, Floor | None, tuple[Note, ...]]:
    """Check the noise floor against the residuals of a fitted model.

    A floor that cannot be true is dropped (None), to be estimated from the residuals instead. The
    notes hold what is far off; what is a little off is left to the chosen model's lack-of-fit test.
    `parts_sought`: errors that do not repeat were looked for, beside the instrument's.
    """
    training = split.training.beside_instrument()
    comparison = _compare_with_floor(training, fitted, floor, POSITION)
    if floor is None or comparison is None:
        return split, floor, ()
    mismatch, left_mm = comparison
    # measured by repeats or target pairs
    is_measured = np.isfinite(floor.freedom)
    if is_measured:
        is_too_small = mismatch.factor > 1
        if not (mismatch.refuted and is_too_small):
            return split, floor, ()
        note = _describe_unlike_floor(floor, mismatch, left_mm)
        return replace(split, known_sigma=False), None, (note,)
    if not mismatch.far:
        return split, floor, ()
    note = _describe_wrong_statement(split, floor, mismatch, left_mm, parts_sought)
    if mismatch.refuted:
        unweighted = replace(split, known_sigma=False)
        return unweighted, None, (note,)
    return split, floor, (note,)


def note_overlooked_noise(noise: NoiseTable, data: Measurements) -> list[Note]:
    """Note which statement of the noise counts, where there are several."""
    statements = {
        "the uncertainties in the file": data.sigma is not None,
        "floor_mm": noise.floor_mm is not None,
        "range_mm, range_ppm and angle_urad": noise.instrument,
    }
    given = [words for words, is_given in statements.items() if is_given]
    if len(given) < 2:
        return []
    first, *others = given
    overlooked = sentence_list(others)
    sentence = (
        f"The noise is stated more than once: it is taken from {first}, not from {overlooked}."
    )
    return [Note("noise-stated-twice", sentence)]


def check_stated_orientation_noise(split: Split, fitted: Fit) -> tuple[Note, ...]:
    """Check stated uncertainties of orientations against the residuals of a fitted model."""
    training = split.training
    sigma = training.data.sigma_rotation
    if sigma is None:
        return ()
    mean_square = np.square(sigma).mean()
    rms = float(np.sqrt(mean_square))
    stated = Floor(rms, "stated")
    comparison = _compare_with_floor(training, fitted, stated, ROTATION)
    if comparison is None:
        return ()
    mismatch, left_rad = comparison
    if not mismatch.far:
        return ()
    columns = "srx_rad, sry_rad and srz_rad"
    has_parts = _has_parts(training)
    model = LEFT_BESIDE_PARTS if has_parts else LEFT
    text = describe_lack(columns, stated.coordinate_mm, left_rad, mismatch, "rad", model)
    reason = name_likeliest_mistake(1 / mismatch.factor, columns, "rad", parts_found=has_parts)
    note = Note("stated-uncertainty", f"{text} {reason}")
    return (note,)


def _compare_with_floor(
    problem: Problem, fitted: Fit, floor: Floor | None, part: slice
) -> tuple[Lack, float] | None:
    """Compare a fitted model's residuals with a floor, in the coordinates `part`.

    Returns the test and the root mean square [mm or rad] of one coordinate, without the parts of
    the errors that were found where the floor is stated; None where there is no floor or no degree
    of freedom. The model's own degrees of freedom are divided among the coordinates.
    """
    residual = fitted.residuals(problem)
    measured = problem.measured
    if measured is None:
        measured = np.ones(residual.shape, bool)
    part_measured = measured[:, part]
    count = int(part_measured.sum())
    total = int(measured.sum())
    used_freedom = fitted.rows - fitted.freedom
    used_share = used_freedom / total
    freedom = count * (1 - used_share)
    if floor is None or freedom < 1:
        return None
    left = _rms_of_part(residual, measured, part, freedom)
    least = max(floor.coordinate_mm, MIN_UNCERTAINTY)
    factor = left / least
    # stated, row by row
    is_stated = np.isinf(floor.freedom)
    if is_stated:
        weighted = whitened(problem, residual)
        factor = _rms_of_part(weighted, measured, part, freedom)
        if _has_parts(problem):
            left = factor * floor.coordinate_mm
    mismatch = lack(floor, factor, freedom)
    return mismatch, left


def _has_parts(problem: Problem) -> bool:
    """Whether parts of the errors were found beside the instrument."""
    return problem.whitening.stated is not None


def _rms_of_part(
    residual: Array, measured: NDArray[np.bool_], part: slice, freedom: float
) -> float:
    squares = np.square(residual)
    measured_squares = np.where(measured, squares, 0.0)
    part_squares = measured_squares[:, part]
    total = part_squares.sum()
    mean = total / freedom
    rms = np.sqrt(mean)
    return float(rms)


def _describe_wrong_statement(
    split: Split, floor: Floor, mismatch: Lack, left_mm: float, parts_sought: bool
) -> Note:
    """Return the note on a floor that the study, its data or the instrument's figures state."""
    data = split.problem.data
    if floor.source == "instrument":
        place = "[noise] range_mm, range_ppm, angle_urad"
    elif data.sigma is None:
        place = "[noise] floor_mm"
    elif data.gauges is not None:
        place = "s_mm"
    else:
        place = "sx_mm, sy_mm, sz_mm"
    problem = split.problem.beside_instrument()
    has_parts = _has_parts(problem)
    model = LEFT_BESIDE_PARTS if has_parts else LEFT
    ratio = 1 / mismatch.factor
    # what was looked for is told elsewhere, found or not
    is_told = has_parts or parts_sought
    mistake = name_likeliest_mistake(ratio, place, parts_found=is_told)
    is_unit = not 1 / NEAR_UNIT < ratio < NEAR_UNIT
    if floor.source == "instrument" and is_unit:
        mistake = INSTRUMENT_UNITS
    sentences = [describe_lack(place, floor.coordinate_mm, left_mm, mismatch, model=model), mistake]
    if mismatch.refuted:
        sentences.append("The figure is not used: what the model leaves takes its place.")
    return Note("stated-uncertainty", " ".join(sentences))


def _describe_unlike_floor(floor: Floor, mismatch: Lack, left_mm: float) -> Note:
    """Return the note on repeats or target pairs that show far less noise than a model leaves.

    That a model leaves more than they show is usual; so much more is not.
    """
    remedy = "Check whether repeated rows were measured again, or copied."
    if floor.source == "target pairs":
        remedy = "Check whether the tracking software computes the markers from one rigid body."
    return Note(
        "floor-unlike",
        f"The {floor.source} show a noise of {write_rounded(floor.coordinate_mm, 2)} mm per coordinate, and the "
        f"model leaves {write_rounded(left_mm)} mm, {write_rounded(mismatch.factor)} times as much: they cannot be the "
        "noise of the measurement, and the noise floor is estimated from what the model leaves. "
        f"{remedy}",
    )


def choose_noise_floor(split: Split, known: Floor | None, named: Evaluation) -> Floor:
    """Return the known noise floor, or else that of the residuals of the model with all that was
    `named`, which `candidates = []` keeps out of the chosen one: these errors are no noise.

    That of repeats is what this model leaves of them: it knows what differs from one to the next.
    That of target pairs, too, where it knows of one that moved.
    Where not every coordinate was measured, it is told how many a row has on average.
    """
    problem = split.problem
    if known is not None and known.source == "repeats":
        known = from_repeats(problem.data, problem.placed, named.residual[:, :3])
    is_of_pairs = known is not None and known.source == "target pairs"
    if is_of_pairs and any(map(find_moved_targets, named.fit.model.mechanisms)):
        known = from_target_pairs(problem.data, named.residual[:, :3])
    floor = known or estimate_floor(named, split)
    measured = problem.measured
    if measured is None:
        return floor
    counts = measured[:, :3].sum(1)
    coordinates = float(counts.mean())
    return replace(floor, coordinates=coordinates)
