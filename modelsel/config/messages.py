"""Values of study and fleet files as their schemas want them, and what is wrong with one, in words
of the file."""

from __future__ import annotations

import os
import re
from collections.abc import Mapping
from typing import Any

import numpy as np


def _shown(value: Any) -> str:
    return (
        f"{value.bit_length() // 3.32:.0f} digits"
        if type(value) is int and abs(value) > 1e300
        else str(value)[:60]
    )


def describe_error(error: Any) -> str:
    """What pydantic says of a value, in words of the file: expected …, found …."""
    kind, what = error["type"], error["msg"].removeprefix("Value error, ")
    if kind == "value_error":
        return str(what)
    what = "expected a table" if kind in ("model_type", "dict_type") else what
    what = re.sub(r"^Input should be (a valid |)", "expected ", what)
    for pydantic, ours in (
        ("string", "text"),
        ("list", "a list"),
        ("boolean", "true or false"),
        ("integer", "a whole number"),
        ("number", "a number"),
        ("finite number", "a finite number"),
    ):
        what = what.replace(f"expected {pydantic}", f"expected {ours}")
    return f"{what.replace(' after validation', '')}, found {_shown(error['input'])!r}"


def _float(value: float) -> float:
    return float(value) if abs(value) < 1e300 else float("inf")


def to_toml_values(value: Any) -> Any:
    """Values as TOML would have them. Whole numbers inside arrays count as numbers (TOML tells 100
    from 100.0; a tool's offset need not); from Python tuples and arrays are arrays, a path is its
    text."""
    if isinstance(value, Mapping):
        lengths = ("_mm", "_ppm", "_urad", "size")
        return {
            k: _float(v) if type(v) is int and str(k).endswith(lengths) else to_toml_values(v)
            for k, v in value.items()
        }
    if isinstance(value, (np.ndarray, np.generic)):
        return to_toml_values(value.tolist())
    if isinstance(value, os.PathLike):
        return os.fspath(value)
    if isinstance(value, (list, tuple)):
        if value and all(isinstance(v, (int, float)) and not isinstance(v, bool) for v in value):
            return [_float(v) for v in value]
        return [to_toml_values(v) for v in value]
    return value
