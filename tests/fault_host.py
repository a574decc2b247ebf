"""Runs a study in children that are killed at drawn moments; prints, as JSON, what was left and whether all came out the same.

`python fault_host.py FOLDER KILLS SEED [sampling]`: a process of its own, with everything loaded before the first child starts.
"""
from __future__ import annotations

import json
import os
import shutil
import signal
import sys
import time
from collections import Counter
from pathlib import Path

import numpy as np
from fuzz_base import base_files

from modelsel.cli import main


def child(words: list[str]) -> int:
    """Process id of a fork that runs a command and says nothing."""
    pid = os.fork()
    if pid:
        return pid
    quiet = os.open(os.devnull, os.O_RDWR)
    for stream in (1, 2):
        os.dup2(quiet, stream)
    try:
        main(words)
    except SystemExit as end:
        os._exit(int(end.code or 0))
    finally:
        os._exit(70)
    return 0


def ended(pid: int) -> int:
    return os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1])


def left(out: Path) -> dict[str, bytes]:
    return {str(p.relative_to(out)): p.read_bytes() for p in sorted(out.rglob("*")) if p.is_file()} if out.exists() else {}


def run(place: Path, kills: int, rng: np.random.Generator, sampling: bool) -> dict[str, object]:
    for name, content in base_files().items():
        (place / name).write_bytes(content)
    words = ["study", str(place / "study.toml"), "--no-report", "--out"]
    if sampling:
        from modelsel.elsewhere import confidence
        from modelsel.sure import sampling as engine
        from modelsel.telling import checkpoint
        engine.LONG, engine.AGREE, confidence.ROWS, checkpoint.EVERY = 2, 100.0, 0, 0.0
    else:
        words.insert(2, "--no-sampling")
    study = place / "study.toml"
    text = study.read_text()
    study.write_text(text.replace("seed = 3", "seed = 4"))
    assert ended(child([*words, str(place / "old")])) == 0
    study.write_text(text)
    took = []
    for _ in range(1 if sampling else 2):
        start = time.perf_counter()
        assert ended(child([*words, str(place / "whole")])) == 0
        took.append(time.perf_counter() - start)
    old, whole, out, found = left(place / "old"), left(place / "whole"), place / "out", Counter[str]()
    latest = min(took)
    for k in range(3 * kills):
        if found["killed"] == kills:
            break
        shutil.rmtree(out, ignore_errors=True)
        if k % 2:                               # over an older result, or where nothing was
            shutil.copytree(place / "old", out)
        pid = child([*words, str(out)])
        time.sleep(float(rng.uniform(0.7 if k % 4 > 1 else 0.2 * sampling, 1) * latest))     # half of them about the writing
        os.kill(pid, signal.SIGKILL)
        if ended(pid) != -signal.SIGKILL:       # it was done already
            found["came too late"] += 1
            latest *= 0.9
            continue
        there = {name: content for name, content in left(out).items() if not name.startswith(".modelsel")}
        states = {"old" if content == old[name] else "new" if content == whole[name] else "broken"
                  for name, content in there.items()}
        found["killed"] += 1
        found["broken"] += "broken" in states
        found["left " + (" and ".join(sorted(states)) or "nothing")] += 1
        found["left a chain"] += (out / ".modelsel" / "sampling.npz").is_file()
        if sampling or k % 3 == 0:
            again = ended(child([*words, str(out), "--resume"]))
            found["resumed"] += 1
            found["resumed to the same bytes"] += again == 0 and left(out) == whole
    return dict(found)


if __name__ == "__main__":
    rng = np.random.default_rng(int(sys.argv[3]))
    sys.stdout.write(json.dumps(run(Path(sys.argv[1]), int(sys.argv[2]), rng, "sampling" in sys.argv)))
