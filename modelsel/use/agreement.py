"""Whether the parts of a stored calibration fit one another: what stands in the file twice, or hangs together, says the same."""
from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from .._typing import Array
from ..fitting.design import Model
from ..mechanisms.serialization import members

SAME = 1e-6      # relative: two numbers of a file that say the same


def contradiction(r: Mapping[str, Any], model: Model, standard_errors: Array) -> str | None:
    """What in a record of a calibration contradicts the rest of it, or its `model` and the `standard_errors` of its covariance
    factor; None where nothing does."""
    joints, floor = len(r["robot"]["joints"]), r["noise_floor"]
    names = {key: [one["name"] for one in r[f"{key}s"]] for key in ("target", "group")}
    screws = [s for t in model.terms for s in t.screws]
    needs = {f"q{j}" for j in range(1, joints + 1)}.union(*(s.cause.names() for s in screws)) - {"target", "group"}
    checks = (
        (np.allclose([e["standard_error"] for e in r["estimates"]], standard_errors, rtol=SAME, atol=0),
         "its standard errors are not those of its covariance_factor"),
        (all(s.frame <= joints + 1 for s in screws), "a screw is at a frame that its robot does not have"),
        (all(0 <= m.index < len(names[m.kind]) for s in screws for m in members(s.cause)),
         "a cause names a target or group that it does not have"),
        (len({t["rotation"] is None for t in r["targets"]}) == 1, "some of its targets have an orientation and some have none"),
        (all(len(set(some)) == len(some) for some in names.values()), "two targets or groups share a name"),
        (floor["coordinate_mm"] >= 0 and (floor["freedom"] is None or floor["freedom"] > 0), "its noise_floor is none"),
        ((r["held_out_rms_mm"] or 0) >= 0, "its held_out_rms_mm is below zero"),
        (all(low <= high for low, high in r["ranges"].values()), "a range ends before it begins"),
        (needs <= r["ranges"].keys(), f"its ranges lack {', '.join(sorted(needs - r['ranges'].keys()))}"))
    return next((what for holds, what in checks if not holds), None)
