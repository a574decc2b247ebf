"""The parts of the errors that a study names, against its robot and its measurements."""

from __future__ import annotations

from ..._part_names import (
    ACROSS_LINE,
    ALONG_LINE,
    AT_TARGET,
    JOINTS,
    is_named,
    is_of_rows,
    list_joints,
    name_rows,
)
from ...config.study_file import Study
from ...config.study_tables import NoiseTable
from ...exceptions import StudyError, count_words
from ...fitting.possible_parts import (
    MAX_COMPARED,
    MAX_COMPARED_ROWS,
    MIN_COMPARED,
    MIN_GROUPS,
    MIN_LEVELS,
    list_parts,
)
from ...notices import Note
from ...robot.kinematics import Robot
from ...selection.evaluation import Split

# scales of fixed parts that no arm exceeds: of a joint that turns [rad], of what moves [of the reach],
# and that of the shortest arm [mm]
MAX_SCALE_RAD = 0.1
MAX_SCALE_SHARE = 0.1
MIN_LARGEST_MM = 10.0
# what would tell a part that the data do not tell
APART = "it takes an instrument that stands apart from the arm; tracker_mm says where it stands"
WHAT_WOULD_TELL = {
    ALONG_LINE: APART,
    ACROSS_LINE: APART,
    "configuration": "several targets at each configuration, or configurations measured again, would",
    "group": f"it takes {MIN_GROUPS} groups or more, of a few rows each",
    "lasting": "it takes configurations measured one after another, in the order of the rows",
}


def check_parts(study: Study, robot: Robot) -> None:
    """Check that the robot has the joints that a study's parts name, and that no arm is as bad as
    scales of parts that are fixed. Raises StudyError."""
    noise = study.noise
    listed = () if noise.parts == "all" else noise.parts
    tables = {
        "noise.parts": listed,
        "noise.fixed": noise.fixed,
        "simulate.parts": study.simulate.parts,
    }
    problems = [
        f'{place}: "{name}", but {robot.name} has {count_words(robot.n, "joint")}.'
        for place, names in tables.items()
        for name, joint in list_joints(names).items()
        if joint > robot.n
    ]
    if not problems:
        problems = _list_absurd_scales(noise, robot)
    if problems:
        raise StudyError(*problems)


def _list_absurd_scales(noise: NoiseTable, robot: Robot) -> list[str]:
    """List the problems with scales of fixed parts that no arm has, with the unit that is
    expected."""
    largest_mm = max(MAX_SCALE_SHARE * robot.reach, MIN_LARGEST_MM)
    joints = list_joints(noise.fixed)
    problems = []
    for name, scale in noise.fixed.items():
        joint = joints.get(name)
        unit = "mm" if joint is None else robot.unit(joint)
        largest = MAX_SCALE_RAD if unit == "rad" else largest_mm
        if scale > largest:
            problems.append(
                f'noise.fixed: "{name}" = {scale:.6g} is more than {largest:.3g} {unit}, which no arm '
                f"has; give its standard deviation in {unit}."
            )
    return problems


def note_untold_parts(noise: NoiseTable, split: Split) -> tuple[Note, ...]:
    """Note the parts that the study names and these data cannot tell."""
    listed = () if noise.parts == "all" else noise.parts
    named = dict.fromkeys((*listed, *noise.fixed))
    if not named:
        return ()
    parts = list_parts(split.problem, split.estimation)
    told = [part.name for part in parts]
    notes = []
    for name in named:
        if any(is_named(part, [name]) for part in told):
            continue
        sentence = _describe_untold(name, split)
        notes.append(Note("part-untold", sentence))
    return tuple(notes)


def _describe_untold(name: str, split: Split) -> str:
    data = split.problem.data.take(split.estimation)
    reason = WHAT_WOULD_TELL.get(name, "it does not move the target")
    if name == JOINTS:
        reason = "none moves the target"
    if is_of_rows(name):
        reason = _describe_untold_rows(name, split)
    if data.configurations < MIN_LEVELS:
        reason = f"it takes {MIN_LEVELS} configurations; {data.configurations} estimate"
    if not split.problem.only_points:
        reason = "rows that are not points tell none"
    return f'[noise] names "{name}", which these data cannot tell: {reason}. It is left out.'


def _describe_untold_rows(name: str, split: Split) -> str:
    """Describe what it takes to tell more noise at one target, or in one group."""
    what, plural, unit, there = "group", "groups", "configurations", split.problem.data.groups
    if name.startswith(AT_TARGET):
        what, plural, unit, there = "target", "targets", "rows", split.problem.data.targets
    if name_rows(name) not in there:
        return f"there is no such {what}"
    return (
        f"it takes {MIN_COMPARED} estimating {unit} of that {what}, as many of others, no more than "
        f"{MAX_COMPARED} {plural}, and fewer than {MAX_COMPARED_ROWS:,} rows"
    )
