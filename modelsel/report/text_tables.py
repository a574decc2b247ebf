"""Tables of plain text that fit a terminal: words are never broken, figures stand below their head."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence
from itertools import zip_longest
from typing import NamedTuple

# between columns; the narrow one where the words would else be broken
WIDE_GAP, NARROW_GAP = "  ", " "
# columns that words have at least
MIN_ROOM = 12


class Row(NamedTuple):
    """A row: words, then a figure per column, then more words; `remark` stands below it."""

    words: str
    figures: Sequence[str]
    last: str = ""
    remark: str = ""


class _Layout(NamedTuple):
    """The widths of the columns: words, figures, and the last words if there are any."""

    first: int
    figures: Sequence[int]
    last: int
    gap: str

    def join(self, words: str, figures: Sequence[str], last: str) -> str:
        """Join the cells of one line: words to the left, figures to the right."""
        cells = [words.ljust(self.first)]
        cells += [text.rjust(size) for text, size in zip(figures, self.figures, strict=True)]
        return self.gap.join([*cells, last]).rstrip()

    @property
    def total(self) -> int:
        """The width of all columns."""
        sizes = [self.first, *self.figures, *([self.last] if self.last else [])]
        return sum(sizes) + len(self.gap) * (len(sizes) - 1)


def fold_text(text: str, width: int, indent: str = "", hanging: str | None = None) -> list[str]:
    """Wrap a text into lines at its blanks; a word that is wider than the width stays whole."""
    return textwrap.wrap(
        text,
        width,
        initial_indent=indent,
        subsequent_indent=indent if hanging is None else hanging,
        break_long_words=False,
        break_on_hyphens=False,
    )


def write_table(
    first: str, heads: Sequence[str], last: str, rows: Sequence[Row], width: int
) -> list[str]:
    """Write a table into lines of at most `width` columns.

    first, heads, last: what stands above the words, the figures, the last words; folded at blanks.
    """
    layout = _choose_layout(first, heads, rows, width)
    lines = _write_head(first, heads, last, layout)
    rule = "─" * layout.total
    lines.append(rule)
    for row in rows:
        lines += _write_row(row, layout, width)
    return lines


def _choose_layout(first: str, heads: Sequence[str], rows: Sequence[Row], width: int) -> _Layout:
    columns = zip(heads, zip(*(row.figures for row in rows), strict=True), strict=True)
    sizes = [max(len(text) for text in (*head.split(), *figures)) for head, figures in columns]
    words = [first, *(row.words for row in rows)]
    needed = max(len(text) for text in words)
    longest = max(len(word) for text in words for word in text.split())
    gap, room = _choose_gap(width - sum(sizes), len(sizes), min(needed, longest + len("+ ")))
    last = max(len(row.last) for row in rows)
    if last:
        last = min(last, max(room - longest - len(gap), MIN_ROOM))
        room -= last + len(gap)
    return _Layout(max(min(needed, room), MIN_ROOM), sizes, last, gap)


def _choose_gap(room: int, gaps: int, wanted: int) -> tuple[str, int]:
    """Return what stands between columns, and the room that it leaves to the words."""
    gap = WIDE_GAP if room - len(WIDE_GAP) * gaps >= wanted else NARROW_GAP
    return gap, room - len(gap) * gaps


def _write_head(first: str, heads: Sequence[str], last: str, layout: _Layout) -> list[str]:
    """Write the heads; all end on the line above the rule."""
    columns = [fold_text(first, layout.first)]
    columns += [fold_text(head, size) for head, size in zip(heads, layout.figures, strict=True)]
    columns.append([last] if layout.last else [])
    height = max(len(column) for column in columns)
    padded = [[""] * (height - len(column)) + column for column in columns]
    return [
        layout.join(words, figures, more) for words, *figures, more in zip(*padded, strict=True)
    ]


def _write_row(row: Row, layout: _Layout, width: int) -> list[str]:
    words = fold_text(row.words, layout.first)
    lines: list[str] = []
    if any(len(line) > layout.first for line in words):
        # a word wider than its column has lines of its own
        lines = fold_text(row.words, width)
        words = []
    blank = [""] * len(row.figures)
    more = fold_text(row.last, layout.last) if row.last else []
    below = zip_longest(words[1:], more[1:], fillvalue="")
    lines.append(layout.join("".join(words[:1]), row.figures, "".join(more[:1])))
    lines += [layout.join(one, blank, another) for one, another in below]
    return lines + fold_text(row.remark, width, "    ")
