"""report.pdf: blocks and pictures through the typst compiler, offline, tagged PDF/UA-1, the same
bytes for the same input."""

from __future__ import annotations

import json
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import partial
from importlib.resources import files
from importlib.util import find_spec
from pathlib import Path
from typing import Any, NamedTuple

from ..exceptions import ModelselError
from ..results.schemas.schema import StudyRecord
from .document import Block, Source
from .section_order import Section, arrange, split_sections
from .style import shorten

SUSPECTS = b"/Suspects false"
LONGEST_HEADER = 70  # letters
LAST_ASCII = 127
BOXES = "LastResort"  # the font that has a box for every letter
# share of the last page that is filled, below which less room between the blocks is tried
MIN_LAST = 0.4
# shares of the usual room that are tried, the last with smaller pictures
ROOMS = ("0.6", "0.5")
FULL = "1"


class ReportError(ModelselError):
    """The report could not be made of what there is; result.json stands."""


class _Typeset(NamedTuple):
    """How a report is set: how many pages there are, the filled share of the last, and the white before each
    large picture, as a share of its page."""

    pages: int
    last: float
    white: list[float]


def fill_template(source: Source, blocks: Sequence[Block]) -> dict[str, Any]:
    """Return the template's data."""
    record = source.record
    return {
        "title": f"Calibration report: {record.study}",
        "short": shorten(record.study, LONGEST_HEADER),
        # one name stands once
        "robot": "" if record.robot == record.study else record.robot,
        "made": _sign(record),
        "blocks": blocks,
    }


def _sign(record: StudyRecord) -> str:
    """Return the foot of every page: what made it, and of which data and study."""
    data, study = (sha256[:8] for sha256 in record.provenance.run)
    return f"modelsel {record.provenance.modelsel} · data {data} · study {study}"


def compile_pdf(
    content: Mapping[str, Any], pictures: Mapping[str, bytes]
) -> tuple[bytes, list[str]]:
    """Return (the PDF, the compiler's warnings) of the template with its data: with less room between the blocks where
    that spares a last page that is nearly empty. Raises ReportError with the compiler's own words."""
    sections = split_sections(content["blocks"])
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        _write_inputs(folder, pictures)
        order, chosen = arrange(sections, partial(_set, folder, content))
        fullest = FULL
        if chosen.pages > 1 and chosen.last < MIN_LAST:
            order, fullest = _spare_last(folder, content, order, chosen)
        return _export(folder, content, order, fullest)


def _spare_last(
    folder: Path, content: Mapping[str, Any], order: list[Section], chosen: _Typeset
) -> tuple[list[Section], str]:
    """Return the order and the room that spare the last page, those that are there where none do: less
    room first, and sections in other places then."""
    spared = chosen.pages - 1
    for room in ROOMS:
        typeset = partial(_set, folder, content, room=room)
        tight_order, tight = arrange(order, typeset)
        if tight.pages <= spared:
            return tight_order, room
    # what stands on the last page may fit into the white of the others
    if sum(tight.white) >= tight.last:
        tight_order, tight = arrange(tight_order, typeset, spared)
    if tight.pages <= spared:
        return tight_order, room
    return order, FULL


def _set(
    folder: Path, content: Mapping[str, Any], sections: Sequence[Section], room: str = FULL
) -> _Typeset:
    """Set the sections in this order, with this share of the usual room between them; writing the PDF would
    take half as long again."""
    compiler = _open_compiler(folder, content, sections, room)
    with _refusing():
        end = json.loads(compiler.query("<end>", field="value", one=True))
        white = json.loads(compiler.query("<white>", field="value"))
    return _Typeset(end["pages"], end["share"], white)


def _export(
    folder: Path, content: Mapping[str, Any], sections: Sequence[Section], room: str
) -> tuple[bytes, list[str]]:
    """Set the sections, and return (the PDF, the compiler's warnings)."""
    compiler = _open_compiler(folder, content, sections, room)
    with _refusing():
        pdf, warnings = compiler.compile_with_warnings(
            format="pdf", pdf_standards="ua-1", timestamp=0
        )
    # false is what a reader takes where the key is missing; poppler calls it an error where it is written
    written = pdf.replace(SUSPECTS, b" " * len(SUSPECTS))
    return written, [warning.message for warning in warnings]


@contextmanager
def _refusing() -> Iterator[None]:
    """Raise ReportError with the compiler's own words where it fails."""
    import typst

    try:
        yield
    except typst.TypstError as error:
        words = f"{error.message} {' '.join(error.hints)}".strip()
        raise ReportError(f"report.pdf could not be made: {words}") from None


def _write_inputs(folder: Path, pictures: Mapping[str, bytes]) -> None:
    template = files(__package__) / "templates" / "report.typ"
    (folder / "template.typ").write_bytes(template.read_bytes())
    for file, picture in pictures.items():
        (folder / file).write_bytes(picture)


def _open_compiler(
    folder: Path, content: Mapping[str, Any], sections: Sequence[Section], room: str
) -> Any:
    """Write the sections in this order, and return the compiler of the template with them."""
    import typst

    blocks: list[Block] = []
    for section in sections:
        blocks += section
    ordered = {**content, "blocks": blocks}
    data = json.dumps(ordered, ensure_ascii=False)
    (folder / "report.json").write_text(data, encoding="utf-8")
    fonts = typst.Fonts(
        include_system_fonts=False, include_embedded_fonts=False, font_paths=[font_folder()]
    )
    return typst.Compiler(
        folder / "template.typ",
        root=folder,
        ignore_system_fonts=True,
        font_paths=fonts,
        sys_inputs={"room": room},
    )


def find_missing_letters(content: Mapping[str, Any]) -> str:
    """Return the letters of a content that no font of the PDF has, each once, in their order; they become
    boxes."""
    from matplotlib.ft2font import FT2Font

    text = json.dumps(content, ensure_ascii=False)
    missing = [letter for letter in dict.fromkeys(text) if ord(letter) > LAST_ASCII]
    folder = font_folder()
    for file in sorted(folder.glob("*.ttf")):
        if not missing:
            break
        if file.name.startswith(BOXES):
            continue
        font = FT2Font(str(file))  # older versions take no Path
        known = font.get_charmap()
        missing = [letter for letter in missing if ord(letter) not in known]
    return "".join(missing)


def font_folder() -> Path:
    """Return the folder with DejaVu Sans, which matplotlib brings along: the same letters on every machine."""
    # found without importing it, which takes a tenth of a second
    specification = find_spec("matplotlib")
    if specification is None or specification.origin is None:
        raise ImportError("matplotlib is not installed")
    return Path(specification.origin).parent / "mpl-data" / "fonts" / "ttf"
