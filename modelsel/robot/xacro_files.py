"""URDFs that are written in xacro: expanded by ROS' own program, where it is installed.

A xacro file is a program: it evaluates expressions and reads other files. So it is expanded only
where a user names it on the command line, in a process of its own, never for a study file."""

from __future__ import annotations

import shutil
import sys
from collections.abc import Mapping
from importlib.util import find_spec
from pathlib import Path

from .._text import find_read_problem
from ..exceptions import StudyError

XACRO_SUFFIX = ".xacro"
# seconds
MAX_SECONDS = 60.0
MAX_MESSAGE = 300
BY_HAND = (
    "expand it (xacro FILE name:=value > robot.urdf) where ROS is installed, and give robot.urdf"
)


def is_xacro(path: Path | str) -> bool:
    """Whether a file is written in xacro, by its suffix."""
    suffix = Path(path).suffix
    return suffix.lower() == XACRO_SUFFIX


def expand_xacro(path: Path, arguments: Mapping[str, str]) -> str:
    """Expand a xacro file to a URDF's text, its arguments given by name. Raises StudyError where
    xacro is not installed, or what it says."""
    import subprocess

    problem = find_read_problem(path)
    if problem is not None:
        raise StudyError(f"{path}: {problem}. Check its name and folder.")
    command = [*_find_program(path), str(path)]
    command += [f"{name}:={value}" for name, value in arguments.items()]
    try:
        done = subprocess.run(
            command, capture_output=True, text=True, timeout=MAX_SECONDS, check=False
        )
    except (OSError, subprocess.TimeoutExpired) as error:
        raise StudyError(
            f"{path.name}: xacro cannot be run: {error}. Instead, {BY_HAND}."
        ) from None
    if done.returncode:
        said = " ".join(done.stderr.split())[-MAX_MESSAGE:]
        raise StudyError(
            f"{path.name}: xacro says: {said}. Arguments are given as --xacro name:=value; packages "
            "that it looks for need ROS' environment."
        )
    return done.stdout.replace(str(path), path.name)


def refuse_xacro(path: Path) -> StudyError:
    """Return the error of a study file, or a call, that names a xacro file."""
    return StudyError(
        f"{path.name}: this is a xacro file, a program that makes a URDF: modelsel init and check "
        f"expand it (--robot {path.name}); for a study, {BY_HAND}."
    )


def _find_program(path: Path) -> list[str]:
    """Find the command that expands: ROS' program, else Python's package. Raises StudyError."""
    program = shutil.which("xacro")
    if program is not None:
        return [program]
    if find_spec("xacro") is not None:
        return [sys.executable, "-c", "import xacro; xacro.main()"]
    raise StudyError(
        f"{path.name}: this is a xacro file, and xacro is not installed. Install it with pip install "
        f"xacro, or {BY_HAND}."
    )
