"""DH rows by the nominal ones: of the frames that one chain allows, those whose x axes point as the
nominal table has them.

An x axis along a common normal may point either way. Turning frame f by 180° about its own z adds that
to θ of row f, takes it from θ of row f + 1, and changes the sign of a and α of the row between the two
axes: row f of a standard table, row f + 1 of a modified one."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from .dh_rows import wrap_degrees

HALF_TURN = 180.0
# numbers of a row that change their sign
REVERSED = ("a_mm", "alpha_deg", "beta_deg")


def turn_frames(nominal: Mapping[str, Any], table: Mapping[str, Any]) -> dict[str, Any]:
    """Return the table of a robot file with the x axis of every frame but the last as near that of the
    nominal table as it may be; the arm is the same."""
    behind = 1 if table["convention"] == "modified" else 0
    joints = [dict(joint) for joint in table["joint"]]
    expected = [joint["dh"] for joint in nominal["joint"]]
    frames = range(len(joints) - 1)
    for frame in frames:
        row = frame + behind
        before = _measure_distance(joints, expected, frame, row)
        turned = _turn(joints, frame, row)
        after = _measure_distance(turned, expected, frame, row)
        if after < before:
            joints = turned
    return {**table, "joint": joints}


def _measure_distance(
    joints: list[dict[str, Any]], expected: list[Mapping[str, float]], frame: int, row: int
) -> float:
    """Measure how far a frame's angle, and the row that its x axis is in, are from those expected: mm
    and degrees alike, since a frame that is turned differs by far in either."""
    own = joints[frame]["dh"]["theta_deg"] - expected[frame]["theta_deg"]
    between = joints[row]["dh"]
    wanted = expected[row]
    twist = between["alpha_deg"] - wanted["alpha_deg"]
    length = between["a_mm"] - wanted["a_mm"]
    angles = abs(wrap_degrees(own)) + abs(wrap_degrees(twist))
    return float(angles + abs(length))


def _turn(joints: list[dict[str, Any]], frame: int, row: int) -> list[dict[str, Any]]:
    """Turn one frame by half a turn about its z axis, and the link's centre of mass with it."""
    turned = [{**joint, "dh": dict(joint["dh"])} for joint in joints]
    for number in (frame, frame + 1):
        values = turned[number]["dh"]
        values["theta_deg"] = wrap_degrees(values["theta_deg"] + HALF_TURN)
    between = turned[row]["dh"]
    for key in REVERSED:
        if key in between:
            between[key] = -between[key] + 0.0
    centre = turned[frame].get("com_mm")
    if centre is not None:
        x, y, z = np.asarray(centre).tolist()
        turned[frame]["com_mm"] = [-x + 0.0, -y + 0.0, z]
    return turned
