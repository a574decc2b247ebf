"""Where a table's header is, and what stands around it: titles above, a row of units below, names
in two rows."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, TypeAlias

from .column_names import parse_column_name
from .number_format import is_number

Row: TypeAlias = Sequence[Any]
# columns of a measurements file as the contract names them: they need no guess
CONTRACT_NAME = re.compile(r"q[0-9]{1,9}_(rad|deg|mm|m)|[xyz]_(mm|m)")
UNIT = re.compile(
    r"[\[(<{]?\s*(°|°\s?[CF]|º|deg|degree|degrees|grad|gradians?|gons?|rad|mrad|[µμu]rad|nm|[µμu]m|mm|cm|dm|m|in"
    r"|inch|ft|kg|g|lb|s|sec|ms|min|h|hz|k|c|n|nm|a|v|%|-|–|/|1)\s*[\])>}]?",
    re.IGNORECASE,
)
NO_UNIT = re.compile(r"[\[(]?\s*[-–/1]?\s*[\])]?")
# of a remark: a word of letters, and how many there are at least
WORD = re.compile(r"[^\W\d_]{2,}")
MIN_REMARK_WORDS = 3
# share of a data row's cells that a header fills
MIN_HEADER_SHARE = 0.7
# joints that a header numbers, and words beside them, at least
MIN_NUMBERED = 3
# of a quaternion, beside x, y and z
FOURTH = "w"
# rows that a row of numbers may stand above the names
MAX_NUMBERED_ROWS = 4


@dataclass(frozen=True)
class Layout:
    """The header of a table: its names, its row and the number of rows, from the first, that come
    before the data; the units that stand below a name."""

    names: list[str]
    header: int
    skipped: int
    units: dict[str, str] = field(default_factory=dict)


def is_blank_row(row: Row) -> bool:
    """Whether no cell of a row holds anything."""
    filled = map(_as_text, row)
    return not any(filled)


def is_remark(row: Row, width: int) -> bool:
    """Whether a row that has not `width` cells is a sentence below or between the rows, whatever
    separates its words: three words or more, and far fewer numbers than words."""
    if len(row) == width:
        return False
    text = " ".join(_as_text(cell) for cell in row)
    words = len(WORD.findall(text))
    numbers = sum(map(is_number, row))
    return words >= MIN_REMARK_WORDS and MIN_REMARK_WORDS * numbers <= words


def advise_on_width(row: Sequence[str], width: int, separator: str) -> str:
    """Say what to do about a row that has not `width` cells; `separator`: what is between them."""
    marks = {separator, "\n", "\r"} - {" "}
    is_joined = any(mark in cell for cell in row for mark in marks)
    is_wide = len(row) > width
    beyond = row[width:]
    if is_joined and not is_wide:
        return "A quotation mark joins several cells into one: close it, or remove it."
    if is_wide and is_blank_row(beyond):
        return "The cells after the last column are empty: remove the separators at the row's end."
    remedy = "Every row needs as many cells as the header."
    if is_wide and separator == ",":
        remedy += " Numbers need a decimal point: a comma separates cells."
    return remedy


def find_layout(rows: Sequence[Row]) -> Layout | None:
    """Find the header among the first rows of a table; None where a table begins with numbers."""
    header = _find_header(rows)
    if header is None:
        return None
    names = [_as_text(cell) for cell in rows[header]]
    above = [row for row in rows[:header] if not is_blank_row(row)]
    if above:
        names = _complete_names(names, _choose_spanning(names, above))
    skipped = header + 1
    units: dict[str, str] = {}
    below = next((k for k in range(skipped, len(rows)) if not is_blank_row(rows[k])), None)
    if below is not None and _is_unit_row(rows[below]):
        cells = [_as_text(cell) for cell in rows[below]]
        pairs = zip(names, cells, strict=False)
        units = {name: cell for name, cell in pairs if not NO_UNIT.fullmatch(cell)}
        skipped = below + 1
    return Layout(names, header, skipped, units)


def _find_header(rows: Sequence[Row]) -> int | None:
    """Find the row of the names: one with the contract's, else the first that holds no number and
    fills as many cells as the data below."""
    filled = [k for k, row in enumerate(rows) if not is_blank_row(row)]
    for k in filled:
        if sum(CONTRACT_NAME.fullmatch(_as_text(cell)) is not None for cell in rows[k]) > 1:
            return k
    counts = Counter(_count_filled(rows[k]) for k in filled)
    usual = max(counts, key=lambda width: (counts[width], width), default=0)
    first = next((k for k in filled if _is_data_row(rows[k], usual)), None)
    if first is not None and _numbers_its_columns(rows[first:]):
        return first
    if first is None:
        widest = [k for k in filled if _count_filled(rows[k]) == usual]
        return widest[0] if widest else None
    above = [k for k in filled if k < first]
    wide = [k for k in filled if k < first + MAX_NUMBERED_ROWS and _is_wide(rows[k], usual)]
    below = [k for k in wide if k > first and _count_quantities(rows[k]) >= MIN_NUMBERED]
    wide = [k for k in wide if k < first]
    # a row that numbers the markers, above the names
    if below and not any(map(_count_quantities, map(rows.__getitem__, wide))):
        return below[0]
    if wide:
        # the first of those that name most joints and coordinates
        return max(wide, key=lambda k: _count_quantities(rows[k]))
    named = [k for k in above if not _is_unit_row(rows[k])]
    return named[-1] if named else None


def _is_wide(row: Row, usual: int) -> bool:
    """Whether a row may be a header: nearly as wide as usual, without a number."""
    count = _count_filled(row)
    return count >= MIN_HEADER_SHARE * usual and not any(map(is_number, row))


def _count_quantities(row: Row) -> int:
    """Count the cells of a row that are called as joints or coordinates are."""
    names = [parse_column_name(_as_text(cell)) for cell in row]
    return sum(name.quantity is not None for name in names)


def _is_data_row(row: Row, usual: int) -> bool:
    """Whether a row is one of measurements: as wide as usual, a third of it or more numbers."""
    count = _count_filled(row)
    numbers = sum(map(is_number, row))
    return count >= 0.6 * usual and numbers >= max(2, count / 3)


def _numbers_its_columns(rows: Sequence[Row]) -> bool:
    """Whether the first row is a header that numbers the joints below a cell that spans them: Nr 1
    2 3 4 5 6 X Y Z, its other cells words above numbers."""
    header, *below = rows
    numbers = [_as_text(cell) for cell in header if is_number(cell)]
    count = len(numbers)
    expected = [str(k + 1) for k in range(count)]
    filled = [row for row in below if not is_blank_row(row)]
    data = [row for row in filled if not _is_unit_row(row)]
    if count < MIN_NUMBERED or numbers != expected or not data:
        return False
    named = 0
    for name, value in zip(header, data[0], strict=False):
        is_word = bool(_as_text(name)) and not is_number(name)
        named += is_word and is_number(value)
    return named >= MIN_NUMBERED


def _is_unit_row(row: Row) -> bool:
    cells = [_as_text(cell) for cell in row if _as_text(cell)]
    has_unit = any(not NO_UNIT.fullmatch(cell) for cell in cells)
    return has_unit and all(UNIT.fullmatch(cell) for cell in cells)


def _choose_spanning(names: Sequence[str], above: Sequence[Row]) -> Row:
    """Choose the row that stands before names: the one just above them, unless it leaves two alike
    where a row of words further up, such as that of the markers, does not."""
    nearest = above[-1]
    for row in above[::-1]:
        complete = list(filter(None, _complete_names(names, row)))
        is_distinct = len(set(complete)) == len(complete)
        if is_distinct and not any(map(is_number, row)):
            return row
    return nearest


def _complete_names(names: Sequence[str], above: Row) -> list[str]:
    """Complete names of two rows: a cell that spans several columns stands before names that occur
    twice or are numbers, before the W beside such an X Y Z, and for those that are empty."""
    filled, last = list[str](), ""
    for cell in above:
        last = _as_text(cell) or last
        filled.append(last)
    filled += [last] * (len(names) - len(filled))
    alone = [_as_text(cell) for cell in above] + [""] * len(names)
    counts = Counter(names)
    is_twice = [bool(name) and (counts[name] > 1 or is_number(name)) for name in names]
    spanned = {filled[k] for k in range(len(names)) if is_twice[k]}
    complete = []
    for k, name in enumerate(names):
        is_fourth = name.lower() == FOURTH and filled[k] in spanned
        longer = name
        if is_twice[k] or is_fourth:
            longer = f"{filled[k]} {name}".strip()
        complete.append(longer or alone[k])
    return complete


def _count_filled(row: Row) -> int:
    filled = filter(_as_text, row)
    return len(list(filled))


def _as_text(cell: Any) -> str:
    if cell is None:
        return ""
    text = str(cell)
    return text.strip()
