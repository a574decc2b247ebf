"""A second process that works while this one does something else.

It does what this one would, by the same functions: a result does not depend on who works. Where it
cannot be started, or fails, there is no result: the caller then works itself, and errors are raised
there as ever.
"""

from __future__ import annotations

import os
import pickle
import subprocess
import sys
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager, suppress
from typing import IO, Any, TypeVar

from ._workers import count_cores

T = TypeVar("T")
Collect = Callable[[], T | None]
SERVE = "from modelsel._second_process import serve; serve()"


class SecondProcess:
    """A process that is told what to do; it is started by the first task.

    cores: how many there are; with one, nothing is started and nothing done."""

    def __init__(self, cores: int):
        self.cores = cores
        self.process: subprocess.Popen[bytes] | None = None
        # neither process waits until the other reads what it was sent
        self.writer = ThreadPoolExecutor(1)
        self.reader = ThreadPoolExecutor(1)

    def ask(self, work: Callable[[], T]) -> Collect[T]:
        """Have work done: a module's function with its arguments, all of which can be pickled.

        Returns a function that waits for the result, None where there is none."""
        if self.process is None and self.cores > 1:
            self.process = _start()
        if self.process is None or self.process.stdin is None:
            return lambda: None
        self.writer.submit(_send, pickle.dumps(work), self.process.stdin)
        result: Future[T] = self.reader.submit(pickle.load, self.process.stdout)  # type: ignore[arg-type]
        return lambda: _result_or_none(result)

    def end(self) -> None:
        """End the process, whatever it is doing."""
        if self.process is not None:
            self.process.kill()
        self.writer.shutdown()
        self.reader.shutdown()
        if self.process is not None:
            self.process.wait()
            for pipe in (self.process.stdin, self.process.stdout):
                with suppress(OSError):
                    if pipe is not None:
                        pipe.close()


def _send(work: bytes, pipe: IO[bytes]) -> None:
    """Send work to the process at the other end; where that has died nobody reads it."""
    with suppress(OSError):
        pipe.write(work)
        pipe.flush()


def _result_or_none(result: Future[T]) -> T | None:
    try:
        return result.result()
    except (EOFError, pickle.UnpicklingError):  # it died
        return None


@contextmanager
def second_process(cores: int | None = None) -> Iterator[SecondProcess]:
    """Open a second process that ends with the context; `cores`, by default those that this process
    may use."""
    process = SecondProcess(count_cores() if cores is None else cores)
    try:
        yield process
    finally:
        process.end()


def _start() -> subprocess.Popen[bytes] | None:
    """Start the process; None where none can be started."""
    path = os.pathsep.join(sys.path)
    try:
        return subprocess.Popen(
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


def serve() -> None:
    """Do what the standard input asks for, results to the standard output, until it ends."""
    tasks: Any = sys.stdin.buffer
    while True:
        try:
            work = pickle.load(tasks)  # noqa: S301  from the process that started this one
        except EOFError:
            return
        pickle.dump(work(), sys.stdout.buffer)
        sys.stdout.buffer.flush()
