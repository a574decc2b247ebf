"""Work on several cores at once, with the same result however many there are."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

Item = TypeVar("Item")
Result = TypeVar("Result")


def count_cores() -> int:
    """Count the cores that this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def map_in_threads(
    function: Callable[[Item], Result], items: Sequence[Item], worth: bool = True
) -> list[Result]:
    """Apply a function to few items, each in a thread of its own where there are cores for it.

    Worth it for products of matrices, which let go of the interpreter; `worth` says so. What is
    computed of an item may not depend on the others, so that the results stay the same."""
    workers = min(len(items), count_cores())
    if workers < 2 or not worth:
        return [function(item) for item in items]
    with ThreadPoolExecutor(workers) as pool:
        return list(pool.map(function, items))
