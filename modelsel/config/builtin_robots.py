"""Names of built-in robots in a study file."""

from __future__ import annotations

from ..exceptions import StudyError
from ..robot.files import find_builtin, is_robot_file


def check_builtin_name(name: str) -> str:
    """Check that a robot's name is known; a robot file's is looked for when it is read. Raises
    ValueError."""
    if is_robot_file(name):
        return name
    try:
        find_builtin(name)
    except StudyError as error:
        raise ValueError(str(error)) from None
    return name
