"""JSON that modelsel writes, and its strict reading: no key twice, every number finite."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from ._text import find_read_problem


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


def _round(value: float) -> float | None:
    return float(f"{value:.10g}") if math.isfinite(value) else None


def to_plain(value: Any) -> Any:
    """Convert to plain values: floats to 10 significant digits, undefined ones null, arrays as
    lists."""
    if isinstance(value, np.ndarray):
        value = value.tolist()
    # most values are floats, and so these come first
    if isinstance(value, float):
        return _round(value)
    if isinstance(value, Mapping):
        return {str(k): to_plain(v) for k, v in value.items()}
    if isinstance(value, (list, tuple)):
        return [_round(v) if type(v) is float else to_plain(v) for v in value]
    is_plain = isinstance(value, (bool, str)) or value is None
    if is_plain:
        return value
    is_whole = isinstance(value, (int, np.integer))
    if is_whole:
        return int(value)
    return to_plain(float(value))


def to_json(result: Mapping[str, Any]) -> str:
    """Write the text of a JSON file."""
    return plain_text(to_plain(result))


def plain_text(value: Any) -> str:
    """Write the text of a JSON file of plain values."""
    return json.dumps(value, ensure_ascii=False, indent=1, allow_nan=False) + "\n"
