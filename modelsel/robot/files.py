"""Robot TOML files -> Robot: 3x4 transforms, URDF-like origins, standard and modified DH rows, in
any mixture."""

from __future__ import annotations

from collections.abc import Mapping
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np

from .._arguments import check_path
from .._foreign_files import FOREIGN, describe_foreign_robot, describe_no_robot
from .._text import parse_toml, read_text
from .._typing import Array
from ..exceptions import StudyError
from .coupling import Coupling, find_coupling_problem, find_passive_problem
from .kinematics import Joint, Robot
from .plain_values import check_reach, check_robot_name
from .rigid import align_z, from_rpy, inverse, rotation_matrix, transform
from .robot_names import find_full_name, find_robot_name, has_robot_name, suggest_robots
from .ur_kinematics import YAML_SUFFIXES, read_ur_calibration
from .value_reader import Reader
from .xacro_files import XACRO_SUFFIX, is_xacro, refuse_xacro

ROBOT_EXPECTED = "a built-in robot's name or the path of a robot file"
ROBOT_SUFFIXES = (".toml", ".urdf", ".xml", XACRO_SUFFIX, *YAML_SUFFIXES)
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
# where payloads hang in the flange's frame
PAYLOAD_AT = "payload_at_mm"
TOP_KEYS = {
    "name",
    "source",
    "gravity",
    PAYLOAD_AT,
    "convention",
    "base_mm",
    "joint",
    "last",
    "usual_mm",
    "usual_mrad",
    "coupling",
    "passive",
}
# the last one in Hayati's rows
DH_KEYS = ("theta_deg", "d_mm", "a_mm", "alpha_deg", "beta_deg")
JOINT_KINDS = ("revolute", "prismatic")
DH_CONVENTIONS = ("standard", "modified")
# entries of R Rᵀ of a rotation in a file differ from the identity's by less
ROTATION_TOLERANCE = 1e-6


def _read_transform(
    read: Reader, place: str, row: Mapping[str, Any], modified: bool
) -> tuple[Array, Array]:
    """Return (transform before the joint, what is left for the next row) of one joint or of
    [last]."""
    given = [form for form in JOINT_FORMS if form in row]
    if len(given) != 1:
        forms = ", ".join(JOINT_FORMS)
        problem = f"give exactly one of {forms}"
        if given:
            found = " and ".join(given)
            problem += f", not {found}"
        read.report(place, problem)
        return np.eye(4), np.eye(4)
    form = given[0]
    if form == "transform_mm":
        matrix = row["transform_mm"]
        before = _read_matrix(read, f"{place}.transform_mm", matrix)
        return before, np.eye(4)
    if form == "xyz_mm":
        return _read_origin(read, place, row)
    numbers = row["dh"]
    return _read_dh(read, f"{place}.dh", numbers, modified)


def _read_matrix(read: Reader, place: str, value: Any) -> Array:
    """Return the transform (4, 4) of its upper three rows."""
    N = read.array(place, value, shape=(3, 4))
    R = N[:, :3]
    deviates = False
    if N.any():
        deviation = R @ R.T - np.eye(3)
        largest = np.abs(deviation).max()
        deviates = largest > ROTATION_TOLERANCE
    if deviates or np.linalg.det(R) < 0:
        read.report(place, "its first three columns are not a rotation")
    offset = N[:, 3]
    return transform(R, offset)


def _read_origin(read: Reader, place: str, row: Mapping[str, Any]) -> tuple[Array, Array]:
    """Return the transforms before and after a joint given as in a URDF: xyz, rpy, axis."""
    rpy = read.array(f"{place}.rpy_deg", row.get("rpy_deg", (0, 0, 0)), shape=(3,))
    offset = read.array(f"{place}.xyz_mm", row["xyz_mm"], shape=(3,))
    axis = read.direction(
        f"{place}.axis", row.get("axis", (0, 0, 1)), problem="the axis has no length"
    )
    to_axis = np.eye(4)
    if axis is not None:
        to_axis = transform(align_z(axis))
    roll, pitch, yaw = np.radians(rpy)
    R = from_rpy(roll, pitch, yaw)
    before = transform(R, offset) @ to_axis
    return before, inverse(to_axis)


def _read_dh(read: Reader, place: str, row: Any, modified: bool) -> tuple[Array, Array]:
    """Return the transforms before and after a joint given as a row of DH parameters."""
    if not isinstance(row, Mapping):
        read.report(place, "expected { theta_deg = …, d_mm = …, a_mm = …, alpha_deg = … }")
        return np.eye(4), np.eye(4)
    read.check_keys(place, row, set(DH_KEYS))
    values = []
    for key in DH_KEYS:
        value = read.number(f"{place}.{key}", row.get(key, 0))
        values.append(value)
    theta, d, a, alpha, beta = values
    R_theta = rotation_matrix(2, np.radians(theta))
    R_alpha = rotation_matrix(0, np.radians(alpha))
    R_beta = rotation_matrix(1, np.radians(beta))
    Rz = transform(R_theta)
    link = transform(R_alpha @ R_beta, (a, 0, 0))
    Tz = transform(t=(0, 0, d))
    if modified:
        before = link @ Tz @ Rz
        return before, np.eye(4)
    after = Tz @ link
    return Rz, after


def _read_joint(read: Reader, place: str, row: Mapping[str, Any], before: Array) -> Joint:
    kind = read.word(f"{place}.kind", row.get("kind", "revolute"), JOINT_KINDS)
    prismatic = kind == "prismatic"
    limits = _read_limits(read, place, row, prismatic)
    mass = None
    if "mass_kg" in row:
        mass = read.number(f"{place}.mass_kg", row["mass_kg"])
        if mass < 0:
            read.report(f"{place}.mass_kg", "expected a mass, 0 or above")
    elif "com_mm" in row:
        read.report(f"{place}.com_mm", "a centre of mass needs the link's mass_kg beside it")
    com = read.vector(f"{place}.com_mm", row.get("com_mm", (0, 0, 0)))
    return Joint(before, prismatic, limits, mass, com)


def _read_limits(
    read: Reader, place: str, row: Mapping[str, Any], prismatic: bool
) -> tuple[float, float] | None:
    key, other, scale = "limits_deg", "limits_mm", np.pi / 180
    if prismatic:
        key, other, scale = "limits_mm", "limits_deg", 1
    if other in row:
        motion = "slides" if prismatic else "turns"
        read.report(f"{place}.{other}", f"the joint {motion}: its limits are {key}")
    if key not in row:
        return None
    limits = read.array(f"{place}.{key}", row[key], shape=(2,))
    low, high = limits * scale
    if not low < high:
        read.report(f"{place}.{key}", "the lower limit must be below the upper one")
    return float(low), float(high)


def _read_usual(read: Reader, table: Mapping[str, Any]) -> tuple[float, float]:
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


def _read_coupling(
    read: Reader, table: Mapping[str, Any], joints: tuple[Joint, ...]
) -> Coupling | None:
    """Return how the motors move the joints, None where the file does not say: each its own."""
    if "coupling" not in table:
        if "passive" in table:
            read.report("passive", "it names motors of a coupling, and there is none")
        return None
    count = len(joints)
    found = len(read.problems)
    matrix = read.array("coupling", table["coupling"], shape=(count, count))
    if len(read.problems) > found:
        return None
    problem = find_coupling_problem(matrix, tuple(joint.prismatic for joint in joints))
    if problem is not None:
        read.report("coupling", problem)
        return None
    passive = table.get("passive", [])
    problem = find_passive_problem(passive, count)
    if problem is not None:
        read.report("passive", problem)
        return None
    return Coupling(matrix, tuple(passive))


def _read_gravity(read: Reader, table: Mapping[str, Any]) -> tuple[float, float, float] | None:
    if "gravity" not in table:
        return None
    remedy = "the direction has no length; leave the key out where it is not known"
    g = read.direction("gravity", table["gravity"], remedy)
    if g is None:
        return None
    x, y, z = (g / float(np.linalg.norm(g))).tolist()
    return x, y, z


def _read_chain(
    read: Reader, table: Mapping[str, Any], rows: list[Mapping[str, Any]]
) -> tuple[tuple[Joint, ...], Array]:
    """Return the joints and the transform (4, 4) from the last of them to the flange."""
    convention = table.get("convention", "standard")
    word = read.word("convention", convention, DH_CONVENTIONS)
    modified = word == "modified"
    pending = np.eye(4)
    # frame 0 to where the first row starts: calibrated rows need it
    if "base_mm" in table:
        pending = _read_matrix(read, "base_mm.transform_mm", table["base_mm"])
    joints = []
    for k, row in enumerate(rows, 1):
        place = f"joint {k}"
        read.check_keys(place, row, JOINT_KEYS)
        before, after = _read_transform(read, place, row, modified)
        to_joint = pending @ before
        joint = _read_joint(read, place, row, to_joint)
        joints.append(joint)
        pending = after
    last = table.get("last")
    if last is None:
        return tuple(joints), pending
    if not isinstance(last, Mapping):
        read.report("last", "expected a table [last]")
        return tuple(joints), pending
    read.check_keys("last", last, JOINT_KEYS)
    before, after = _read_transform(read, "last", last, modified)
    to_flange = pending @ before @ after
    return tuple(joints), to_flange


def robot_from_table(table: Mapping[str, Any], where: str) -> Robot:
    """Build the robot that a TOML table describes. Raises StudyError with every problem, each with
    its place in `where`."""
    read = Reader(where)
    read.check_keys("robot file", table, TOP_KEYS)
    rows = table.get("joint")
    if not isinstance(rows, list) or not rows or not all(isinstance(row, Mapping) for row in rows):
        raise StudyError(
            *read.problems,
            f"{where}: no [[joint]] found: one table per joint, from the base on, is expected.",
        )
    name = str(table.get("name", Path(where).stem))
    source = str(table.get("source", "not stated"))
    joints, last = _read_chain(read, table, rows)
    robot = Robot(
        name,
        " ".join(source.split()),
        joints,
        last,
        gravity=_read_gravity(read, table),
        usual=_read_usual(read, table),
        coupling=_read_coupling(read, table, joints),
        payload_at_mm=read.vector(PAYLOAD_AT, table[PAYLOAD_AT]) if PAYLOAD_AT in table else None,
    )
    try:
        check_robot_name(robot)
    except ValueError as error:
        read.problems.append(f"{where}: {error}.")
    if read.problems:
        raise StudyError(*read.problems)
    check_reach(robot, "mm", where)
    return robot


def read_robot(path: Path, base: str | None = None, tip: str | None = None) -> Robot:
    """Read a robot from a TOML or URDF file, or the YAML file of ur_calibration; of a URDF the chain
    between two links, where they are named. Raises StudyError."""
    foreign = describe_foreign_robot(path)
    if foreign is not None:
        raise StudyError(foreign)
    if path.suffix.lower() in (".urdf", ".xml"):
        from .urdf import read_urdf

        return read_urdf(path, base, tip)
    if is_xacro(path):
        raise refuse_xacro(path)
    if base is not None or tip is not None:
        raise StudyError(
            f"{path.name}: base and tip choose a chain of a URDF; other robot files have one chain."
        )
    if path.suffix.lower() in YAML_SUFFIXES:
        return read_ur_calibration(path)
    return robot_from_table(parse_toml(read_text(path, "the robot file"), path.name), path.name)


def builtin_names() -> list[str]:
    """List the names of the built-in robots, sorted."""
    catalogue = files("modelsel").joinpath("robot", "catalogue")
    names = []
    for entry in catalogue.iterdir():
        name = entry.name
        if name.endswith(".toml"):
            names.append(name.removesuffix(".toml"))
    return sorted(names)


def list_full_names() -> dict[str, str]:
    """List what the built-in robots are called in full, by their names: what stands before the
    colon of their source, where it holds the name."""
    catalogue = files("modelsel").joinpath("robot", "catalogue")
    found = {}
    for name in builtin_names():
        file = f"{name}.toml"
        text = catalogue.joinpath(file).read_text(encoding="utf-8")
        table = parse_toml(text, file)
        source = str(table.get("source", ""))
        full, colon, _ = source.partition(":")
        is_full_name = has_robot_name(full, name)
        if colon and is_full_name:
            found[name] = full
    return found


def is_robot_file(source: str) -> bool:
    """Whether a name is that of a robot file, by its suffix; also of one that is not read."""
    suffix = Path(source).suffix.lower()
    return suffix in ROBOT_SUFFIXES or suffix in FOREIGN


def load_robot(source: str | Path) -> Robot:
    """Load a nominal robot: a built-in one by its name, however it is spelled, or a robot file
    (TOML, URDF) by its path.

    A name with a suffix (.toml, .urdf, .xml, .yaml) is a path. Raises StudyError for an unknown name, with
    suggestions, and for a file that cannot be read, with the place."""
    path = check_path(source, ROBOT_EXPECTED)
    if not isinstance(source, str) or is_robot_file(source):
        return read_robot(path)
    other = describe_no_robot(path) if source else None
    if other is not None and find_any_builtin(source) is None:
        raise StudyError(other)
    name = find_builtin(source)
    file = f"{name}.toml"
    text = files("modelsel").joinpath("robot", "catalogue", file).read_text(encoding="utf-8")
    return robot_from_table(parse_toml(text, file), file)


def as_robot(robot: Robot | str | Path) -> Robot:
    """Return a robot as it is; load the one that a name or a path means. Raises StudyError."""
    if isinstance(robot, Robot):
        return robot
    return load_robot(robot)


def find_any_builtin(given: str) -> str | None:
    """Find the built-in robot that a name means; None where it means none."""
    name = find_robot_name(given, builtin_names())
    if name is not None:
        return name
    full_names = list_full_names()
    return find_full_name(given, full_names)


def find_builtin(given: str) -> str:
    """Find the built-in robot that a name means, however it is spelled. Raises StudyError, with
    suggestions."""
    name = find_any_builtin(given)
    if name is None:
        raise StudyError(f'unknown robot "{given}". {suggest_robots(given, builtin_names())}')
    return name
