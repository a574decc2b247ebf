"""The rules of the house, each a function from the package's folder to a list of problems.

Only the text of the modules is read; nothing is imported. Late imports and imports under
TYPE_CHECKING count too.
"""

from __future__ import annotations

import ast
import re
from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping
from functools import cache
from graphlib import CycleError, TopologicalSorter
from pathlib import Path
from statistics import median

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
# The folders within a folder, top to bottom, by the same rule; the modules of the folder itself
# stand below all of them.
INNER_FLOORS = {
    "measurements": ("formats", "campaign", "quantities", "recognition", "pairing"),
    "diagnosis": (
        "shapes",
        "candidates",
        "columns",
        "inference",
        "search",
        "rivals",
        "faults",
        "findings",
    ),
    "results": (
        "schemas",
        "runs",
        "numbers",
        "sentences",
        "repeatability",
        "conclusions",
        "pictures",
    ),
    "study": (
        "tables",
        "preparation",
        "inputs",
        "models",
        "pipeline",
        "planning",
        "inspection",
        "drafts",
    ),
}
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
# What the extra `test` does not install: a test imports it where it needs it, so that the unit stage
# can be collected without it.
INTEGRATION = (
    *("arviz_base", "arviz_stats", "dask", "distributed", "hatchling", "jupyter_client", "mkdocs"),
    *("mujoco", "nbclient", "nbformat", "pdfminer", "pinocchio", "pypdf", "selenium", "sklearn"),
    "statsmodels",
)
ALLOWED = {
    ("study_file", "pydantic"),
    ("study_tables", "pydantic"),
    ("frozen_table", "pydantic"),
    ("campaign_table", "pydantic"),
    ("covariate_table", "pydantic"),
    ("fleet_file", "pydantic"),
    ("_records", "pydantic"),
    ("schema", "pydantic"),
    ("calibration_schema", "pydantic"),
    ("finding_schema", "pydantic"),
    ("details_schema", "pydantic"),
    ("serialization", "pydantic"),
}  # a file is its schema, imported to read one
# What a reader must hold at once. Lines alone say little: they can be made longer.
MAX_LINES = 400  # of a file
MAX_STATEMENTS = 40  # of a function, without its docstring and the bodies of nested functions
MAX_NODES_PER_LINE = 10  # of the syntax tree, median over all functions
MAX_SHARED_NAMES = 5  # public functions of one name in several modules
# In what people read something is not a number; it "is no number" nowhere. Nothing is said of "there is
# no column" and "is no longer".
NO_PREDICATE = re.compile(
    r"(?<!there )\b(?:is|are|be|was|were) (?:no|none)\b(?! (?:longer|less|more|better|worse|other))",
    re.IGNORECASE,
)

PACKAGE = Path(__file__).parents[2] / "modelsel"
FUNCTIONS = (ast.FunctionDef, ast.AsyncFunctionDef)
Function = ast.FunctionDef | ast.AsyncFunctionDef
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


@cache
def tree_of(path: Path) -> ast.Module:
    """The syntax tree of a module, parsed once for all rules."""
    return ast.parse(path.read_text(encoding="utf-8"))


@cache
def nodes_of(path: Path) -> tuple[ast.AST, ...]:
    """Every node of a module's tree, gathered once for all rules."""
    return tuple(ast.walk(tree_of(path)))


def imports_of(name: str, path: Path, known: Mapping[str, Path]) -> Iterator[tuple[int, str]]:
    """(line, dotted name) of each module of the same package that a file imports, wherever in the
    file it does."""
    house = name.partition(".")[0]
    for node in nodes_of(path):
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
    blocks = [node for node in nodes_of(path) if isinstance(node, ast.If) and checks_types(node)]
    return {
        inner.lineno
        for block in blocks
        for child in block.body
        for inner in ast.walk(child)
        if isinstance(inner, (ast.Import, ast.ImportFrom))
    }


def checks_types(node: ast.If) -> bool:
    """Whether a condition is TYPE_CHECKING."""
    test = node.test
    if isinstance(test, ast.Attribute) and isinstance(test.value, ast.Name):
        return (test.value.id, test.attr) == ("typing", "TYPE_CHECKING")
    return isinstance(test, ast.Name) and test.id == "TYPE_CHECKING"


def absolute(node: ast.ImportFrom, name: str, *, is_package: bool) -> str:
    """The module that a from-import names: `from ..fit import x` inside modelsel.report.pdf is
    modelsel.fit."""
    if not node.level:
        return node.module or ""
    parts = name.split(".") if is_package else name.split(".")[:-1]
    return ".".join(parts[: len(parts) - node.level + 1] + ([node.module] if node.module else []))


def level_of(name: str, path: Path) -> tuple[int, int] | None:
    """How far down the page a module stands: its floor, and where that has floors of its own which
    of these; None for a folder without a floor."""
    _, folder, module, *_ = *name.split("."), "__init__", "__init__"
    level = LEVEL.get(folder, 0 if folder.startswith("_") else None)
    inner = INNER_FLOORS.get(folder)
    if level is None or inner is None:
        return None if level is None else (level, 0)
    if module in inner:
        return level, inner.index(module)
    is_folder = path.parent.name != folder
    return None if is_folder else (level, len(inner))


def floor_of(level: tuple[int, int]) -> str:
    """The name of a floor: diagnosis, or diagnosis/search where it has floors of its own."""
    floor = FLOORS[level[0]]
    inner = INNER_FLOORS.get(floor, ())[level[1] :]
    return f"{floor}/{inner[0]}" if inner else floor


def floor_problems(package: Path) -> list[str]:
    """Modules without a floor, imports that point down the page, and imports that run in a
    circle."""
    known = modules_of(package)
    problems = [
        f"{path}: {name} stands on no floor: move it into the folder of one of FLOORS or INNER_FLOORS (tests/support/house_rules.py)"
        for name, path in known.items()
        if level_of(name, path) is None
    ]
    graph: dict[str, set[str]] = {}
    for name, path in known.items():
        for_types = typing_lines(path)
        for line, target in imports_of(name, path, known):
            if target not in known:
                problems.append(f"{path}:{line}: {name} imports {target}, which does not exist")
                continue
            here, there = level_of(name, path), level_of(target, known[target])
            if not (line in for_types and name.split(".")[1:2] == target.split(".")[1:2]):
                graph.setdefault(name, set()).add(target)
            if here is not None and there is not None and there > here:
                floors = (
                    f"on floor '{floor_of(here)}' imports {target} from floor '{floor_of(there)}'"
                )
                problems.append(f"{path}:{line}: {name} {floors}: imports point up the page")
    try:
        TopologicalSorter(graph).prepare()
    except CycleError as circle:
        problems.append(f"imports run in a circle: {' imports '.join(reversed(circle.args[1]))}")
    return problems


def size_problems(package: Path) -> list[str]:
    """Files above MAX_LINES lines, functions above MAX_STATEMENTS statements."""
    problems = []
    for path in modules_of(package).values():
        lines = len(path.read_text(encoding="utf-8").splitlines())
        if lines > MAX_LINES:
            problems.append(f"{path}: {lines} lines, at most {MAX_LINES}")
        for function in functions_of(path):
            count = statements(function)
            if count > MAX_STATEMENTS:
                problems.append(
                    f"{path}:{function.lineno}: {function.name} has {count} statements, "
                    f"at most {MAX_STATEMENTS}: split it into named steps"
                )
    return problems


def functions_of(path: Path) -> list[Function]:
    """Every function of a module, methods and nested ones too."""
    return [node for node in nodes_of(path) if isinstance(node, FUNCTIONS)]


def body_of(function: Function) -> list[ast.stmt]:
    """The statements of a function without its docstring."""
    documented = ast.get_docstring(function, clean=False) is not None
    return function.body[1:] if documented else function.body


def statements(function: Function) -> int:
    """How many statements a function has: a nested function or class counts as one."""
    count = 0
    nodes: list[ast.AST] = list(body_of(function))
    while nodes:
        node = nodes.pop()
        count += isinstance(node, ast.stmt)
        if not isinstance(node, (*FUNCTIONS, ast.ClassDef, ast.Lambda)):
            nodes.extend(ast.iter_child_nodes(node))
    return count


def density_problems(package: Path) -> list[str]:
    """A median of syntax nodes per line of a function's body above MAX_NODES_PER_LINE."""
    densities = []
    for path in modules_of(package).values():
        for function in functions_of(path):
            body = body_of(function)
            if body:
                nodes = sum(1 for statement in body for _ in ast.walk(statement))
                lines = (body[-1].end_lineno or 0) - body[0].lineno + 1
                densities.append(nodes / lines)
    if not densities or median(densities) <= MAX_NODES_PER_LINE:
        return []
    problem = (
        f"{package}: a line of a function's body has {median(densities):.1f} syntax nodes "
        f"(median), at most {MAX_NODES_PER_LINE}: name the intermediate steps"
    )
    return [problem]


def name_problems(package: Path) -> list[str]:
    """File names that stand twice, modules named like a function in them, and more than
    MAX_SHARED_NAMES public function names that several modules define."""
    problems: list[str] = []
    modules: dict[str, list[str]] = defaultdict(list)
    definitions: dict[str, list[str]] = defaultdict(list)
    for name, path in modules_of(package).items():
        modules[path.name].append(name)
        for node in tree_of(path).body:
            if not isinstance(node, FUNCTIONS):
                continue
            if node.name == path.stem:
                problems.append(f"{path}:{node.lineno}: the module is named like its function")
            if not node.name.startswith("_"):
                definitions[node.name].append(name)
    problems += [
        f"{package}: the file name {file} stands twice: {', '.join(names)}"
        for file, names in modules.items()
        if len(names) > 1 and file != "__init__.py"
    ]
    shared = {name: places for name, places in sorted(definitions.items()) if len(places) > 1}
    if len(shared) > MAX_SHARED_NAMES:
        listed = "; ".join(f"{name} ({', '.join(places)})" for name, places in shared.items())
        problems.append(
            f"{package}: {len(shared)} function names are defined in several modules, "
            f"at most {MAX_SHARED_NAMES}: {listed}"
        )
    return problems


def sentence_problems(package: Path) -> list[str]:
    """Texts but docstrings that say of something that it is none, or no number."""
    return [
        f'{path}:{line}: "{match[0]}" as a predicate; write that it is not a …'
        for path in modules_of(package).values()
        for line, text in texts_of(tree_of(path))
        for match in NO_PREDICATE.finditer(text)
    ]


def texts_of(tree: ast.Module) -> Iterator[tuple[int, str]]:
    """(line, text) of each string that is not a docstring; a name stands for each value in it."""
    for node in ast.walk(tree):
        for child in ast.iter_child_nodes(node):
            if isinstance(child, ast.JoinedStr):
                parts = [
                    value.value if isinstance(value, ast.Constant) else "x"
                    for value in child.values
                ]
                yield child.lineno, "".join(map(str, parts))
            elif isinstance(node, (ast.Expr, ast.JoinedStr)) or not isinstance(child, ast.Constant):
                continue
            elif isinstance(child.value, str):
                yield child.lineno, child.value


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


def imported_names(node: ast.AST) -> set[str]:
    """The dotted names that an absolute import brings in."""
    if isinstance(node, ast.Import):
        return {alias.name for alias in node.names}
    if isinstance(node, ast.ImportFrom) and not node.level:
        return {f"{node.module}.{alias.name}" for alias in node.names}
    return set()


def imports_any(node: ast.AST, libraries: Iterable[str]) -> list[str]:
    """Those of the libraries that a statement imports."""
    names = imported_names(node)
    return [
        library
        for library in libraries
        if any(f"{name}.".startswith(f"{library}.") for name in names)
    ]


def heavy_problems(package: Path) -> list[str]:
    """Imports of a HEAVY library that are run when the module is imported."""
    return [
        f"{path}:{node.lineno}: {heavy} is imported with the module; import it in the function that needs it"
        for path in modules_of(package).values()
        for node in run_on_import(tree_of(path))
        for heavy in imports_any(node, HEAVY)
        if (path.stem, heavy) not in ALLOWED
    ]


def mentions_any(path: Path, libraries: Iterable[str]) -> bool:
    """Whether the text of a file has the name of one of the libraries: few are worth parsing."""
    text = path.read_text(encoding="utf-8")
    return any(library.partition(".")[0] in text for library in libraries)


def collection_problems(tests: Path) -> list[str]:
    """Imports that are run when tests are collected, of what the extra `test` does not install."""
    return [
        f"{path}:{node.lineno}: {library} is imported with the tests; import it in the test that needs it"
        for path in sorted(tests.rglob("*.py"))
        if mentions_any(path, INTEGRATION)
        for node in run_on_import(tree_of(path))
        for library in imports_any(node, INTEGRATION)
    ]
