"""The notebooks of docs/tutorials/notebooks run as they stand and show what they compute.
`python tests/rewrite.py notebooks` writes their outputs anew."""

from __future__ import annotations

import base64
import os
import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

FOLDER = Path(__file__).parents[2] / "docs" / "tutorials" / "notebooks"
NOTEBOOKS = sorted(FOLDER.glob("*.ipynb"))
AGAIN = "python tests/rewrite.py notebooks writes the outputs anew"
SECONDS = 120  # a cell, on a machine that does much else
ALL_BYTES = 300_000
KERNEL = {
    "MPLBACKEND": "module://matplotlib_inline.backend_inline",
    "OPENBLAS_NUM_THREADS": "1",
    "OMP_NUM_THREADS": "1",
}


def rewrite(out: Path) -> None:
    """Every notebook into a folder, with its outputs as they are now: run where it stands, in one
    kernel that imports the libraries once and has no names of the notebook before."""
    import nbformat
    from jupyter_client.manager import KernelManager
    from nbclient import NotebookClient

    kernel = KernelManager(kernel_name="python3")
    kernel.start_kernel(env=os.environ | KERNEL, cwd=str(FOLDER))
    try:
        for path in NOTEBOOKS:
            notebook = nbformat.read(path, as_version=4)
            notebook.cells.insert(0, nbformat.v4.new_code_cell("%reset -f"))
            NotebookClient(
                notebook, km=kernel, timeout=SECONDS, resources={"metadata": {"path": str(FOLDER)}}
            ).execute()
            del notebook.cells[0]
            for k, cell in enumerate(code(notebook), 1):
                cell.execution_count = k
                cell.metadata.pop("execution", None)  # when it was run is nobody's business
                for output in cell.outputs:
                    if "execution_count" in output:
                        output.execution_count = k
            nbformat.write(notebook, out / path.name)
    finally:
        kernel.shutdown_kernel(now=True)


def code(notebook: Any) -> list[Any]:
    return [cell for cell in notebook.cells if cell.cell_type == "code"]


def said(cell: Any) -> Iterator[str]:
    """All text that a cell shows: prints, values, tables; of a picture its size in pixels alone.

    Prints are one text: in how many pieces a kernel sends them is chance."""
    printed = "".join(o.text for o in cell.outputs if o.output_type == "stream")
    if printed:
        yield printed
    for output in cell.outputs:
        for kind, content in sorted(output.get("data", {}).items()):
            yield (
                f"picture {base64.b64decode(content)[16:24].hex()}"
                if kind == "image/png"
                else content
            )


@pytest.fixture(scope="module")
def now(tmp_path_factory) -> Path:
    """The notebooks as they come out now; in a process of its own, whose sockets are its own
    affair."""
    folder = tmp_path_factory.mktemp("notebooks")
    ran = subprocess.run(
        [sys.executable, __file__, str(folder)], capture_output=True, text=True, check=False
    )
    assert ran.returncode == 0, ran.stderr
    return folder


@pytest.mark.slow
@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_a_notebook_shows_what_it_computes(path, now) -> None:
    import nbformat

    kept, new = (nbformat.read(p, as_version=4) for p in (path, now / path.name))
    nbformat.validate(kept)
    for before, after in zip(code(kept), code(new), strict=True):
        assert list(said(before)) == list(said(after)), f"{AGAIN}:\n{before.source}"


def test_gallery_is_whole_and_small() -> None:
    import nbformat

    assert len(NOTEBOOKS) == 4
    assert sum(path.stat().st_size for path in NOTEBOOKS) < ALL_BYTES
    for path in NOTEBOOKS:
        notebook = nbformat.read(path, as_version=4)
        assert not [
            line for cell in code(notebook) for line in cell.source.splitlines() if len(line) > 112
        ]  # fits a page
        shown = "".join(text for cell in code(notebook) for text in said(cell))
        assert "Traceback" not in shown
        assert str(FOLDER.parents[1]) not in path.read_text(encoding="utf-8")
        words = "".join(cell.source for cell in notebook.cells if cell.cell_type == "markdown")
        for link in re.findall(r"\]\(([\w./-]+)", words):
            assert (FOLDER / link).exists(), f"{path.name}: {link} does not exist"


if __name__ == "__main__":
    rewrite(Path(sys.argv[1]) if len(sys.argv) > 1 else FOLDER)
