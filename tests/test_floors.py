"""The house: imports point up the page, files and functions stay short, heavy libraries are
imported late.

Only the text of the modules is read; nothing is imported. Late imports and imports under
TYPE_CHECKING count too; only a circle inside one folder may be closed by an import for types."""

from __future__ import annotations

import ast
from collections.abc import Iterator, Mapping
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import pytest

# The folders of the package, top to bottom: a module may import from its own floor and from those
# above it in this list.
FLOORS = (
    "base",
    "robot",
    "measurements",
    "mechanisms",
    "fitting",
    "setup",
    "selection",
    "diagnosis",
    "uncertainty",
    "config",
    "calibration",
    "results",
    "report",
    "study",
    "cli",
)
BASE = (
    "exceptions",
    "notices",
)  # and every module of the package itself whose name starts with an underscore
TOP = (
    "__init__",
    "__main__",
    "testing",
)  # beside the command line: the names of `import modelsel`, and of plug-ins' tests
HEAVY = ("scipy.stats", "matplotlib", "pandas", "pyarrow", "emcee", "rich", "pydantic", "typst")
ALLOWED = {
    ("study_file", "pydantic"),
    ("fleet_file", "pydantic"),
    ("finding_schema", "pydantic"),
    ("schema", "pydantic"),
    ("details_schema", "pydantic"),
    ("_records", "pydantic"),
    ("serialization", "pydantic"),
}  # a file is its schema, imported to read one
LONGEST_FILE = 300
LONGEST_FUNCTION = 60

PACKAGE = Path(__file__).parents[1] / "modelsel"
FUNCTIONS = (ast.FunctionDef, ast.AsyncFunctionDef)
LEVEL = (
    {floor: level for level, floor in enumerate(FLOORS)}
    | dict.fromkeys(BASE, 0)
    | dict.fromkeys(TOP, len(FLOORS) - 1)
)


def modules_of(package: Path) -> dict[str, Path]:
    """Dotted name -> file, for every module below the package; a folder goes by the name of its
    __init__."""
    dotted = {
        ".".join(path.relative_to(package.parent).with_suffix("").parts): path
        for path in package.rglob("*.py")
    }
    return {name.removesuffix(".__init__"): dotted[name] for name in sorted(dotted)}


def imports_of(name: str, path: Path, known: Mapping[str, Path]) -> Iterator[tuple[int, str]]:
    """(line, dotted name) of each module of the same package that a file imports, wherever in the
    file it does."""
    house = name.partition(".")[0]
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            found = [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            base = absolute(node, name, is_package=path.name == "__init__.py")
            children = [f"{base}.{alias.name}" for alias in node.names]
            found = [child if child in known else base for child in children]
        else:
            continue
        yield from (
            (node.lineno, target)
            for target in dict.fromkeys(found)
            if target.partition(".")[0] == house
        )


def typing_lines(path: Path) -> set[int]:
    """Lines of the imports that only a type checker runs."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    blocks = [node for node in ast.walk(tree) if isinstance(node, ast.If) and checks_types(node)]
    return {
        inner.lineno
        for block in blocks
        for child in block.body
        for inner in ast.walk(child)
        if isinstance(inner, (ast.Import, ast.ImportFrom))
    }


def checks_types(node: ast.If) -> bool:
    """Whether a condition is TYPE_CHECKING."""
    return ast.unparse(node.test) in {"TYPE_CHECKING", "typing.TYPE_CHECKING"}


def absolute(node: ast.ImportFrom, name: str, *, is_package: bool) -> str:
    """The module that a from-import names: `from ..fit import x` inside modelsel.report.pdf is
    modelsel.fit."""
    if not node.level:
        return node.module or ""
    parts = name.split(".") if is_package else name.split(".")[:-1]
    return ".".join(parts[: len(parts) - node.level + 1] + ([node.module] if node.module else []))


def level_of(name: str) -> int | None:
    folder = [*name.split("."), "__init__"][1]
    return LEVEL.get(folder, 0 if folder.startswith("_") else None)


def floor_problems(package: Path) -> list[str]:
    """Modules without a floor, imports that point down the page, and imports that run in a
    circle."""
    known = modules_of(package)
    problems = [
        f"{path}: {name} stands on no floor: move it into the folder of one of FLOORS (tests/test_floors.py)"
        for name, path in known.items()
        if level_of(name) is None
    ]
    graph: dict[str, set[str]] = {}
    for name, path in known.items():
        for_types = typing_lines(path)
        for line, target in imports_of(name, path, known):
            here, there = level_of(name), level_of(target)
            if target not in known:
                problems.append(f"{path}:{line}: {name} imports {target}, which does not exist")
                continue
            if not (line in for_types and name.split(".")[1:2] == target.split(".")[1:2]):
                graph.setdefault(name, set()).add(target)
            if here is not None and there is not None and there > here:
                floors = f"on floor '{FLOORS[here]}' imports {target} from floor '{FLOORS[there]}'"
                problems.append(f"{path}:{line}: {name} {floors}: imports point up the page")
    try:
        TopologicalSorter(graph).prepare()
    except CycleError as circle:
        problems.append(f"imports run in a circle: {' imports '.join(reversed(circle.args[1]))}")
    return problems


def length_problems(package: Path) -> list[str]:
    """Files above LONGEST_FILE lines, functions above LONGEST_FUNCTION from `def` to last line,
    docstring included."""
    problems = []
    for path in modules_of(package).values():
        text = path.read_text(encoding="utf-8")
        if (lines := len(text.splitlines())) > LONGEST_FILE:
            problems.append(f"{path}: {lines} lines, at most {LONGEST_FILE}")
        problems += [
            f"{path}:{node.lineno}: {node.name} has {lines} lines, at most {LONGEST_FUNCTION}"
            for node in ast.walk(ast.parse(text))
            if isinstance(node, FUNCTIONS)
            and (lines := (node.end_lineno or 0) - node.lineno + 1) > LONGEST_FUNCTION
        ]
    return problems


def run_on_import(node: ast.AST) -> Iterator[ast.AST]:
    """Every node that is run when the file is imported: not inside functions, not under `if
    TYPE_CHECKING`."""
    for child in ast.iter_child_nodes(node):
        if isinstance(child, (*FUNCTIONS, ast.Lambda)):
            continue
        if isinstance(child, ast.If) and checks_types(child):
            yield from run_on_import(ast.Module(child.orelse, []))
        else:
            yield child
            yield from run_on_import(child)


def heavy_problems(package: Path) -> list[str]:
    """Imports of a HEAVY library that are run when the module is imported."""
    problems = []
    for path in modules_of(package).values():
        for node in run_on_import(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Import):
                names = {alias.name for alias in node.names}
            elif isinstance(node, ast.ImportFrom) and not node.level:
                names = {f"{node.module}.{alias.name}" for alias in node.names}
            else:
                continue
            problems += [
                f"{path}:{node.lineno}: {heavy} is imported with the module; import it in the function that needs it"
                for heavy in HEAVY
                if (path.stem, heavy) not in ALLOWED
                and any(f"{name}.".startswith(f"{heavy}.") for name in names)
            ]
    return problems


def test_every_name_stands_on_one_floor() -> None:
    assert set(LEVEL) >= {
        path.name for path in PACKAGE.iterdir() if path.is_dir() and any(path.glob("*.py"))
    }
    assert modules_of(PACKAGE), f"no modules in {PACKAGE}"


@pytest.mark.parametrize("problems", [floor_problems, length_problems, heavy_problems])
def test_house(problems) -> None:
    found = problems(PACKAGE)
    assert not found, "\n" + "\n".join(found)


BREACHES = {
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
    "circle, types of another folder": (
        floor_problems,
        {
            "fitting/least_squares.py": "from . import noise",
            "fitting/noise.py": "from typing import TYPE_CHECKING\nif TYPE_CHECKING:\n    from ..selection import subsets",
        },
        "selection.subsets from",
    ),
    "long file": (length_problems, {"fitting/least_squares.py": "x = 1\n" * 301}, "301 lines"),
    "long function": (
        length_problems,
        {"fitting/least_squares.py": "class A:\n  def f():\n" + "    x = 1\n" * 60},
        "f has 61 lines",
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
}
SOUND = {
    "up": {
        "fitting/least_squares.py": "from ..exceptions import E\nfrom modelsel.robot import rigid\nimport modelsel.fitting.design, numpy"
    },
    "own floor": {"fitting/least_squares.py": "from . import noise"},
    "subpackage": {
        "report/figures/__init__.py": "from . import a",
        "report/figures/a.py": "from ..style import S",
    },
    "door": {
        "__init__.py": "from modelsel.fitting.least_squares import f",
        "__main__.py": "from .cli.main import run_command_line",
    },
    "late": {
        "fitting/least_squares.py": "import scipy.linalg, richer\ndef f():\n    import pandas\n    from scipy import stats"
    },
    "types": {
        "fitting/least_squares.py": "from typing import TYPE_CHECKING\nif TYPE_CHECKING:\n    import pandas as pd"
    },
    "types of the own folder": {
        "fitting/least_squares.py": "from . import noise",
        "fitting/noise.py": "from typing import TYPE_CHECKING\nif TYPE_CHECKING:\n    from .least_squares import Fit",
    },
    "at the limits": {"fitting/least_squares.py": "def f():\n" + "    x = 1\n" * 59 + "\n" * 240},
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
    assert floor_problems(package) + length_problems(package) + heavy_problems(package) == []
