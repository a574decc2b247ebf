"""Hashes: of nested frozen dataclasses, cached since they are asked for often; of rows of numbers, the
factor that spreads their bits."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar

import numpy as np

HASH_ATTRIBUTE = "_hash"
# 2^64 over the golden ratio: spreads the bits of a hash. Calibrations are stored with it
HASH_FACTOR = np.uint64(0x9E3779B97F4A7C15)
Class = TypeVar("Class", bound=type)


def cache_hash(cls: Class) -> Class:
    """Make the values of a frozen dataclass remember their hash. It is not pickled: another process
    hashes strings another way."""
    work_out: Callable[[Any], int] = cls.__hash__  # type: ignore[assignment]

    def remembered(self: Any) -> int:
        values: dict[str, Any] = self.__dict__
        try:
            known: int = values[HASH_ATTRIBUTE]
        except KeyError:
            known = values[HASH_ATTRIBUTE] = work_out(self)
        return known

    def travelling(self: Any) -> dict[str, Any]:
        state = dict(self.__dict__)
        state.pop(HASH_ATTRIBUTE, None)
        return state

    cls.__hash__ = remembered  # type: ignore[assignment,method-assign]
    cls.__getstate__ = travelling  # type: ignore[assignment,method-assign]
    return cls
