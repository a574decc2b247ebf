"""Values of study and fleet files as their models want them, and pydantic's errors in words of the
file."""

from __future__ import annotations

import os
import re
from collections.abc import Mapping, Sequence
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
# ends of the keys whose values are lengths, angles or sizes
NUMBER_KEYS = ("_mm", "_ppm", "_urad", "size")


def _show(value: Any) -> str:
    if type(value) is int and abs(value) > MAX_NUMBER:
        return f"{value.bit_length() // 3.32:.0f} digits"
    return str(value)[:MAX_SHOWN]


def describe_error(error: Any) -> str:
    """Describe what pydantic says of a value, in words of the file: expected …, found …."""
    message: str = error["msg"].removeprefix("Value error, ")
    if error["type"] == "value_error":
        return message
    if error["type"] in ("model_type", "dict_type"):
        message = "expected a table"
    message = re.sub(r"^Input should be (a valid |)", "expected ", message)
    for theirs, ours in EXPECTED:
        message = message.replace(f"expected {theirs}", f"expected {ours}")
    message = message.replace(" after validation", "")
    return f"{message}, found {_show(error['input'])!r}"


def format_place(location: Sequence[Any]) -> str:
    """Write a place in a file: its keys, and items of arrays counted from 1."""
    parts = [part + 1 if isinstance(part, int) else str(part) for part in location]
    return ".".join(str(part).removesuffix("_") for part in parts)


def _to_float(value: float) -> float:
    return float(value) if abs(value) < MAX_NUMBER else float("inf")


def _is_number(value: Any) -> bool:
    return isinstance(value, (int, float)) and not isinstance(value, bool)


def to_toml_values(value: Any) -> Any:
    """Convert values to those that TOML would have. Whole numbers inside arrays count as numbers
    (TOML tells 100 from 100.0; a tool's offset need not); from Python tuples and arrays are arrays,
    a path is its text."""
    if isinstance(value, Mapping):
        return {key: _to_toml_item(str(key), inner) for key, inner in value.items()}
    if isinstance(value, (np.ndarray, np.generic)):
        return to_toml_values(value.tolist())
    if isinstance(value, os.PathLike):
        return os.fspath(value)
    if isinstance(value, (list, tuple)):
        if value and all(_is_number(item) for item in value):
            return [_to_float(item) for item in value]
        return [to_toml_values(item) for item in value]
    return value


def _to_toml_item(key: str, value: Any) -> Any:
    if type(value) is int and key.endswith(NUMBER_KEYS):
        return _to_float(value)
    return to_toml_values(value)
