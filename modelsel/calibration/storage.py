"""Whether the parts of a stored calibration fit one another: what stands in the file twice, or
hangs together, says the same."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from .._json import PAIR, TRIPLE, Each, Maybe, find_misfit, parse_json, read_json_text
from .._typing import Array
from ..exceptions import StudyError
from ..fitting.design import Model
from ..fitting.noise import Floor
from ..mechanisms.serialization import (
    TERM,
    collect_members,
    mechanism_from_record,
    mechanism_record,
)
from ..robot.plain_values import (
    JOINT,
    ROTATION,
    TRANSFORM,
    bounded_array,
    check_rotation,
    robot_from_record,
    robot_record,
)
from .calibration import Calibration
from .refitting import REFITS, refits_of, refits_record

if TYPE_CHECKING:
    pass

SAME = 1e-6  # relative: two numbers of a file that say the same


def contradiction(r: Mapping[str, Any], model: Model, standard_errors: Array) -> str | None:
    """What in a record of a calibration contradicts the rest of it, or its `model` and the
    `standard_errors` of its covariance factor; None where nothing does."""
    joints, floor = len(r["robot"]["joints"]), r["noise_floor"]
    names = {key: [one["name"] for one in r[f"{key}s"]] for key in ("target", "group")}
    screws = [s for t in model.terms for s in t.screws]
    needs = {f"q{j}" for j in range(1, joints + 1)}.union(*(s.cause.names() for s in screws)) - {
        "target",
        "group",
    }
    checks = (
        (
            np.allclose(
                [e["standard_error"] for e in r["estimates"]], standard_errors, rtol=SAME, atol=0
            ),
            "its standard errors are not those of its covariance_factor",
        ),
        (
            all(s.frame <= joints + 1 for s in screws),
            "a screw is at a frame that its robot does not have",
        ),
        (
            all(
                0 <= m.index < len(names[m.kind]) for s in screws for m in collect_members(s.cause)
            ),
            "a cause names a target or group that it does not have",
        ),
        (
            len({t["rotation"] is None for t in r["targets"]}) == 1,
            "some of its targets have an orientation and some have none",
        ),
        (
            all(len(set(some)) == len(some) for some in names.values()),
            "two targets or groups share a name",
        ),
        (
            floor["coordinate_mm"] >= 0 and (floor["freedom"] is None or floor["freedom"] > 0),
            "its noise_floor is none",
        ),
        ((r["held_out_rms_mm"] or 0) >= 0, "its held_out_rms_mm is below zero"),
        (all(low <= high for low, high in r["ranges"].values()), "a range ends before it begins"),
        (
            needs <= r["ranges"].keys(),
            f"its ranges lack {', '.join(sorted(needs - r['ranges'].keys()))}",
        ),
    )
    return next((what for holds, what in checks if not holds), None)


SCHEMA = 1
NAME = "calibration.json"


# -- the file
# ----------------------------------------------------------------------------------------------------------------


def calibration_text(c: Calibration) -> str:
    """Text of calibration.json; numbers in full."""
    return json.dumps(_record(c), ensure_ascii=False, indent=1, allow_nan=False) + "\n"


def _record(c: Calibration) -> dict[str, Any]:
    return {
        "schema": SCHEMA,
        "kind": "calibration",
        "study": c.study,
        "robot": robot_record(c.robot),
        "targets": [
            {
                "name": name,
                "tool_mm": c.tools[k].tolist(),
                "rotation": None if c.tool_rotations is None else c.tool_rotations[k].tolist(),
            }
            for k, name in enumerate(c.targets)
        ],
        "groups": [
            {
                "name": name,
                "rotation": c.placement[0][k].tolist(),
                "translation_mm": c.placement[1][k].tolist(),
            }
            for k, name in enumerate(c.groups)
        ],
        "registered": c.registered,
        "tracker_mm": list(c.tracker),
        "mechanisms": [mechanism_record(m) for m in c.model.mechanisms],
        "estimates": [
            {
                "symbol": t.symbol,
                "value": float(v),
                "standard_error": float(e),
                "unit": t.unit,
                "estimable": k in c.kept,
            }
            for k, (t, v, e) in enumerate(zip(c.terms, c.theta, c.standard_errors, strict=True))
        ],
        "covariance_factor": {
            "says": "row k of the fitted terms (estimable), from its own column on: covariance = F Fᵀ",
            "rows": [c.factor[k, i:].tolist() for i, k in enumerate(c.kept)],
        },
        "noise_floor": {
            "coordinate_mm": c.floor.coordinate_mm,
            "source": c.floor.source,
            "freedom": c.floor.freedom if np.isfinite(c.floor.freedom) else None,
        },
        "held_out_rms_mm": c.held_out_rms_mm,
        "ranges": {name: list(pair) for name, pair in c.ranges.items()},
        "provenance": dict(c.provenance),
        **(
            {}
            if c.refits is None
            else {"refits": refits_record(c.refits, [t.symbol for t in c.terms])}
        ),
    }


def _restored(r: Mapping[str, Any]) -> Calibration:
    """The calibration of a record of its shape. Raises ValueError where its parts do not agree."""
    model = Model(tuple(mechanism_from_record(m) for m in r["mechanisms"]))
    estimates, rows, robot = (
        r["estimates"],
        r["covariance_factor"]["rows"],
        robot_from_record(r["robot"]),
    )
    if [(e["symbol"], e["unit"]) for e in estimates] != [(t.symbol, t.unit) for t in model.terms]:
        raise ValueError("its estimates are not those of its terms")
    kept = tuple(k for k, e in enumerate(estimates) if e["estimable"])
    if [len(row) for row in rows] != list(range(len(kept), 0, -1)):
        raise ValueError("its covariance_factor has other rows than its estimable terms")
    factor = np.zeros((len(estimates), len(kept)))
    for i, (k, row) in enumerate(zip(kept, rows, strict=True)):
        factor[k, i:] = row
    for kind in ("targets", "groups"):
        if len({each["name"] for each in r[kind]}) < len(r[kind]):
            raise ValueError(f"two {kind} have one name")
    turned = [
        None if t["rotation"] is None else check_rotation(t["rotation"]) for t in r["targets"]
    ]
    floor, held, (x, y, z) = (
        r["noise_floor"],
        r["held_out_rms_mm"],
        bounded_array(r["tracker_mm"]).tolist(),
    )
    c = Calibration(
        r["study"],
        robot,
        tuple(t["name"] for t in r["targets"]),
        tuple(g["name"] for g in r["groups"]),
        bounded_array([t["tool_mm"] for t in r["targets"]]),
        None if any(t is None for t in turned) else np.array(turned),
        (
            np.array([check_rotation(g["rotation"]) for g in r["groups"]]),
            bounded_array([g["translation_mm"] for g in r["groups"]]),
        ),
        r["registered"],
        (x, y, z),
        model,
        np.array([float(e["value"]) for e in estimates]),
        factor,
        kept,
        Floor(
            float(floor["coordinate_mm"]),
            floor["source"],
            np.inf if floor["freedom"] is None else float(floor["freedom"]),
        ),
        None if held is None else float(held),
        {k: (float(v[0]), float(v[1])) for k, v in r["ranges"].items()},
        dict(r["provenance"]),
        refits_of(r["refits"], model) if "refits" in r else None,
    )
    if (what := contradiction(r, model, c.standard_errors)) is not None:
        raise ValueError(what)
    return c


def loads(text: str, where: str = NAME) -> Calibration:
    """The calibration of a file's text. Raises StudyError."""
    try:
        record = parse_json(text)
    except ValueError as error:
        raise StudyError(f"{where}: cannot be read: {error}. Run the study again.") from None
    if not isinstance(record, dict) or record.get("kind") != "calibration":
        raise StudyError(
            f"{where}: not a calibration; `modelsel study` writes one beside its result.json."
        )
    if record.get("schema") is True or record.get("schema") != SCHEMA:
        raise StudyError(
            f"{where}: schema {str(record.get('schema'))[:40]}, but this modelsel reads schema {SCHEMA}. Run the "
            "study again."
        )
    try:
        if (found := find_misfit(record, CALIBRATION)) is not None:
            raise ValueError(found)
        return _restored(record)
    except ValueError as error:
        raise StudyError(f"{where}: damaged: {error}. Run the study again.") from None


def load_calibration(path: Path | str) -> Calibration:
    """A stored calibration: its file, the result.json beside it, or the folder of both. Raises
    StudyError."""
    path = Path(path)
    path = (
        path / NAME
        if path.is_dir()
        else path.with_name(NAME)
        if path.name == "result.json"
        else path
    )
    try:
        text = read_json_text(path)
    except FileNotFoundError:
        raise StudyError(
            f"{path}: no such calibration; `modelsel study STUDY.toml` writes one beside its result.json."
        ) from None
    except ValueError as error:
        raise StudyError(f"{path.name}: cannot be read: {error}. Run the study again.") from None
    return loads(text, path.name)


# Causes, terms, mechanisms and robots as plain JSON values, and back: structure as structure,
# nothing parsed from text.

CALIBRATION = {
    "kind": frozenset(["calibration"]),
    "study": str,
    "robot": {
        "name": str,
        "source": str,
        "gravity": Maybe(TRIPLE),
        "joints": Each(JOINT, least=1),
        "last_mm": TRANSFORM,
        "usual?": PAIR,
    },
    "targets": Each({"name": str, "tool_mm": TRIPLE, "rotation": Maybe(ROTATION)}, least=1),
    "groups": Each({"name": str, "rotation": ROTATION, "translation_mm": TRIPLE}, least=1),
    "registered": bool,
    "tracker_mm": TRIPLE,
    "mechanisms": Each(
        {
            "name": str,
            "sentence": str,
            "equation": str,
            "source": str,
            "terms": Each(TERM),
            "contrary?": str,
        }
    ),
    "estimates": Each(
        {"symbol": str, "value": float, "standard_error": float, "unit": str, "estimable": bool}
    ),
    "covariance_factor": {"rows": Each(Each(float))},
    "noise_floor": {"coordinate_mm": float, "source": str, "freedom": Maybe(float)},
    "held_out_rms_mm": Maybe(float),
    "ranges": {str: PAIR},
    "provenance": {str: str},
    "refits?": REFITS,
}
