"""What to note about planned commands: what lies beyond what the calibration has seen, and what
follows from their order alone."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ..._typing import Array
from ...exceptions import sentence_list
from ...measurements.campaign.state_names import StateKind, parse_state_name
from ...measurements.measurements import Measurements
from ...mechanisms.step_moments import list_step_moments
from ..assumed_values import describe_assumed
from .late_effects import describe_unknown_history

if TYPE_CHECKING:
    from ..calibration import Calibration

RANGE_TOLERANCE = 0.01  # of a range: a value further beyond it is noted
FAR_TOLERANCE = 0.1  # and one so far beyond it tells nothing of what was calibrated


def find_past_limits(c: Calibration, q: Array) -> NDArray[np.bool_]:
    """Find the readings (m, n) beyond their joint's limits; none where these are not known."""
    beyond = np.zeros(q.shape, bool)
    for j, joint in enumerate(c.robot.joints):
        beyond[:, j] = joint.find_beyond(q[:, j])
    return beyond


def describe_extrapolation(c: Calibration, data: Measurements) -> list[str]:
    """Describe what lies beyond what the calibration has seen: joint readings, the covariates that
    its model uses, joint limits, unknown directions of approach; and covariates that are assumed."""
    return [
        *describe_assumed(c, data),
        *_describe_beyond_ranges(c, data),
        *_describe_past_limits(c, data),
        *_describe_unknown_approach(c, data),
        *_describe_unknown_path(c, data),
        *describe_unknown_history(c.terms, data),
        *_describe_steps(c),
    ]


def count_rows_beyond(c: Calibration, data: Measurements) -> int:
    """Count the rows of which a value lies far beyond what the calibration has seen."""
    beyond = np.zeros(len(data), bool)
    for rows in _find_beyond_ranges(c, data, FAR_TOLERANCE).values():
        beyond |= rows
    count = beyond.sum()
    return int(count)


def _find_beyond_ranges(
    c: Calibration, data: Measurements, tolerance: float
) -> dict[str, NDArray[np.bool_]]:
    """Find the rows (m,) beyond the range of each value that the model uses, by more than a share
    `tolerance` of it."""
    needs = c.needs()
    values = {}
    for j, readings in enumerate(data.q.T, 1):
        values[f"q{j}"] = readings
    for name in data.covariates:
        if name not in needs:
            continue
        values[name] = data.covariates[name]
    found = {}
    for name, column in values.items():
        if name not in c.ranges:
            continue
        low, high = c.ranges[name]
        slack = tolerance * (high - low)
        below = column < low - slack
        above = column > high + slack
        found[name] = below | above
    return found


def _describe_beyond_ranges(c: Calibration, data: Measurements) -> list[str]:
    sentences = []
    for name, beyond in _find_beyond_ranges(c, data, RANGE_TOLERANCE).items():
        low, high = c.ranges[name]
        count = int(beyond.sum())
        if count:
            factor, unit = _reading_unit(c, name)
            known = f"{low * factor:.4g} to {high * factor:.4g}{unit}"
            verb = "lies" if count == 1 else "lie"
            sentences.append(
                f"{name}: {count:,} of {len(data):,} rows {verb} beyond the {known} that the calibration has seen; "
                "there the model extrapolates."
            )
    return sentences


def _describe_past_limits(c: Calibration, data: Measurements) -> list[str]:
    past = find_past_limits(c, data.q)
    rows = len(data)
    sentences = []
    counts = past.sum(0).tolist()
    for j, count in enumerate(counts, 1):
        verb = "lies" if count == 1 else "lie"
        sentence = f"joint {j}: {count:,} of {rows:,} rows {verb} beyond its limits."
        if count:
            sentences.append(sentence)
    return sentences


def _describe_unknown_approach(c: Calibration, data: Measurements) -> list[str]:
    sentences = []
    for joint in list_joints_of(c, StateKind.APPROACH):
        directions = data.approach[:, joint - 1]
        unknown = directions == 0
        if unknown.any():
            sentence = f"joint {joint}: the direction of approach is unknown (0) in some rows; the middle of the backlash is taken there."
            sentences.append(sentence)
    return sentences


def _describe_unknown_path(c: Calibration, data: Measurements) -> list[str]:
    """Describe that a joint's hysteresis is left out where its path is not known."""
    joints = list_joints_of(c, StateKind.DRAG)
    if not joints or data.path is not None:
        return []
    named = sentence_list([str(joint) for joint in joints])
    several = len(joints) > 1
    what = (
        "joints came is not known; the middle of their"
        if several
        else "joint came is not known; the middle of its"
    )
    sentence = f"joint{'s' * several} {named}: with directions of approach given, the way that the {what} hysteresis is taken."
    return [sentence]


def _describe_steps(c: Calibration) -> list[str]:
    """Describe how what stepped during the campaign is taken."""
    mechanisms = c.model.mechanisms
    steps = [mechanism.name for mechanism in mechanisms if list_step_moments(mechanism.terms)]
    if not steps:
        return []
    names = sentence_list(steps)
    return [f"{names}: what moved during the campaign is taken as it stood at its end."]


def needs_approach(c: Calibration, data: Measurements) -> bool:
    """Whether directions of approach were given with the commands, or the model looks at one."""
    if not data.approach_from_order:
        return True
    joints = list_joints_of(c, StateKind.APPROACH)
    return bool(joints)


def list_joints_of(c: Calibration, kind: StateKind) -> list[int]:
    """List the joints whose state variable of a kind the model uses."""
    joints = []
    for name in c.needs():
        variable = parse_state_name(name)
        if variable is None or variable.kind is not kind:
            continue
        if variable.joint is not None:
            joints.append(variable.joint)
    return sorted(set(joints))


def describe_order_dependence(c: Calibration, data: Measurements) -> list[str]:
    """Describe which motions that the model uses follow from the order of the targets alone."""
    approach = list[int]()
    if data.approach_from_order:
        approach = list_joints_of(c, StateKind.APPROACH)
    path = list[int]()
    if data.path is not None:
        path = list_joints_of(c, StateKind.DRAG)
    sentences = []
    for joints, what, remedy in (
        (approach, "directions of approach", " or give approach columns"),
        (list_joints_of(c, StateKind.MOVE), "sizes of the moves", ""),
        (path, "effects of hysteresis", ""),
    ):
        if joints:
            named = sentence_list([str(j) for j in joints])
            sentences.append(
                f"joint{'s' * (len(joints) > 1)} {named}: the {what} are taken from the order of the targets in the "
                f"file. Run them in this order{remedy}."
            )
    return sentences


def _reading_unit(c: Calibration, name: str) -> tuple[float, str]:
    """Return the factor and unit in which people read a value: degrees and mm for joints."""
    for j, joint in enumerate(c.robot.joints, 1):
        if name != f"q{j}":
            continue
        if joint.prismatic:
            return 1.0, " mm"
        return 180 / np.pi, " deg"
    return 1.0, ""
