"""The parts of the errors that a study names, against its robot and its measurements."""

from __future__ import annotations

from .._part_names import JOINTS, is_named, list_joints
from ..config.study_file import Study
from ..config.study_tables import NoiseTable
from ..exceptions import StudyError
from ..fitting.possible_parts import MIN_GROUPS, MIN_LEVELS, list_parts
from ..notices import Note
from ..robot.kinematics import Robot
from ..selection.evaluation import Split

# what would tell a part that the data do not tell
WHAT_WOULD_TELL = {
    "configuration": "several targets at each configuration, or configurations measured again, would",
    "group": f"it takes {MIN_GROUPS} groups or more, of a few rows each",
    "lasting": "it takes configurations measured one after another, in the order of the rows",
}


def check_joints_of_parts(study: Study, robot: Robot) -> None:
    """Check that the robot has the joints that a study's parts name. Raises StudyError."""
    noise = study.noise
    listed = () if noise.parts == "all" else noise.parts
    tables = {
        "noise.parts": listed,
        "noise.fixed": noise.fixed,
        "simulate.parts": study.simulate.parts,
    }
    problems = [
        f'{place}: "{name}", but {robot.name} has {robot.n} joints.'
        for place, names in tables.items()
        for name, joint in list_joints(names).items()
        if joint > robot.n
    ]
    if problems:
        raise StudyError(*problems)


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
    if data.configurations < MIN_LEVELS:
        reason = f"it takes {MIN_LEVELS} configurations; {data.configurations} estimate"
    if not split.problem.only_points:
        reason = "rows that are no points tell none"
    return f'[noise] names "{name}", which these data cannot tell: {reason}. It is left out.'
