"""What mkdocs does not do by itself: generated parts of pages, computed figures, formulas as
MathML.

A page says `<!-- made: NAME -->` where a generated part stands (`figure NAME`, `report NAME`: one
picture); a list between `<!-- in the repository -->` and `<!-- in the site -->` stands for it where
the page is read as it is. Nothing that is made here is stored: it says what the program does now. No network.
"""

from __future__ import annotations

import html
import os
import re
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

for _threads in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(
        _threads, "1"
    )  # before numpy loads, as the command line does: the same figures on any machine

import catalogue
import figures
import notebooks
import rates
import reference
import repeating
from example import run_example

from modelsel.report.document import Source, collect_blocks, walk_blocks
from modelsel.report.drawing import PAGES

if TYPE_CHECKING:
    from mkdocs.config.defaults import MkDocsConfig
    from mkdocs.structure.files import Files
    from mkdocs.structure.pages import Page

ROOT = Path(__file__).parents[2]
REPORT = ROOT / "reports" / "puma760"
NOTEBOOKS = ROOT / "docs" / "tutorials" / "notebooks"
MADE = re.compile(r"^<!-- made: ([\w-]+)(?: ([\w-]+))? -->$", re.MULTILINE)
# what a page shows where it is read in the repository, in place of a generated part
UNFILLED = re.compile(
    r"^<!-- in the repository -->\n.*?^<!-- in the site -->\n", re.MULTILINE | re.DOTALL
)
CANVAS = re.compile(
    rb'(<g id="patch_\d+">\s*<path d="[^"]+"\s+style="fill: )#ffffff'
)  # white paper, in the dark a box
GENERATED = re.compile(r"\]\((made/|mechanisms/|reference/|explanation/|how-to/)")
FORMULA = re.compile(r'<(span|div) class="arithmatex">\\[(\[](.*?)\\[)\]]</\1>', re.DOTALL)


@cache
def report() -> dict[str, tuple[bytes, str, str]]:
    """(SVG, caption, text) of the figures of the PUMA study's report, by name; of its findings the
    first alone."""
    result = run_example()
    whole = Source(result.record, result.details)
    first = (
        records.model_copy(update={"findings": records.findings[:1]})
        for records in (whole.record, whole.details)
    )
    source = Source(*first)
    blocks = collect_blocks(source, PAGES, ("data", "findings", "residuals"))
    blocks += collect_blocks(whole, PAGES, ("first", "parameters", "map"))
    pictures = source.pictures | whole.pictures
    return {
        b["file"].removesuffix(".svg"): (pictures[b["file"]], b["caption"], b["alt"])
        for b in walk_blocks(blocks)
        if b["kind"] == "figure"
    }


@cache
def mechanisms() -> tuple[str, dict[str, bytes]]:
    """The catalogue and its pictures."""
    return catalogue.page()


def _report(name: str) -> str:
    _, caption, alt = report()[name]
    below = f"\n\n*{caption}*{{ .caption }}" if caption else ""
    return f"![{alt}](made/report-{name}.svg){{ .figure }}{below}"


def _figure(name: str) -> str:
    _, caption = figures.ALL[name]()
    return f"![{caption}](made/{name}.svg){{ .figure }}\n\n*{caption}*{{ .caption }}"


def _notebooks() -> str:
    """A list of what is there; every notebook is a page of its own, as it was last run."""
    found = [f"- [{title}]({name}.md)" for name, (title, _) in notebooks.pages(NOTEBOOKS).items()]
    said = "They run anywhere that Jupyter does; here they are shown as they were last run."
    return "\n".join([said, "", *found]) if found else "None is here yet."


PARTS: dict[str, Any] = {
    "catalogue": lambda: mechanisms()[0],
    "commands": reference.commands,
    "names": reference.names,
    "broken": rates.broken,
    "measured": rates.measured,
    "naming": rates.naming,
    "notebooks": _notebooks,
    "repeatability": repeating.said,
    "stated": rates.stated,
}


def on_page_markdown(markdown: str, page: Page, **_: Any) -> str:
    """Put generated parts into their places; their links start at the documentation's root."""
    root = "../" * page.file.src_uri.count("/")

    def part(found: re.Match[str]) -> str:
        kind, name = found.groups()
        if kind == "report":
            text = _report(name)
        elif kind == "figure":
            text = _figure(name)
        else:
            text = str(PARTS[kind]())
        return GENERATED.sub(rf"]({root}\1", text)

    return MADE.sub(part, UNFILLED.sub("", markdown))


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Computed pictures as files of the site, and those that the README shows."""
    from mkdocs.structure.files import File

    made = {f"mechanisms/{name}": drawn for name, drawn in mechanisms()[1].items()}
    made |= {f"made/report-{name}.svg": drawn for name, (drawn, _, _) in report().items()}
    made |= {f"made/{name}.svg": draw()[0] for name, draw in figures.ALL.items()}
    made |= {
        f"made/{name}": (ROOT / "reports" / name).read_bytes()
        for name in ("puma760-pdf.png", "puma760-html.png")
    }
    made |= {"made/stated.png": rates.STATED_PICTURE.read_bytes()}
    made |= {f"made/{name}": (REPORT / name).read_bytes() for name in ("report.html", "report.pdf")}
    made |= {
        f"tutorials/notebooks/{name}.md": text
        for name, (_, text) in notebooks.pages(NOTEBOOKS).items()
    }
    for name, content in made.items():
        shown = (
            CANVAS.sub(rb"\1none", content)
            if isinstance(content, bytes) and name.endswith(".svg")
            else content
        )
        files.append(File.generated(config, name, content=shown))
    return files


def on_page_context(context: Any, page: Any, **_: Any) -> Any:
    """A page that stands alone in its tab needs no list of pages beside it: the text gets the
    room."""
    if page.parent is None:
        page.meta.setdefault("hide", ["navigation"])
    return context


def on_page_content(content: str, **_: Any) -> str:
    """Formulas as MathML, which browsers draw without a script."""
    from latex2mathml.converter import convert

    def drawn(found: re.Match[str]) -> str:
        kind, formula = found.groups()
        return str(convert(html.unescape(formula), display="block" if kind == "div" else "inline"))

    return FORMULA.sub(drawn, content)
