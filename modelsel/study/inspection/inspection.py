"""Describe a robot or a measurements file as plain values and in words."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...exceptions import DataError, NotEstimable, write_percent
from ...fitting.design import Model, residuals
from ...fitting.identifiability import as_drawn, identify
from ...fitting.least_squares import fit
from ...fitting.noise import Floor, compare_repeats, from_repeats, from_target_pairs
from ...fitting.prior import fitted_terms
from ...fitting.problem import Problem
from ...fitting.reduction import reduce_problem
from ...fitting.undetermined import describe_unidentifiable
from ...measurements.campaign.features import KINDS
from ...measurements.campaign.visits import count_distinct
from ...measurements.measurements import Measurements
from ...mechanisms.geometry import build_setup, geometric
from ...notices import SETUP_MISTAKE, Note, list_alarms
from ...results.conclusions.placements import locate_placements
from ...results.repeatability.rounded_readings import find_rounding
from ...results.repeatability.rounding_effect import note_rounding
from ...robot.kinematics import Robot
from ...setup.feature_positions import place_features
from ...setup.mistakes import MIN_CONFIGURATIONS
from ...setup.plausibility import MAX_DISTANCE_SHARE
from ...setup.registration import register
from ..preparation.checks import MIN_MOTION, check_setup
from ..preparation.near_rows import note_returns
from .told_parts import describe_told_parts

MAX_REGISTERED_POINTS = 2000
ASSUMED_TOOL_MM = (0.0, 0.0, 100.0)  # nominal target, for what the configurations determine
TOOL_OFF_AXIS_MM = (50.0, 0.0, 100.0)  # the same where every joint shall move it
# what is said of positions further from the arm than a study takes
FAR = (
    "The positions are {share} of the length of the arm's links and target in all from where the robot has "
    "them, and `modelsel study` refuses them: check the robot, the order of the joints, the units and the frame."
)
MAX_PLACES = 5  # rows beyond a joint's limits that are listed


def inspect_measurements(robot: Robot, data: Measurements) -> dict[str, Any]:
    """Describe measurements: what they hold, and what they determine of the geometry."""
    found = _find_placement(robot, data)
    notes = [*data.notes, *note_returns(data), *_note_rounding(data, found)]
    return {
        "rows": len(data),
        "configurations": data.configurations,
        "targets": list(data.targets),
        "groups": list(data.groups),
        **_count_kinds(data),
        "orientation": data.rotation is not None,
        "covariates": sorted(data.covariates),
        "joints": _describe_joints(robot, data),
        "repeats": data.configurations - count_distinct(data.block),
        "noise_floor": _estimate_noise_floor(data, found),
        **_describe_geometry(robot, data, found),
        "repeatability": _describe_repeatability(robot, data),
        **_describe_registration(found),
        "warnings": [{"code": note.code, "sentence": note.sentence} for note in notes],
    }


def _count_kinds(data: Measurements) -> dict[str, Any]:
    """Return the rows of each kind and feature; empty where all rows are points."""
    gauges = data.gauges
    if gauges is None:
        return {}
    present = {}
    for kind in KINDS:
        count = int(gauges.of(kind).sum())
        if count:
            present[kind] = count
    features = []
    for k, feature in enumerate(gauges.features):
        is_of_feature = gauges.feature == k
        counted = {"name": feature.name, "kind": feature.kind, "rows": int(is_of_feature.sum())}
        features.append(counted)
    return {"kinds": present, "features": features}


def _describe_joints(robot: Robot, data: Measurements) -> list[dict[str, Any]]:
    joints = []
    for j, joint in enumerate(robot.joints):
        readings = data.q[:, j]
        low, high = float(readings.min()), float(readings.max())
        share = None
        beyond = data.row[joint.find_beyond(readings)]
        if joint.limits is not None:
            least, most = joint.limits
            inside = min(high, most) - max(low, least)
            share = max(inside, 0.0) / (most - least)
        places = data.where.listed(beyond, MAX_PLACES) if len(beyond) else None
        description = {
            "joint": j + 1,
            "low": low,
            "high": high,
            "unit": robot.unit(j + 1),
            "share_of_range": share,
            "limits": joint.limits,
            "rows_beyond_limits": len(beyond),
            "places_beyond_limits": places,
            "moves": high - low > MIN_MOTION,
        }
        joints.append(description)
    return joints


def _estimate_noise_floor(data: Measurements, found: _Placement | None) -> dict[str, Any] | None:
    """Return the noise floor by repeats or target pairs, else as the data state it; None without all
    of these.

    Nothing says yet whether the instrument stood alike for every group: each is taken by itself."""
    if data.gauges is not None:
        return None
    if found is None:
        repeated = from_repeats(data, data.group)
    else:
        repeated = compare_repeats(found.problem, data.group)
    floor = repeated or from_target_pairs(data)
    if floor is None and data.sigma is not None:
        floor = Floor(float(np.sqrt(np.square(data.sigma).mean())), "stated")
    if floor is None:
        return None
    return {"coordinate_mm": floor.coordinate_mm, "source": floor.source}


def _describe_geometry(
    robot: Robot, data: Measurements, found: _Placement | None
) -> dict[str, Any]:
    """Return what the configurations determine of the geometric model, and what they do not, for
    targets where they were found to be."""
    targets = len(data.targets)
    tools = np.tile(ASSUMED_TOOL_MM, (targets, 1))
    if found is not None:
        tools = found.problem.tools
    all_rows = np.ones(len(data), bool)
    problem = Problem(robot, data, tools)
    problem = place_features(problem, all_rows)
    model = _build_geometry(robot, data)
    tool_mm = None if found is not None else list(ASSUMED_TOOL_MM)
    determined = describe_determined(problem, model)
    determined["geometry"]["tool_mm"] = tool_mm
    return determined


def describe_determined(problem: Problem, model: Model) -> dict[str, Any]:
    """Describe what the rows of a problem determine of a model, and what they do not."""
    terms = model.terms
    reduction = reduce_problem(problem, terms)
    identified = identify(reduction)
    identified = as_drawn(identified, problem, terms)
    geometry = {
        "parameters": len(terms),
        "rank": identified.rank,
        "condition": identified.condition,
    }
    fitted = fitted_terms(identified, model)
    groups = []
    for group in describe_unidentifiable(fitted, terms):
        values = asdict(group)
        for key in ("parameters", "at_zero"):
            listed = list(values[key])
            values[key] = listed
        groups.append(values)
    return {"geometry": geometry, "unidentifiable": groups}


def _build_geometry(robot: Robot, data: Measurements) -> Model:
    """Build the geometric model, with what may be open of the set-up."""
    features = () if data.gauges is None else data.gauges.features
    oriented = data.rotation is not None
    placement = build_setup(robot, len(data.targets), 1, False, oriented, features)
    return Model((placement, geometric(robot)))


def _note_rounding(data: Measurements, found: _Placement | None) -> tuple[Note, ...]:
    """Say which readings may have been rounded, beside what the geometric model leaves of the points and
    the noise that is known without it."""
    if found is None or not find_rounding(data):
        return ()
    problem = found.problem.take(found.use)
    try:
        fitted = fit(problem, _build_geometry(problem.robot, data))
    except NotEstimable:
        return ()
    left = np.linalg.norm(fitted.residuals(problem)[:, :3], axis=1)
    left_mm = float(np.sqrt(np.square(left).mean()))
    known = _estimate_noise_floor(data, found)
    floor_mm = 0.0 if known is None else known["coordinate_mm"] * np.sqrt(3)
    return note_rounding(problem, fitted, left_mm, float(floor_mm))


def _describe_repeatability(robot: Robot, data: Measurements) -> dict[str, Any]:
    """Return which parts of the errors the rows can tell, for targets off the last axis."""
    tools = np.tile(TOOL_OFF_AXIS_MM, (len(data.targets), 1))
    return describe_told_parts(Problem(robot, data, tools))


class _Placement(NamedTuple):
    """Measurements with tracker and targets found from the rows that are used (m,)."""

    problem: Problem
    use: NDArray[np.bool_]


def _find_placement(robot: Robot, data: Measurements) -> _Placement | None:
    """Find the tracker and the targets; all groups have one placement. None where too few points
    are measured."""
    no_tools = np.zeros((len(data.targets), 3))
    problem = Problem(robot, data, no_tools)
    points = np.flatnonzero(data.points)
    step = max(len(points) // MAX_REGISTERED_POINTS, 1)
    use = np.zeros(len(data), bool)
    use[points[::step]] = True
    blocks = data.block[use]
    configurations = np.unique(blocks)
    if len(configurations) < MIN_CONFIGURATIONS:
        return None
    try:
        registered = register(problem, use, per_group=False)
        return _Placement(registered, use)
    except (DataError, NotEstimable):
        return None


def _describe_registration(found: _Placement | None) -> dict[str, Any]:
    """Return how well the points fit the nominal robot once tracker and targets are found, and
    which simple mistake of the set-up would fit better; empty where they were not found."""
    if found is None:
        return {}
    problem, use = found
    residual = residuals(problem.take(use))
    distances = np.linalg.norm(residual[:, :3], axis=1)
    median = float(np.median(distances))
    notes = check_setup(problem, use, registered=True, per_group=False)
    mistakes = [note.sentence for note in notes if note.code == SETUP_MISTAKE]
    alarms = list_alarms(notes)
    reach = problem.reach_mm
    share = median / reach
    if share > MAX_DISTANCE_SHARE and not alarms:
        alarms = [FAR.format(share=write_percent(share))]
    return {
        "registered": {
            "median_mm": median,
            **locate_placements(problem, False),
            "mistake": mistakes[0] if mistakes else None,
            "alarms": alarms,
        }
    }
