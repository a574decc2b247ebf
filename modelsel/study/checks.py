"""What is asked of the data before anything is believed, and of the result before it is told:
warnings, each with its code."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from .._typing import Array
from ..diagnosis.mistaken_rows import describe_slip_before_fit, describe_slips
from ..diagnosis.outliers import Fault
from ..exceptions import NotEstimable, sentence_list
from ..fitting.design import whitened
from ..fitting.least_squares import Fit
from ..fitting.noise import Floor
from ..fitting.noise_check import Lack, describe_lack, lack, name_likeliest_mistake
from ..fitting.problem import Problem
from ..measurements.columns import MIN_UNCERTAINTY
from ..mechanisms.causes import ONE
from ..notices import (
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
from ..robot.files import builtin_names, load
from ..robot.kinematics import Robot
from ..selection.evaluation import Evaluation, Split, measure_orientation
from ..setup.measured_orientations import describe_orientation_mistake
from ..setup.mistakes import describe_setup_mistake
from ..setup.other_robots import describe_other_robot, describe_shifted_rows
from ..setup.target_labels import describe_swapped_labels

TOLERANCE = {"mm": 5.0, "rad": np.pi / 180}  # what makers allow a link or an axis at most
SURE = 10.0  # standard errors beyond it, before it is said: those of a misfit are too small
LISTED = 6
THOUSANDTH = 1e-3  # of the reach: what a calibrated arm leaves at most
HOPELESS_TIMES = 5.0  # that, or
NOISE_TIMES = 50.0  # the known noise, if more than a thousandth of the reach is left
TURNED = 0.1  # rad of orientation left (rms)
BELOW = (
    5.0  # times that a detection limit is below what is left, where the noise does not explain it
)
FAINT = 2.0  # times the noise, from which it does not


def setup_notes(
    bound: Problem, use: NDArray[np.bool_], registered: bool, per_group: bool
) -> tuple[Note, ...]:
    """What simple mistake explains how the positions of the rows `use` (mask) lie, of a problem at
    its placement and tools."""
    other = describe_other_robot(
        bound, use, builtin
    )  # asked first: another robot's links are no mistake in this one's
    found = [
        (
            SETUP_MISTAKE,
            describe_setup_mistake(bound, use, registered, per_group, links=other is None),
        ),
        ("orientation-mistake", describe_orientation_mistake(bound, use, registered)),
        (
            "labels-swapped",
            describe_swapped_labels(bound, np.ones(len(bound), bool), registered, per_group),
        ),
        (OTHER_ROBOT, other),
    ]
    if not any(said for _, said in found):
        found += [
            (ROWS_MISTAKEN, describe_slip_before_fit(bound, registered, per_group)),
            ("rows-shifted", describe_shifted_rows(bound, np.ones(len(bound), bool))),
        ]
    return tuple(Note(code, said) for code, said in found if said)


@contextmanager
def told_with(notes: Sequence[Note]) -> Iterator[None]:
    """Whatever cannot be estimated is refused together with what looks wrong in the set-up or the
    data."""
    try:
        yield
    except NotEstimable as error:
        said = list_alarms(notes)
        if not said:
            raise
        raise NotEstimable(f"{error} {' '.join(said)}", parameters=error.parameters) from None


def builtin() -> dict[str, Robot]:
    """The built-in robots by name."""
    return {name: load(name) for name in builtin_names()}


# -- noise
# -----------------------------------------------------------------------------------------------------------------


def believed(
    split: Split, floor: Floor | None, fitted: Fit
) -> tuple[Split, Floor | None, tuple[Note, ...]]:
    """(the data, the floor, what is said) once a fitted model shows what is left: a floor that
    cannot be true is no longer known, and is estimated (None) instead. Said is what is far off;
    what is a little off, the chosen model's lack of fit says."""
    some = split.training()
    found = _lack(some, fitted.residuals(some), floor, slice(0, 3), fitted.rows - fitted.freedom)
    if floor is None or found is None:
        return split, floor, ()
    asked, left = found
    if np.isfinite(floor.freedom) and asked.refuted and asked.factor > 1:
        return replace(split, known_sigma=False), None, (_unlike(floor, asked, left),)
    if np.isfinite(floor.freedom) or not asked.far:
        return split, floor, ()
    note = _stated(split, floor, asked, left)
    return (
        (replace(split, known_sigma=False), None, (note,))
        if asked.refuted
        else (split, floor, (note,))
    )


def turns_believed(split: Split, fitted: Fit) -> tuple[Note, ...]:
    """What is said of stated uncertainties of orientations once a fitted model shows what is
    left."""
    some = split.training()
    spread = some.data.sigma_rotation
    if spread is None:
        return ()
    own = Floor(float(np.sqrt(np.square(spread).mean())), "stated")
    found = _lack(some, fitted.residuals(some), own, slice(3, 6), fitted.rows - fitted.freedom)
    if found is None or not found[0].far:
        return ()
    asked, left = found
    where = "srx_rad, sry_rad and srz_rad"
    return (
        Note(
            "stated-uncertainty",
            f"{describe_lack(where, own.coordinate_mm, left, asked, 'rad')} "
            f"{name_likeliest_mistake(1 / asked.factor, where, 'rad')}",
        ),
    )


def _lack(
    problem: Problem, residual: Array, floor: Floor | None, part: slice, used: float
) -> tuple[Lack, float] | None:
    """(what is left against a floor, its root mean square [mm or rad] of one coordinate), of the
    coordinates `part`; the model has `used` so many degrees of freedom of all."""
    seen = problem.components_measured
    count = int(seen[:, part].sum())
    freedom = count * (1 - used / int(seen.sum()))
    if floor is None or freedom < 1:
        return None
    left = float(np.sqrt(np.where(seen, np.square(residual), 0.0)[:, part].sum() / freedom))
    factor = left / max(floor.coordinate_mm, MIN_UNCERTAINTY)
    if np.isinf(floor.freedom):  # stated, row by row
        factor = float(
            np.sqrt(
                np.where(seen, np.square(whitened(problem, residual)), 0.0)[:, part].sum() / freedom
            )
        )
    return lack(floor, factor, freedom), left


def _stated(split: Split, floor: Floor, asked: Lack, left: float) -> Note:
    """Of a floor that the study, its file or the instrument's figures state."""
    measured = split.problem.data
    where = (
        "[noise] range_mm, range_ppm, angle_urad"
        if floor.source == "instrument"
        else "[noise] floor_mm"
        if measured.sigma is None
        else "s_mm"
        if measured.gauges is not None
        else "sx_mm, sy_mm, sz_mm"
    )
    instead = (
        " The figure is not used: what the model leaves takes its place." if asked.refuted else ""
    )
    return Note(
        "stated-uncertainty",
        f"{describe_lack(where, floor.coordinate_mm, left, asked)} "
        f"{name_likeliest_mistake(1 / asked.factor, where)}{instead}",
    )


def _unlike(floor: Floor, asked: Lack, left: float) -> Note:
    """Of repeats or target pairs: that a model leaves more than they show is usual, so much more is
    not."""
    look = (
        "whether the tracking software computes the markers from one rigid body"
        if floor.source == "target pairs"
        else "whether repeated rows were measured again, or copied"
    )
    return Note(
        "floor-unlike",
        f"The {floor.source} show a noise of {floor.coordinate_mm:.2g} mm per coordinate, and the model "
        f"leaves {left:.3g} mm, {asked.factor:.3g} times as much: they cannot be the noise of the measurement, and the "
        f"noise floor is estimated from what the model leaves. Check {look}.",
    )


# -- the outcome
# -----------------------------------------------------------------------------------------------------------


def unsaid(faults: Sequence[Fault], notes: Sequence[Note]) -> tuple[Fault, ...]:
    """The faults of the data but those that an alarm has said of the same rows."""
    return tuple(f for f in faults if ALARM_OF_FAULT.get(f.name) not in {n.code for n in notes})


def outcome(
    split: Split,
    chosen: Evaluation,
    floor: Floor,
    limit: float | None,
    notes: tuple[Note, ...],
    per_group: bool | None,
    faults: Sequence[Fault] = (),
) -> tuple[Note, ...]:
    """All notes, with what the chosen model itself gives away: parameters beyond tolerances, rows
    that a slip explains, a fit that is hopeless, a detection limit far below what is left.
    Parameters beyond tolerances are no alarm of their own where a mistake of the set-up or another
    robot was said: nothing of that is applied, and the parameters make up for it. `per_group`: None
    where nothing was registered. Rows of `faults` are said already."""
    codes = {n.code for n in notes}
    more = list(notes)
    named = np.isin(split.problem.data.row, [row for f in faults for row in f.rows])
    if ROWS_MISTAKEN not in codes and (split.outlying & split.estimation).mean() < 1:
        more += [
            Note(ROWS_MISTAKEN, said)
            for said in describe_slips(
                split.problem, chosen.fit.residuals, split.outlying, named=named
            )
        ]
    if (
        not codes & {SETUP_MISTAKE, OTHER_ROBOT}
        and (said := _beyond(split, chosen.fit)) is not None
    ):
        more.append(Note("beyond-tolerance", said))
    if (said := _hopeless(split, chosen, floor, more, per_group)) is not None:
        return (*more, Note(HOPELESS_FIT, said))
    left, noise = (
        chosen.estimation.rms_mm or 0.0,
        floor.coordinate_mm * float(np.sqrt(floor.coordinates)),
    )
    if limit is not None and left > FAINT * noise and limit < left / BELOW:
        more.append(
            Note(
                "limit-below-left",
                f"The detection limit of {limit:.2g} mm rms is that of one single cause: "
                f"{left:.2g} mm rms are left where noise would leave {noise:.2g} mm, so larger errors of another form "
                "are in the data.",
            )
        )
    return tuple(more)


def _beyond(split: Split, fitted: Fit) -> str | None:
    """A sentence on geometric parameters that no maker's tolerance allows, with the built-in robot
    that fits better, if any."""
    some = []
    for k in fitted.found.kept:
        term, value, error = (
            fitted.terms[k],
            float(fitted.theta[k]),
            float(fitted.standard_errors[k]),
        )
        if len(term.screws) != 1:
            continue
        screw = term.screws[0]
        own = screw.cause == ONE and 1 < screw.frame <= split.problem.robot.n
        limit = TOLERANCE.get(term.unit, np.inf)
        if own and abs(value) - SURE * error > limit:
            some.append((abs(value) / limit, term.symbol, value, error, term.unit))
    if not some:
        return None
    some.sort(reverse=True)
    words = [
        f"{symbol} = {_with_unit(value, error, unit)}"
        for _, symbol, value, error, unit in some[:LISTED]
    ]
    more = f" and {len(some) - LISTED} more" if len(some) > LISTED else ""
    other = describe_other_robot(split.problem, split.used, builtin, always=True)
    return f"{', '.join(words)}{more}: beyond what makers' tolerances allow (1 to 5 mm, 1°). " + (
        other or "Check the robot's name or file, and where the joints' zeros are."
    )


def _with_unit(value: float, error: float, unit: str) -> str:
    if unit == "rad":
        return f"{np.degrees(value):.3g} ± {np.degrees(error):.2g}°"
    return f"{value:.4g} ± {error:.2g} {unit}"


def _hopeless(
    split: Split, chosen: Evaluation, floor: Floor, notes: Sequence[Note], per_group: bool | None
) -> str | None:
    """A sentence that the fit is hopeless, with how much is left, against what, and the likeliest
    reasons; None where not."""
    problem = split.problem
    reach = problem.reach_mm
    left = max(chosen.estimation.rms_mm or 0.0, chosen.held_out.rms_mm or 0.0)
    noise = floor.coordinate_mm * float(np.sqrt(floor.coordinates))
    known = floor.source != "estimated"
    angle = (measure_orientation(split, chosen, chosen) or (0.0, 0.0))[1]
    far = (
        left > HOPELESS_TIMES * THOUSANDTH * reach
        or known
        and left > max(NOISE_TIMES * noise, THOUSANDTH * reach)
    )
    if not far and angle < TURNED:
        return None
    what = (
        f"{left:.3g} mm rms are left, {left / reach:.2%} of the arm's reach, where a calibrated arm leaves less than a "
        f"thousandth ({THOUSANDTH * reach:.2g} mm)"
        + (f" and the noise ({floor.source}) {noise:.2g} mm" if known else "")
        if far
        else f"{np.degrees(angle):.3g}° rms of orientation are left, where a calibrated arm leaves less than 1°"
    )
    leads = [
        lead.removeprefix("Check ")
        for code, lead in ALARMS.items()
        if code in {n.code for n in notes} - NOISE_CODES
    ]
    reasons = (
        f"Likeliest reason: what the warnings say of {sentence_list(list(dict.fromkeys(leads)))}"
        if leads
        else "Likeliest reasons: the wrong robot file; positions that belong to other readings; "
        + (
            "a tracker's frame that is not the robot's base ([robot] register = true)"
            if per_group is None
            else 'a tracker moved between groups (register = "per group")'
            if not per_group and len(problem.data.groups) > 1
            else "a tracker or target moved during the campaign"
        )
    )
    return f"This fit explains the data badly, and nothing that follows can be relied on: {what}. {reasons}."
