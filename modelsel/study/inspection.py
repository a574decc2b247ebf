"""Describe a robot or a measurements file as plain values and in words."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..exceptions import DataError, NotEstimable, count_words, write_percent, write_rounded
from ..fitting.design import Model, residuals
from ..fitting.identifiability import as_drawn, identify
from ..fitting.least_squares import fit
from ..fitting.noise import Floor, from_repeats, from_target_pairs
from ..fitting.prior import fitted_terms
from ..fitting.problem import Problem
from ..fitting.reduction import reduce_problem
from ..fitting.undetermined import describe_unidentifiable
from ..measurements.features import KINDS
from ..measurements.measurements import Measurements
from ..measurements.visits import count_distinct
from ..mechanisms.geometry import build_setup, geometric
from ..notices import SETUP_MISTAKE, Note, list_alarms
from ..results.placements import describe_placements, locate_placements
from ..results.rounded_readings import find_rounding
from ..results.rounding_effect import note_rounding
from ..results.schema import RegistrationRecord
from ..robot.kinematics import Robot
from ..setup.feature_positions import place_features
from ..setup.mistakes import MIN_CONFIGURATIONS
from ..setup.plausibility import MAX_DISTANCE_SHARE
from ..setup.registration import register
from .checks import check_setup
from .told_parts import describe_told_parts

MAX_REGISTERED_POINTS = 2000
MAX_LISTED_FEATURES = 6
MAX_LISTED_GROUPS = 8
ASSUMED_TOOL_MM = (0.0, 0.0, 100.0)  # nominal target, for what the configurations determine
TOOL_OFF_AXIS_MM = (50.0, 0.0, 100.0)  # the same where every joint shall move it
# what is said of positions further from the arm than a study takes
FAR = (
    "The positions are {share} of the length of the arm's links in all from where the robot has "
    "them, and `modelsel study` refuses them: check the robot, the order of the joints, the units and the frame."
)
MAX_PLACES = 5  # rows beyond a joint's limits that are listed
MIN_MOTION = 1e-6  # rad or mm: a joint with a smaller range does not move


def inspect_measurements(robot: Robot, data: Measurements) -> dict[str, Any]:
    """Describe measurements: what they hold, and what they determine of the geometry."""
    found = _find_placement(robot, data)
    notes = [*data.notes, *_note_rounding(data, found)]
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
        "noise_floor": _estimate_noise_floor(data),
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


def _estimate_noise_floor(data: Measurements) -> dict[str, Any] | None:
    """Return the noise floor by repeats or target pairs, else as the data state it; None without all
    of these.

    Nothing says yet whether the instrument stood alike for every group: each is taken by itself."""
    if data.gauges is not None:
        return None
    floor = from_repeats(data, data.group) or from_target_pairs(data)
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
        parameters = list(group.parameters)
        groups.append({"sentence": group.sentence, "parameters": parameters})
    return {"geometry": geometry, "unidentifiable": groups}


def _build_geometry(robot: Robot, data: Measurements) -> Model:
    """Build the geometric model, with what may be open of the set-up."""
    features = () if data.gauges is None else data.gauges.features
    oriented = data.rotation is not None
    placement = build_setup(robot, len(data.targets), 1, False, oriented, features)
    return Model((placement, geometric(robot)))


def _note_rounding(data: Measurements, found: _Placement | None) -> tuple[Note, ...]:
    """Say which readings may have been rounded, beside what the geometric model leaves of the points, or
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
    share = fitted.freedom / fitted.rows
    noise_mm = left_mm / np.sqrt(share)
    known = _estimate_noise_floor(data)
    if known is not None:
        noise_mm = known["coordinate_mm"] * np.sqrt(3)
    return note_rounding(problem, fitted, left_mm, float(noise_mm))


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


def format_inspection(inspection: dict[str, Any]) -> list[str]:
    """Return in words what `inspect_measurements` found, one line per topic."""
    counts = _format_counts(inspection)
    lines = [counts]
    if "kinds" in inspection:
        kinds = _format_kinds(inspection)
        lines.append(kinds)
    covariates = ", ".join(inspection["covariates"]) or "none"
    orientations = "positions only"
    if inspection["orientation"]:
        orientations = "orientations measured"
    lines.append(f"Covariates: {covariates}; {orientations}")
    lines += [_format_joint(joint) for joint in inspection["joints"]]
    noise_floor = _format_noise_floor(inspection)
    lines.append(noise_floor)
    lines += _format_geometry(inspection)
    lines.append("What does not repeat:")
    lines += [f"  {sentence}" for sentence in inspection["repeatability"]["sentences"]]
    if "study" in inspection:
        lines += _format_study(inspection["study"])
    elif "registered" in inspection:
        lines += _format_registration(inspection["registered"])
    for warning in inspection["warnings"]:
        sentence = warning["sentence"]
        lines.append(f"Note: {sentence}")
    return lines


def _format_counts(inspection: dict[str, Any]) -> str:
    groups = inspection["groups"]
    listed = ", ".join(groups[:MAX_LISTED_GROUPS])
    if len(groups) > MAX_LISTED_GROUPS:
        listed += " …"
    rows = count_words(inspection["rows"], "row")
    configurations = count_words(inspection["configurations"], "configuration")
    return (
        f"{rows}, {configurations}, "
        f"{inspection['repeats']:,} of them repeats; targets: {', '.join(inspection['targets'])}; "
        f"groups: {listed}"
    )


def _format_kinds(inspection: dict[str, Any]) -> str:
    names: dict[str, list[str]] = {}
    for feature in inspection["features"]:
        kind = feature["kind"]
        names_of_kind = names.setdefault(kind, [])
        names_of_kind.append(feature["name"])
    parts = []
    for kind, count in inspection["kinds"].items():
        part = f"{count} {kind}"
        if kind in names:
            listed = _shorten_list(names[kind])
            part += f" ({listed})"
        parts.append(part)
    counts = ", ".join(parts)
    return f"Rows by kind: {counts}"


def _shorten_list(names: list[str]) -> str:
    text = ", ".join(names[:MAX_LISTED_FEATURES])
    more = len(names) - MAX_LISTED_FEATURES
    if more > 0:
        text += f" and {more} more"
    return text


def _format_joint(joint: dict[str, Any]) -> str:
    number = joint["joint"]
    name = f"Joint {number}"
    if not joint["moves"]:
        return f"{name}: does not move: errors that grow with it cannot be seen"
    limits = np.array([joint["low"], joint["high"]])
    unit = "mm"
    if joint["unit"] == "rad":
        limits = np.degrees(limits)
        unit = "deg"
    low, high = limits
    text = f"{name}: {low:.1f} to {high:.1f} {unit}"
    share = joint["share_of_range"]
    if share is not None:
        text += f", {write_percent(share)} of its range"
    beyond = joint["rows_beyond_limits"]
    if beyond:
        factor = 180 / np.pi if unit == "deg" else 1.0
        least, most = (limit * factor for limit in joint["limits"])
        verb = "lies" if beyond == 1 else "lie"
        places = joint["places_beyond_limits"]
        text += (
            f"; {count_words(beyond, 'row')} ({places}) {verb} beyond its limits, {least:.6g} to {most:.6g} {unit}: "
            "check the joint's zero, its sense and the robot file"
        )
    return text


def _format_noise_floor(inspection: dict[str, Any]) -> str:
    floor = inspection["noise_floor"]
    if floor:
        size = f"{write_rounded(floor['coordinate_mm'])} mm per coordinate"
        if floor["source"] == "stated":
            return f"Noise floor: {size}, as the data state it"
        return f"Noise floor: {size}, from {floor['source']}"
    reason = "" if "kinds" in inspection else " (no repeats, no target pairs)"
    return f"Noise floor: cannot be told from these data alone{reason}"


def _format_geometry(inspection: dict[str, Any]) -> list[str]:
    geometry = inspection["geometry"]
    where = "target where it was found, below"
    if "tool_mm" not in geometry:
        where = "target as the study has it, below"
    elif geometry["tool_mm"] is not None:
        x, y, z = geometry["tool_mm"]
        where = f"target assumed at {x:g}, {y:g}, {z:g} mm"
    line = (
        f"Geometry: {geometry['rank']} of {geometry['parameters']} parameters can be determined "
        f"({where}), condition {geometry['condition']:.0f}"
    )
    lines = [line]
    for group in inspection["unidentifiable"]:
        sentence = group["sentence"]
        lines.append(f"  {sentence}")
    return lines


def _format_registration(registered: dict[str, Any]) -> list[str]:
    line = (
        f"Registered (tracker's frame and target found): {write_rounded(registered['median_mm'])} mm from the "
        "nominal robot (median)"
    )
    placements = RegistrationRecord.model_validate(registered)
    places = [f"  {sentence}" for sentence in describe_placements(placements)]
    return [line, *places, *registered["alarms"]]


def _format_study(described: dict[str, Any]) -> list[str]:
    """Say how a study has the robot stand before its measurements, or why it refuses them."""
    refused = described["refused"]
    if refused is not None:
        return [f"`modelsel study` refuses these data: {sentence}" for sentence in refused]
    way = "Tool and tracker's frame as the study states them"
    if described["registered"]:
        way = "Registered as the study does (tracker's frame and target found)"
    distance = write_rounded(described["median_mm"])
    line = f"{way}: {distance} mm from the nominal robot (median)"
    placements = RegistrationRecord(
        base_in_tracker=described["base_in_tracker"], target_on_flange=described["target_on_flange"]
    )
    places = describe_placements(placements)
    if not described["registered"]:
        places = places[len(placements.base_in_tracker) :]
    return [line, *(f"  {sentence}" for sentence in places), *described["alarms"]]
