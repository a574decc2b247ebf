"""A command run in this process, without network, warnings or end; and what is wrong with what it did."""

from __future__ import annotations

import contextlib
import json
import math
import re
import signal
import socket
import time
import warnings
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from click.testing import CliRunner

from modelsel.cli import main
from modelsel.telling.stored import WRITES

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
            ran = CliRunner().invoke(main, words)
        status, stdout, stderr = ran.exit_code, ran.stdout, ran.stderr
        if ran.exception is not None and not isinstance(ran.exception, SystemExit):
            stderr += f"Traceback: {ran.exception!r}"
    except Hang:
        status, stdout, stderr = 124, "", "hang"
    left = {str(p.relative_to(out)): p.read_bytes() for p in sorted(out.rglob("*")) if p.is_file()} if out.exists() else {}
    return Outcome(status, stdout, stderr, left, time.perf_counter() - start)


WRITTEN = set(WRITES)
INSIDE = re.compile(r"Traceback|Error\b|Warning\b|internal error|<class|object at 0x|pydantic|numpy|\[type=")


def refusal_problems(ran: Outcome, exits: tuple[int, ...]) -> list[str]:
    """A refusal: the exit status of its kind, one sentence or one for each problem with its place, nothing left."""
    problems = []
    if ran.status not in exits:
        problems.append(f"exit status {ran.status}, expected one of {exits}")
    if not ran.said or not all(line.startswith("modelsel: ") for line in ran.said):
        problems.append("not a message of modelsel's own")
    problems += [
        f"not a user's words: {line[:200]}" for line in ran.said if INSIDE.search(re.sub(r'"[^"]*"|\'[^\']*\'', "", line))
    ]
    problems += [f"too long: {line[:80]}…" for line in ran.said if len(line) > 700]
    problems += [f"not a sentence: {line[:200]}" for line in ran.said if not line.rstrip().endswith((".", "?", ")", '"', "}"))]
    if ran.left:
        problems.append(f"left behind: {sorted(ran.left)}")
    return problems


def _finite(value: Any) -> bool:
    if isinstance(value, dict):
        return all(map(_finite, value.values()))
    if isinstance(value, list):
        return all(map(_finite, value))
    return not isinstance(value, float) or math.isfinite(value)


def result_problems(ran: Outcome) -> list[str]:
    """A clean study: its files whole and alone, its numbers finite and possible."""
    problems = [] if set(ran.left) == WRITTEN else [f"files: {sorted(ran.left)}"]
    try:
        result = json.loads(ran.left["result.json"], parse_constant=lambda c: math.nan)
        json.loads(ran.left["calibration.json"]), json.loads(ran.left["details.json"])
    except (KeyError, ValueError) as error:
        return [*problems, f"result: {error!r}"]
    if not _finite(result):
        problems.append("a number that is none")
    for rung in result["ladder"]:
        errors = rung["estimation"]
        if not 0 <= errors["mean_mm"] <= errors["rms_mm"] * (1 + 1e-9) <= errors["max_mm"] * (1 + 2e-9):
            problems.append(f"impossible errors: {errors}")
        if rung["cv_rms_mm"] is None and not any(w["code"] == "cv-not-estimable" for w in result["warnings"]):
            problems.append("cv null, and nothing said")
    if not all(0 < f["p_value"] <= 1 for f in result["findings"] if f["p_value"] is not None):
        problems.append("a probability that is none")
    if extra := [line for line in ran.said if not line.startswith("modelsel: ")]:
        problems.append(f"said: {extra[0][:200]}")
    return problems


def alike(a: Any, b: Any) -> bool:
    """Two results with the same numbers, whatever was said on reading: files and warnings may differ."""
    if isinstance(a, dict) and isinstance(b, dict):
        skip = {"provenance", "warnings"}
        return a.keys() == b.keys() and all(alike(a[k], b[k]) for k in a if k not in skip)
    if isinstance(a, list) and isinstance(b, list):
        return len(a) == len(b) and all(map(alike, a, b))
    if isinstance(a, float) and isinstance(b, (int, float)):
        return math.isclose(a, b, rel_tol=1e-4, abs_tol=1e-6)
    return bool(a == b) or isinstance(a, str)
