"""A command run in this process, without network, warnings or end; and what is wrong with a refusal
of it."""

from __future__ import annotations

import contextlib
import re
import signal
import socket
import time
import warnings
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import click
from click.testing import CliRunner

from modelsel.cli.main import _Lazy

SLOW = 60  # seconds: beyond it a command hangs


@dataclass
class Outcome:
    """What a command did: exit status, what it said, the files it left, seconds."""

    status: int
    stdout: str
    stderr: str
    left: dict[str, bytes]
    seconds: float

    @property
    def said(self) -> list[str]:
        """The message: what stands on the error stream but for progress."""
        return [line for line in self.stderr.splitlines() if not re.match(r" *\d+\.\d s  ", line)]


class Hang(BaseException):
    """A command took longer than SLOW."""


def _offline(*_: object, **__: object) -> None:
    raise AssertionError("a socket was opened")


class _WithLoading(_Lazy):
    """The program with one command more: what Python does with a folder."""

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        return load if cmd_name == "load" else super().get_command(ctx, cmd_name)


@click.group(cls=_WithLoading)
@click.option("--debug", is_flag=True)
def program(debug: bool) -> None:
    """modelsel, and `load`."""


@click.command()
@click.argument("folder", type=Path)
def load(folder: Path) -> None:
    """Every table of a stored result, as JSON."""
    from modelsel.cli._options import print_json
    from modelsel.results.sentences.tables import TABLES
    from modelsel.study.pipeline.result import load_result

    found = load_result(folder)
    tables = {what: found.to_frame(what).to_dict("split") for what in (*TABLES, "residuals")}
    print_json(
        {
            "tables": tables,
            "page": len(found._repr_html_()),
            "terms": found.calibration.to_frame().to_dict("split"),
        }
    )


@contextlib.contextmanager
def guarded() -> Iterator[None]:
    """No network, no warning, no hang."""

    def late(*_: object) -> None:
        raise Hang

    real, before = socket.socket.connect, signal.signal(signal.SIGALRM, late)
    socket.socket.connect = _offline  # type: ignore[method-assign, assignment]
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            signal.alarm(SLOW)
            yield
    finally:
        signal.alarm(0)
        signal.signal(signal.SIGALRM, before)
        socket.socket.connect = real  # type: ignore[method-assign]


def in_process(words: list[str], out: Path) -> Outcome:
    start = time.perf_counter()
    try:
        with guarded():
            ran = CliRunner().invoke(program, words)
        status, stdout, stderr = ran.exit_code, ran.stdout, ran.stderr
        if ran.exception is not None and not isinstance(ran.exception, SystemExit):
            stderr += f"Traceback: {ran.exception!r}"
    except Hang:
        status, stdout, stderr = 124, "", "hang"
    left = (
        {str(p.relative_to(out)): p.read_bytes() for p in sorted(out.rglob("*")) if p.is_file()}
        if out.exists()
        else {}
    )
    return Outcome(status, stdout, stderr, left, time.perf_counter() - start)


INSIDE = re.compile(
    r"Traceback|Error\b|Warning\b|internal error|<class|object at 0x|pydantic|(?<!\.)numpy|\[type="
)


def refusal_problems(ran: Outcome, exits: tuple[int, ...]) -> list[str]:
    """A refusal: the exit status of its kind, one sentence or one for each problem with its place,
    nothing left."""
    problems = []
    if ran.status not in exits:
        problems.append(f"exit status {ran.status}, expected one of {exits}")
    if not ran.said or not all(line.startswith("modelsel: ") for line in ran.said):
        problems.append("not a message of modelsel's own")
    problems += [
        f"not a user's words: {line[:200]}"
        for line in ran.said
        if INSIDE.search(re.sub(r'"[^"]*"|\'[^\']*\'', "", line))
    ]
    problems += [f"too long: {line[:80]}…" for line in ran.said if len(line) > 700]
    problems += [
        f"not a sentence: {line[:200]}"
        for line in ran.said
        if not line.rstrip().endswith((".", "?", ")", '"', "}"))
    ]
    if ran.left:
        problems.append(f"left behind: {sorted(ran.left)}")
    return problems
