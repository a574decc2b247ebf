"""Names that people give to studies, robots, targets, groups and columns: what they may hold, and
how a CSV for people has them.

A name is data: it is never run, nor pasted into code, markup or a path. Every printable character
is allowed, in any writing. Refused are those that nobody sees but that change what is read: control
and direction-changing characters, zero-width ones, half of a surrogate pair. So no output has to
escape, cut or isolate a name in a way of its own."""

from __future__ import annotations

import keyword
import re
import unicodedata

MAX_NAME_LENGTH = 200  # characters of a name
MAX_TEXT_LENGTH = 4000  # characters of a source or a sentence
HIDDEN_CATEGORIES = frozenset(("Cc", "Cf", "Cs", "Zl", "Zp"))  # categories of Unicode
JOINERS = "\u200c\u200d"  # of Persian and Indic letters, and of emoji: they are part of a word
FORMULA = re.compile(
    r"[=+\-@\t\r\n\uff1d\uff0b\uff0d\uff20]"
)  # starts one in a spreadsheet; full-width signs do too
DIRECTIONS = re.compile(
    "[\u061c\u200e\u200f\u202a-\u202e\u2066-\u2069]"
)  # marks of writing direction
NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?")


def find_hidden_character(text: str) -> str | None:
    """Find the first character that no name may hold; None where there is none."""
    # nothing that is printable is hidden
    if text.isprintable():
        return None
    hidden = [c for c in set(text) if _is_hidden(c)]
    return min(hidden, key=text.index, default=None)


def _is_hidden(c: str) -> bool:
    """Whether nobody sees a character, nor is it part of a word."""
    if c in JOINERS:
        return False
    return unicodedata.category(c) in HIDDEN_CATEGORIES or _none(c)


def _none(c: str) -> bool:
    """Whether Unicode says that this is no character, and never will be one."""
    code = ord(c)
    ends_plane = code & 0xFFFE == 0xFFFE
    in_hole = 0xFDD0 <= code <= 0xFDEF
    return ends_plane or in_hole


def find_name_problem(name: str, longest: int = MAX_NAME_LENGTH) -> str | None:
    """Say why a text cannot be a name (or, with `longest` = TEXT, a sentence of a file), in words; None
    where it can."""
    hidden = find_hidden_character(name)
    if hidden is not None:
        called = unicodedata.name(hidden, "a control character").lower()
        return f"it holds U+{ord(hidden):04X} ({called}), which nobody sees. Write it without"
    length = len(name)
    if length > longest:
        return f"it has {length:,} characters, and {longest:,} are the most. Write a shorter one"
    is_blank = all(unicodedata.category(c)[0] in "ZMC" for c in name)
    if is_blank:
        return "it has no letter, digit or sign. Write one that people can see"
    return None


def strip_directions(text: str) -> str:
    """Return a text without the marks that change its direction, which nobody sees."""
    return DIRECTIONS.sub("", text)


def as_name(text: str) -> str:
    """Return the text itself. Raises ValueError for one that cannot be a name."""
    if (why := find_name_problem(text)) is not None:
        raise ValueError(f"not a name: {why}")
    return text


def is_plain_word(name: str) -> bool:
    """Whether a name can stand in a formula: a word of one spelling that no formula takes for its
    own."""
    return (
        name.isidentifier()
        and not keyword.iskeyword(name)
        and unicodedata.normalize("NFKC", name) == name
    )


def quote_name(name: str) -> str:
    """Quote a name, short enough for a message."""
    if len(name) > 40:
        name = name[:39] + "…"
    return f'"{name}"'


# -- cells of a CSV
# ------------------------------------------------------------------------------------------------------------


def guard_cell(cell: str) -> str:
    """Write a text cell for a CSV: an apostrophe goes before what a spreadsheet would run
    as a formula (OWASP, CSV injection). A plain number stays as it is. `unguard_cell` gives the cell
    back."""
    bare = cell.lstrip("'")
    if not FORMULA.match(bare):
        return cell
    if bare == cell and NUMBER.fullmatch(cell):
        return cell
    return f"'{cell}"


def unguard_cell(cell: str) -> str:
    """Return a text cell as it was before `guard_cell`."""
    if not cell.startswith("'"):
        return cell
    bare = cell.lstrip("'")
    return cell[1:] if FORMULA.match(bare) else cell


def check_listed_once(names: list[str]) -> list[str]:
    """Return names, none of which is listed twice. Raises ValueError for one that is."""
    seen = set[str]()
    for name in names:
        if name in seen:
            raise ValueError(f'lists "{name}" twice; keep one')
        seen.add(name)
    return names
