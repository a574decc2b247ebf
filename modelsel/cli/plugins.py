"""Plug-ins for authors: the package that `modelsel mechanisms --new` writes, and the laws that
`--test` checks."""

from __future__ import annotations

import re
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib import import_module
from importlib.resources import files
from importlib.util import module_from_spec, spec_from_file_location
from keyword import iskeyword
from pathlib import Path
from string import Template
from types import ModuleType
from typing import Any

import numpy as np

from ..exceptions import StudyError
from ..mechanisms.registry import BUILTIN, Registry, build_mechanisms, find_entry_problem
from ..robot.kinematics import Robot
from ..testing import find_broken_laws

TEMPLATES = "plugin_template"  # folder of the files of a new package
SUFFIX = ".template"
NAME_PATTERN = "[a-z][a-z0-9_-]{0,99}"
TAKEN = (
    "this name is taken by a built-in mechanism, which is not replaced: studies leave this one out"
)


def render_plugin(name: str) -> dict[str, str]:
    """Return the files of a new package (file name -> text) with a mechanism of this name. Raises
    StudyError for a name that cannot be one."""
    if not re.fullmatch(NAME_PATTERN, name) or iskeyword(name):
        raise StudyError(
            f'"{name}" cannot name a mechanism: use lower-case letters, digits and -, starting with a letter, such as '
            '"hose-twist".'
        )
    module = name.replace("-", "_")
    return {
        "pyproject.toml": _render("pyproject.toml", name, module),
        f"{module}.py": _render("mechanism.py", name, module),
        "README.md": _render("README.md", name, module),
    }


def _render(file: str, name: str, module: str) -> str:
    folder = files(__package__)
    path = folder.joinpath(TEMPLATES, file + SUFFIX)
    text = path.read_text(encoding="utf-8")
    template = Template(text)
    return template.substitute(name=name, module=module)


def load_plugin(where: str) -> Registry:
    """Load the mechanisms of a module, by its name ("hosepack", "hosepack:mechanisms") or file.
    Raises StudyError."""
    try:
        made = _call_mechanisms(where)
    except Exception as error:  # noqa: BLE001  a stranger's code may fail in any way
        raise StudyError(
            f"{where}: cannot be loaded: {type(error).__name__}: {error}. A module with a function mechanisms() "
            "that returns {name: entry} is expected."
        ) from None
    if not isinstance(made, Mapping) or not made:
        raise StudyError(
            f"{where}: mechanisms() returned {type(made).__name__}, but a table {{name: entry}} with at least one entry "
            "is expected."
        )
    return dict(made)


def _call_mechanisms(where: str) -> Any:
    """Import a module by its name or file and call its function, `mechanisms` unless named."""
    if where.endswith(".py"):
        module = _import_file(Path(where))
        return module.mechanisms()
    name, _, given = where.partition(":")
    function_name = given or "mechanisms"
    module = import_module(name)
    function = getattr(module, function_name)
    return function()


def _import_file(path: Path) -> ModuleType:
    spec = spec_from_file_location(path.stem, path)
    if spec is None or spec.loader is None:
        raise ImportError("not a Python file")
    module = module_from_spec(spec)
    sys.modules[path.stem] = module
    spec.loader.exec_module(module)
    return module


@dataclass(frozen=True)
class Trial:
    """One mechanism tried on one robot and the laws it breaks; `robot` is empty where an entry
    applies to none, or is tried on none as its name is taken."""

    mechanism: str
    robot: str
    broken: list[str]


def try_mechanisms(entries: Registry, robots: Sequence[Robot]) -> list[Trial]:
    """Check the laws for every part of every entry on every robot to which it applies."""
    trials = list[Trial]()
    for name, entry in entries.items():
        if name in BUILTIN:
            trials.append(Trial(name, "", [TAKEN]))
            continue
        on_robots = list[Trial]()
        for robot in robots:
            on_robots += _try_entry(name, entry, robot)
        if not on_robots:
            on_robots = [Trial(name, "", [])]
        trials += on_robots
    return trials


def _try_entry(name: str, entry: Any, robot: Robot) -> list[Trial]:
    tried = robot.name
    defect = find_entry_problem(name, entry, robot)
    if defect is not None:
        return [Trial(name, tried, [defect])]
    registry = {name: entry}
    mechanisms = build_mechanisms(name, robot, registry)
    trials = []
    for k, mechanism in enumerate(mechanisms):
        rng = np.random.default_rng([0, k])
        broken = find_broken_laws(mechanism, robot, rng)
        trial = Trial(mechanism.name, tried, broken)
        trials.append(trial)
    return trials
