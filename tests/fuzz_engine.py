"""A small study, broken in every way: what comes out is its result, or one clear refusal and nothing else.

`python tests/fuzz_engine.py COUNT [SEED] [--minutes M] [--share S] [--json FILE]` tries COUNT mutants and says what came out.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import math
import os
import re
import shutil
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from fuzz_base import FLEET, ROBOT, STUDY, base_files
from fuzz_files import toml_mutant
from fuzz_judge import INSIDE, Outcome, alike, in_process, refusal_problems, result_problems
from fuzz_parquet import columns_of, parquet_mutant, parquet_of
from fuzz_tables import csv_mutant, csv_of, grid_of
from fuzz_urdf import urdf_mutant
from fuzz_words import REFUSED, SAME, Mutant

KINDS = ("csv", "parquet", "study", "robot", "urdf", "fleet")
SHARE = (0.32, 0.14, 0.2, 0.12, 0.14, 0.08)


@dataclass
class Fuzzer:
    """The good files and their results; draws mutants, runs them, keeps count."""

    rng: np.random.Generator
    place: Path
    share: float = 1.0  # of the mutants that pass the dry run, those computed
    counts: Counter[str] = field(default_factory=Counter)
    defects: list[dict[str, Any]] = field(default_factory=list)
    sentences: Counter[str] = field(default_factory=Counter)
    slowest: tuple[float, str] = (0.0, "")

    def __post_init__(self) -> None:
        self.files = base_files()
        self.expected: dict[str, Any] = {}
        for kind in KINDS[:5]:
            ran = self.command(kind, Mutant("none", self.good(kind)), ["study"], "--no-report")
            assert ran.status == 0, ran.stderr
            self.expected[kind] = json.loads(ran.left["result.json"])

    def good(self, kind: str) -> bytes:
        if kind == "parquet":
            return parquet_of(columns_of(self.files["measurements.csv"].decode()))
        return {
            "csv": self.files["measurements.csv"],
            "study": STUDY.encode(),
            "robot": ROBOT.encode(),
            "urdf": self.files["robot.urdf"],
            "fleet": FLEET.encode(),
        }[kind]

    def draw(self, kind: str) -> Mutant:
        text = (self.files["measurements.csv"] if kind == "parquet" else self.good(kind)).decode()
        make: Callable[[str, np.random.Generator], Mutant] = {
            "csv": csv_mutant,
            "parquet": parquet_mutant,
            "urdf": urdf_mutant,
        }.get(kind, toml_mutant)
        mutant = make(text, self.rng)
        return Mutant(mutant.name, mutant.content, SAME) if mutant.content == self.good(kind) else mutant

    def lay_out(self, kind: str, mutant: Mutant) -> Path:
        """A folder with the good files, one of them replaced; the study file to run."""
        shutil.rmtree(self.place, ignore_errors=True)
        self.place.mkdir(parents=True)
        study = (
            STUDY.replace("measurements.csv", "measurements.parquet")
            if kind == "parquet"
            else (STUDY.replace("robot.toml", "robot.urdf") if kind == "urdf" else STUDY)
        )
        files = self.files | {"study.toml": study.encode()}
        if kind == "fleet":
            (self.place / "arm").mkdir()
            for name, content in files.items():
                (self.place / "arm" / name).write_bytes(content)
            grid = grid_of(self.files["measurements.csv"].decode())
            for k in range(2):
                (self.place / f"day{k}.parquet").write_bytes(
                    parquet_of(columns_of(csv_of([grid[0], *grid[1 + k :: 2]]).decode()))
                )
        names = {
            "csv": "measurements.csv",
            "parquet": "measurements.parquet",
            "study": "study.toml",
            "robot": "robot.toml",
            "urdf": "robot.urdf",
            "fleet": "fleet.toml",
        }
        for name, content in ({} if kind == "fleet" else files).items():
            (self.place / name).write_bytes(content)
        (self.place / names[kind]).write_bytes(mutant.content)
        return self.place / ("fleet.toml" if kind == "fleet" else "study.toml")

    def command(self, kind: str, mutant: Mutant, words: list[str], *more: str) -> Outcome:
        file = self.lay_out(kind, mutant)
        before = set(self.place.rglob("*"))
        out = self.place.parent / "out"
        shutil.rmtree(out, ignore_errors=True)
        ran = in_process([*words, str(file), "--out", str(out), "--no-sampling", *more], out)
        strange = set(self.place.rglob("*")) - before
        strange |= {p for p in self.place.parent.iterdir() if p not in (self.place, out)}
        if strange or Path("pwned").exists():
            ran.stderr += f"\nTraceback: written outside the output folder: {strange}"
        return ran

    def one(self, kind: str) -> None:
        """Draw a mutant, try it, note what came out."""
        mutant = self.draw(kind)
        if kind == "fleet":
            ran = self.command(kind, mutant, ["fleet"])
            outcome, problems = self.judged_fleet(mutant, ran)
        else:
            ran = self.command(kind, mutant, ["study"], "--dry-run")
            outcome, problems = "read", []
            if ran.status:
                outcome, problems = f"refused {ran.status}", refusal_problems(ran, mutant.exits)
                if mutant.expect == SAME:
                    problems.append("refused, though it says the same as the good file")
            elif ran.left or ran.said:
                problems.append(f"a dry run left {sorted(ran.left)} and said {ran.said}")
            elif mutant.expect in {SAME, REFUSED} or self.rng.random() < self.share:
                ran = self.command(kind, mutant, ["study"], "--no-report")
                outcome, problems = self.judged(kind, mutant, ran)
        self.note(kind, mutant, ran, outcome, problems)

    def judged(self, kind: str, mutant: Mutant, ran: Outcome) -> tuple[str, list[str]]:
        if ran.status:
            same = ["refused, though it says the same as the good file"] if mutant.expect == SAME else []
            return f"refused {ran.status}", refusal_problems(ran, mutant.exits) + same
        problems = result_problems(ran)
        if mutant.expect == REFUSED:
            problems.append("taken, though it must be refused")
        if mutant.expect == SAME and not problems and not alike(json.loads(ran.left["result.json"]), self.expected[kind]):
            problems.append("another result than the good file's, though it says the same")
        return "same result" if mutant.expect == SAME else "clean result", problems

    def judged_fleet(self, mutant: Mutant, ran: Outcome) -> tuple[str, list[str]]:
        if ran.status and "summary.csv" not in ran.left:
            same = ["refused, though it says the same as the good file"] if mutant.expect == SAME else []
            return f"refused {ran.status}", refusal_problems(ran, mutant.exits) + same
        taken = ["taken, though it must be refused"] if mutant.expect == REFUSED else []
        return "clean result", taken + [f"said: {line}" for line in ran.said if INSIDE.search(line)]

    def note(self, kind: str, mutant: Mutant, ran: Outcome, outcome: str, problems: list[str]) -> None:
        self.slowest = max(self.slowest, (ran.seconds, f"{kind}: {mutant.name}"))
        self.counts[f"{kind}: {'defect' if problems else outcome}"] += 1
        for line in ran.said:
            self.sentences[re.sub(r"\d+", "0", re.sub(r'"[^"]*"', '"…"', re.sub(r"'[^']*'", "'…'", line)))[:160]] += 1
        if problems:
            self.defects.append(
                {
                    "kind": kind,
                    "mutant": mutant.name,
                    "problems": problems,
                    "said": ran.said[:5],
                    "status": ran.status,
                    "content": mutant.content[:200_000].decode("utf-8", "backslashreplace"),
                }
            )


def fleet_here(monkey: Callable[[str, Any], None]) -> None:
    """A fleet without workers: its files are read, its measurement sets fitted in this process."""

    @contextlib.contextmanager
    def nobody(*_: object) -> Iterator[None]:
        yield None

    from modelsel.telling import fleet as module

    def only_parts(read: Any, out: Path, client: Any, **_: Any) -> list[Any]:
        return [module._whole_set(part, read.folder, out / part.name, client) for part in read.parts]

    monkey("modelsel.telling.fleet.cluster", nobody)
    monkey("modelsel.telling.fleet.run_fleet", only_parts)
    monkey("modelsel.telling.fleet._on_workers", lambda client, work, items: [work(item) for item in items])


def _patch(dotted: str, value: Any) -> None:
    from importlib import import_module

    module, _, name = dotted.rpartition(".")
    setattr(import_module(module), name, value)


def summary(fuzz: Fuzzer, seed: int, seconds: float) -> dict[str, Any]:
    """What was tried and what came out, for people and machines."""
    table: dict[str, dict[str, int]] = {}
    for key, count in sorted(fuzz.counts.items()):
        kind, _, outcome = key.partition(": ")
        table.setdefault(kind, {})[outcome] = count
    return {
        "seed": seed,
        "mutants": fuzz.counts.total(),
        "seconds": round(seconds),
        "defects": len(fuzz.defects),
        "by_kind": table,
        "slowest_s": round(fuzz.slowest[0], 2),
        "slowest": fuzz.slowest[1],
        "python": ".".join(map(str, sys.version_info[:3])),
        "numpy": np.__version__,
    }


def run() -> None:
    """The long run."""
    asked = argparse.ArgumentParser()
    asked.add_argument("count", type=int)
    asked.add_argument("seed", type=int, nargs="?", default=1)
    asked.add_argument("--minutes", type=float, default=math.inf)
    asked.add_argument("--json", type=Path)
    asked.add_argument("--kinds", nargs="*", default=list(KINDS))
    asked.add_argument("--share", type=float, default=1.0, help="of the mutants that can be read and need not be, those computed")
    given = asked.parse_args()
    fleet_here(_patch)
    start, share = time.monotonic(), np.array([SHARE[KINDS.index(k)] for k in given.kinds])
    with tempfile.TemporaryDirectory(dir="/dev/shm" if Path("/dev/shm").is_dir() else None) as name:
        os.chdir(name)
        fuzz = Fuzzer(np.random.default_rng(given.seed), Path(name) / "work" / "files", given.share)
        while fuzz.counts.total() < given.count and time.monotonic() - start < 60 * given.minutes:
            fuzz.one(str(fuzz.rng.choice(given.kinds, p=share / share.sum())))
            if given.json and fuzz.counts.total() % 500 == 0:
                given.json.write_text(json.dumps(summary(fuzz, given.seed, time.monotonic() - start), indent=1) + "\n")
        os.chdir("/")
    found = summary(fuzz, given.seed, time.monotonic() - start)
    sys.stdout.write(json.dumps(found, indent=1) + "\n")
    if given.json:
        given.json.write_text(json.dumps(found, indent=1) + "\n")
        given.json.with_suffix(".defects.json").write_text(json.dumps(fuzz.defects, indent=1))
        given.json.with_suffix(".sentences.txt").write_text(
            "\n".join(f"{n:6d}  {s}" for s, n in fuzz.sentences.most_common()) + "\n"
        )


if __name__ == "__main__":
    run()
