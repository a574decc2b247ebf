"""Cache the hash of nested frozen dataclasses, which is asked for often."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar

HASH_ATTRIBUTE = "_hash"
Class = TypeVar("Class", bound=type)


def cache_hash(cls: Class) -> Class:
    """Make the values of a frozen dataclass remember their hash. It is not pickled: another process
    hashes strings another way."""
    work_out: Callable[[Any], int] = cls.__hash__  # type: ignore[assignment]

    def remembered(self: Any) -> int:
        try:
            known: int = self._hash
        except AttributeError:
            known = work_out(self)
            self.__dict__[HASH_ATTRIBUTE] = known
        return known

    def travelling(self: Any) -> dict[str, Any]:
        state = dict(self.__dict__)
        state.pop(HASH_ATTRIBUTE, None)
        return state

    cls.__hash__ = remembered  # type: ignore[assignment,method-assign]
    cls.__getstate__ = travelling  # type: ignore[assignment,method-assign]
    return cls
