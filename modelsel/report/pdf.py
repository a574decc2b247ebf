"""report.pdf: blocks and pictures through the typst compiler, offline, tagged PDF/UA-1, the same
bytes for the same input."""

from __future__ import annotations

import json
import tempfile
from importlib.resources import files
from pathlib import Path
from typing import Any

from ..exceptions import ModelselError
from ..results.storage import Source
from .document import Block
from .style import shortened


class ReportError(ModelselError):
    """The report could not be made of what there is; result.json stands."""


def fonts() -> Path:
    """The folder with DejaVu Sans, which matplotlib brings along: the same letters on every
    machine."""
    import matplotlib as mpl

    return Path(mpl.get_data_path()) / "fonts" / "ttf"


def compiled(content: dict[str, Any], pictures: dict[str, bytes]) -> tuple[bytes, list[str]]:
    """(the PDF, the compiler's warnings) of the template with its data. Raises ReportError with the
    compiler's own words."""
    import typst

    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "report.json").write_text(
            json.dumps(content, ensure_ascii=False), encoding="utf-8"
        )
        (folder / "template.typ").write_bytes(
            (files(__package__) / "templates" / "report.typ").read_bytes()
        )
        for file, picture in pictures.items():
            (folder / file).write_bytes(picture)
        compiler = typst.Compiler(
            folder / "template.typ",
            root=folder,
            ignore_system_fonts=True,
            font_paths=typst.Fonts(
                include_system_fonts=False, include_embedded_fonts=False, font_paths=[fonts()]
            ),
        )
        try:
            out, warnings = compiler.compile_with_warnings(
                format="pdf", pdf_standards="ua-1", timestamp=0
            )
        except typst.TypstError as error:
            raise ReportError(
                f"report.pdf could not be made: {error.message} {' '.join(error.hints)}".strip()
            ) from None
    assert isinstance(out, bytes)
    return out, [w.message for w in warnings]


def content(source: Source, blocks: list[Block]) -> dict[str, Any]:
    """The template's data."""
    result = source.result
    return {
        "title": f"Calibration report: {result['study']}",
        "short": shortened(result["study"], 70),
        "robot": result["robot"],
        "made": f"modelsel {result['provenance']['modelsel']}",
        "blocks": blocks,
    }
