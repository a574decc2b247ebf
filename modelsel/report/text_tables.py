"""Tables of plain text that fit a terminal: words are never broken, figures stand below their head."""

from __future__ import annotations

import textwrap
from collections.abc import Mapping, Sequence
from itertools import zip_longest
from typing import NamedTuple

# between columns; the narrow one where the words would else be broken
WIDE_GAP, NARROW_GAP = "  ", " "
# columns that words have at least
MIN_ROOM = 12
# binds the + of a list of names to the name that follows it: no blank of textwrap's
BOUND = "\N{NO-BREAK SPACE}"


class Row(NamedTuple):
    """A row: words, then a figure per column, then more words; `remark` stands below it."""

    words: str
    figures: Sequence[str]
    last: str = ""
    remark: str = ""


class Span(NamedTuple):
    """A head above the heads, a line each, of several columns of figures, from `first` to `last`."""

    words: str
    first: int
    last: int


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


def fold_names(text: str, width: int) -> list[str]:
    """Wrap names that are joined by + into lines: a line begins with the +, none ends with it."""
    lines = fold_text(_bind(text), width)
    return [line.replace(BOUND, " ") for line in lines]


def _bind(text: str) -> str:
    return text.replace(" + ", f" +{BOUND}")


def _longest_word(texts: Sequence[str]) -> int:
    """Return the length of the longest word, with the + before it."""
    return max((len(word) for text in texts for word in _bind(text).split(" ")), default=0)


def write_table(
    first: str,
    heads: Sequence[str],
    last: str,
    rows: Sequence[Row],
    width: int,
    spans: Sequence[Span] = (),
) -> list[str]:
    """Write a table into lines of at most `width` columns.

    first, heads, last: what stands above the words, the figures, the last words; folded at blanks.
    spans: what stands above several of the heads.
    """
    layout = _choose_layout(first, heads, rows, width)
    lines = _write_head(first, heads, last, layout)
    if spans and len(lines) == 1:
        lines.insert(0, "")
    for span in spans:
        above = lines[-2]
        lines[-2] = _write_span(above, span, layout)
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
    longest = max(_longest_word(words), MIN_ROOM)
    lasts = [row.last for row in rows]
    last, least = max(map(len, lasts)), max(_longest_word(lasts), MIN_ROOM)
    wanted = min(needed, longest) + (min(last, least) + len(WIDE_GAP) if last else 0)
    gap, room = _choose_gap(width - sum(sizes), len(sizes), wanted)
    if last:
        last = min(last, max(room - longest - len(gap), least))
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


def _write_span(above: str, span: Span, layout: _Layout) -> str:
    """Write a span into the line above its heads, in the middle over them."""
    before = [layout.first, *layout.figures[: span.first]]
    sizes = layout.figures[span.first : span.last + 1]
    start = sum(before) + len(layout.gap) * len(before)
    room = sum(sizes) + len(layout.gap) * (len(sizes) - 1)
    line = above.ljust(start + room)
    return (line[:start] + span.words.center(room) + line[start + room :]).rstrip()


def _write_row(row: Row, layout: _Layout, width: int) -> list[str]:
    words = fold_names(row.words, layout.first)
    lines: list[str] = []
    if any(len(line) > layout.first for line in words):
        # a word wider than its column has lines of its own
        lines = fold_names(row.words, width)
        words = []
    blank = [""] * len(row.figures)
    more = fold_names(row.last, layout.last) if row.last else []
    below = zip_longest(words[1:], more[1:], fillvalue="")
    lines.append(layout.join("".join(words[:1]), row.figures, "".join(more[:1])))
    lines += [layout.join(one, blank, another) for one, another in below]
    return lines + fold_text(row.remark, width, "    ")


def write_numbered_tables(
    groups: Sequence[Mapping[str, Sequence[str]]], width: int
) -> list[list[str]]:
    """Write columns of figures, numbered from 1, into as few tables as fit: groups that have no room
    beside those before them stand in a table below, one that is too wide in several."""
    parts = [part for group in groups for part in _split_group(group, width)]
    tables: list[dict[str, Sequence[str]]] = []
    for part in parts:
        if tables and _measure_columns(tables[-1] | dict(part)) <= width:
            tables[-1] |= part
        else:
            tables.append(dict(part))
    return [_write_numbered(table) for table in tables]


def _split_group(group: Mapping[str, Sequence[str]], width: int) -> list[dict[str, Sequence[str]]]:
    """Split columns into runs that fit, each of one column at least."""
    runs: list[dict[str, Sequence[str]]] = []
    for name, figures in group.items():
        if runs and _measure_columns(runs[-1] | {name: figures}) <= width:
            runs[-1][name] = figures
        else:
            runs.append({name: figures})
    return runs


def _measure_columns(columns: Mapping[str, Sequence[str]]) -> int:
    """Return how wide columns are with their numbers and a blank between them."""
    numbers = len(str(max(map(len, columns.values()))))
    return numbers + sum(1 + _measure_column(name, figures) for name, figures in columns.items())


def _measure_column(name: str, figures: Sequence[str]) -> int:
    return max(map(len, [name, *figures]))


def _write_numbered(columns: Mapping[str, Sequence[str]]) -> list[str]:
    count = max(map(len, columns.values()))
    cells = [["", *map(str, range(1, count + 1))]]
    cells += [[name, *figures] for name, figures in columns.items()]
    sizes = [max(map(len, column)) for column in cells]
    return [
        " ".join(cell.rjust(size) for cell, size in zip(line, sizes, strict=True))
        for line in zip(*cells, strict=True)
    ]
