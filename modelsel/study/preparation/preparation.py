"""Prepare measurements for a study: split, set up, registered, checked, weighted and folded.

`prepare` lists the steps in their order. It uses nothing but the nominal robot, the measurements
and the study; nothing is fitted here but the registration.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ..._random import generator
from ..._typing import Array, Index
from ...config.study_file import Study
from ...config.study_tables import NoiseTable, RobotTable
from ...exceptions import DataError, NotEstimable, StudyError, suggest
from ...fitting.component_noise import POSITION
from ...fitting.design import residuals
from ...fitting.noise import Floor, Instrument, weigh
from ...fitting.problem import Problem
from ...measurements.campaign.visits import count_distinct
from ...measurements.measurements import Measurements
from ...notices import OTHER_ROBOT, SETUP_MISTAKE, Note
from ...robot.kinematics import Robot
from ...selection.evaluation import Split
from ...selection.splits import assign_folds
from ...setup.feature_positions import place_features
from ...setup.plausibility import describe_implausible_distance
from ...setup.registration import note_undetermined, register
from .checks import check_setup
from .computed_columns import drop_computed_columns
from .gravity_direction import note_gravity
from .near_rows import note_near_rows, note_returns
from .own_causes import list_own_words, note_constant_causes
from .row_selection import (
    center_unknown_times,
    check_features_in_one_group,
    choose_estimation_rows,
    drop_unknown_features,
    drop_unknown_targets,
    warn_of_equal_weights,
)
from .stated_noise import note_overlooked_noise

Mask = NDArray[np.bool_]

# of mistakes with which the arm is so far off that nothing is known of where it stands
FAR_CODES = (SETUP_MISTAKE, OTHER_ROBOT, "rows-shifted", "targets-mistaken")
METRES = 0.01  # of the arm's reach: coordinates so small (median length) look like metres


def prepare(
    study: Study, robot: Robot, data: Measurements, labels: NDArray[np.object_] | None = None
) -> tuple[Split, Floor | None, tuple[Note, ...]]:
    """Prepare measurements for a study.

    `labels` (m,) say which rows estimate, where the study names a column for it. Returns the split
    problem, the noise floor (None where it is not known), and the notes on data and set-up. Raises
    StudyError, DataError or NotEstimable.
    """
    notes = list(data.notes)
    estimation = choose_estimation_rows(study, data, labels, robot.prismatic)
    data, time_notes = center_unknown_times(data, estimation)
    notes += time_notes
    data, estimation, dropped_notes = _drop_unknown_rows(study, data, estimation)
    notes += dropped_notes

    problem = _set_up(study, robot, data)
    problem, registration_notes = _register(study, problem, estimation)
    notes += registration_notes
    problem, computed_notes = drop_computed_columns(problem, estimation, list_own_words(study))
    notes += computed_notes
    per_group = study.robot.per_group
    setup_notes = check_setup(problem, estimation, bool(study.robot.register_), per_group)
    problem = place_features(problem, estimation)
    _check_plausible(study, problem, setup_notes)

    problem, floor = weigh(problem, read_instrument(study.noise), study.noise.floor_mm)
    notes += note_overlooked_noise(study.noise, data)
    is_stated = study.robot.gravity is not None or not study.robot.register_
    is_far = any(note.code in FAR_CODES for note in setup_notes)
    notes += note_gravity(robot, problem, is_stated or is_far)
    notes += note_constant_causes(study, problem)
    _check_enough_configurations(study, data, estimation)
    folds = _assign_folds(study, data, estimation)
    notes += _warn_of_nothing_held_out(estimation)
    notes += note_near_rows(data, estimation) + note_returns(data, estimation)
    split = Split(
        problem,
        estimation,
        outlying=np.zeros(len(data), bool),
        folds=folds,
        known_sigma=floor is not None and floor.source == "stated",
    )
    return split, floor, (*setup_notes, *notes)


def _drop_unknown_rows(
    study: Study, data: Measurements, estimation: Mask
) -> tuple[Measurements, Mask, list[Note]]:
    """Leave out the held-out rows of targets and features that nothing gives the position of."""
    notes: list[Note] = []
    table = study.robot
    if table.register_:
        data, estimation, notes = drop_unknown_targets(data, estimation)
    if table.per_group:
        check_features_in_one_group(data)
    weight_notes = warn_of_equal_weights(data)
    data, estimation, feature_notes = drop_unknown_features(data, estimation)
    all_notes = [*notes, *feature_notes, *weight_notes]
    return data, estimation, all_notes


def _set_up(study: Study, robot: Robot, data: Measurements) -> Problem:
    """Return the problem with the nominal targets and the tracker's position."""
    x, y, z = study.noise.tracker_mm
    tools = arrange_tools(study.robot, data)
    return replace(Problem(robot, data, tools), tracker=(x, y, z))


def arrange_tools(table: RobotTable, data: Measurements) -> Array:
    """Return the nominal targets (T, 3) [mm, flange frame] in the order of the data's targets.

    Zero where the study gives none. Raises StudyError for a target without a line in
    [robot.tools_mm].
    """
    tools = table.tools_mm
    if not tools:
        tool = np.array(table.tool_mm or [0.0, 0.0, 0.0], float)
        return np.tile(tool, (len(data.targets), 1))
    missing = [name for name in data.targets if name not in tools]
    if missing:
        raise StudyError(
            *(
                f'robot.tools_mm: no line for target "{name}". {suggest(name, tools)}'
                for name in missing
            )
        )
    return np.array([tools[name] for name in data.targets], float)


def read_instrument(noise: NoiseTable) -> Instrument | None:
    """Return the instrument that a study describes; None where it describes none."""
    if not noise.instrument:
        return None
    x, y, z = noise.tracker_mm
    return Instrument(noise.range_mm, noise.range_ppm, noise.angle_urad, (x, y, z))


def _register(study: Study, problem: Problem, estimation: Mask) -> tuple[Problem, list[Note]]:
    """Find tracker frame and targets from the estimation rows, where the study asks for it."""
    if not study.robot.register_:
        return problem, []
    per_group = study.robot.per_group
    nominal_tools = problem.tools
    problem = register(problem, estimation, per_group)
    notes = note_undetermined(problem, estimation, per_group, nominal_tools)
    return problem, list(notes)


def _check_plausible(study: Study, problem: Problem, setup_notes: Sequence[Note]) -> None:
    """Check that the measurements are near the nominal arm.

    Raises DataError where the median residual is above a quarter of the reach, with the likeliest
    reason.
    """
    residual = residuals(problem)
    positions = residual[:, POSITION]
    codes = {note.code for note in setup_notes}
    explained = not codes.isdisjoint(FAR_CODES)
    what = describe_implausible_distance(positions, problem.reach_mm, explained=explained)
    if what is None:
        return
    reason = _explain_implausible(study, problem, setup_notes)
    raise DataError(what, remedy=reason)


def _explain_implausible(study: Study, problem: Problem, setup_notes: Sequence[Note]) -> str:
    """Return the likeliest reason why the measurements are far from the nominal arm."""
    if setup_notes:
        text = " ".join(note.sentence for note in setup_notes)
        return text[0].upper() + text[1:]
    data = problem.data
    if data.gauges is None:
        positions = np.nan_to_num(data.position)
        if np.ptp(positions, axis=0).max() == 0:
            return "Every row has the same position: check the columns of x, y and z."
        lengths = np.linalg.norm(positions, axis=1)
        if np.nanmedian(lengths) < METRES * problem.reach_mm:
            return "The coordinates look like metres: name them x_m y_m z_m."
    frame = "an instrument frame that is not the robot's base ([robot] register = true finds it), "
    if study.robot.register_:
        frame = ""
    return (
        f"This looks like {frame}the wrong robot or tool, metres called millimetres, or joints "
        "whose zero or sense is another than the robot file's."
    )


def _check_enough_configurations(study: Study, data: Measurements, estimation: Mask) -> None:
    """Check that the estimation rows can be compared and cross-validated.

    Raises StudyError or NotEstimable.
    """
    if study.comparison.by == "group" and count_distinct(data.group[estimation]) < 2:
        raise StudyError(
            'comparison.by = "group": the estimation rows belong to one group; two or more are '
            'needed to leave one out. Use by = "configuration".'
        )
    if count_distinct(data.block) < 2:
        raise NotEstimable(
            "the file has one set of joint readings: no parameter can be determined from it; "
            "measure more configurations."
        )
    if count_distinct(data.block[estimation]) < 2:
        raise NotEstimable(
            "split: the estimation rows have one set of joint readings: nothing can be compared "
            "or cross-validated. Let more configurations estimate ([split] estimation)."
        )


def _assign_folds(study: Study, data: Measurements, estimation: Mask) -> Index:
    """Return the fold (m,) of every estimation row, −1 for held-out rows."""
    table = study.comparison
    seed = study.seed
    count = len(data)
    rows = data.take(estimation)
    rng = generator(seed, "folds")
    row_folds = assign_folds(rows, table.folds, rng, table.by)
    folds = np.full(count, -1, dtype=np.intp)
    folds[estimation] = row_folds
    return folds


def _warn_of_nothing_held_out(estimation: Mask) -> list[Note]:
    if not estimation.all():
        return []
    return [
        Note(
            "nothing-held-out",
            "All configurations fit the models: nothing is held out, and no gain can be measured.",
        )
    ]
