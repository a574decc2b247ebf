"""A report as values: blocks in order and the pictures they show; `collect_blocks` gathers the chosen pages."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import zip_longest
from typing import Any

from .._progress import News, keep_silent
from .._typing import Say
from ..exceptions import StudyError, suggest
from ..measurements.formats.row_places import Where, where_from_record
from ..results.schemas.details_schema import DetailsRecord
from ..results.schemas.schema import StudyRecord

Block = dict[str, Any]
# kinds of blocks that words may introduce
SHOWN = ("table", "figure", "beside")
# a hyphen that stands for a minus: before a number, after a blank
HYPHEN = re.compile(r"(?<=\s)-(?=\d)")
# letters of a cell that is not broken
MAX_WHOLE = 16


@dataclass(frozen=True, eq=False)
class Source:
    """What a report is made of: the records of a study, and its pictures by file name, drawn by its pages or ahead of
    them."""

    record: StudyRecord
    details: DetailsRecord
    pictures: dict[str, bytes] = field(default_factory=dict)

    @property
    def where(self) -> Where:
        """What the user calls the rows of the measurements."""
        places = self.details.places
        return where_from_record(None if places is None else places.to_dict())

    def add_figure(self, name: str, draw: Callable[[], bytes], caption: str, alt: str) -> Block:
        """Draw a picture unless it is drawn already, and return its block: a caption that says what to see and a text
        for those who cannot."""
        file = f"{name}.svg"
        is_new = file not in self.pictures
        if is_new:
            self.pictures[file] = draw()
        return {"kind": "figure", "file": file, "caption": caption, "alt": alt}


def keep_together(blocks: Sequence[Block]) -> Block:
    """Return blocks that stand on one page, a large picture with its heading and its words. Where a page has
    no room for them, the picture is made a little smaller, or another section comes first."""
    return {"kind": "together", "blocks": list(blocks)}


def make_heading(text: str, level: int = 1, opens: bool = False) -> Block:
    """Return a heading; it opens a page if told so."""
    return {"kind": "heading", "text": text, "level": level, "opens": opens}


def use_minus(words: str) -> str:
    """Return words in which numbers have a true minus sign, as in the tables; formulas stay."""
    return HYPHEN.sub("−", words)


def make_text(words: str, style: str = "body", keep: bool = False) -> Block:
    """Return a paragraph; style body, quiet or lead; kept on one page with what follows if told so."""
    return {"kind": "text", "text": use_minus(words), "style": style, "keep": keep}


def make_table(
    columns: Sequence[tuple[str, str]],
    rows: Sequence[Sequence[str]],
    caption: str = "",
    widths: Sequence[float] | None = None,
) -> Block:
    """Return a table: (name, "left" or "right") of each column, rows of text, relative widths (0: as narrow as the
    text)."""
    return {
        "kind": "table",
        "columns": [{"name": name, "align": align} for name, align in columns],
        "rows": [list(row) for row in rows],
        "caption": caption,
        "widths": list(widths or [0.0] * len(columns)),
    }


def share_room(texts: Sequence[str], share: float) -> float:
    """Return the relative width of a table's column: its share of the room where a text is long enough to be
    broken, else 0, as narrow as the text."""
    longest = max(map(len, texts), default=0)
    return share if longest > MAX_WHOLE else 0.0


def put_beside(left: Sequence[Block], right: Sequence[Block], right_mm: float = 80.0) -> Block:
    """Return blocks in two columns, on one page."""
    return {"kind": "beside", "left": list(left), "right": list(right), "right_mm": right_mm}


def walk_blocks(blocks: Sequence[Block]) -> Iterator[Block]:
    """Yield every block, those in columns too, in reading order."""
    for block in blocks:
        yield block
        if block["kind"] == "beside":
            yield from walk_blocks([*block["left"], *block["right"]])
        if block["kind"] == "together":
            yield from walk_blocks(block["blocks"])


def make_list(items: Sequence[str]) -> Block:
    """Return a list of sentences."""
    return {"kind": "points", "items": list(map(use_minus, items))}


Page = Callable[[Source], list[Block]]


def collect_blocks(
    source: Source,
    pages: Mapping[str, Page],
    chosen: Sequence[str] | None = None,
    say: Say = keep_silent,
) -> list[Block]:
    """Return the blocks of the chosen pages (all without), in the report's own order. Raises StudyError for an unknown
    page."""
    unknown = [name for name in chosen or () if name not in pages]
    if unknown:
        names = ", ".join(pages)
        raise StudyError(
            *(
                f'pages: no page "{name}". {suggest(name, pages)} Pages: {names}.'
                for name in unknown
            )
        )
    blocks: list[Block] = []
    wanted = [name for name in pages if chosen is None or name in chosen]
    for number, name in enumerate(wanted):
        say(News(name, number / len(wanted)))
        write_page = pages[name]
        blocks += write_page(source)
    return bind_words(blocks)


def bind_words(blocks: Sequence[Block]) -> list[Block]:
    """Keep the words right before a table or a picture on one page with it, but for the lead of the first page."""
    bound: list[Block] = []
    for block, following in zip_longest(blocks, blocks[1:]):
        is_text = block["kind"] == "text" and block["style"] != "lead"
        is_shown = following is not None and following["kind"] in SHOWN
        bound.append(block | {"keep": True} if is_text and is_shown else block)
    return bound
