"""Names of points in programs: a planner's own, in letters that a controller reads."""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Sequence

# all that a name may hold where it is text, and where it is an identifier
OTHER_THAN_TEXT = re.compile(r"[^A-Za-z0-9 ._-]+")
OTHER_THAN_WORD = re.compile(r"[^A-Za-z0-9]+")
MAX_TEXT = 32


def write_as_text(names: Sequence[str], longest: int = MAX_TEXT) -> list[str]:
    """Write names as plain text of ASCII: for a comment, or between quotation marks."""
    texts = []
    for name in names:
        plain = _plain(name)
        words = OTHER_THAN_TEXT.sub(" ", plain).split()
        text = " ".join(words)[:longest]
        texts.append(text.strip())
    return texts


def write_as_words(names: Sequence[str], longest: int, reserved: re.Pattern[str]) -> list[str]:
    """Write names as identifiers, a letter first, that differ whatever the case of their letters:
    one that is reserved, or starts with a digit, begins with pt_."""
    words = []
    for name in names:
        plain = _plain(name)
        word = OTHER_THAN_WORD.sub("_", plain).strip("_")
        is_digit = word[:1].isdigit()
        if is_digit or reserved.fullmatch(word):
            word = f"pt_{word}"
        short = word[:longest]
        words.append(short.rstrip("_"))
    return words


def make_distinct(names: Sequence[str], numbered: str, longest: int = MAX_TEXT) -> list[str]:
    """Give every point a name of its own: an empty one its number after `numbered`, one that stands
    before, whatever the case of its letters, a number behind it."""
    given = {name.lower() for name in names}
    used = set[str]()
    distinct = []
    for k, name in enumerate(names, 1):
        base = name or f"{numbered}{k}"
        own = base
        taken = used if name else used | given
        count = 1
        while own.lower() in taken:
            count += 1
            end = f"_{count}"
            start = base[: longest - len(end)]
            own = start + end
            taken = used | given
        key = own.lower()
        used.add(key)
        distinct.append(own)
    return distinct


def _plain(name: str) -> str:
    """Return a name without the accents of its letters."""
    decomposed = unicodedata.normalize("NFKD", name)
    letters = [c for c in decomposed if not unicodedata.combining(c)]
    return "".join(letters)
