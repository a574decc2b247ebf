"""Where the tracker and the targets stand, as registration found them: plain values, and in words with units and
frames."""

from __future__ import annotations

from collections.abc import Sequence, Sized
from typing import Any

import numpy as np

from ...exceptions import count_words
from ...fitting.problem import Problem
from ...robot.rigid import to_rpy
from ..schemas.schema import BaseRecord, RegistrationRecord, TargetRecord

SHOWN = 6  # groups, targets


def locate_placements(problem: Problem, per_group: bool) -> dict[str, Any]:
    """Return where registration found the base and the targets, as plain values.

    Frame 0 (the nominal robot's base) in the tracker's frame, by group or once: position [mm] and roll, pitch, yaw
    [deg], with R = Rz(yaw) Ry(pitch) Rx(roll); every target in the flange frame [mm]."""
    rotation, translation = problem.placement
    groups = problem.data.groups if per_group else ("all",)
    bases = [
        {
            "group": name,
            "position_mm": translation[group].tolist(),
            "rpy_deg": np.degrees(to_rpy(rotation[group])).tolist(),
        }
        for group, name in enumerate(groups)
    ]
    targets = [
        {"target": name, "position_mm": tool.tolist()}
        for name, tool in zip(problem.data.targets, problem.tools, strict=True)
    ]
    return {"base_in_tracker": bases, "target_on_flange": targets}


def describe_placements(registration: RegistrationRecord) -> list[str]:
    """Describe where registration found the base and the targets, a sentence for each."""
    bases, targets = registration.base_in_tracker, registration.target_on_flange
    sentences = [_describe_base(base, _qualifier(base.group, bases)) for base in bases[:SHOWN]]
    sentences += [
        _describe_target(target, _qualifier(target.target, targets)) for target in targets[:SHOWN]
    ]
    more = max(len(bases) - SHOWN, 0) + max(len(targets) - SHOWN, 0)
    if more:
        verb = "is" if more == 1 else "are"
        sentences.append(f"{count_words(more, 'more placement')} {verb} in the JSON.")
    return sentences


def _describe_base(base: BaseRecord, qualifier: str) -> str:
    return (
        f"Base of the nominal robot (frame 0) in the instrument's frame{qualifier}: {_numbers(base.position_mm, 2)} mm, "
        f"turned by roll, pitch, yaw {_numbers(base.rpy_deg, 3)}° (fixed x, y, z)."
    )


def _describe_target(target: TargetRecord, qualifier: str) -> str:
    return f"Target{qualifier} in the flange frame: {_numbers(target.position_mm, 2)} mm."


def _qualifier(name: str, several: Sized) -> str:
    """Return the name in parentheses where there are several."""
    return f" ({name})" if len(several) > 1 else ""


def _numbers(values: Sequence[float], digits: int) -> str:
    """Return numbers with so many decimals, no negative zero."""
    return ", ".join(f"{round(value, digits) + 0.0:.{digits}f}" for value in values)
