"""Values of study and fleet files as their models want them, and pydantic's errors in words of the
file."""

from __future__ import annotations

import os
import re
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np

# digits of a whole number, and characters of any value, that a message shows
MAX_NUMBER = 1e300
MAX_SHOWN = 60
# a value that pydantic expects, and our word for it
EXPECTED = (
    ("string", "text"),
    ("list", "a list"),
    ("boolean", "true or false"),
    ("integer", "a whole number"),
    ("number", "a number"),
    ("finite number", "a finite number"),
)
# a bound of a number: how pydantic says it, and we do
BOUNDS = (
    # the least that is above zero by far
    (
        re.compile(r"expected greater than or equal to (1e-\d+|0\.0{5,}1)\b"),
        "expected a positive number",
    ),
    (re.compile(r"expected greater than or equal to (\S+)"), r"expected \1 or more"),
    (re.compile(r"expected less than or equal to (\S+)"), r"expected \1 at most"),
    (re.compile(r"expected greater than (\S+)"), r"expected more than \1"),
)
# what pydantic says of lengths and letters, in our words
LENGTH_MESSAGES = {
    "too_short": "expected {min_length} values or more",
    "too_long": "expected {max_length} values or fewer",
    "string_too_short": "expected text",
    "string_too_long": "expected at most {max_length} characters",
    "string_pattern_mismatch": "expected text without line breaks and control characters",
}
# of lists with three at least, or at most, each is a vector of exactly three
VECTOR_KINDS = {"too_short": ("min_length", 3), "too_long": ("max_length", 3)}
# a value of another type than expected: place, what was expected, what was found
ALTERNATIVE = re.compile(r"(.+?): expected (.+), found (.+)", re.DOTALL)
# ends of the keys whose values are lengths, angles or sizes
NUMBER_KEYS = ("_mm", "_ppm", "_urad", "size")


class SeveralProblems(ValueError):
    """Everything that is wrong with one table, each problem without a full stop."""

    def __init__(self, problems: Sequence[str]):
        self.problems = tuple(problems)
        super().__init__("; ".join(problems))


def list_single_problems(errors: Iterable[Any]) -> list[Any]:
    """List pydantic's errors, those of a table with several problems once for each."""
    single = []
    for error in errors:
        raised = error.get("ctx", {}).get("error")
        if not isinstance(raised, SeveralProblems):
            single.append(error)
            continue
        single += [{**error, "msg": problem} for problem in raised.problems]
    return single


def _show(value: Any) -> str:
    is_whole = type(value) is int
    if is_whole and abs(value) > MAX_NUMBER:
        # str() refuses a number of thousands of digits
        digits = value.bit_length() // 3.32
        return f"{digits:.0f} digits"
    text = str(value)
    return text[:MAX_SHOWN]


def describe_error(error: Any) -> str:
    """Describe what pydantic says of a value, in words of the file: expected …, found …."""
    kind = error["type"]
    message: str = error["msg"]
    message = message.removeprefix("Value error, ")
    if kind == "value_error":
        return message
    if kind in ("model_type", "dict_type"):
        message = "expected a table"
    if kind in LENGTH_MESSAGES:
        message = LENGTH_MESSAGES[kind].format(**error["ctx"])
    if kind in VECTOR_KINDS and VECTOR_KINDS[kind] in error["ctx"].items():
        message = "expected exactly 3 values"
    message = re.sub(r"^Input should be (a valid |)", "expected ", message)
    for theirs, ours in EXPECTED:
        message = message.replace(f"expected {theirs}", f"expected {ours}")
    for their_bound, our_bound in BOUNDS:
        message = their_bound.sub(our_bound, message)
    message = message.replace(" after validation", "")
    value = error["input"]
    if isinstance(value, bool):
        written = str(value).lower()
        return f"{message}, found {written}"
    shown = _show(value)
    return f"{message}, found {shown!r}"


def describe_value_problem(error: Any, place: str) -> str | None:
    """Describe a value that is missing or wrong, by its place; None for a key that is unknown."""
    if error["type"] == "missing":
        return f"{place} is missing."
    if error["type"] == "extra_forbidden":
        return None
    description = describe_error(error)
    stop = "" if description.endswith(("?", ".")) else "."
    return f"{place}: {description}{stop}"


def format_place(location: Sequence[Any]) -> str:
    """Write a place in a file: its keys, and items of arrays counted from 1."""
    words = []
    for part in location:
        word = str(part)
        if isinstance(part, int):
            word = str(part + 1)
        key = word.removesuffix("_")
        words.append(key)
    return ".".join(words)


def _to_float(value: float) -> float:
    """Convert a number; a whole one that no float holds stays, and is refused as it is."""
    is_huge = isinstance(value, int) and abs(value) >= MAX_NUMBER
    return value if is_huge else float(value)


def _is_number(value: Any) -> bool:
    if isinstance(value, bool):
        return False
    return isinstance(value, (int, float))


def to_toml_values(value: Any) -> Any:
    """Convert values to those that TOML would have. Whole numbers inside arrays count as numbers
    (TOML tells 100 from 100.0; a tool's offset need not); from Python tuples and arrays are arrays,
    a path is its text."""
    if isinstance(value, Mapping):
        table = {}
        for key, inner in value.items():
            name = str(key)
            table[key] = _to_toml_item(name, inner)
        return table
    if isinstance(value, (np.ndarray, np.generic)):
        plain = value.tolist()
        return to_toml_values(plain)
    if isinstance(value, os.PathLike):
        return os.fspath(value)
    if not isinstance(value, (list, tuple)):
        return value
    is_array_of_numbers = all(_is_number(item) for item in value)
    if is_array_of_numbers:
        return [_to_float(item) for item in value]
    return [to_toml_values(item) for item in value]


def _to_toml_item(key: str, value: Any) -> Any:
    is_number = key.endswith(NUMBER_KEYS)
    if type(value) is int and is_number:
        return _to_float(value)
    return to_toml_values(value)


def join_alternatives(problems: Sequence[str]) -> list[str]:
    """Say what is wrong with one value once, where pydantic tried several types: expected A or B."""
    joined: dict[tuple[str, str], str] = {}
    for problem in problems:
        match = ALTERNATIVE.fullmatch(problem)
        if match is None:
            joined[problem, ""] = problem
            continue
        place, expected, found = match.groups()
        before = joined.get((place, found))
        if before is None:
            joined[place, found] = f"{place}: expected {expected}, found {found}"
            continue
        first = before.removesuffix(f", found {found}")
        joined[place, found] = f"{first} or {expected}, found {found}"
    return list(joined.values())
