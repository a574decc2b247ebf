"""Export as a kinematic chain: URDF and DH tables, refitted to what the form can carry."""

from __future__ import annotations

import tomllib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from ..._typing import Array
from ...robot.dh import compute_dh_rows, format_dh_file
from ...robot.files import robot_from_table
from ...robot.kinematics import Robot, forward
from ...robot.rigid import inverse, transform
from ...robot.urdf import read_urdf_text
from ...robot.urdf_writer import write_urdf
from ..constant_part import (
    ConstantChain,
    build_constant_chain,
    compute_points,
    sample_workspace,
    split_parts,
)
from .form import Exported

if TYPE_CHECKING:
    from ..calibration import Calibration


def measure_chain(
    c: Calibration,
    text: str,
    read: Callable[[str, int], Callable[[Array], Array]],
    notes: tuple[str, ...],
) -> Exported:
    """Measured as a chain: `read` gives, of the file's text, the target's position in frame 0 at
    joint readings."""
    worst = 0.0
    for t in range(len(c.targets)):
        at = sample_workspace(c, t)
        worst = max(
            worst,
            float(
                np.linalg.norm(
                    read(text, t)(at.data.q) - compute_points(at, split_parts(c, t)[0]), axis=1
                ).max()
            ),
        )
    return Exported(text, worst, len(at) * len(c.targets), notes=notes)


def to_urdf(c: Calibration, notes: Sequence[str] = ()) -> Exported:
    """The calibrated chain as a URDF: targets on the flange, the tracker on the base."""
    made, links = build_constant_chain(c), _name_links(c.targets)
    tips = {links[name]: place for name, place in made.targets.items()}
    tracker = inverse(transform(c.placement[0][0], c.placement[1][0]))
    robot, bounded = _bound_slides(made.robot, c.ranges)
    text = write_urdf(
        robot,
        tips,
        {"tracker": tracker} if c.registered else {},
        [made.robot.source, *notes, *bounded],
    )

    def read(text: str, target: int) -> Callable[[Array], Array]:
        back = read_urdf_text(text, "the export", "base", links[c.targets[target]])
        return lambda q: forward(back, q, np.zeros(3))

    return measure_chain(c, text, read, bounded)


def _bound_slides(
    robot: Robot, ranges: Mapping[str, tuple[float, float]]
) -> tuple[Robot, tuple[str, ...]]:
    """(the robot, what is to be said): a URDF's slide must have limits; where the robot file has
    none, those of the readings."""
    bare = [
        j for j, joint in enumerate(robot.joints, 1) if joint.prismatic and joint.limits is None
    ]
    joints = (
        replace(joint, limits=ranges[f"q{j}"]) if j in bare else joint
        for j, joint in enumerate(robot.joints, 1)
    )
    return replace(robot, joints=tuple(joints)), tuple(
        f"joint {j} slides, and a URDF wants its limits: they are those of the readings the calibration has seen"
        for j in bare
    )


def _name_links(targets: Sequence[str]) -> dict[str, str]:
    """Target -> the name of its link: its own, unless a link of the arm or another target's has
    it."""
    out: dict[str, str] = {}
    for name in sorted(
        targets, key=lambda name: (_is_reserved(name), targets.index(name))
    ):  # who may keep its name does
        link = name
        while _is_reserved(link) or link in out.values():
            link = f"target_{link}"
        out[name] = link
    return out


def _is_reserved(name: str) -> bool:
    return name in ("world", "base", "flange", "tracker") or name.startswith("link")


def to_dh(c: Calibration, modified: bool, notes: Sequence[str]) -> Exported:
    """Write the calibrated chain as standard or modified DH rows, targets in the notes."""
    made = build_constant_chain(c)
    nearly = tuple(
        f"joints {a} and {b} are almost parallel: their rows have a large d; small changes of the angle change it much"
        for a, b in compute_dh_rows(made.robot, modified).nearly
    )
    where = tuple(
        f"target {name} on the flange: x, y, z = {', '.join(repr(float(v)) for v in T[:3, 3])} mm"
        for name, T in made.targets.items()
    )
    text = format_dh_file(made.robot, modified, [*notes, *where, *nearly])

    def read(text: str, target: int) -> Callable[[Array], Array]:
        back = robot_from_table(tomllib.loads(text), "the export")
        return lambda q: forward(back, q, _target_offset(made, c.targets[target]))

    return measure_chain(c, text, read, nearly)


def _target_offset(made: ConstantChain, target: str) -> Array:
    return np.asarray(made.targets[target][:3, 3])
