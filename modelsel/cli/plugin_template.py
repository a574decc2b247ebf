"""A package of one's own with a mechanism in it: the files of `modelsel mechanisms --new`, and what
`--test` tries."""

from __future__ import annotations

import re
import sys
from collections.abc import Mapping, Sequence
from importlib import import_module
from importlib.util import module_from_spec, spec_from_file_location
from keyword import iskeyword
from pathlib import Path
from types import ModuleType

import numpy as np

from ..exceptions import StudyError
from ..mechanisms.registry import Registry, parts, unsound
from ..robot.kinematics import Robot
from ..testing import broken

PYPROJECT = """[build-system]
requires = ["hatchling"]
build-backend = "hatchling.build"

[project]
name = "{name}"
version = "0.1.0"
description = "A mechanism for modelsel: what goes wrong, in one sentence."
requires-python = ">=3.11"
dependencies = ["modelsel"]

[project.entry-points."modelsel.mechanisms"]
{module} = "{module}:mechanisms"

[tool.hatch.build.targets.wheel]
include = ["{module}.py"]
"""

MODULE = '''"""A mechanism of my own for modelsel: one joint is turned by another."""
from modelsel.mechanisms.causes import q, sin
from modelsel.mechanisms.terms import Mechanism, Screw, Term


def build(robot):
    """What goes wrong: a place (frame and axis) and a cause. None where it does not apply to a robot."""
    if robot.n < 6:
        return None
    term = Term("t46", (Screw(4, "rz", sin(q(4) + q(6))),), size=(1e-5, 2e-3))     # rad: the usual range
    return Mechanism("{name}", (term,), "The hose pack twists joint 4 as joints 4 and 6 wind it up.",
                     "θ4 = q4 + t46 sin(q4+q6)", "where the idea comes from")


def mechanisms():
    """The table that modelsel asks for."""
    return {{"{name}": build}}
'''

README = """# {name}

A mechanism for modelsel. Edit `{module}.py`, then:

    modelsel mechanisms --test {module}.py      # the laws that every mechanism obeys
    pip install .                               # from then on every study may find it
    modelsel mechanisms {name}
"""


def skeleton(name: str) -> dict[str, str]:
    """File name -> text of a new package. Raises StudyError for a name that cannot be one."""
    if not re.fullmatch("[a-z][a-z0-9_-]{0,99}", name) or iskeyword(name):
        raise StudyError(
            f'"{name}" cannot name a mechanism: lower-case letters, digits and -, a letter first: "hose-twist".'
        )
    words = {"name": name, "module": name.replace("-", "_")}
    return {
        "pyproject.toml": PYPROJECT.format(**words),
        f"{words['module']}.py": MODULE.format(**words),
        "README.md": README.format(**words),
    }


def table(where: str) -> Registry:
    """The mechanisms of a module, by its name ("hosepack", "hosepack:mechanisms") or file. Raises
    StudyError."""
    name, _, function = (
        where.removesuffix(".py").partition(":") if not where.endswith(".py") else (where, "", "")
    )
    try:
        module = _of_file(Path(where)) if where.endswith(".py") else import_module(name)
        made = getattr(module, function or "mechanisms")()
    except Exception as error:  # noqa: BLE001  a stranger's code may fail in any way
        raise StudyError(
            f"{where}: cannot be loaded: {type(error).__name__}: {error}. A module with a function mechanisms() "
            "that returns {name: entry} is expected."
        ) from None
    if not isinstance(made, Mapping) or not made:
        raise StudyError(
            f"{where}: mechanisms() gives {type(made).__name__}; a table {{name: entry}} with an entry is expected."
        )
    return dict(made)


def _of_file(path: Path) -> ModuleType:
    spec = spec_from_file_location(path.stem, path)
    if spec is None or spec.loader is None:
        raise ImportError("not a Python file")
    module = module_from_spec(spec)
    sys.modules[path.stem] = module
    spec.loader.exec_module(module)
    return module


def tried(
    entries: Registry, robots: Sequence[Robot], seed: int = 0
) -> list[tuple[str, str, list[str]]]:
    """(mechanism, robot, what it breaks) of every part of every entry on every robot it applies to;
    ("name", "", []) where an entry applies to none."""
    out = []
    for name, entry in entries.items():
        found = []
        for robot in robots:
            wrong = unsound(name, entry, robot)
            if wrong is not None:
                found.append((name, robot.name, [wrong]))
                continue
            found += [
                (m.name, robot.name, broken(m, robot, np.random.default_rng([seed, k])))
                for k, m in enumerate(parts(name, robot, {name: entry}))
            ]
        out += found or [(name, "", [])]
    return out
