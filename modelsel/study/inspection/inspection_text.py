"""What the inspection of a robot or a measurements file says, in words."""

from __future__ import annotations

from typing import Any

import numpy as np

from ...exceptions import count_words, write_percent, write_rounded
from ...fitting.undetermined import Unidentifiable, write_unidentifiable
from ...results.conclusions.placements import describe_placements
from ...results.schemas.schema import RegistrationRecord

MAX_LISTED_FEATURES = 6
MAX_LISTED_GROUPS = 8


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
    study = inspection.get("study", {})
    if "median_mm" in study:
        where = "target as the study has it, below"
    elif geometry["tool_mm"] is not None:
        x, y, z = geometry["tool_mm"]
        where = f"target assumed at {x:g}, {y:g}, {z:g} mm"
    line = (
        f"Geometry: {geometry['rank']} of {geometry['parameters']} parameters can be determined "
        f"({where}), condition {geometry['condition']:.0f}"
    )
    lines = [line]
    groups = [Unidentifiable(**group) for group in inspection["unidentifiable"]]
    lines += [f"  {sentence}" for sentence in write_unidentifiable(groups)]
    return lines


def _format_registration(registered: dict[str, Any]) -> list[str]:
    line = (
        f"Registered (instrument's frame and target found): {write_rounded(registered['median_mm'])} mm from the "
        "nominal robot (median)"
    )
    placements = RegistrationRecord.model_validate(registered)
    places = [f"  {sentence}" for sentence in describe_placements(placements)]
    return [line, *places, *registered["alarms"]]


def _format_study(described: dict[str, Any]) -> list[str]:
    """Say how a study has the robot stand before its measurements, or why it is refused."""
    refused = described["refused"]
    if refused is not None:
        return [f"`modelsel study` refuses this study: {sentence}" for sentence in refused]
    way = "Tool and instrument's frame as the study states them"
    if described["registered"]:
        way = "Registered as the study does (instrument's frame and target found)"
    distance = write_rounded(described["median_mm"])
    line = f"{way}: {distance} mm from the nominal robot (median)"
    placements = RegistrationRecord(
        base_in_tracker=described["base_in_tracker"], target_on_flange=described["target_on_flange"]
    )
    places = describe_placements(placements)
    if not described["registered"]:
        places = places[len(placements.base_in_tracker) :]
    lines = [line, *(f"  {sentence}" for sentence in places), *described["alarms"]]
    folds = described["nested_folds"]
    return [*lines, describe_folds(folds)] if folds else lines


def describe_folds(count: int) -> str:
    """Say how often nested folds repeat the procedure, and in which rows."""
    return (
        f"Nested folds: outliers, naming and fit are repeated {count} times, each time without one of {count} "
        "parts of the estimation configurations, which takes about as long as the search itself each "
        "time; they run side by side on the cores that there are."
    )
