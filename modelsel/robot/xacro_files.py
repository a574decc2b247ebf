"""URDFs that are written in xacro: expanded by ROS' own program, where it is installed.

A xacro file is a program: it evaluates expressions and reads other files. So it is expanded only
where a user names it on the command line, in a process of its own, never for a study file."""

from __future__ import annotations

import re
import shutil
import sys
from collections.abc import Mapping
from importlib.util import find_spec
from pathlib import Path

from .._text import find_read_problem
from ..exceptions import StudyError, suggest

XACRO_SUFFIX = ".xacro"
# seconds
MAX_SECONDS = 60.0
MAX_MESSAGE = 300
EMPTY = '""'
COMMENT = re.compile(r"<!--.*?-->", re.DOTALL)
ARGUMENT = re.compile(r"<xacro:arg\b[^>]*>")
INCLUDE = re.compile(r"<xacro:include\b[^>]*\bfilename\s*=\s*[\"']([^\"']*)[\"']")
ATTRIBUTE = re.compile(r"\b(name|default)\s*=\s*(?:\"([^\"]*)\"|'([^']*)')")
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
    _check_arguments(path, arguments)
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


def list_arguments(path: Path) -> tuple[dict[str, str | None], bool]:
    """List (the arguments that a xacro file and those it includes declare, with their defaults,
    None for none; whether all included files could be looked at)."""
    declared: dict[str, str | None] = {}
    waiting, seen, complete = [path], set[Path](), True
    while waiting:
        file = waiting.pop(0)
        if file in seen:
            continue
        seen.add(file)
        try:
            text = COMMENT.sub("", file.read_text(encoding="utf-8"))
        except (OSError, UnicodeError):
            complete = False
            continue
        for tag in ARGUMENT.findall(text):
            attributes = {key: one or other for key, one, other in ATTRIBUTE.findall(tag)}
            declared.setdefault(attributes.get("name", ""), attributes.get("default"))
        waiting += [file.parent / name for name in INCLUDE.findall(text)]
    return declared, complete


def describe_expansion(path: Path, arguments: Mapping[str, str]) -> str:
    """Say that a xacro file was expanded, with which arguments, defaults included."""
    declared, _ = list_arguments(path)
    said = [f"{name}:={value}" for name, value in arguments.items()]
    for name, default in declared.items():
        if name not in arguments and default is not None:
            said.append(f"{name}:={default or EMPTY} (default)")
    which = ", ".join(said) or "no arguments"
    return f"{path.name} was expanded by xacro, with {which}."


def _check_arguments(path: Path, arguments: Mapping[str, str]) -> None:
    """Refuse an argument that neither the file nor what it includes declares. Raises StudyError."""
    declared, complete = list_arguments(path)
    for name in arguments:
        if name not in declared and complete:
            listed = ", ".join(declared) or "none"
            raise StudyError(
                f"--xacro {name}:=…: {path.name} has no such argument. {suggest(name, declared)} "
                f"Its arguments: {listed}."
            )


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
