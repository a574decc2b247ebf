"""Named errors: each carries its data, says the remedy, and knows its exit status."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from difflib import get_close_matches
from math import isfinite
from typing import Any

# exit status of a command that is done, but where a check failed: no convergence, a drift, a miss
CHECK_FAILED = 5
# letters of a list in a message: with what stands around it, a message is no longer than 700
MAX_LISTED_LETTERS = 400
# what is a cell or a column of a sheet, or a name like one: A1, X
CELL = re.compile(r"[A-Z]{1,3}\d{0,7}", re.IGNORECASE)
SHEET = ', sheet "'


class ModelselError(Exception):
    """Anything modelsel says to a user; `exit_code` is the command's exit status."""

    exit_code = 1


class StudyError(ModelselError):
    """The study, the robot file or the command line is wrong: every problem, each with its
    place. Of values of a study, `places` are those of all of it: keys, and numbers of items from 0."""

    exit_code = 2

    def __init__(self, *problems: str, places: Sequence[tuple[Any, ...]] = ()):
        self.places = tuple(places)
        self.problems = tuple(one_line(problem) for problem in problems)
        super().__init__("\n".join(self.problems))


class NotStored(StudyError, AttributeError):
    """What a result that was read back does not have: `hasattr` is false of it."""


class ArgumentError(StudyError, ValueError):
    """An argument of a function is wrong: which, what was expected, what was found. It is a
    ValueError, too."""


def _quote_in_sheet(column: str, file: str) -> str:
    """Quote a column's name that a reader of a spreadsheet takes for a cell or its own column."""
    is_like_cell = CELL.fullmatch(column) and SHEET in file
    return f'"{column}"' if is_like_cell else column


class DataError(ModelselError):
    """The measurements are wrong: what, where, what to do. In a file: its line (the header is line
    1) and column; in a DataFrame: its row, counted from 0, and column."""

    exit_code = 3

    def __init__(
        self,
        what: str,
        *,
        file: str = "",
        line: int | None = None,
        row: int | None = None,
        column: str | None = None,
        remedy: str = "",
    ):
        what, column, remedy = (
            one_line(what),
            None if column is None else one_line(column),
            one_line(remedy),
        )
        self.file, self.line, self.row, self.column, self.remedy = file, line, row, column, remedy
        places = (
            one_line(file),
            f"line {line}" if line else "",
            f"row {row}" if row is not None else "",
            f"column {_quote_in_sheet(column, file)}" if column else "",
        )
        place = ", ".join(part for part in places if part)
        super().__init__(
            f"{place}: {what}" + (f" {remedy}" if remedy else "")
            if place
            else f"{what} {remedy}".strip()
        )

    def beside(self, others: Sequence[DataError]) -> DataError:
        """Return this error with what others say, a line each."""
        said = "\n".join(str(error) for error in (self, *others))
        self.args = (said,)
        return self


class NotEstimable(ModelselError):
    """The data cannot carry the model: how many parameters, how many they can carry, and which."""

    exit_code = 4

    def __init__(self, what: str, *, parameters: Sequence[str] = ()):
        self.parameters = tuple(parameters)
        super().__init__(one_line(what))


def one_line(text: str) -> str:
    """A sentence that holds what a user wrote, fit to be printed: no line breaks or control
    characters, very long words cut, the stops and quotes after them kept."""
    letters = []
    for letter in text:
        if letter.isprintable():
            letters.append(letter)
        else:
            escaped = letter.encode("unicode_escape", "replace")
            letters.append(escaped.decode())
    line = "".join(letters)
    return re.sub(r"([^ ]{80})[^ ]{120,}?([^\w ]{0,3})(?= |$)", r"\1…\2", line)


def sentence_list(words: Sequence[str]) -> str:
    """a, b and c."""
    return words[0] if len(words) == 1 else f"{', '.join(words[:-1])} and {words[-1]}"


def choice_list(words: Sequence[str]) -> str:
    """a, b or c."""
    return words[0] if len(words) == 1 else f"{', '.join(words[:-1])} or {words[-1]}"


def list_within(words: Sequence[str], separator: str = ", ") -> str:
    """a, b, c: as many words as a message holds, one at least, and how many more there are."""
    shown: list[str] = []
    for word in words:
        longer = separator.join([*shown, word])
        if shown and len(longer) > MAX_LISTED_LETTERS:
            break
        shown.append(word)
    listed = separator.join(shown)
    more = len(words) - len(shown)
    return f"{listed} and {more} more" if more else listed


def count_words(count: int, word: str) -> str:
    """1 row, 2 rows, 1,200 rows, 2 studies."""
    if count != 1:
        stem = re.sub(r"(?<![aeou])y$", "ie", word)
        word = f"{stem}s"
    return f"{count:,} {word}"


def number_repeated(names: Sequence[str]) -> list[int | None]:
    """Number names that stand several times, from 1 in their order; None for one that stands once."""
    counts = dict.fromkeys(names, 0)
    numbers: list[int | None] = []
    for name in names:
        counts[name] += 1
        number = counts[name]
        numbers.append(number)
    for place, name in enumerate(names):
        if counts[name] == 1:
            numbers[place] = None
    return numbers


def write_numbered(name: str, number: int | None) -> str:
    """play, or play (2) where others have that name, too."""
    if number is None:
        return name
    return f"{name} ({number})"


def write_rounded(value: float, digits: int = 3) -> str:
    """0.0120, 12.3, 1,230: a number of so many significant digits, zeros kept, its thousands apart;
    never 1.23e+03."""
    short = f"{value:.{digits - 1}e}"
    rounded = float(short)
    if rounded == 0 or not isfinite(rounded):
        return f"{rounded:.0f}"
    exponent = int(short.partition("e")[2])
    places = max(digits - 1 - exponent, 0)
    return f"{rounded:,.{places}f}"


def write_percent(share: float, decimals: int = 0) -> str:
    """92 %: a share in percent."""
    return f"{100 * share:.{decimals}f} %"


def suggest(word: object, known: Iterable[str]) -> str:
    """`Did you mean "x"?`, or the known words where they are few, or nothing; a word may be what a
    user gave in the place of one."""
    known = sorted(known)
    near = find_nearest(word, known)
    if near is not None:
        return f'Did you mean "{near}"?'
    return list_known(known)


def find_nearest(word: object, known: Iterable[str]) -> str | None:
    """Find the known word that looks most like another; None where none does."""
    near = get_close_matches(str(word), sorted(known), n=1, cutoff=0.6)
    return near[0] if near else None


def list_known(known: Iterable[str]) -> str:
    """List the known words in a sentence where they are few, else say nothing."""
    words = sorted(known)
    if not 0 < len(words) <= 30:
        return ""
    return f"Known: {list_within(words)}."
