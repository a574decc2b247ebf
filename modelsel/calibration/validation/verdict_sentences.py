"""What is said of new data against a calibration."""

from __future__ import annotations

import numpy as np

from ...exceptions import sentence_list, write_rounded
from ...measurements.measurements import Measurements
from .mistaken_data import REGISTER_AGAIN
from .validation import Verdict

FINE_MM = 10.0  # a length below is told to micrometres
MAX_EXACT_FACTOR = 100.0  # a factor below is told to hundredths
MIN_EXACT_P = 1e-12  # a p below is told to be below
MAX_LISTED = 10
LOUDER = (
    "look at the instrument, at what holds the target and at how well the arm repeats, or for an effect "
    "that is new, with a study of these data."
)
# share of rows beyond what the calibration has seen, above which they tell nothing of a drift
MAX_BEYOND_SHARE = 0.5
BEYOND_REMEDY = (
    "measure configurations within its ranges to learn whether the arm has changed, and make a study "
    "with these to calibrate it there."
)
MIN_HALF_RATIO = 1.5  # of mean squared errors in two halves of a joint's range, to be named
MIN_HALF_ROWS = 5


def describe_verdict(data: Measurements, verdict: Verdict) -> list[str]:
    """Describe the verdict in one sentence, then what belongs to it."""
    sentences = [_summarise_verdict(data, verdict)]
    if verdict.quieter is not None:
        before, now = map(write_rounded, verdict.quieter)
        sentences.append(
            f"The study estimated a noise of {before} mm per coordinate; the new data show {now} mm, which is "
            "expected here instead."
        )
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
            f"Registered again: the instrument is {write_rounded(shift)} mm and {write_rounded(turn * 1e3)} mrad from where it was, and the "
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
    if verdict.drifted:
        return _describe_drift(data, verdict, figures)
    if verdict.small:
        return f"Drift cannot be judged, since the stated uncertainty is far above the errors: {figures}."
    count = len(verdict.left_out)
    if count:
        rows = "a row that is" if count == 1 else f"{count} rows that are"
        return f"The calibration is still valid within noise, without {rows} far off: {figures}."
    return f"The calibration is still valid within noise: {figures}."


def _describe_drift(data: Measurements, verdict: Verdict, figures: str) -> str:
    """Describe errors that the calibration does not expect."""
    total = len(data)
    if verdict.patternless:
        return (
            f"The errors of the new data are larger than the calibration expects: {figures}. No change of the set-up, of the "
            f"geometry, of a joint's zero or its play, or of a calibrated effect explains them: {LOUDER}"
        )
    if verdict.beyond > MAX_BEYOND_SHARE * total:
        verb = "lies" if verdict.beyond == 1 else "lie"
        return (
            f"The calibration does not hold for these data: {figures}. But {verdict.beyond:,} of {total:,} rows {verb} "
            f"far beyond what it has seen, where that need not be a change of the arm: {BEYOND_REMEDY}"
        )
    count = len(verdict.worst)
    rows = "no single row shows it"
    if count:
        verb = "shows" if count == 1 else "show"
        rows = f"{count:,} of {total:,} rows {verb} it"
    place = _locate_errors(data, verdict)
    remedy = ""
    if verdict.moved is None:
        remedy = f" {REGISTER_AGAIN}"
    return f"The calibration has drifted: {figures}; {rows}{place}.{remedy}"


def _write_mm(length: float) -> str:
    """Write a length [mm] to micrometres; one of 10 mm or more with three digits."""
    return f"{length:.3f}" if length < FINE_MM else write_rounded(length)


def _list_worst(data: Measurements, verdict: Verdict) -> str:
    rows = []
    for k in verdict.worst[:MAX_LISTED]:
        row = int(data.row[k])
        words = [data.where.label([row], 1), data.where.name_row(row)]
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
