"""Robot TOML files -> Robot: 3x4 transforms, URDF-like origins, standard and modified DH rows, in
any mixture."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np

from .._json import PAIR, TRIPLE, Each, Maybe
from .._names import MAX_TEXT_LENGTH, find_name_problem
from .._text import parse_toml, read_text
from .._typing import LARGEST, Array
from ..exceptions import StudyError, suggest
from .kinematics import Joint, Robot
from .rigid import align_z, from_rpy, inverse, rotation_matrix, transform

JOINT_FORMS = ("transform_mm", "xyz_mm", "dh")
JOINT_KEYS = {
    *JOINT_FORMS,
    "rpy_deg",
    "axis",
    "kind",
    "limits_deg",
    "limits_mm",
    "mass_kg",
    "com_mm",
    "name",
}
TOP_KEYS = {
    "name",
    "source",
    "gravity",
    "convention",
    "base_mm",
    "joint",
    "last",
    "usual_mm",
    "usual_mrad",
}
DH_KEYS = {"theta_deg", "d_mm", "a_mm", "alpha_deg"}


class _Reader:
    """Collects every problem of one file, so that all are said at once."""

    def __init__(self, where: str):
        self.where, self.problems = where, list[str]()

    def say(self, place: str, what: str) -> None:
        self.problems.append(
            f"{self.where}: {place}: {what}{'' if what.endswith(('.', '?')) else '.'}"
        )

    def keys(self, place: str, table: Mapping[str, Any], known: set[str]) -> None:
        for key in table:
            if key not in known:
                self.say(place, f'unknown key "{key}". {suggest(key, known)}')

    def numbers(self, place: str, value: Any, shape: tuple[int, ...]) -> Array:
        """A finite array of the wanted shape; zeros, and a problem noted, where it is not one."""
        try:
            out = np.array(value, dtype=float)
        except (TypeError, ValueError, OverflowError):
            out = np.array(np.nan)
        if (
            out.shape != shape
            or not (np.abs(out) <= LARGEST).all()
            or isinstance(value, (bool, str))
        ):
            wanted = (
                " x ".join(map(str, shape)) + " finite numbers" if shape else "one finite number"
            )
            if out.shape == shape and np.isfinite(out).all():
                wanted += f" below {LARGEST:g}"
            self.say(place, f"expected {wanted}, found {str(value)[:120]}")
            return np.zeros(shape)
        return out


def _form(read: _Reader, place: str, row: Mapping[str, Any], modified: bool) -> tuple[Array, Array]:
    """(transform before the joint, what is left for the next row) of one joint or of [last]."""
    given = [form for form in JOINT_FORMS if form in row]
    if len(given) != 1:
        read.say(
            place,
            f"give exactly one of {', '.join(JOINT_FORMS)}"
            + (f", not {' and '.join(given)}" if given else ""),
        )
        return np.eye(4), np.eye(4)
    if given == ["transform_mm"]:
        N = read.numbers(f"{place}.transform_mm", row["transform_mm"], (3, 4))
        if (
            N.any()
            and np.abs(N[:, :3] @ N[:, :3].T - np.eye(3)).max() > 1e-6
            or np.linalg.det(N[:, :3]) < 0
        ):
            read.say(f"{place}.transform_mm", "its first three columns are not a rotation")
        return transform(N[:, :3], N[:, 3]), np.eye(4)
    if given == ["xyz_mm"]:
        origin = transform(
            from_rpy(
                *np.radians(read.numbers(f"{place}.rpy_deg", row.get("rpy_deg", (0, 0, 0)), (3,)))
            ),
            read.numbers(f"{place}.xyz_mm", row["xyz_mm"], (3,)),
        )
        axis = read.numbers(f"{place}.axis", row.get("axis", (0, 0, 1)), (3,))
        if np.linalg.norm(axis) < 1e-9:
            read.say(f"{place}.axis", "the axis has no length")
            axis = np.array([0.0, 0.0, 1.0])
        B = transform(align_z(axis))
        return origin @ B, inverse(B)
    dh = row["dh"]
    if not isinstance(dh, Mapping):
        read.say(f"{place}.dh", "expected { theta_deg = …, d_mm = …, a_mm = …, alpha_deg = … }")
        return np.eye(4), np.eye(4)
    read.keys(f"{place}.dh", dh, DH_KEYS)
    theta, d, a, alpha = (
        float(read.numbers(f"{place}.dh.{key}", dh.get(key, 0), ()))
        for key in ("theta_deg", "d_mm", "a_mm", "alpha_deg")
    )
    Rz, Rx = (
        transform(rotation_matrix(2, np.radians(theta))),
        transform(rotation_matrix(0, np.radians(alpha))),
    )
    Tz, Tx = transform(t=(0, 0, d)), transform(t=(a, 0, 0))
    return (Rx @ Tx @ Tz @ Rz, np.eye(4)) if modified else (Rz, Tz @ Tx @ Rx)


def _joint(read: _Reader, place: str, row: Mapping[str, Any], before: Array) -> Joint:
    kind = row.get("kind", "revolute")
    if kind not in ("revolute", "prismatic"):
        read.say(f"{place}.kind", f'expected "revolute" or "prismatic", found "{kind}"')
    prismatic = kind == "prismatic"
    limits, key = None, "limits_mm" if prismatic else "limits_deg"
    if key in row:
        low, high = read.numbers(f"{place}.{key}", row[key], (2,)) * (
            1 if prismatic else np.pi / 180
        )
        limits = (float(low), float(high))
        if not low < high:
            read.say(f"{place}.{key}", "the lower limit must be below the upper one")
    mass = float(read.numbers(f"{place}.mass_kg", row["mass_kg"], ())) if "mass_kg" in row else None
    com = read.numbers(f"{place}.com_mm", row.get("com_mm", (0, 0, 0)), (3,))
    return Joint(before, prismatic, limits, mass, (float(com[0]), float(com[1]), float(com[2])))


def _usual(read: _Reader, table: Mapping[str, Any]) -> tuple[float, float]:
    """The usual size of such an arm's errors: (mm, rad)."""
    sizes = [
        float(read.numbers(key, table.get(key, 1.0), ())) for key in ("usual_mm", "usual_mrad")
    ]
    for key, size in zip(("usual_mm", "usual_mrad"), sizes, strict=True):
        if not size > 0:
            read.say(
                key,
                "expected a number above 0: the standard deviation of the arm's parameters about its drawing",
            )
    return sizes[0], sizes[1] * 1e-3


def robot_from_table(table: Mapping[str, Any], where: str) -> Robot:
    """The robot a TOML table describes; raises StudyError with every problem, each with its place
    in `where`."""
    read = _Reader(where)
    read.keys("robot file", table, TOP_KEYS)
    rows, last = table.get("joint"), table.get("last")
    if not isinstance(rows, list) or not rows or not all(isinstance(row, Mapping) for row in rows):
        raise StudyError(
            *read.problems,
            f"{where}: no [[joint]] found: one table per joint, from the base on, is expected.",
        )
    convention = table.get("convention", "standard")
    if convention not in ("standard", "modified"):
        read.say("convention", f'expected "standard" or "modified", found "{convention}"')
    pending, joints = np.eye(4), []
    if "base_mm" in table:  # frame 0 to where the first row starts: calibrated rows need it
        pending, _ = _form(read, "base_mm", {"transform_mm": table["base_mm"]}, False)
    for k, row in enumerate(rows, 1):
        place = f"joint {k}"
        read.keys(place, row, JOINT_KEYS)
        before, after = _form(read, place, row, convention == "modified")
        joints.append(_joint(read, place, row, pending @ before))
        pending = after
    end = pending
    if last is not None:
        if isinstance(last, Mapping):
            read.keys("last", last, JOINT_KEYS)
            before, after = _form(read, "last", last, convention == "modified")
            end = pending @ before @ after
        else:
            read.say("last", "expected a table [last]")
    gravity = None
    if "gravity" in table:
        g = read.numbers("gravity", table["gravity"], (3,))
        size = float(np.linalg.norm(g))
        if size >= 1e-9:
            gravity = (float(g[0] / size), float(g[1] / size), float(g[2] / size))
        else:
            read.say(
                "gravity", "the direction has no length; leave the key out where it is not known"
            )
    source = " ".join(str(table.get("source", "not stated")).split())
    robot = Robot(
        str(table.get("name", Path(where).stem)),
        source,
        tuple(joints),
        end,
        gravity,
        _usual(read, table),
    )
    try:
        check_robot_name(robot)
    except ValueError as error:
        read.problems.append(f"{where}: {error}.")
    if read.problems:
        raise StudyError(*read.problems)
    return robot


def check_robot_name(robot: Robot) -> None:
    """Raises ValueError where a robot's name or source cannot be one."""
    if (why := find_name_problem(robot.name)) is not None or (
        why := find_name_problem(robot.source or "none", MAX_TEXT_LENGTH)
    ) is not None:
        raise ValueError(
            f"the robot's {'source' if find_name_problem(robot.name) is None else 'name'} is not one: {why}"
        )


def read_robot(path: Path, base: str | None = None, tip: str | None = None) -> Robot:
    """A robot from a TOML or URDF file; of a URDF the chain between two links, where they are
    named. Raises StudyError."""
    if path.suffix.lower() in (".urdf", ".xml"):
        from .urdf import read_urdf

        return read_urdf(path, base, tip)
    if base is not None or tip is not None:
        raise StudyError(
            f"{path.name}: base and tip choose a chain of a URDF; a TOML robot file has one chain."
        )
    return robot_from_table(parse_toml(read_text(path, "the robot file"), path.name), path.name)


def builtin_names() -> list[str]:
    """Names of the built-in robots, sorted."""
    return sorted(
        entry.name.removesuffix(".toml")
        for entry in files("modelsel").joinpath("robot", "catalogue").iterdir()
        if entry.name.endswith(".toml")
    )


def load(name: str) -> Robot:
    """A built-in robot by name. Raises StudyError with a suggestion."""
    if name not in builtin_names():
        raise StudyError(f'unknown robot "{name}". {suggest(name, builtin_names())}')
    text = (
        files("modelsel")
        .joinpath("robot", "catalogue")
        .joinpath(f"{name}.toml")
        .read_text(encoding="utf-8")
    )
    return robot_from_table(parse_toml(text, f"{name}.toml"), f"{name}.toml")


ROTATION_TOLERANCE = 1e-6  # a stored rotation differs from one by less
ROTATION, TRANSFORM = Each(TRIPLE, 3), Each(Each(float, 4), 3)
JOINT = {
    "before_mm": TRANSFORM,
    "prismatic": bool,
    "limits": Maybe(PAIR),
    "mass_kg": Maybe(float),
    "com_mm": TRIPLE,
}


def robot_record(robot: Robot) -> dict[str, Any]:
    """The nominal robot in full."""
    return {
        "name": robot.name,
        "source": robot.source,
        "gravity": None if robot.gravity is None else list(robot.gravity),
        "usual": list(robot.usual),
        "joints": [
            {
                "before_mm": j.before[:3].tolist(),
                "prismatic": j.prismatic,
                "limits": None if j.limits is None else list(j.limits),
                "mass_kg": j.mass,
                "com_mm": list(j.com),
            }
            for j in robot.joints
        ],
        "last_mm": robot.last[:3].tolist(),
    }


def robot_from_record(record: Mapping[str, Any]) -> Robot:
    """The nominal robot of a record of its shape. Raises ValueError where a transform is not rigid,
    or a limit none."""
    joints = []
    for k, j in enumerate(record["joints"], 1):
        limits, (x, y, z) = j["limits"], bounded_array(j["com_mm"]).tolist()
        if (
            limits is not None
            and not -LARGEST < limits[0] < limits[1] < LARGEST
            or not 0 <= (j["mass_kg"] or 0) <= LARGEST
        ):
            raise ValueError(f"the limits or the mass of joint {k} are none")
        joints.append(
            Joint(
                rigid_transform(j["before_mm"]),
                j["prismatic"],
                None if limits is None else (float(limits[0]), float(limits[1])),
                None if j["mass_kg"] is None else float(j["mass_kg"]),
                (x, y, z),
            )
        )
    g = record["gravity"]
    if g is not None and abs(float(np.linalg.norm(g)) - 1) > ROTATION_TOLERANCE:
        raise ValueError("the direction of gravity is not of length one")
    return Robot(
        record["name"],
        record["source"],
        tuple(joints),
        rigid_transform(record["last_mm"]),
        None if g is None else (float(g[0]), float(g[1]), float(g[2])),
        _usual_pair(record.get("usual", Robot.usual)),
    )


def _usual_pair(pair: Sequence[float]) -> tuple[float, float]:
    if not all(0 < size < LARGEST for size in pair):
        raise ValueError("the robot's usual errors (mm, rad) must be above 0")
    return float(pair[0]), float(pair[1])


def rigid_transform(rows: Sequence[Sequence[float]]) -> Array:
    """The (4, 4) transform of its upper three rows [mm]. Raises ValueError."""
    upper = bounded_array(rows)
    return np.vstack([np.column_stack([check_rotation(upper[:, :3]), upper[:, 3]]), [0, 0, 0, 1]])


def check_rotation(rows: Array | Sequence[Sequence[float]]) -> Array:
    """A rotation (3, 3). Raises ValueError."""
    R = bounded_array(rows)
    if np.abs(R @ R.T - np.eye(3)).max() > ROTATION_TOLERANCE or np.linalg.det(R) < 0:
        raise ValueError(f"three columns are not a rotation: {R.round(6).tolist()}")
    return R


def bounded_array(value: Any) -> Array:
    """An array of lengths no arm or room exceeds. Raises ValueError."""
    out = np.array(value, dtype=float)
    if not (np.abs(out) <= LARGEST).all():
        raise ValueError(f"a length is beyond {LARGEST:g}")
    return out
