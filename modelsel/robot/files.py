"""Robot TOML files -> Robot: 3x4 transforms, URDF-like origins, standard and modified DH rows, in
any mixture."""

from __future__ import annotations

from collections.abc import Mapping
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np

from .._text import parse_toml, read_text
from .._typing import LARGEST, Array
from ..exceptions import StudyError, suggest
from .kinematics import Joint, Robot
from .plain_values import check_robot_name
from .rigid import align_z, from_rpy, inverse, rotation_matrix, transform

# the forms of a fixed transform, one of which every joint has
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
DH_KEYS = ("theta_deg", "d_mm", "a_mm", "alpha_deg")
JOINT_KINDS = ("revolute", "prismatic")
DH_CONVENTIONS = ("standard", "modified")
# a direction shorter than this has no length
MIN_DIRECTION = 1e-9
# entries of R Rᵀ of a rotation in a file differ from the identity's by less
ROTATION_TOLERANCE = 1e-6


class _Reader:
    """Reads values of one file and collects every problem, so that all are said at once."""

    def __init__(self, where: str):
        self.where = where
        self.problems: list[str] = []

    def report(self, place: str, problem: str) -> None:
        """Note a problem at a place of the file."""
        stop = "" if problem.endswith((".", "?")) else "."
        self.problems.append(f"{self.where}: {place}: {problem}{stop}")

    def check_keys(self, place: str, table: Mapping[str, Any], known: set[str]) -> None:
        """Note the keys of a table that are not known."""
        for key in table:
            if key not in known:
                self.report(place, f'unknown key "{key}". {suggest(key, known)}')

    def word(self, place: str, value: Any, choices: tuple[str, str]) -> str:
        """Return one of two words; the first, and a problem noted, for any other value."""
        if value in choices:
            return str(value)
        self.report(place, f'expected "{choices[0]}" or "{choices[1]}", found "{value}"')
        return choices[0]

    def array(self, place: str, value: Any, shape: tuple[int, ...]) -> Array:
        """Return a finite array of the wanted shape; zeros, and a problem noted, for any other
        value."""
        try:
            array = np.array(value, dtype=float)
        except (TypeError, ValueError, OverflowError):
            array = np.array(np.nan)
        is_numeric = not isinstance(value, (bool, str))
        if is_numeric and array.shape == shape and (np.abs(array) <= LARGEST).all():
            return array
        expected = "one finite number"
        if shape:
            expected = f"{' x '.join(map(str, shape))} finite numbers"
        if array.shape == shape and np.isfinite(array).all():
            expected += f" below {LARGEST:g}"
        self.report(place, f"expected {expected}, found {str(value)[:120]}")
        return np.zeros(shape)

    def number(self, place: str, value: Any) -> float:
        """Return a finite number; 0, and a problem noted, for any other value."""
        return float(self.array(place, value, ()))

    def vector(self, place: str, value: Any) -> tuple[float, float, float]:
        """Return three finite numbers; zeros, and a problem noted, for any other value."""
        x, y, z = self.array(place, value, (3,)).tolist()
        return x, y, z

    def direction(self, place: str, value: Any, problem: str) -> Array | None:
        """Return a vector; None, and the problem noted, where it has no length."""
        direction = self.array(place, value, (3,))
        if np.linalg.norm(direction) >= MIN_DIRECTION:
            return direction
        self.report(place, problem)
        return None


def _read_transform(
    read: _Reader, place: str, row: Mapping[str, Any], modified: bool
) -> tuple[Array, Array]:
    """Return (transform before the joint, what is left for the next row) of one joint or of
    [last]."""
    given = [form for form in JOINT_FORMS if form in row]
    if len(given) != 1:
        contrast = f", not {' and '.join(given)}" if given else ""
        read.report(place, f"give exactly one of {', '.join(JOINT_FORMS)}{contrast}")
        return np.eye(4), np.eye(4)
    if given == ["transform_mm"]:
        return _read_matrix(read, f"{place}.transform_mm", row["transform_mm"]), np.eye(4)
    if given == ["xyz_mm"]:
        return _read_origin(read, place, row)
    return _read_dh(read, f"{place}.dh", row["dh"], modified)


def _read_matrix(read: _Reader, place: str, value: Any) -> Array:
    """Return the transform (4, 4) of its upper three rows."""
    N = read.array(place, value, (3, 4))
    R = N[:, :3]
    deviates = N.any() and np.abs(R @ R.T - np.eye(3)).max() > ROTATION_TOLERANCE
    if deviates or np.linalg.det(R) < 0:
        read.report(place, "its first three columns are not a rotation")
    return transform(R, N[:, 3])


def _read_origin(read: _Reader, place: str, row: Mapping[str, Any]) -> tuple[Array, Array]:
    """Return the transforms before and after a joint given as in a URDF: xyz, rpy, axis."""
    angles = np.radians(read.array(f"{place}.rpy_deg", row.get("rpy_deg", (0, 0, 0)), (3,)))
    offset = read.array(f"{place}.xyz_mm", row["xyz_mm"], (3,))
    axis = read.direction(f"{place}.axis", row.get("axis", (0, 0, 1)), "the axis has no length")
    to_axis = transform(None if axis is None else align_z(axis))
    return transform(from_rpy(*angles), offset) @ to_axis, inverse(to_axis)


def _read_dh(read: _Reader, place: str, row: Any, modified: bool) -> tuple[Array, Array]:
    """Return the transforms before and after a joint given as a row of DH parameters."""
    if not isinstance(row, Mapping):
        read.report(place, "expected { theta_deg = …, d_mm = …, a_mm = …, alpha_deg = … }")
        return np.eye(4), np.eye(4)
    read.check_keys(place, row, set(DH_KEYS))
    theta, d, a, alpha = (read.number(f"{place}.{key}", row.get(key, 0)) for key in DH_KEYS)
    Rz = transform(rotation_matrix(2, np.radians(theta)))
    Rx = transform(rotation_matrix(0, np.radians(alpha)))
    Tz, Tx = transform(t=(0, 0, d)), transform(t=(a, 0, 0))
    if modified:
        return Rx @ Tx @ Tz @ Rz, np.eye(4)
    return Rz, Tz @ Tx @ Rx


def _read_joint(read: _Reader, place: str, row: Mapping[str, Any], before: Array) -> Joint:
    kind = read.word(f"{place}.kind", row.get("kind", "revolute"), JOINT_KINDS)
    prismatic = kind == "prismatic"
    limits = _read_limits(read, place, row, prismatic)
    mass = read.number(f"{place}.mass_kg", row["mass_kg"]) if "mass_kg" in row else None
    com = read.vector(f"{place}.com_mm", row.get("com_mm", (0, 0, 0)))
    return Joint(before, prismatic, limits, mass, com)


def _read_limits(
    read: _Reader, place: str, row: Mapping[str, Any], prismatic: bool
) -> tuple[float, float] | None:
    key, scale = ("limits_mm", 1) if prismatic else ("limits_deg", np.pi / 180)
    if key not in row:
        return None
    low, high = read.array(f"{place}.{key}", row[key], (2,)) * scale
    if not low < high:
        read.report(f"{place}.{key}", "the lower limit must be below the upper one")
    return float(low), float(high)


def _read_usual(read: _Reader, table: Mapping[str, Any]) -> tuple[float, float]:
    """Return the usual size of such an arm's errors: (mm, rad)."""
    sizes = []
    for key in ("usual_mm", "usual_mrad"):
        size = read.number(key, table.get(key, 1.0))
        sizes.append(size)
        if not size > 0:
            read.report(
                key,
                "expected a number above 0: the standard deviation of the arm's parameters "
                "about its drawing",
            )
    return sizes[0], sizes[1] * 1e-3


def _read_gravity(read: _Reader, table: Mapping[str, Any]) -> tuple[float, float, float] | None:
    if "gravity" not in table:
        return None
    remedy = "the direction has no length; leave the key out where it is not known"
    g = read.direction("gravity", table["gravity"], remedy)
    if g is None:
        return None
    x, y, z = (g / float(np.linalg.norm(g))).tolist()
    return x, y, z


def _read_chain(
    read: _Reader, table: Mapping[str, Any], rows: list[Mapping[str, Any]]
) -> tuple[tuple[Joint, ...], Array]:
    """Return the joints and the transform (4, 4) from the last of them to the flange."""
    convention = table.get("convention", "standard")
    modified = read.word("convention", convention, DH_CONVENTIONS) == "modified"
    pending = np.eye(4)
    if "base_mm" in table:  # frame 0 to where the first row starts: calibrated rows need it
        pending = _read_matrix(read, "base_mm.transform_mm", table["base_mm"])
    joints = []
    for k, row in enumerate(rows, 1):
        place = f"joint {k}"
        read.check_keys(place, row, JOINT_KEYS)
        before, after = _read_transform(read, place, row, modified)
        joints.append(_read_joint(read, place, row, pending @ before))
        pending = after
    last = table.get("last")
    if last is None:
        return tuple(joints), pending
    if not isinstance(last, Mapping):
        read.report("last", "expected a table [last]")
        return tuple(joints), pending
    read.check_keys("last", last, JOINT_KEYS)
    before, after = _read_transform(read, "last", last, modified)
    return tuple(joints), pending @ before @ after


def robot_from_table(table: Mapping[str, Any], where: str) -> Robot:
    """Build the robot that a TOML table describes. Raises StudyError with every problem, each with
    its place in `where`."""
    read = _Reader(where)
    read.check_keys("robot file", table, TOP_KEYS)
    rows = table.get("joint")
    if not isinstance(rows, list) or not rows or not all(isinstance(row, Mapping) for row in rows):
        raise StudyError(
            *read.problems,
            f"{where}: no [[joint]] found: one table per joint, from the base on, is expected.",
        )
    name = str(table.get("name", Path(where).stem))
    source = " ".join(str(table.get("source", "not stated")).split())
    joints, last = _read_chain(read, table, rows)
    gravity = _read_gravity(read, table)
    robot = Robot(name, source, joints, last, gravity, _read_usual(read, table))
    try:
        check_robot_name(robot)
    except ValueError as error:
        read.problems.append(f"{where}: {error}.")
    if read.problems:
        raise StudyError(*read.problems)
    return robot


def read_robot(path: Path, base: str | None = None, tip: str | None = None) -> Robot:
    """Read a robot from a TOML or URDF file; of a URDF the chain between two links, where they are
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
    """List the names of the built-in robots, sorted."""
    entries = files("modelsel").joinpath("robot", "catalogue").iterdir()
    names = [entry.name for entry in entries]
    return sorted(name.removesuffix(".toml") for name in names if name.endswith(".toml"))


def load(name: str) -> Robot:
    """Load a built-in robot by name. Raises StudyError with a suggestion."""
    if name not in builtin_names():
        raise StudyError(f'unknown robot "{name}". {suggest(name, builtin_names())}')
    file = f"{name}.toml"
    text = files("modelsel").joinpath("robot", "catalogue", file).read_text(encoding="utf-8")
    return robot_from_table(parse_toml(text, file), file)


def load_robot(source: str | Path) -> Robot:
    """Load a nominal robot: a built-in one by its name, or a robot file (TOML, URDF) by its path.

    A name with a suffix (.toml, .urdf, .xml) is a path. Raises StudyError for an unknown name, with
    a suggestion, and for a file that cannot be read, with the place."""
    path = Path(source)
    if isinstance(source, Path) or path.suffix.lower() in (".toml", ".urdf", ".xml"):
        return read_robot(path)
    return load(source)
