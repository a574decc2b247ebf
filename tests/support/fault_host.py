"""Runs a study in children that are killed at their n-th step on the disk; prints, as JSON, what
was left and whether all came out the same.

`python fault_host.py FOLDER KILLS SEED [sampling]`: a process of its own, with everything loaded
before the first child starts. A step is a file opened to be written, half of its content written, a
file renamed or removed, a folder made or removed, below the output folder: the child kills itself
there, so that no clock and no load of the machine has a part in it. Where there are more steps than
KILLS they are drawn."""

from __future__ import annotations

import json
import os
import shutil
import signal
import sys
from collections import Counter
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from fuzz_base import base_files

from modelsel.cli.main import run_command_line
from modelsel.exceptions import StudyError
from modelsel.study.pipeline.result import load_result

ON_DISK = ("os.rename", "os.remove", "os.mkdir", "os.rmdir")
WRITING = os.O_WRONLY | os.O_RDWR | os.O_CREAT


class Steps:
    """The steps of a child below a folder, counted; at step `last` it is killed."""

    def __init__(self, below: Path, last: int | None):
        self.below, self.last, self.count = str(below), last, 0
        self.fdopen = os.fdopen

    def begin(self) -> None:
        """From now on, in this process."""
        sys.addaudithook(self.hook)
        os.fdopen = self.opened  # type: ignore[assignment]

    def hook(self, event: str, given: tuple[Any, ...]) -> None:
        writes = (
            event in ON_DISK or event == "open" and isinstance(given[2], int) and given[2] & WRITING
        )
        if writes and any(str(path).startswith(self.below) for path in given[:2]):
            self.step()

    def step(self) -> None:
        self.count += 1
        if self.count == self.last:
            os.kill(os.getpid(), signal.SIGKILL)

    def opened(self, handle: int, *how: Any, **more: Any) -> Any:
        """A file whose first write is a step when half of it is on the disk."""
        file = self.fdopen(handle, *how, **more)
        write = file.write

        def halves(content: bytes) -> None:
            write(content[: len(content) // 2])
            file.flush()
            self.step()
            write(content[len(content) // 2 :])

        return _Halved(file, halves)


class _Halved:
    """A file with a write of its own."""

    def __init__(self, file: Any, write: Any):
        self.file, self.write = file, write

    def __enter__(self) -> _Halved:
        return self

    def __exit__(self, *_: object) -> None:
        self.file.close()

    def __getattr__(self, name: str) -> Any:
        return getattr(self.file, name)


def child(words: list[str], last: int | None = None, count: Path | None = None) -> int:
    """Process id of a fork that runs a command and says nothing; killed at step `last`. `count`:
    the file that its number of steps is written into."""
    pid = os.fork()
    if pid:
        return pid
    quiet = os.open(os.devnull, os.O_RDWR)
    for stream in (1, 2):
        os.dup2(quiet, stream)
    status, steps = 70, Steps(Path(words[words.index("--out") + 1]), last)
    steps.begin()
    try:
        run_command_line(words)
    except SystemExit as end:
        status = int(end.code or 0)
    finally:
        if count is not None:
            count.write_text(str(steps.count))
        os._exit(status)
    return 0


def ended(pid: int) -> int:
    return os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1])


def left(out: Path) -> dict[str, bytes]:
    return (
        {str(p.relative_to(out)): p.read_bytes() for p in sorted(out.rglob("*")) if p.is_file()}
        if out.exists()
        else {}
    )


def loads(out: Path) -> bool:
    """Whether a folder is read back as a whole result."""
    try:
        load_result(out)
    except StudyError:
        return False
    return True


def run(place: Path, kills: int, rng: np.random.Generator, sampling: bool) -> dict[str, object]:
    for name, content in base_files().items():
        (place / name).write_bytes(content)
    words = ["study", str(place / "study.toml"), "--no-report", "--out"]
    if sampling:
        from modelsel.study.pipeline import checkpoint, pipeline
        from modelsel.uncertainty.sampling_options import SamplingOptions

        options = SamplingOptions(min_times=2, max_r_hat=100.0, max_evaluations=0)
        pipeline.build_log_posterior = partial(pipeline.build_log_posterior, options=options)
        pipeline.sample_confidence = partial(pipeline.sample_confidence, options=options)
        checkpoint.COPY_INTERVAL_S = 0.0
    else:
        words.insert(2, "--no-sampling")
    study = place / "study.toml"
    text = study.read_text()
    study.write_text(text.replace("seed = 3", "seed = 4"))
    assert ended(child([*words, str(place / "old")])) == 0
    study.write_text(text)
    old, out, found, points = left(place / "old"), place / "out", Counter[str](), []
    for name, over in (
        ("whole", False),
        ("again", True),
    ):  # over an older result, or where nothing was
        if over:
            shutil.copytree(place / "old", place / name)
        assert ended(child([*words, str(place / name)], count=place / "steps")) == 0
        points += [(n, over) for n in range(1, int((place / "steps").read_text()) + 1)]
    whole = left(place / "whole")
    assert left(place / "again") == whole
    found["steps"] = len(points)
    if len(points) > kills:
        points = [points[k] for k in np.sort(rng.choice(len(points), kills, replace=False))]
    for k, (n, over) in enumerate(points):
        shutil.rmtree(out, ignore_errors=True)
        if over:
            shutil.copytree(place / "old", out)
        if ended(child([*words, str(out)], last=n)) != -signal.SIGKILL:
            found["not killed"] += 1
            continue
        there = {
            name: content for name, content in left(out).items() if not name.startswith(".modelsel")
        }
        states = {
            "old" if content == old.get(name) else "new" if content == whole.get(name) else "broken"
            for name, content in there.items()
        }
        found["killed"] += 1
        found["broken"] += "broken" in states
        found["left " + (" and ".join(sorted(states)) or "nothing")] += 1
        found["taken for one run"] += states != {"old"} and there != whole and loads(out)
        found["left a chain"] += (out / ".modelsel" / "sampling.npz").is_file()
        if sampling or k % 3 == 0:
            again = ended(child([*words, str(out), "--resume"]))
            found["resumed"] += 1
            found["resumed to the same bytes"] += again == 0 and left(out) == whole
    return dict(found)


if __name__ == "__main__":
    rng = np.random.default_rng(int(sys.argv[3]))
    sys.stdout.write(
        json.dumps(run(Path(sys.argv[1]), int(sys.argv[2]), rng, "sampling" in sys.argv))
    )
