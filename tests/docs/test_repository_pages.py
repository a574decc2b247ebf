"""Reference pages that the site fills hold their lists in the repository, too: what README links to
is not empty. `python tests/rewrite.py repository_pages` writes the lists anew."""

from __future__ import annotations

import inspect
import re
from pathlib import Path

import pytest

import modelsel
from modelsel.cli.main import COMMANDS
from modelsel.mechanisms.registry import BUILTIN, build_mechanisms
from modelsel.robot.files import load_robot

REFERENCE = Path(__file__).parents[2] / "docs" / "reference"
BLOCK = re.compile(
    r"<!-- in the repository -->\n(.*?)<!-- in the site -->\n<!-- made: (commands|catalogue|names) -->",
    re.DOTALL,
)
AGAIN = "python tests/rewrite.py repository_pages writes it anew"


def list_commands() -> str:
    rows = [f"| `modelsel {name}` | {says} |" for name, says in COMMANDS.items()]
    head = "The site has the whole text of every command; so has `modelsel COMMAND --help`."
    return "\n".join([head, "", "| command | does |", "|---|---|", *rows, ""])


def list_mechanisms() -> str:
    """Every registered name, by the first mechanism that it stands for on the PUMA 760."""
    robot = load_robot("puma760")
    rows = []
    for name in BUILTIN:
        built = build_mechanisms(name, robot)
        says = built[0].sentence if built else "Of other arms than this one."
        rows.append(f"| `{name}` | {says} |")
    head = "The site has equations and figures; `modelsel mechanisms NAME` prints an entry, without the figures."
    return "\n".join([head, "", "| mechanism | for instance |", "|---|---|", *rows, ""])


def list_names() -> str:
    rows = []
    for name in sorted(modelsel.__all__):
        text = inspect.getdoc(getattr(modelsel, name)) or ""
        first = " ".join(text.partition("\n\n")[0].split())
        sentence = re.split(r"(?<=\.)\s", first)[0].replace("|", "\\|")
        rows.append(f"| `{name}` | {sentence} |")
    head = "The site has the whole text of every name; so has `help(modelsel.NAME)`."
    return "\n".join([head, "", "| name | is |", "|---|---|", *rows, ""])


PAGES = {"commands.md": list_commands, "mechanisms.md": list_mechanisms, "python.md": list_names}


@pytest.mark.docs
@pytest.mark.parametrize("page", PAGES)
def test_the_list_is_the_programs(page) -> None:
    text = (REFERENCE / page).read_text(encoding="utf-8")
    found = BLOCK.search(text)
    assert found is not None, page
    assert found[1] == PAGES[page]() + "\n", AGAIN


if __name__ == "__main__":
    for page, make in PAGES.items():
        file = REFERENCE / page
        text = file.read_text(encoding="utf-8")
        marker = re.search(r"<!-- made: (commands|catalogue|names) -->", text)
        assert marker is not None
        found = BLOCK.search(text)
        start, end = found.span() if found else marker.span()
        block = f"<!-- in the repository -->\n{make()}\n<!-- in the site -->\n{marker[0]}"
        file.write_text(text[:start] + block + text[end:], encoding="utf-8")
