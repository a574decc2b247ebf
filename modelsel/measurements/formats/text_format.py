"""How a text table is written: its encoding, what separates its cells, which lines are comments.

A rule, not a detector of languages: what is not UTF-8 or UTF-16 is Windows-1252. The detectors of
natural language need sentences; of a header with one degree sign charset-normalizer says Korean or
Cyrillic. Separators are found by the widths of the rows: of a table of numbers they hardly leave a
doubt, and csv.Sniffer takes a decimal comma for one."""

from __future__ import annotations

import codecs
import csv
import io
import re
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

from ...exceptions import DataError
from .number_format import is_number

BYTE_ORDER_MARKS = (
    (codecs.BOM_UTF32_LE, "utf-32"),
    (codecs.BOM_UTF32_BE, "utf-32"),
    (codecs.BOM_UTF8, "utf-8-sig"),
    (codecs.BOM_UTF16_LE, "utf-16"),
    (codecs.BOM_UTF16_BE, "utf-16"),
)
ENCODING_NAMES = {
    "utf-16": "UTF-16",
    "utf-16-le": "UTF-16",
    "utf-16-be": "UTF-16",
    "utf-32": "UTF-32",
    "cp1252": "Windows-1252",
}
SEPARATOR_NAMES = {",": "commas", ";": "semicolons", "\t": "tabs", "|": "vertical bars"}
BLANKS = " "
COMMENT_MARKS = ("#", "//", "%")
# a first line of Excel's that names the separator
EXCEL_HINT = "sep="
# bytes, and rows, from which a table's form is found
SAMPLE_BYTES = 200_000
SAMPLE_ROWS = 2000
BLOCK_BYTES = 1 << 20
# score from which a separator is not doubted (see `_score_rows`)
CLEAR_SCORE = 0.8
# a character of two bytes or more; in Windows-1252 it would be two or more signs and accents
UTF8_CHARACTER = re.compile(
    rb"[\xc2-\xdf][\x80-\xbf]|[\xe0-\xef][\x80-\xbf]{2}|[\xf0-\xf4][\x80-\xbf]{3}"
)


class Reader(Protocol):
    """Rows of cells, and the number of the lines read so far."""

    @property
    def line_num(self) -> int:
        """Lines read so far."""

    def __iter__(self) -> Iterator[list[str]]: ...

    def __next__(self) -> list[str]: ...


@dataclass(frozen=True)
class TextFormat:
    """How a text table is written; `separator` " " stands for any number of blanks and tabs."""

    encoding: str
    separator: str
    marks: tuple[str, ...] = COMMENT_MARKS


def sniff_text(path: Path) -> tuple[TextFormat, str]:
    """Find how a text file is written, and return its beginning too. Raises DataError for what is
    no text; OSError."""
    encoding = find_encoding(path)
    with path.open("rb") as file:
        head = file.read(SAMPLE_BYTES + 1)
    is_cut = len(head) > SAMPLE_BYTES
    decoder = codecs.getincrementaldecoder(encoding)()
    sample = decoder.decode(head, final=not is_cut)
    readable, zero, _ = sample.partition("\0")
    if zero and _is_table_text(readable):
        raise DataError(
            "bytes of zero follow, as in a file that was not written to its end.",
            file=path.name,
            line=1 + readable.count("\n"),
            remedy="Export the table again, or remove them.",
        )
    if zero or not sample.strip():
        raise DataError(
            "the file is empty or not text.",
            file=path.name,
            remedy="A table with a header line and a row per measured point is expected.",
        )
    if is_cut:
        sample = sample[: max(sample.rfind("\n"), sample.rfind("\r")) + 1]
    marks = _find_marks(sample)
    separator = _find_separator(sample, marks)
    return TextFormat(encoding, separator, marks), sample


def _is_table_text(text: str) -> bool:
    """Whether text has several lines, and nothing in them that cannot be seen."""
    lines = text.splitlines()
    joined = "".join(lines)
    plain = joined.replace("\t", " ")
    has_lines = len(lines) > 1
    return has_lines and plain.isprintable()


def find_encoding(path: Path) -> str:
    """Find a text file's encoding, by its byte-order mark or by all of its bytes. Raises DataError
    for a file that fits none."""
    with path.open("rb") as file:
        head = file.read(4096)
        for mark, encoding in BYTE_ORDER_MARKS:
            if head.startswith(mark):
                candidates = [encoding]
                break
        else:
            candidates = [*_guess_utf16(head), "utf-8", "cp1252"]
        for encoding in candidates:
            file.seek(0)
            blocks = iter(lambda: file.read(BLOCK_BYTES), b"")
            if encoding == "cp1252":
                blocks = _refuse_broken_utf8(blocks)
            if _can_decode(blocks, encoding):
                return encoding
    raise DataError(
        "the file cannot be read: it is not UTF-8 text, nor UTF-16 or Windows-1252.",
        file=path.name,
        remedy="Save it as CSV in UTF-8.",
    )


def _guess_utf16(head: bytes) -> list[str]:
    """List the forms of UTF-16 that a file without a mark may have: every other byte is zero."""
    if not head or len(head) < 2:
        return []
    half = len(head) // 2
    if head[1::2].count(0) > 0.8 * half:
        return ["utf-16-le"]
    if head[::2].count(0) > 0.8 * half:
        return ["utf-16-be"]
    return []


def _refuse_broken_utf8(blocks: Iterator[bytes]) -> Iterator[bytes]:
    """Pass blocks on until one has characters of UTF-8: a file of both is a damaged one. Raises
    UnicodeError."""
    for block in blocks:
        if UTF8_CHARACTER.search(block):
            raise UnicodeError("characters of UTF-8 in a file that is not UTF-8")
        yield block


def _can_decode(blocks: Iterable[bytes], encoding: str) -> bool:
    decoder = codecs.getincrementaldecoder(encoding)()
    try:
        for block in blocks:
            decoder.decode(block)
        decoder.decode(b"", final=True)
    except UnicodeError:
        return False
    return True


# -- comments
# --------------------------------------------------------------------------------------------


def _find_marks(sample: str) -> tuple[str, ...]:
    """List the marks that begin comments: not one that begins most lines, as in names like #1."""
    lines = [line.lstrip() for line in sample.splitlines() if line.strip()]
    return tuple(
        mark
        for mark in COMMENT_MARKS
        if sum(line.startswith(mark) for line in lines) <= len(lines) / 2
    )


def mask_comments(
    lines: Iterable[str], marks: tuple[str, ...], comments: dict[int, str]
) -> Iterator[str]:
    """Empty the lines that are comments, and keep them in `comments` by number; a line inside
    quotes is none."""
    quoted = False
    for number, line in enumerate(lines, 1):
        bare = line.lstrip()
        is_comment = bare.startswith(marks)
        if number == 1:
            is_comment = is_comment or _is_excel_hint(bare)
        if is_comment and not quoted:
            comments[number] = bare.rstrip()
            yield "\n"
            continue
        if '"' in line and line.count('"') % 2:
            quoted = not quoted
        yield line


def refuse_open_quote(path: Path, form: TextFormat) -> None:
    """Refuse a file without rows because a quotation mark is not closed. Raises DataError."""
    opened = 0
    with path.open(encoding=form.encoding, errors="replace") as file:
        for number, line in enumerate(file, 1):
            if line.count('"') % 2:
                opened = 0 if opened else number
    if opened:
        raise DataError(
            "an open quotation mark: everything after it is one cell.",
            file=path.name,
            line=opened,
            remedy="Close it, or remove it.",
        )


def _is_excel_hint(line: str) -> bool:
    """Whether a line is Excel's own, that names the separator."""
    hint = line.rstrip().lower()
    names_one = len(hint) == len(EXCEL_HINT) + 1
    return names_one and hint.startswith(EXCEL_HINT)


# -- rows
# --------------------------------------------------------------------------------------------


def split_rows(lines: Iterable[str], separator: str) -> Reader:
    """Split lines into rows of cells; `line_num` counts the lines."""
    if separator == BLANKS:
        words = (line.split() for line in lines)
        joined = ("\t".join(cells) for cells in words)
        return csv.reader(joined, delimiter="\t")
    return csv.reader(lines, delimiter=separator)


def sample_rows(text: str, form: TextFormat) -> tuple[list[list[str]], list[int], dict[int, str]]:
    """Split a sample into (rows, the lines they end on, its comments by line)."""
    comments: dict[int, str] = {}
    file = io.StringIO(text, newline="")
    lines = mask_comments(file, form.marks, comments)
    reader = split_rows(lines, form.separator)
    rows, ends = [], []
    for row in reader:
        rows.append(row)
        ends.append(reader.line_num)
        if len(rows) == SAMPLE_ROWS:
            break
    return rows, ends, comments


def _find_separator(sample: str, marks: tuple[str, ...]) -> str:
    """Find what separates the cells: what gives rows of one width, and most numbers."""
    first_line, _, _ = sample.partition("\n")
    if _is_excel_hint(first_line):
        return first_line.rstrip()[-1]
    scores = {}
    for separator in SEPARATOR_NAMES:
        form = TextFormat("", separator, marks)
        scores[separator] = _score_rows(sample, form)
    best = max(scores, key=lambda separator: scores[separator])
    share, _ = scores[best]
    if share >= CLEAR_SCORE:
        return best
    # blanks stand within cells as well
    form = TextFormat("", BLANKS, marks)
    share_by_blanks, _ = _score_rows(sample, form)
    return BLANKS if share_by_blanks > share else best


def _score_rows(sample: str, form: TextFormat) -> tuple[float, float]:
    """Score a separator: (share of the rows that have the usual width, times the share of their
    cells that are numbers; the width)."""
    try:
        rows = sample_rows(sample, form)[0]
    except csv.Error:
        return 0.0, 0.0
    filled = [row for row in rows if any(cell.strip() for cell in row)]
    widths = Counter(len(row) for row in filled if len(row) > 1)
    if not widths:
        return 0.0, 0.0
    width, count = max(widths.items(), key=lambda item: (item[1], item[0]))
    usual = [row for row in filled if len(row) == width]
    numbers = sum(_count_numbers(row) for row in usual)
    share = numbers / (width * count)
    return round(count / len(filled) * (0.1 + share), 2), float(width)


def _count_numbers(row: Sequence[str]) -> int:
    numbers = filter(is_number, row)
    return len(list(numbers))
