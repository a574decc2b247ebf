"""Export as a kinematic chain: URDF and DH tables, refitted to what the form can carry."""

from __future__ import annotations

import tomllib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from ..._typing import Array
from ...exceptions import StudyError
from ...fitting.problem import Problem
from ...robot.alignment import align_chains
from ...robot.dh import DhForm, DhRows, compute_dh_rows, dh_table, format_robot_table
from ...robot.files import robot_from_table
from ...robot.kinematics import Robot, UrdfSource, forward
from ...robot.rigid import inverse, to_rpy, transform
from ...robot.urdf import read_urdf_text
from ...robot.urdf_origins import replace_origins
from ...robot.urdf_writer import write_urdf
from ..constant_part import ConstantChain, build_constant_chain, compute_points, split_parts
from .dh_rows import compare_rows, fold_last, round_rows
from .dh_signs import turn_frames
from .form import Exported, measure_export

if TYPE_CHECKING:
    from ..calibration import Calibration

OWN_NAMES = (
    "joints and links have names of modelsel's own; `--urdf FILE` writes the calibration into your "
    "own URDF of this arm"
)


def measure_chain(
    c: Calibration,
    text: str,
    read: Callable[[str, int], Callable[[Array], Array]],
    notes: tuple[str, ...],
) -> Exported:
    """Measure an exported chain: `read` gives, of the file's text, the target's position in frame 0
    at joint readings."""

    def compute_difference(target: int, at: Problem) -> Array:
        constant, _ = split_parts(c, target)
        predict = read(text, target)
        intended = compute_points(at, constant)
        return predict(at.data.q) - intended

    return measure_export(c, text, compute_difference, notes)


def to_urdf(c: Calibration, notes: Sequence[str] = ()) -> Exported:
    """Write the calibrated chain as a URDF: the one that the robot was read from, with other
    origins; where there is none a new one, with targets on the flange and the tracker on the
    base."""
    if c.robot.urdf is not None:
        return rewrite_urdf(c, c.robot.urdf)
    made = build_constant_chain(c)
    links = _name_links(c.targets)
    tips = {}
    for name, place in made.targets.items():
        tips[links[name]] = place
    R = c.placement[0][0]
    t = c.placement[1][0]
    trackers = {}
    if c.registered:
        trackers["tracker"] = inverse(transform(R, t))
    robot, bounded = _bound_slides(made.robot, c.ranges)
    text = write_urdf(robot, tips, trackers, [made.robot.source, *notes, *bounded])

    def read(text: str, target: int) -> Callable[[Array], Array]:
        link = links[c.targets[target]]
        back = read_urdf_text(text, "the export", "base", link)
        origin = np.zeros(3)
        return lambda q: forward(back, q, origin)

    return measure_chain(c, text, read, (*bounded, OWN_NAMES))


def rewrite_urdf(c: Calibration, source: UrdfSource) -> Exported:
    """Write the calibrated chain into the origins of a URDF, all else as it stands there. Raises
    StudyError where it is the URDF of another arm."""
    made = build_constant_chain(c)
    nominal = read_urdf_text(source.text, "the URDF", source.base, source.tip)
    try:
        alignment = align_chains(c.robot, nominal)
    except ValueError as error:
        raise StudyError(
            f'the URDF\'s chain from "{source.base}" to "{source.tip}" is not the calibrated '
            f"arm's: {error}. Give the URDF of this arm, or name its chain with --base and --tip."
        ) from None
    before = [joint.before for joint in made.robot.joints]
    text = replace_origins(source, alignment.express(before))
    to_tip = inverse(alignment.frames[-1] @ nominal.last) @ made.robot.last
    places = {name: to_tip @ place for name, place in made.targets.items()}
    from_base = inverse(alignment.base)

    def read(text: str, target: int) -> Callable[[Array], Array]:
        back = read_urdf_text(text, "the export", source.base, source.tip)
        name = c.targets[target]
        offset = places[name][:3, 3]
        R = from_base[:3, :3]
        t = from_base[:3, 3]
        return lambda q: forward(back, q, offset) @ R.T + t

    notes = _describe_rewritten(source, places, alignment.base)
    return measure_chain(c, text, read, notes)


def _describe_rewritten(
    source: UrdfSource, places: Mapping[str, Array], base: Array
) -> tuple[str, ...]:
    """Describe what the URDF itself does not say: which joints are new, where targets and frame 0
    are."""
    said = (
        f'the file differs from the robot\'s own URDF in the origins of the joints from "{source.base}" '
        f'to "{source.tip}" alone; meshes and masses move along with their links'
    )
    return said, *describe_link_places(source.base, source.tip, places, base)


def describe_link_places(
    base_link: str, tip_link: str, places: Mapping[str, Array], base: Array
) -> list[str]:
    """Describe where targets stand in the last link, and frame 0 of the calibration in the first,
    unless they are one; poses (4, 4), mm."""
    notes = []
    for name, place in places.items():
        position = _write_lengths(place[:3, 3])
        notes.append(f'target "{name}" in link "{tip_link}": x, y, z = {position} mm')
    if not np.array_equal(base, np.eye(4)):
        position = _write_lengths(base[:3, 3])
        angles = ", ".join(f"{angle:.9f}" for angle in np.degrees(to_rpy(base[:3, :3])))
        notes.append(
            f'frame 0 of the calibration in link "{base_link}": x, y, z = {position} mm; '
            f"roll, pitch, yaw = {angles} deg"
        )
    return notes


def _write_lengths(values: Array) -> str:
    """Write lengths [mm] so that a chain which is put together from them is off by less than 1e-9 mm."""
    return ", ".join(f"{value:.10f}" for value in values)


def _bound_slides(
    robot: Robot, ranges: Mapping[str, tuple[float, float]]
) -> tuple[Robot, tuple[str, ...]]:
    """Give every slide the limits that a URDF wants: where the robot file has none, those of the
    readings. Returns the robot and the notes on it."""
    bounded = []
    joints = []
    for j, joint in enumerate(robot.joints, 1):
        if joint.prismatic and joint.limits is None:
            limits = ranges[f"q{j}"]
            joints.append(replace(joint, limits=limits))
            bounded.append(j)
        else:
            joints.append(joint)
    notes = [
        f"joint {j} slides, and a URDF wants its limits: they are those of the readings the calibration has seen"
        for j in bounded
    ]
    return replace(robot, joints=tuple(joints)), tuple(notes)


def _name_links(targets: Sequence[str]) -> dict[str, str]:
    """Name every target's link: as the target, unless a link of the arm or another target's has
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
    taken = ("world", "base", "flange", "tracker")
    if name in taken:
        return True
    return name.startswith("link")


def _describe_parallel(rows: DhRows, form: DhForm) -> list[str]:
    """Describe what the rows of nearly parallel axes hold."""
    pairs = [f"joints {a} and {b} are almost parallel" for a, b in rows.nearly]
    if form == "hayati":
        of_rows = zip(pairs, rows.nearly, strict=True)
        return [f"{words}: row {a} has the angle beta, and no d" for words, (a, _) in of_rows]
    if not pairs:
        return []
    largest = max(abs(row.d) for row in rows.rows) / 1e3
    sentence = (
        f"{' and '.join(pairs)}: their common normal is far away, so that rows have a d of up to "
        f"{largest:,.0f} m, which are accurate only with all their digits; the form hayati has a second "
        "angle in its place, and numbers near the drawing's"
    )
    return [sentence]


def to_dh(c: Calibration, form: DhForm, notes: Sequence[str]) -> Exported:
    """Write the calibrated chain as standard or modified DH rows, or with Hayati's between nearly
    parallel axes; targets in the notes."""
    made = build_constant_chain(c)
    rows = compute_dh_rows(made.robot, form)
    nearly = _describe_parallel(rows, form)
    where = []
    for name, T in made.targets.items():
        numbers = _write_lengths(T[:3, 3])
        where.append(f'target "{name}" on the flange: x, y, z = {numbers} mm')
    nominal = dh_table(c.robot, form)
    near = turn_frames(nominal, dh_table(made.robot, form))
    table = round_rows(fold_last(near))
    compared = compare_rows(fold_last(nominal), table)
    text = format_robot_table(table, [*notes, *where, *nearly, *compared])

    def read(text: str, target: int) -> Callable[[Array], Array]:
        record = tomllib.loads(text)
        back = robot_from_table(record, "the export")
        name = c.targets[target]
        offset = _target_offset(made, name)
        return lambda q: forward(back, q, offset)

    made_file = measure_chain(c, text, read, (*where, *nearly))
    return replace(made_file, table=compared)


def _target_offset(made: ConstantChain, target: str) -> Array:
    place = made.targets[target]
    offset: Array = place[:3, 3]
    return offset
