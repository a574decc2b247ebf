"""Checks of what users of the Python API pass: each refusal is one sentence, a StudyError that is a
ValueError, too."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from .exceptions import ArgumentError, count_words

if TYPE_CHECKING:
    from ._typing import Array, Mask

MAX_SHOWN = 60  # characters of a value that a message shows


def describe_value(value: Any) -> str:
    """Describe a value in a few words: itself where it is short and plain, else its type."""
    if value is None or isinstance(value, (str, int, float, tuple)):
        shown = repr(value)
        if len(shown) <= MAX_SHOWN:
            return shown
    return name_type(value)


def name_type(value: Any) -> str:
    """Name the type of a value; with its module where another program's type has a usual name."""
    kind = type(value)
    name = kind.__name__
    package, _, _ = kind.__module__.partition(".")
    if package in ("builtins", "modelsel", "numpy"):
        return name
    return f"{package}.{name}"


def check_type(name: str, value: Any, kind: type | tuple[type, ...], expected: str) -> None:
    """Refuse a value of another type; `expected`: what to give, and how to get it. Raises
    ArgumentError."""
    if not isinstance(value, kind):
        raise ArgumentError(f"{name}: expected {expected}, found {describe_value(value)}.")


def check_function(name: str, value: Any, expected: str) -> None:
    """Refuse what cannot be called, unless it is None. Raises ArgumentError."""
    if value is None or callable(value):
        return
    found = describe_value(value)
    raise ArgumentError(f"{name}: expected {expected}, found {found}.")


def check_path(value: Any, expected: str) -> Path:
    """Return what names a file or a folder as a path. Raises ArgumentError for what names none."""
    try:
        return Path(value)
    except TypeError:
        found = name_type(value)
        raise ArgumentError(f"expected {expected}, found {found}.") from None


def check_whole_number(name: str, number: Any, least: int, most: int | None = None) -> int:
    """Return a whole number within bounds. Raises ArgumentError for what is none, or lies beyond."""
    is_whole = isinstance(number, (int, np.integer)) and not isinstance(number, bool)
    is_within = is_whole and number >= least and (most is None or number <= most)
    if not is_within:
        bounds = f"from {least} on"
        if most is not None:
            bounds = f"from {least} to {most:,}"
        found = describe_value(number)
        raise ArgumentError(f"{name}: expected a whole number {bounds}, found {found}.")
    return int(number)


def check_rows(name: str, given: Any, rows: int) -> Mask:
    """Return a choice of rows as a mask (rows,). Raises ArgumentError for what is none, such as
    indices, and for one that chooses nothing."""
    mask = np.asarray(given)
    shape = mask.shape
    if shape != (rows,):
        raise ArgumentError(
            f"{name} has shape {shape}; expected ({rows},), one truth value per row. Of indices: "
            "np.isin(np.arange(len(problem)), indices)."
        )
    is_mask = np.isin(mask, (False, True)).all()
    if not is_mask:
        raise ArgumentError(
            f"{name}: expected one truth value per row, found other numbers. Of indices: "
            "np.isin(np.arange(len(problem)), indices)."
        )
    chosen = mask.astype(bool)
    if not chosen.any():
        said = count_words(rows, "row")
        raise ArgumentError(f"{name}: none of the {said} is chosen, and there is nothing to fit.")
    return chosen


def check_sliding(name: str, given: Any, expected: str) -> tuple[bool, ...]:
    """Return which joints slide, one truth value per joint. Raises ArgumentError for what says
    anything else."""
    values = list(given) if isinstance(given, (Sequence, np.ndarray)) else []
    is_known = [isinstance(one, (bool, int, np.bool_, np.integer)) for one in values]
    if not values or not all(is_known):
        found = describe_value(given)
        raise ArgumentError(f"{name}: expected {expected}, found {found}.")
    return tuple(bool(one) for one in values)


def collect_all(name: str, given: Any, kind: type, expected: str) -> tuple[Any, ...]:
    """Return values of one type that are given in a list. Raises ArgumentError for one that stands
    alone, and for others among them."""
    # most are tuples, which are told faster than what else has an order
    is_list = isinstance(given, (tuple, Sequence, Iterator))
    if not is_list or isinstance(given, (str, bytes)):
        found = describe_value(given)
        raise ArgumentError(f"{name}: expected {expected}, found {found}.")
    values = tuple(given)
    for one in values:
        if not isinstance(one, kind):
            found = describe_value(one)
            raise ArgumentError(f"{name}: expected {expected}, found {found} in it.")
    return values


def check_numbers(name: str, given: Any, shape: tuple[int, ...], expected: str) -> Array:
    """Return finite numbers of a shape as an array. Raises ArgumentError for anything else."""
    found = name_type(given)
    try:
        values = np.asarray(given, dtype=float)
    except (TypeError, ValueError):
        raise ArgumentError(f"{name}: expected {expected}, found {found}.") from None
    if values.shape != shape:
        raise ArgumentError(f"{name} has shape {values.shape}; expected {shape}, {expected}.")
    if not np.isfinite(values).all():
        raise ArgumentError(f"{name}: a number is not finite; expected {expected}.")
    return values


def collect_names(name: str, given: Any) -> tuple[str, ...]:
    """Return names that are given as one, or several in a list. Raises ArgumentError for what is
    none of both."""
    if isinstance(given, str):
        return (given,)
    names = tuple(given) if isinstance(given, Iterable) else (given,)
    for one in names:
        if not isinstance(one, str):
            found = name_type(one)
            raise ArgumentError(f"{name}: expected a name or a list of names, found {found}.")
    return names
