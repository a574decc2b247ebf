"""JSON that modelsel writes, and its strict reading: no key twice, every number finite."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ._text import find_read_problem
from ._typing import Array

LONG_LIST = 1000
# a text in place of a long list, with the list's number
MARK = re.compile(r'"\\u0000(\d+)"')


def parse_json(text: str) -> Any:
    """Parse a JSON text. Raises ValueError in plain words: no NaN or infinity, no key twice,
    not too deep."""

    def none(word: str) -> Any:
        raise _Words(f"{word} is not a number")

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


def _round(value: float) -> float | None:
    return float(f"{value:.10g}") if math.isfinite(value) else None


def to_plain(value: Any) -> Any:
    """Convert to plain values: floats to 10 significant digits, undefined ones null, arrays as
    lists."""
    if isinstance(value, np.ndarray):
        if value.ndim == 1 and value.dtype == float and np.isfinite(value).all():
            return _round_floats(value)
        value = value.tolist()
    # most values are floats, and so these come first
    if isinstance(value, float):
        return _round(value)
    if isinstance(value, Mapping):
        return {str(k): to_plain(v) for k, v in value.items()}
    if isinstance(value, (list, tuple)):
        return _convert_members(value)
    is_plain = isinstance(value, (bool, str)) or value is None
    if is_plain:
        return value
    is_whole = isinstance(value, (int, np.integer))
    return int(value) if is_whole else to_plain(float(value))


def _convert_members(values: Sequence[Any]) -> list[Any]:
    """Convert each of some values; whole numbers, of which there may be millions, stay."""
    kinds = set(map(type, values))
    if kinds == {int}:
        return list(values)
    return [_round(v) if type(v) is float else to_plain(v) for v in values]


def _round_floats(values: Array) -> list[float]:
    """Round finite numbers (n,) to 10 significant digits, by one call for all."""
    text = "%.10g " * len(values) % tuple(values.tolist())
    return list(map(float, text.split()))


def to_json(result: Mapping[str, Any]) -> str:
    """Write the text of a JSON file."""
    return plain_text(to_plain(result))


def plain_text(values: Any) -> str:
    """Write the text of a JSON file of values that are plain already.

    Long lists of numbers are written at once: with an indent, json writes each by a call."""
    long: dict[str, str] = {}
    short = _set_aside(values, 0, long)
    text = json.dumps(short, ensure_ascii=False, indent=1, allow_nan=False)
    whole = MARK.sub(lambda found: long[found[1]], text)
    return whole + "\n"


def _set_aside(value: Any, depth: int, long: dict[str, str]) -> Any:
    """Return a plain value with marks in place of its long lists of numbers, whose texts are
    added."""
    if isinstance(value, dict):
        return {key: _set_aside(each, depth + 1, long) for key, each in value.items()}
    if not isinstance(value, list):
        return value
    kinds = set(map(type, value))
    if len(value) < LONG_LIST or not kinds <= {int, float}:
        return [_set_aside(each, depth + 1, long) for each in value]
    line = "\n" + " " * (depth + 1)
    numbers = f",{line}".join(map(repr, value))
    number = str(len(long))
    long[number] = f"[{line}{numbers}{line[:-1]}]"
    return f"\0{number}"  # no text has a zero byte
