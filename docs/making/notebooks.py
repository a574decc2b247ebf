"""Notebooks as pages: their words, code and kept outputs; nothing is run."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any


def _joined(text: str | list[str]) -> str:
    return text if isinstance(text, str) else "".join(text)


def _output(output: dict[str, Any]) -> list[str]:
    if "text" in output:
        return ["```text", _joined(output["text"]).rstrip(), "```"]
    data = output.get("data", {})
    if "image/png" in data:
        picture = _joined(data["image/png"]).replace("\n", "")
        return [
            f'<img class="figure" alt="Output of the cell above" src="data:image/png;base64,{picture}">'
        ]
    if "image/svg+xml" in data or "text/html" in data:
        shown = _joined(data.get("image/svg+xml") or data["text/html"])
        return ["<div>" + " ".join(line for line in shown.splitlines() if line.strip()) + "</div>"]
    return ["```text", _joined(data["text/plain"]).rstrip(), "```"] if "text/plain" in data else []


def page(path: Path) -> tuple[str, str]:
    """(title, Markdown) of a notebook."""
    out: list[str] = []
    for cell in json.loads(path.read_text(encoding="utf-8"))["cells"]:
        source = _joined(cell["source"]).strip()
        if cell["cell_type"] == "markdown":
            out += [source, ""]
        elif cell["cell_type"] == "code" and source:
            out += ["```python", source, "```", ""]
            out += [line for output in cell.get("outputs", []) for line in (*_output(output), "")]
    title = next(
        (line.removeprefix("# ") for line in "\n".join(out).splitlines() if line.startswith("# ")),
        path.stem,
    )
    return title, "\n".join([*out, f"[The notebook itself]({path.name})", ""])


def pages(folder: Path) -> dict[str, tuple[str, str]]:
    """{name: (title, Markdown)} of every notebook of a folder."""
    return {path.stem: page(path) for path in sorted(folder.glob("*.ipynb"))}
