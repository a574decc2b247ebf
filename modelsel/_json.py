"""JSON that modelsel wrote, read back strictly: no key twice, every number finite, every value of
its shape, or where not.

A shape is a type (float: any finite number), a set of words, `Each` of a list, a tuple of shapes
for a list of so many, `Maybe` for null, or a table of shapes by key: a key that ends in "?" may be
absent, the key `str` stands for every key. Keys that a shape does not know are left alone."""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ._names import find_hidden_character
from ._text import find_read_problem

MAX_NUMBER = 1e100  # of a number: its square and its cube can be computed with
NAMES = {
    float: "a finite number",
    int: "a whole number",
    str: "text that can be seen",
    bool: "true or false",
}
TYPES = {float: (float, int), int: (int,), str: (str,), bool: (bool,)}


@dataclass(frozen=True)
class Each:
    """A list whose items have one shape; `count` of them, or `least`."""

    of: Any
    count: int | None = None
    least: int = 0


@dataclass(frozen=True)
class Maybe:
    """The shape, or null."""

    of: Any


def find_misfit(value: Any, shape: Any, place: str = "") -> str | None:
    """Describe the first place where a JSON value is not of a shape; None where all of it is."""
    if isinstance(shape, Maybe):
        return None if value is None else find_misfit(value, shape.of, place)
    if isinstance(shape, Each):
        return _list(value, shape, place)
    if isinstance(shape, tuple):
        return (
            _list(value, Each({}, len(shape)), place)
            if not isinstance(value, list) or len(value) != len(shape)
            else (_first(zip(value, shape, strict=True), place))
        )
    if isinstance(shape, Mapping):
        return _table(value, shape, place)
    if isinstance(shape, frozenset):
        return (
            None
            if isinstance(value, str) and value in shape
            else _not(place, f"one of {', '.join(sorted(shape))}", value)
        )
    good = type(value) in TYPES[shape]
    if good and shape in (float, int):
        good = -MAX_NUMBER <= value <= MAX_NUMBER
    elif good and shape is str:
        good = find_hidden_character(value) is None
    return None if good else _not(place, NAMES[shape], value)


def _list(value: Any, shape: Each, place: str) -> str | None:
    if (
        not isinstance(value, list)
        or shape.count not in (None, len(value))
        or len(value) < shape.least
    ):
        count = "a list" if shape.count is None else f"a list of {shape.count}"
        return _not(place, f"{count}, {shape.least} at least" if shape.least else count, value)
    if shape.of is float and all(
        type(v) is float and -MAX_NUMBER <= v <= MAX_NUMBER for v in value
    ):
        return None
    return _first(((v, shape.of) for v in value), place)


def _first(pairs: Iterable[tuple[Any, Any]], place: str) -> str | None:
    """Describe the first item, of (value, shape), that is not of its shape."""
    return next(
        (
            found
            for k, (v, shape) in enumerate(pairs, 1)
            if (found := find_misfit(v, shape, _at(place, k))) is not None
        ),
        None,
    )


def _table(value: Any, shape: Mapping[Any, Any], place: str) -> str | None:
    if not isinstance(value, dict):
        return _not(place, "a table", value)
    any_key = str in shape
    shapes = dict.fromkeys(value, shape[str]) if any_key else shape
    hidden = [key for key in value if find_hidden_character(key) is not None]
    if hidden:
        where = place or "the file"
        shown = json.dumps(hidden[0])[:80]
        return f"{where}: the key {shown} holds a character that nobody sees"
    for key, inner in shapes.items():
        name = key if any_key else key.removesuffix("?")
        inside = _at(place, name)
        if name in value:
            found = find_misfit(value[name], inner, inside)
            if found is not None:
                return found
        elif name == key:
            return f"{inside} is missing"
    return None


def _at(place: str, key: object) -> str:
    if not place:
        return str(key)
    return f"{place}.{key}"


def _not(place: str, expected: str, value: Any) -> str:
    if isinstance(value, list):
        found = f"a list of {len(value)}"
    elif isinstance(value, dict):
        found = "a table"
    else:
        found = json.dumps(value, ensure_ascii=True)
    return f"{place or 'the file'}: expected {expected}, found {found[:80]}"


def parse_json(text: str) -> Any:
    """Parse a JSON text. Raises ValueError in plain words: no NaN or infinity, no key twice,
    not too deep."""

    def none(word: str) -> Any:
        raise _Words(f"{word} is no number")

    def once(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
        table = dict(pairs)
        if len(table) < len(pairs):
            names = [name for name, _ in pairs]
            raise _Words(f'the key "{next(n for n in names if names.count(n) > 1)}" stands twice')
        return table

    try:
        return json.loads(text, parse_constant=none, object_pairs_hook=once)
    except RecursionError:
        raise ValueError("it is nested too deeply") from None
    except json.JSONDecodeError as error:
        said = error.msg.removesuffix(" at")
        raise ValueError(
            f"it is not valid JSON ({said} at line {error.lineno}, column {error.colno})"
        ) from None
    except _Words:
        raise
    except ValueError:
        raise ValueError("a number has too many digits") from None


class _Words(ValueError):
    """Said in plain words already."""


def read_json_text(path: Path) -> str:
    """Read a file's text. Raises FileNotFoundError, else ValueError in plain words."""
    why = find_read_problem(path)
    if why == "no such file":
        raise FileNotFoundError(path)
    try:
        if why is None:
            return path.read_bytes().decode("utf-8-sig")
    except UnicodeDecodeError:
        why = "it is not UTF-8 text"
    except OSError as error:
        why = str(error.strerror or error).lower()
    raise ValueError(why)


def to_plain(value: Any) -> Any:
    """Convert to plain values: floats to 10 significant digits, undefined ones null, arrays as
    lists."""
    if isinstance(value, np.ndarray):
        value = value.tolist()
    # most values are floats, and so these come first
    if isinstance(value, float):
        rounded = float(f"{value:.10g}")
        return rounded if math.isfinite(value) else None
    if isinstance(value, Mapping):
        return {str(k): to_plain(v) for k, v in value.items()}
    if isinstance(value, (list, tuple)):
        return [to_plain(v) for v in value]
    is_plain = isinstance(value, (bool, str)) or value is None
    if is_plain:
        return value
    is_whole = isinstance(value, (int, np.integer))
    if is_whole:
        return int(value)
    return to_plain(float(value))


def to_json(result: Mapping[str, Any]) -> str:
    """Write the text of a JSON file."""
    text = json.dumps(
        to_plain(result),
        ensure_ascii=False,
        indent=1,
        allow_nan=False,
    )
    return text + "\n"


TRIPLE, PAIR = Each(float, 3), Each(float, 2)
