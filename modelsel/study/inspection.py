"""What is in a file, a mechanism, a robot: plain values for people and programs."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..exceptions import DataError, NotEstimable
from ..fitting.design import Model, residuals
from ..fitting.identifiability import as_drawn, identify
from ..fitting.noise import from_repeats, from_target_pairs
from ..fitting.prior import fitted_terms
from ..fitting.problem import Problem
from ..fitting.reduction import reduce_problem
from ..fitting.undetermined import describe_unidentifiable
from ..measurements.features import KINDS
from ..measurements.measurements import Measurements
from ..mechanisms.geometry import build_setup, geometric
from ..notices import SETUP_MISTAKE, list_alarms
from ..results.placements import describe_placements, locate_placements
from ..results.schema import RegistrationRecord
from ..robot.kinematics import Robot
from ..setup.feature_positions import place_features
from ..setup.mistakes import LEAST
from ..setup.registration import register
from .checks import setup_notes

MOST = 2000  # points that are registered


def describe(robot: Robot, data: Measurements) -> dict[str, Any]:
    """What a file holds, what its configurations determine of the geometry, and what they do
    not."""
    orientation = data.rotation is not None
    bound = Problem(robot, data, np.tile([0.0, 0.0, 100.0], (len(data.targets), 1)))
    features, gauges = data.gauges.features if data.gauges is not None else (), data.gauges
    bound = place_features(bound, np.ones(len(data), bool))
    model = Model(
        (build_setup(robot, len(data.targets), 1, False, orientation, features), geometric(robot))
    )
    found = as_drawn(identify(reduce_problem(bound, model.terms)), bound, model.terms)
    rank, condition = found.rank, found.condition
    found = fitted_terms(found, model)
    floor = None if gauges is not None else from_repeats(data) or from_target_pairs(data)
    kinds = (
        {}
        if gauges is None
        else {
            "kinds": {k: int(gauges.of(k).sum()) for k in KINDS if gauges.of(k).any()},
            "features": [
                {"name": f.name, "kind": f.kind, "rows": int((gauges.feature == k).sum())}
                for k, f in enumerate(features)
            ],
        }
    )
    joints = []
    for j, joint in enumerate(robot.joints):
        low, high = float(data.q[:, j].min()), float(data.q[:, j].max())
        whole = None if joint.limits is None else (high - low) / (joint.limits[1] - joint.limits[0])
        joints.append(
            {
                "joint": j + 1,
                "low": low,
                "high": high,
                "unit": robot.unit(j + 1),
                "share_of_range": whole,
                "moves": high - low > 1e-6,
            }
        )
    return {
        "rows": len(data),
        "configurations": data.configurations,
        "targets": list(data.targets),
        "groups": list(data.groups),
        **kinds,
        "orientation": orientation,
        "covariates": sorted(data.covariates),
        "joints": joints,
        "repeats": data.configurations - len(np.unique(data.block)),
        "noise_floor": None
        if floor is None
        else {"coordinate_mm": floor.coordinate_mm, "source": floor.source},
        "geometry": {"parameters": len(model.terms), "rank": rank, "condition": condition},
        "unidentifiable": [
            {"sentence": u.sentence, "parameters": list(u.parameters)}
            for u in describe_unidentifiable(found, model.terms)
        ],
        **_registered(robot, data),
        "warnings": [{"code": n.code, "sentence": n.sentence} for n in data.notes],
    }


def _registered(robot: Robot, data: Measurements) -> dict[str, Any]:
    """How well the positions fit the nominal robot once the tracker's frame and the targets are
    found, as one placement of all groups, and which simple mistake of the set-up would fit better;
    empty where too few points are measured."""
    bound = Problem(robot, data, np.zeros((len(data.targets), 3)))
    points = np.flatnonzero(
        np.ones(len(data), bool) if data.gauges is None else data.gauges.of("point")
    )
    use = np.zeros(len(data), bool)
    use[points[:: max(len(points) // MOST, 1)]] = True
    if len(np.unique(data.block[use])) < LEAST:
        return {}
    try:
        bound = register(bound, use, per_group=False)
        left = float(np.median(np.linalg.norm(residuals(bound.take(use))[:, :3], axis=1)))
    except (DataError, NotEstimable):
        return {}
    doubts = setup_notes(bound, use, True, False)
    return {
        "registered": {
            "median_mm": left,
            **locate_placements(bound, False),
            "mistake": next((n.sentence for n in doubts if n.code == SETUP_MISTAKE), None),
            "alarms": list_alarms(doubts),
        }
    }


def _some(names: list[str]) -> str:
    return ", ".join(names[:6]) + (f" and {len(names) - 6} more" if len(names) > 6 else "")


def sentences(found: dict[str, Any]) -> list[str]:
    """`describe` in words."""
    out = [
        f"{found['rows']:,} rows, {found['configurations']:,} configurations, {found['repeats']:,} of them repeats; targets: "
        f"{', '.join(found['targets'])}; groups: {', '.join(found['groups'][:8])}"
        + (" …" if len(found["groups"]) > 8 else "")
    ]
    if "kinds" in found:
        shared: dict[str, list[str]] = {}
        for f in found["features"]:
            shared.setdefault(f["kind"], []).append(f["name"])
        out.append(
            "Rows by kind: "
            + ", ".join(
                f"{count} {kind}" + (f" ({_some(shared[kind])})" if kind in shared else "")
                for kind, count in found["kinds"].items()
            )
        )
    out.append(
        "Covariates: "
        + (", ".join(found["covariates"]) or "none")
        + ("; orientations measured" if found["orientation"] else "; positions only")
    )
    for j in found["joints"]:
        factor, unit = (180 / np.pi, "deg") if j["unit"] == "rad" else (1.0, "mm")
        share = "" if j["share_of_range"] is None else f", {j['share_of_range']:.0%} of its range"
        moved = (
            f"{j['low'] * factor:.1f} to {j['high'] * factor:.1f} {unit}{share}"
            if j["moves"]
            else ("does not move: nothing can be said of errors that grow with it")
        )
        out.append(f"Joint {j['joint']}: {moved}")
    floor = found["noise_floor"]
    out.append(
        "Noise floor: "
        + (
            f"{floor['coordinate_mm']:.3g} mm per coordinate, from {floor['source']}"
            if floor
            else "cannot be told from these data alone"
            + ("" if "kinds" in found else " (no repeats, no target pairs)")
        )
    )
    geometry = found["geometry"]
    out.append(
        f"Geometry: {geometry['rank']} of {geometry['parameters']} parameters can be determined (target assumed at "
        f"0, 0, 100 mm), condition {geometry['condition']:.0f}"
    )
    out += [f"  {u['sentence']}" for u in found["unidentifiable"]]
    if "registered" in found:
        placed = found["registered"]
        out.append(
            f"Registered (tracker's frame and target found): {placed['median_mm']:.3g} mm from the nominal robot (median)"
        )
        out += [
            f"  {sentence}"
            for sentence in describe_placements(RegistrationRecord.model_validate(placed))
        ]
        out += placed["alarms"]
    return [*out, *(f"Note: {w['sentence']}" for w in found["warnings"])]
