"""Where the tracker and the targets stand, as registration found them: plain values, and in words
with units and frames."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from ..fitting.problem import Problem
from ..robot.rigid import to_rpy

SHOWN = 6  # groups, targets


def standing(problem: Problem, per_group: bool) -> dict[str, Any]:
    """Frame 0 (the nominal robot's base) in the tracker's frame, by group or once: position [mm]
    and roll, pitch, yaw [deg], with R = Rz(yaw) Ry(pitch) Rx(roll); every target in the flange
    frame [mm]."""
    R, t = problem.placement
    groups = problem.data.groups if per_group else ("all",)
    return {
        "base_in_tracker": [
            {
                "group": name,
                "position_mm": t[g].tolist(),
                "rpy_deg": np.degrees(to_rpy(R[g])).tolist(),
            }
            for g, name in enumerate(groups)
        ],
        "target_on_flange": [
            {"target": name, "position_mm": tool.tolist()}
            for name, tool in zip(problem.data.targets, problem.tools, strict=True)
        ],
    }


def standing_sentences(found: Mapping[str, Any]) -> list[str]:
    """The same in words."""
    bases, targets = found["base_in_tracker"], found["target_on_flange"]
    out = []
    for base in bases[:SHOWN]:
        x, turns = _numbers(base["position_mm"], 2), _numbers(base["rpy_deg"], 3)
        out.append(
            f"Base of the nominal robot (frame 0) in the tracker's frame{_of(base['group'], bases)}: {x} mm, "
            f"turned by roll, pitch, yaw {turns}° (fixed x, y, z)."
        )
    out += [
        f"Target{_of(one['target'], targets)} in the flange frame: {_numbers(one['position_mm'], 2)} mm."
        for one in targets[:SHOWN]
    ]
    more = max(len(bases) - SHOWN, 0) + max(len(targets) - SHOWN, 0)
    return [*out, *([f"{more} more placements are in the JSON."] if more else [])]


def _of(name: str, several: Sequence[Any]) -> str:
    return f" ({name})" if len(several) > 1 else ""


def _numbers(values: Sequence[float], digits: int) -> str:
    return ", ".join(f"{round(v, digits) + 0.0:.{digits}f}" for v in values)
