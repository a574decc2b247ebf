"""The house: imports point up the page, files and functions stay small and light, names are told
apart, heavy libraries are imported late. The rules are in house_rules.py."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import pytest
from house_rules import (
    INNER_FLOORS,
    LEVEL,
    PACKAGE,
    collection_problems,
    density_problems,
    floor_problems,
    heavy_problems,
    modules_of,
    name_problems,
    sentence_problems,
    size_problems,
)

RULES = (
    floor_problems,
    size_problems,
    density_problems,
    name_problems,
    heavy_problems,
    sentence_problems,
)


def test_every_name_stands_on_one_floor() -> None:
    assert set(LEVEL) >= {
        path.name for path in PACKAGE.iterdir() if path.is_dir() and any(path.glob("*.py"))
    }
    assert modules_of(PACKAGE), f"no modules in {PACKAGE}"
    for folder, floors in INNER_FLOORS.items():
        inner = {path.parent.name for path in (PACKAGE / folder).glob("*/*.py")}
        assert inner == set(floors)


@pytest.mark.parametrize("problems", RULES)
def test_house(problems) -> None:
    found = problems(PACKAGE)
    assert not found, "\n" + "\n".join(found)


def test_the_unit_stage_needs_the_extra_test_alone(tmp_path) -> None:
    assert collection_problems(PACKAGE.parent / "tests") == []
    (tmp_path / "test_a.py").write_text("import pytest, statsmodels.api as sm\n")
    (tmp_path / "test_b.py").write_text("def test() -> None:\n    import mujoco\n")
    (problem,) = collection_problems(tmp_path)
    assert "test_a.py:1: statsmodels is imported with the tests" in problem


def defined(*names: str) -> str:
    """A module's text with empty functions."""
    return "".join(f"def {name}(): ...\n" for name in names)


FORTY = "    x = 1\n" * 40
BREACHES = {
    "types, down": (
        floor_problems,
        {
            "fitting/noise.py": "from typing import TYPE_CHECKING\n"
            "if TYPE_CHECKING:\n    from ..selection import subsets"
        },
        "selection.subsets from",
    ),
    "from, down": (
        floor_problems,
        {"fitting/least_squares.py": "from modelsel.selection.subsets import best"},
        "selection.subsets from",
    ),
    "package, down": (
        floor_problems,
        {"fitting/least_squares.py": "from modelsel.selection import subsets"},
        "selection.subsets from",
    ),
    "import, down": (
        floor_problems,
        {"fitting/least_squares.py": "import modelsel.selection.subsets as s"},
        "selection.subsets from",
    ),
    "relative, down": (
        floor_problems,
        {"fitting/least_squares.py": "from ..selection.subsets import best"},
        "selection.subsets from",
    ),
    "dot, down": (
        floor_problems,
        {"fitting/least_squares.py": "from ..selection import subsets"},
        "selection.subsets from",
    ),
    "subpackage, down": (
        floor_problems,
        {"report/figures/a.py": "from ...cli.main import f"},
        "cli.main from",
    ),
    "late, down": (
        floor_problems,
        {"fitting/least_squares.py": "def f():\n    import modelsel.selection.subsets"},
        "selection.subsets from",
    ),
    "front door": (
        floor_problems,
        {"fitting/least_squares.py": "from modelsel import __version__"},
        "floor 'cli'",
    ),
    "inner floor, down": (
        floor_problems,
        {"diagnosis/shapes/a.py": "from ..search.state import Search"},
        "imports modelsel.diagnosis.search.state from floor 'diagnosis/search'",
    ),
    "inner floor, types, down": (
        floor_problems,
        {
            "diagnosis/shapes/a.py": "from typing import TYPE_CHECKING\n"
            "if TYPE_CHECKING:\n    from ..search.state import Search"
        },
        "'diagnosis/shapes' imports",
    ),
    "out of an inner floor": (
        floor_problems,
        {"diagnosis/search/a.py": "def f():\n    from .. import procedure"},
        "on floor 'diagnosis/search' imports modelsel.diagnosis.procedure from floor 'diagnosis'",
    ),
    "no inner floor": (
        floor_problems,
        {"diagnosis/a/__init__.py": ""},
        "modelsel.diagnosis.a stands on no floor",
    ),
    "no floor": (floor_problems, {"utils.py": ""}, "modelsel.utils stands on no floor"),
    "no module": (
        floor_problems,
        {"fitting/least_squares.py": "from .gone import x"},
        "modelsel.fitting.gone, which does not exist",
    ),
    "circle": (
        floor_problems,
        {
            "fitting/least_squares.py": "from . import noise",
            "fitting/noise.py": "from .least_squares import f",
        },
        "in a circle",
    ),
    "circle inside": (
        floor_problems,
        {
            "report/figures/__init__.py": "from .a import A",
            "report/figures/a.py": "from . import B",
        },
        "in a circle",
    ),
    "long file": (size_problems, {"fitting/least_squares.py": "x = 1\n" * 401}, "401 lines"),
    "many statements": (
        size_problems,
        {"fitting/noise.py": f"class A:\n  def f():\n    'd'\n{FORTY}    return x"},
        "f has 41 statements",
    ),
    "statements in blocks": (
        size_problems,
        {"fitting/noise.py": f"def f():\n  if x:\n{FORTY}"},
        "f has 41 statements",
    ),
    "statements of an inner function": (
        size_problems,
        {"fitting/noise.py": f"def f():\n  def g():\n{FORTY}    return x"},
        "g has 41 statements",
    ),
    "dense": (density_problems, {"fitting/noise.py": "def f():\n  f(a, b, c, 1)"}, "has 11.0"),
    "a file name twice": (
        name_problems,
        {"report/noise.py": ""},
        "noise.py stands twice: modelsel.fitting.noise, modelsel.report.noise",
    ),
    "module and function": (
        name_problems,
        {"fitting/noise.py": "x = 1\ndef noise(): ..."},
        "noise.py:2: the module is named like its function",
    ),
    "shared names": (
        name_problems,
        {"fitting/noise.py": defined(*"abcdef"), "fitting/design.py": defined(*"abcdef")},
        "6 function names are defined in several modules",
    ),
    "heavy": (
        heavy_problems,
        {"fitting/least_squares.py": "import pandas as pd"},
        "least_squares.py:1: pandas is imported",
    ),
    "heavy, from": (
        heavy_problems,
        {"fitting/least_squares.py": "from scipy import linalg, stats"},
        "scipy.stats is imported",
    ),
    "heavy, below": (
        heavy_problems,
        {"fitting/least_squares.py": "try:\n    import rich.table\nexcept: ..."},
        "rich is imported",
    ),
    "no number": (
        sentence_problems,
        {"fitting/noise.py": "raise E(\n    f'{word} is '\n    'no number')"},
        'noise.py:2: "is no" as a predicate',
    ),
    "none of them": (sentence_problems, {"fitting/noise.py": "x = 'it is none'"}, '"is none"'),
}
SOUND = {
    "types of the own folder": {
        "fitting/least_squares.py": "from . import noise",
        "fitting/noise.py": "from typing import TYPE_CHECKING\n"
        "if TYPE_CHECKING:\n    from .least_squares import Fit",
    },
    "up": {
        "fitting/least_squares.py": "from ..exceptions import E\nfrom modelsel.robot import rigid\nimport modelsel.fitting.design, numpy"
    },
    "own floor": {"fitting/least_squares.py": "from . import noise"},
    "subpackage": {
        "report/figures/__init__.py": "from . import a",
        "report/figures/a.py": "from ..style import S",
    },
    "inner floors": {
        "diagnosis/procedure.py": "from .search.state import Search",
        "diagnosis/search/a.py": "from ..shapes import b\nfrom .state import Search",
        "diagnosis/shapes/b.py": "from ...exceptions import E",
    },
    "door": {
        "__init__.py": "from modelsel.fitting.least_squares import f",
        "__main__.py": "from .cli.main import main",
    },
    "late": {
        "fitting/least_squares.py": "import scipy.linalg, richer\ndef f():\n    import pandas\n    from scipy import stats"
    },
    "types": {
        "fitting/least_squares.py": "from typing import TYPE_CHECKING\nif TYPE_CHECKING:\n    import pandas as pd"
    },
    "at the limits": {"fitting/noise.py": f"def f():\n    'd'\n{FORTY}" + "\n" * 358},
    "an inner function counts once": {
        "fitting/noise.py": f"def f():\n    def g():\n{FORTY.replace('    ', '        ')}{FORTY[10:]}"
    },
    "light": {"fitting/noise.py": "def f():\n  f(a, b, c)"},
    "sentences": {
        "fitting/noise.py": "'''It is none.'''\nx = 'There is no row, and it is no longer true.'"
    },
    "own names": {
        "fitting/noise.py": defined(*"abcde", "_g") + "class A:\n  def noise(self): ...",
        "fitting/design.py": defined(*"abcde", "_g"),
        "__init__.py": defined("h"),
        "report/figures/__init__.py": "",
    },
}


def planted(folder: Path, files: Mapping[str, str]) -> Path:
    """A package named modelsel with the modules that the examples import, and the given files."""
    names = (
        *(
            "__init__",
            "exceptions",
            "robot/rigid",
            "report/style",
            "report/figures/__init__",
            "cli/main",
            "diagnosis/procedure",
            "diagnosis/search/state",
        ),
        *(
            "fitting/design",
            "fitting/least_squares",
            "fitting/noise",
            "selection/__init__",
            "selection/subsets",
        ),
    )
    for name, text in ({f"{name}.py": "" for name in names} | dict(files)).items():
        path = folder / "modelsel" / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, encoding="utf-8")
    return folder / "modelsel"


@pytest.mark.parametrize(("problems", "files", "message"), BREACHES.values(), ids=BREACHES)
def test_breach_is_seen(problems, files, message, tmp_path) -> None:
    found = problems(planted(tmp_path, files))
    assert len(found) == 1
    assert message in found[0]


@pytest.mark.parametrize("files", SOUND.values(), ids=SOUND)
def test_sound_house_passes(files, tmp_path) -> None:
    package = planted(tmp_path, files)
    assert [problem for rule in RULES for problem in rule(package)] == []
