"""Work done ahead by a second process, while this one does something else.

It does what this one would, by the same functions: the result does not depend on who works. Where
it cannot be started, or fails, there is no result: the caller then works itself, and errors are
raised there as ever.
"""

from __future__ import annotations

import os
import pickle
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from typing import Generic, TypeVar

T = TypeVar("T")
Process = subprocess.Popen[bytes]
SERVE = "from modelsel._ahead import serve; serve()"


class Ahead(Generic[T]):
    """What a second process may have worked out."""

    def __init__(self, process: Process | None = None):
        self.process = process

    def collect(self) -> T | None:
        """Wait for the result; None where the process failed or there is none."""
        if self.process is None or self.process.stdout is None:
            return None
        content = self.process.stdout.read()
        if self.process.wait():
            return None
        result: T = pickle.loads(content)  # noqa: S301  from a process of our own
        return result


@contextmanager
def work_ahead(work: Callable[[], T], cores: int | None = None) -> Iterator[Ahead[T]]:
    """Start work (pickled: a module's function with its arguments) in a process that ends with the
    context.

    cores: how many there are, by default those that this process may use; with one, nothing is
    started."""
    process = None
    if (count_cores() if cores is None else cores) > 1:
        process = _start(pickle.dumps(work))
    try:
        yield Ahead(process)
    finally:
        if process is not None:
            process.kill()
            # waits for its end, and closes the pipes
            process.communicate()


def count_cores() -> int:
    """Count the cores that this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def _start(request: bytes) -> Process | None:
    """Start the process; None where none can be started."""
    path = os.pathsep.join(sys.path)
    try:
        process = subprocess.Popen(
            [sys.executable, "-c", SERVE],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            env={**os.environ, "PYTHONPATH": path},
            # Ctrl-C is for this process alone, which ends the other
            start_new_session=True,
        )
    except OSError:
        return None
    assert process.stdin is not None
    with suppress(BrokenPipeError):
        process.stdin.write(request)
    with suppress(BrokenPipeError):
        process.stdin.close()
    # else `communicate` would flush it
    process.stdin = None
    return process


def serve() -> None:
    """Do the work that the standard input asks for; its result goes to the standard output."""
    work = pickle.loads(sys.stdin.buffer.read())  # noqa: S301  from the process that started this
    sys.stdout.buffer.write(pickle.dumps(work()))
