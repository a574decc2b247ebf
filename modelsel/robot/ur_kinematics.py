"""Universal Robots' calibrated chain, as ROS' ur_calibration writes it: a YAML file with the place of
every link on the one before."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from .._text import read_text
from .._typing import LARGEST
from ..exceptions import StudyError
from .kinematics import Joint, Robot
from .plain_values import check_reach
from .rigid import from_rpy, transform

YAML_SUFFIXES = (".yaml", ".yml")
# links in the order of the chain, each placed by the joint before it
LINKS = ("shoulder", "upper_arm", "forearm", "wrist_1", "wrist_2", "wrist_3")
KEYS = ("x", "y", "z", "roll", "pitch", "yaw")


def read_ur_calibration(path: Path) -> Robot:
    """Read the chain of a kinematics file (m, rad), in the controller's base frame, to the flange
    (tool0). Raises StudyError with every problem."""
    table = _load_yaml(path)
    chain = table.get("kinematics")
    if not isinstance(chain, Mapping):
        raise StudyError(
            f"{path.name}: no table kinematics. A file of Universal Robots' ur_calibration is "
            "expected; other robots are TOML or URDF files."
        )
    problems = list[str]()
    joints = []
    for link in LINKS:
        values = _read_link(chain, link, path.name, problems)
        x, y, z, roll, pitch, yaw = values
        R = from_rpy(roll, pitch, yaw)
        before = transform(R, np.array([x, y, z]) * 1e3)
        joints.append(Joint(before))
    if problems:
        raise StudyError(*problems)
    robot = Robot(
        path.stem,
        source=f"ur_calibration {path.name}, {chain.get('hash', 'without hash')}",
        joints=tuple(joints),
        last=np.eye(4),
        gravity=(0.0, 0.0, -1.0),
    )
    check_reach(robot, "m", path.name)
    return robot


def _load_yaml(path: Path) -> Mapping[str, Any]:
    try:
        import yaml
    except ImportError:
        raise StudyError(
            f"{path.name}: YAML files need PyYAML. Install it: pip install 'modelsel[ros]'."
        ) from None
    text = read_text(path, "the robot file")
    try:
        table = yaml.safe_load(text)
    except (yaml.YAMLError, RecursionError, ValueError) as error:
        said = " ".join(str(error).split())
        raise StudyError(f"{path.name}: not valid YAML: {said}. Correct this place.") from None
    if not isinstance(table, Mapping):
        raise StudyError(f"{path.name}: a table kinematics is expected.")
    return table


def _read_link(
    chain: Mapping[str, Any], link: str, where: str, problems: list[str]
) -> tuple[float, ...]:
    """Read the six numbers of a link; a problem is added where they are not there."""
    row = chain.get(link)
    if not isinstance(row, Mapping):
        problems.append(f"{where}: kinematics.{link} is missing: x, y, z, roll, pitch, yaw.")
        return (0.0,) * len(KEYS)
    values = []
    for key in KEYS:
        given = row.get(key)
        value = _as_number(given)
        if value is None:
            problems.append(f"{where}: kinematics.{link}.{key}: a number is expected.")
        values.append(value or 0.0)
    return tuple(values)


def _as_number(value: Any) -> float | None:
    """Return a finite number; None for anything else. YAML 1.1 takes 1e-05 for a word."""
    if isinstance(value, bool) or not isinstance(value, (int, float, str)):
        return None
    try:
        number = float(value)
    except ValueError:
        return None
    is_finite = math.isfinite(number)
    return number if is_finite and abs(number) <= LARGEST else None
