"""Work on several cores at once, with the same result however many there are."""

from __future__ import annotations

import gc
import os
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, contextmanager
from threading import Lock
from typing import TypeVar

Item = TypeVar("Item")
Result = TypeVar("Result")

# new objects between two runs of the garbage collector: a study makes many small objects and drops
# few, and looking for lost ones at the usual rate costs a twentieth of its time
COLLECT = 50_000


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


@contextmanager
def steady_arithmetic() -> Iterator[None]:
    """Compute alike whatever the program has set: products of matrices use one thread, underflow is
    no error, and lost objects are looked for less often.

    The matrices of a study are small: more threads wait for each other longer than they work, and
    add up in another order. A probability may be too small for a number. As a decorator: of what a
    program calls, and of what other processes do. The limit of threads and the rate of the garbage
    collector hold for the whole process until the last of those that asked for them ends."""
    import numpy as np
    import scipy.linalg  # noqa: F401  it has threads of its own, which can be limited once it is loaded

    with _limit.lock:
        _limit.begin()
    try:
        with np.errstate(under="ignore"):
            yield
    finally:
        with _limit.lock:
            _limit.end()


class _Limit:
    """What is set for a whole process, and how many ask for it."""

    def __init__(self) -> None:
        self.lock = Lock()
        self.asked = 0
        self.open = ExitStack()

    def begin(self) -> None:
        """Set it for the first that asks."""
        from threadpoolctl import threadpool_limits

        if self.asked == 0:
            self.open.enter_context(threadpool_limits(1, "blas"))
            first, *others = gc.get_threshold()
            self.open.callback(gc.set_threshold, first, *others)
            # none at all is what the program wants then
            gc.set_threshold(first and max(first, COLLECT), *others)
        self.asked += 1

    def end(self) -> None:
        """Take it back after the last."""
        self.asked -= 1
        if self.asked == 0:
            self.open.close()


_limit = _Limit()
