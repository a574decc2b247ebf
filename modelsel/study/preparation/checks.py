"""Check the set-up before anything is fitted, and the chosen model before it is reported.

Every check returns warnings, each with its code.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from ...diagnosis.faults.data_faults import Fault
from ...diagnosis.faults.mistaken_rows import describe_slip_before_fit, describe_slips
from ...exceptions import NotEstimable, sentence_list, write_percent, write_rounded
from ...fitting.least_squares import Fit
from ...fitting.noise import Floor
from ...fitting.problem import Problem
from ...measurements.measurements import Measurements
from ...mechanisms.causes import ONE
from ...mechanisms.terms import Term
from ...notices import (
    ALARM_OF_FAULT,
    ALARMS,
    HOPELESS_FIT,
    NOISE_CODES,
    OTHER_ROBOT,
    ROWS_MISTAKEN,
    SETUP_MISTAKE,
    Note,
    list_alarms,
)
from ...results.repeatability.rounding_effect import note_rounding
from ...robot.files import builtin_names, load_robot
from ...robot.kinematics import Robot
from ...selection.evaluation import Evaluation, Split, measure_orientation
from ...setup.measured_orientations import describe_orientation_mistake
from ...setup.mistakes import describe_moved_targets, describe_setup_mistake
from ...setup.other_robots import describe_other_robot, describe_shifted_rows
from ...setup.target_labels import find_swapped_labels
from ...setup.target_places import describe_wrong_targets

Register = bool | Literal["per group"]  # as [robot] register in a study

# tolerance that makers allow a link or an axis at most
MAX_TOLERANCE = {"mm": 5.0, "rad": np.pi / 180}
# standard errors by which a parameter must exceed it: those of a wrong model are too small. Of 900
# simulated arms with parameters up to half the tolerance, and errors beside them of up to 20 times the
# noise, 5 were told with 3, 2 with 5 and none with 10; of 450 with parameters up to the tolerance 16, 8
# and 1. Of 100 links typed 10 mm wrong, 72 were told with 3, 66 with 5 and 39 with 10.
MIN_STANDARD_ERRORS = 5.0
MAX_LISTED = 6  # parameters that one sentence lists
# of the reach: what a calibrated arm leaves at most
CALIBRATED_SHARE = 1e-3
# a fit is hopeless above this many times CALIBRATED_SHARE
HOPELESS_RATIO = 5.0
# or above CALIBRATED_SHARE and this many times the known noise
HOPELESS_NOISE_RATIO = 50.0
MIN_MOTION = 1e-6  # rad or mm: a joint with a smaller range does not move
HOPELESS_ANGLE = 0.1  # rad of orientation left (rms)
# residual over detection limit, above which the limit alone would mislead
MIN_LEFT_OVER_LIMIT = 5.0
# residual over noise, above which noise does not explain the residual
MIN_LEFT_OVER_NOISE = 2.0


def check_setup(
    problem: Problem, use: NDArray[np.bool_], registered: bool, per_group: bool
) -> tuple[Note, ...]:
    """Return the simple mistakes of the set-up that explain the positions of the rows `use` (mask).

    The problem has its placement and targets; `registered` and `per_group` say whether and how
    they were found from the rows.
    """
    every_row = np.ones(len(problem), bool)
    misplaced = describe_wrong_targets(problem.data)
    if misplaced is not None:
        # whatever else seems to explain such positions makes up for it
        return (Note("targets-mistaken", misplaced),)
    # asked first: links that are another robot's are no mistake in this one's
    other = describe_other_robot(problem, use, load_builtin_robots)
    swapped = find_swapped_labels(problem, every_row, registered, per_group)
    mistake = describe_setup_mistake(problem, use, registered, per_group, links=other is None)
    moved = None
    if not registered:
        moved = describe_moved_targets(problem, use)
    sentences = [
        (SETUP_MISTAKE, mistake),
        (SETUP_MISTAKE, moved),
        ("orientation-mistake", describe_orientation_mistake(problem, use, registered)),
        ("labels-swapped", None if swapped is None else swapped.sentence),
        (OTHER_ROBOT, other),
    ]
    explained = any(sentence for _, sentence in sentences)
    if not explained:
        sentences = [
            (ROWS_MISTAKEN, describe_slip_before_fit(problem, registered, per_group)),
            ("rows-shifted", describe_shifted_rows(problem, every_row)),
        ]
    concerned = {} if swapped is None else {"labels-swapped": swapped.rows}
    notes = [Note(code, text, concerned.get(code)) for code, text in sentences if text]
    return tuple(notes)


@contextmanager
def add_alarms_to_errors(notes: Sequence[Note]) -> Iterator[None]:
    """Add the alarms among the notes to a NotEstimable that is raised inside.

    They are its likeliest reason.
    """
    try:
        yield
    except NotEstimable as error:
        sentences = list_alarms(notes)
        if not sentences:
            raise
        text = " ".join([str(error), *sentences])
        raise NotEstimable(text, parameters=error.parameters) from None


def load_builtin_robots() -> dict[str, Robot]:
    """Return the built-in robots by name."""
    names = builtin_names()
    return {name: load_robot(name) for name in names}


def drop_known_faults(faults: Sequence[Fault], notes: Sequence[Note]) -> tuple[Fault, ...]:
    """Return the data faults but those that an alarm reports of the same rows."""
    return tuple(fault for fault in faults if not any(_reports(note, fault) for note in notes))


def _reports(note: Note, fault: Fault) -> bool:
    """Whether a note is the alarm of a fault's kind, of all its rows."""
    if note.code != ALARM_OF_FAULT.get(fault.name):
        return False
    return note.rows is None or set(fault.rows.tolist()) <= set(note.rows)


def check_chosen_model(
    split: Split,
    chosen: Evaluation,
    floor: Floor,
    limit_mm: float | None,
    notes: Sequence[Note],
    register: Register,
    faults: Sequence[Fault] = (),
) -> tuple[Note, ...]:
    """Return the warnings that the chosen model itself gives rise to.

    They concern rows that a slip explains, parameters beyond makers' tolerances, a hopeless fit,
    a detection limit far below what is left, and joint readings that may have been rounded. `notes`: the warnings so far. Where these report a
    mistake of the set-up or another robot, parameters beyond tolerances are no further warning: the
    mistake is not corrected, and the parameters make up for it. Rows of `faults` are reported as
    such.
    """
    codes = {note.code for note in notes}
    new_notes: list[Note] = []
    if ROWS_MISTAKEN not in codes:
        new_notes += _check_slipped_rows(split, chosen.fit, faults)
    is_mistaken = SETUP_MISTAKE in codes or OTHER_ROBOT in codes
    if not is_mistaken:
        new_notes += _check_tolerances(split, chosen.fit)
    known_notes = [*notes, *new_notes]
    hopeless = _describe_hopeless_fit(split, chosen, floor, known_notes, register)
    if hopeless is not None:
        note = Note(HOPELESS_FIT, hopeless)
        return (*new_notes, note)
    limit_notes = _check_detection_limit(chosen, floor, limit_mm)
    left_mm = chosen.estimation.rms_mm
    rounding_notes = note_rounding(split.training, chosen.fit, left_mm, _row_noise(floor))
    return (*new_notes, *limit_notes, *rounding_notes)


def _check_slipped_rows(split: Split, fitted: Fit, faults: Sequence[Fault]) -> list[Note]:
    outlying = split.outliers
    is_slipped = outlying & split.estimation
    if is_slipped.all():
        return []
    fault_rows: list[int] = []
    for fault in faults:
        rows = fault.rows.tolist()
        fault_rows.extend(rows)
    problem = split.problem
    reported = np.isin(problem.data.row, fault_rows)
    sentences = describe_slips(problem, fitted.residuals, outlying, named=reported)
    return [Note(ROWS_MISTAKEN, sentence) for sentence in sentences]


def _check_tolerances(split: Split, fitted: Fit) -> list[Note]:
    """Return a note on geometric parameters that no maker's tolerance allows.

    It names the built-in robot that fits better, if any.
    """
    excesses = []
    robot = split.problem.robot
    for k in fitted.found.kept:
        term = fitted.terms[k]
        value = float(fitted.theta[k])
        error = float(fitted.standard_errors[k])
        tolerance = MAX_TOLERANCE.get(term.unit, np.inf)
        certain_part = abs(value) - MIN_STANDARD_ERRORS * error
        if _is_link_parameter(term, robot.n) and certain_part > tolerance:
            ratio = abs(value) / tolerance
            excesses.append((ratio, term.symbol, value, error, term.unit))
    if not excesses:
        return []
    excesses.sort(reverse=True)
    listed = []
    for _, symbol, value, error, unit in excesses[:MAX_LISTED]:
        formatted = _format_value(value, error, unit)
        listed.append(f"{symbol} = {formatted}")
    text = ", ".join(listed)
    if len(excesses) > MAX_LISTED:
        text += f" and {len(excesses) - MAX_LISTED} more"
    other = describe_other_robot(split.problem, split.used, load_builtin_robots, always=True)
    remedy = other or "Check the robot's name or file, and where the joints' zeros are."
    return [
        Note(
            "beyond-tolerance",
            f"{text}: beyond what makers' tolerances allow (1 to 5 mm, 1°). {remedy}",
        )
    ]


def _is_link_parameter(term: Term, joints: int) -> bool:
    """Return whether a term is one constant screw between the second and the last joint."""
    if term.fixture:
        return False
    screws = term.screws
    if len(screws) != 1:
        return False
    screw = screws[0]
    is_on_link = 1 < screw.frame <= joints
    return screw.cause == ONE and is_on_link


def _format_value(value: float, error: float, unit: str) -> str:
    if unit == "rad":
        value_deg = np.degrees(value)
        error_deg = np.degrees(error)
        return f"{write_rounded(value_deg)} ± {write_rounded(error_deg, 2)}°"
    return f"{value:.4g} ± {write_rounded(error, 2)} {unit}"


def _row_noise(floor: Floor) -> float:
    """Return the root mean square length [mm] of the noise of a row."""
    coordinates = np.sqrt(floor.coordinates)
    length = float(coordinates)
    return floor.coordinate_mm * length


def _check_detection_limit(chosen: Evaluation, floor: Floor, limit_mm: float | None) -> list[Note]:
    left_mm = chosen.estimation.rms_mm or 0.0
    noise_mm = _row_noise(floor)
    unexplained = left_mm > MIN_LEFT_OVER_NOISE * noise_mm
    if limit_mm is None or not unexplained or not limit_mm < left_mm / MIN_LEFT_OVER_LIMIT:
        return []
    return [
        Note(
            "limit-below-left",
            f"The detection limit of {write_rounded(limit_mm, 2)} mm rms is that of one single cause: "
            f"{write_rounded(left_mm, 2)} mm rms are left where noise would leave {write_rounded(noise_mm, 2)} mm, so larger "
            "errors of another form are in the data.",
        )
    ]


def _describe_hopeless_fit(
    split: Split, chosen: Evaluation, floor: Floor, notes: Sequence[Note], register: Register
) -> str | None:
    """Return the sentence on a hopeless fit: how much is left, against what, the likeliest reasons.

    None where the fit is not hopeless.
    """
    if not is_hopeless(split, chosen, floor):
        return None
    reach = split.problem.reach_mm
    calibrated = CALIBRATED_SHARE * reach
    left_mm = _measure_left(chosen)
    noise_mm = _row_noise(floor)
    noise_known = floor.source != "estimated"
    angle = _measure_angle(split, chosen)
    if _is_far(split, chosen, floor):
        what = (
            f"{write_rounded(left_mm)} mm rms are left, {write_percent(left_mm / reach, 2)} of the length of the arm's links and target in all, where a "
            f"calibrated arm leaves less than a thousandth ({write_rounded(calibrated, 2)} mm)"
        )
        if noise_known:
            what += f" and the noise ({floor.source}) {write_rounded(noise_mm, 2)} mm"
    else:
        what = (
            f"{write_rounded(np.degrees(angle))}° rms of orientation are left, where a calibrated arm leaves "
            "less than 1°"
        )
    data = split.problem.data
    reasons = _list_still(data) + _list_reasons(notes, register, len(data.groups))
    return (
        "This fit explains the data poorly, and nothing that follows can be relied on: "
        f"{what}. {reasons}."
    )


def is_hopeless(split: Split, evaluation: Evaluation, floor: Floor) -> bool:
    """Return whether a model leaves far more than a calibrated arm does, of positions or of
    orientations."""
    if _is_far(split, evaluation, floor):
        return True
    angle = _measure_angle(split, evaluation)
    return angle >= HOPELESS_ANGLE


def _is_far(split: Split, evaluation: Evaluation, floor: Floor) -> bool:
    """Return whether a model leaves far more of the positions than a calibrated arm does."""
    problem = split.problem
    calibrated = CALIBRATED_SHARE * problem.reach_mm
    left_mm = _measure_left(evaluation)
    most = HOPELESS_RATIO * calibrated
    if floor.source != "estimated":
        of_noise = HOPELESS_NOISE_RATIO * _row_noise(floor)
        most = min(most, max(of_noise, calibrated))
    return left_mm > most


def _measure_left(evaluation: Evaluation) -> float:
    """Return what a model leaves of the positions (rms, mm), of estimation or held-out rows, whichever
    is more."""
    estimation = evaluation.estimation
    held_out = evaluation.held_out
    of_estimation = estimation.rms_mm or 0.0
    of_held_out = held_out.rms_mm or 0.0
    return max(of_estimation, of_held_out)


def _measure_angle(split: Split, evaluation: Evaluation) -> float:
    """Return what a model leaves of the orientations (rms, rad); 0 where none was measured."""
    angles = measure_orientation(split, evaluation, evaluation)
    if angles is None:
        return 0.0
    _, angle = angles
    return angle


def _list_still(data: Measurements) -> str:
    """Return a sentence on joints whose readings never change, which a wrong column would explain; nothing
    where there are none."""
    ranges = np.ptp(data.q, axis=0)
    still = np.flatnonzero(ranges <= MIN_MOTION)
    if not len(still):
        return ""
    joints = sentence_list([f"joint {j}" for j in still + 1])
    return f"The readings of {joints} never change: if the arm moved there, correct that first. "


def _list_reasons(notes: Sequence[Note], register: Register, groups: int) -> str:
    """Return the likeliest reasons of a hopeless fit: the alarms, or the usual ones."""
    codes = {note.code for note in notes} - NOISE_CODES
    topics = [lead.removeprefix("Check ") for code, lead in ALARMS.items() if code in codes]
    if topics:
        topics = list(dict.fromkeys(topics))
        return f"Likeliest reason: what the warnings say about {sentence_list(topics)}"
    if not register:
        frame = "an instrument's frame that is not the robot's base ([robot] register = true)"
    elif register != "per group" and groups > 1:
        frame = 'an instrument moved between groups (register = "per group")'
    else:
        frame = "an instrument or target moved during the campaign"
    return (
        f"Likeliest reasons: the wrong robot file; positions that belong to other readings; {frame}"
    )
