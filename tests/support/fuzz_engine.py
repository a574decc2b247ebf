"""Files of every kind, broken in every way: what comes out is the good result, or one clear refusal
and nothing else.

`python tests/support/fuzz_engine.py COUNT [SEED] [--kinds KIND …] [--minutes M] [--share S] [--json FILE]`
tries COUNT mutants and says what came out; `python tests/support/fuzz_engine.py --merge FILE …` puts what
runs wrote with --json into benchmarks/results/fuzz.json."""

from __future__ import annotations

import argparse
import contextlib
import json
import math
import os
import re
import resource
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
from fuzz_clean import judge_of
from fuzz_judge import Outcome, in_process, refusal_problems
from fuzz_kinds import KINDS, Files, shares
from fuzz_words import REFUSED, SAME, Mutant

RESULTS = Path(__file__).parents[2] / "benchmarks" / "results" / "fuzz.json"
MEMORY = 4 << 30  # bytes that a mutant may take


def lay_out(kind: str, content: bytes, place: Path) -> dict[Path, bytes]:
    """A folder with the good files of a kind, the one that is broken replaced; what lies where."""
    shutil.rmtree(place, ignore_errors=True)
    files: Files = KINDS[kind].files() | {KINDS[kind].file: content}
    for name, some in files.items():
        (place / name).parent.mkdir(parents=True, exist_ok=True)
        (place / name).write_bytes(some)
    return {place / name: some for name, some in files.items()}


def words_of(command: str, place: Path, out: Path) -> list[str]:
    return [word.format(i=place, o=out) for word in command.split()]


@dataclass
class Fuzzer:
    """Draws mutants, runs them, keeps count."""

    rng: np.random.Generator
    place: Path
    share: float = 1.0  # of the mutants that pass the dry run, those computed
    counts: Counter[str] = field(default_factory=Counter)
    defects: list[dict[str, Any]] = field(default_factory=list)
    sentences: Counter[str] = field(default_factory=Counter)
    slowest: tuple[float, str] = (0.0, "")
    good: dict[tuple[str, str], Outcome] = field(default_factory=dict)

    def draw(self, kind: str) -> Mutant:
        content = KINDS[kind].files()[KINDS[kind].file]
        mutant = KINDS[kind].mutant(content, self.rng)
        return Mutant(mutant.name, mutant.content, SAME) if mutant.content == content else mutant

    def command(self, kind: str, content: bytes, command: str) -> Outcome:
        """A command on a folder with this content in the broken file's place. What it left are the
        files that it wrote."""
        there = lay_out(kind, content, self.place)
        shutil.rmtree(self.place.parent / "out", ignore_errors=True)
        out = self.place if KINDS[kind].among else self.place.parent / "out"
        ran = in_process(words_of(command, self.place, out), out)
        now = {path: path.read_bytes() for path in self.place.rglob("*") if path.is_file()}
        strange = [path for path in there if now.get(path) != there[path]]
        strange += [path for path in now if path not in there and out != self.place]
        strange += [path for path in self.place.parent.iterdir() if path not in (self.place, out)]
        if strange or Path("pwned").exists():
            ran.stderr += f"\nTraceback: written where nothing belongs: {strange}"
        ran.left = {
            name: some
            for name, some in ran.left.items()
            if self.place / name not in there or out != self.place
        }
        return ran

    def expected(self, kind: str, command: str) -> Outcome:
        """What the good file gives."""
        if (kind, command) not in self.good:
            ran = self.command(kind, KINDS[kind].files()[KINDS[kind].file], command)
            assert judge_of(command).took(ran), ran.stderr
            assert not (wrong := judge_of(command).problems(ran, ran)), (
                kind,
                command,
                wrong,
                ran.stderr,
            )
            self.good[kind, command] = ran
        return self.good[kind, command]

    def one(self, kind: str) -> None:
        """Draw a mutant and a command, try it, note what came out."""
        mutant, row = self.draw(kind), KINDS[kind]
        command = row.commands[
            int(self.rng.integers(len(row.commands))) if len(row.commands) > 1 else 0
        ]
        if row.first:
            ran = self.command(kind, mutant.content, row.first)
            if ran.status or ran.left or ran.said:
                self.note(kind, mutant, row.first, ran, *self.judged(kind, mutant, ran, row.first))
                return
            if mutant.expect not in {SAME, REFUSED} and self.rng.random() >= self.share:
                self.note(kind, mutant, row.first, ran, "read", [])
                return
        ran = self.command(kind, mutant.content, command)
        self.note(kind, mutant, command, ran, *self.judged(kind, mutant, ran, command))

    def judged(
        self, kind: str, mutant: Mutant, ran: Outcome, command: str
    ) -> tuple[str, list[str]]:
        """(how it ended, what is wrong with that)."""
        judge = judge_of(command)
        if ran.status and not judge.took(ran):
            same = (
                ["refused, though it says the same as the good file"]
                if mutant.expect == SAME
                else []
            )
            return f"refused {ran.status}", refusal_problems(ran, mutant.exits) + same
        if command == KINDS[kind].first:
            return "read", [f"a dry run left {sorted(ran.left)} and said {ran.said}"]
        good = self.expected(kind, command)
        problems = judge.problems(ran, good)
        if mutant.expect == REFUSED:
            problems.append("taken, though it must be refused")
        if mutant.expect == SAME and not problems and not judge.alike(ran, good):
            problems.append("another result than the good file's, though it says the same")
        return "same result" if mutant.expect == SAME else "clean result", problems

    def note(
        self,
        kind: str,
        mutant: Mutant,
        command: str,
        ran: Outcome,
        outcome: str,
        problems: list[str],
    ) -> None:
        self.slowest = max(self.slowest, (ran.seconds, f"{kind}: {mutant.name}"))
        self.counts[f"{kind}: {'defect' if problems else outcome}"] += 1
        for line in ran.said:
            self.sentences[
                re.sub(r"\d+", "0", re.sub(r'"[^"]*"', '"…"', re.sub(r"'[^']*'", "'…'", line)))[
                    :160
                ]
            ] += 1
        if problems:
            self.defects.append(
                {
                    "kind": kind,
                    "command": command,
                    "mutant": mutant.name,
                    "problems": problems,
                    "said": ran.said[:5],
                    "status": ran.status,
                    "content": mutant.content[:200_000].decode("utf-8", "backslashreplace"),
                }
            )


def tried(folder: Path, kind: str, content: bytes, command: str) -> Outcome:
    """What a command does with one file of this content."""
    (folder / "work").mkdir(parents=True, exist_ok=True)
    return Fuzzer(np.random.default_rng(1), folder / "work" / "files").command(
        kind, content, command
    )


def fleet_here(monkey: Callable[[str, Any], None]) -> None:
    """A fleet without workers: its files are read, its measurement sets fitted in this process."""

    @contextlib.contextmanager
    def nobody(*_: object) -> Iterator[None]:
        yield None

    from modelsel.study import fleet_runner as module

    def only_parts(read: Any, out: Path, client: Any, *_: Any, **__: Any) -> list[Any]:
        return [
            module.fit_measurement_set(part, read.folder, out / part.name, client)
            for part in read.parts
        ]

    monkey("modelsel.study.fleet_runner.cluster", nobody)
    monkey("modelsel.study.fleet_runner.run_fleet", only_parts)
    monkey(
        "modelsel.study.fleet_runner.map_on_workers",
        lambda client, work, items: [work(item) for item in items],
    )


def _patch(dotted: str, value: Any) -> None:
    from importlib import import_module

    module, _, name = dotted.rpartition(".")
    setattr(import_module(module), name, value)


def summary(fuzz: Fuzzer, seed: int, kinds: tuple[str, ...], seconds: float) -> dict[str, Any]:
    """What was tried and what came out, for people and machines."""
    table: dict[str, dict[str, int]] = {}
    for key, count in sorted(fuzz.counts.items()):
        kind, _, outcome = key.partition(": ")
        table.setdefault(kind, {})[outcome] = count
    return {
        "seed": seed,
        "kinds": kinds,
        "share": fuzz.share,
        "mutants": fuzz.counts.total(),
        "seconds": round(seconds),
        "defects": len(fuzz.defects),
        "by_kind": table,
        "slowest_s": round(fuzz.slowest[0], 2),
        "slowest": fuzz.slowest[1],
        "python": ".".join(map(str, sys.version_info[:3])),
        "numpy": np.__version__,
    }


def merged(runs: list[dict[str, Any]], before: dict[str, Any]) -> dict[str, Any]:
    """What fuzz.json says with some runs more: each stands there once, told by its seed, kinds and
    count."""

    def which(one: dict[str, Any]) -> str:
        return json.dumps(
            {key: one[key] for key in ("seed", "mutants", "by_kind", "python", "numpy")},
            sort_keys=True,
        )

    every = list({which(one): one for one in [*runs, *before["runs"]]}.values())
    every.sort(key=lambda one: [which(old) for old in [*before["runs"], *runs]].index(which(one)))
    total = {key: sum(one[key] for one in every) for key in ("mutants", "defects")}
    return {"what": before["what"], **total, "runs": every}


def merge(files: list[Path], into: Path = RESULTS) -> None:
    """Put long runs' own output into the benchmark's results."""
    whole = merged([json.loads(file.read_text()) for file in files], json.loads(into.read_text()))
    into.write_text(json.dumps(whole, indent=1) + "\n")


def run() -> None:
    """The long run, or the merging of several."""
    asked = argparse.ArgumentParser()
    asked.add_argument("count", type=int, nargs="?", default=0)
    asked.add_argument("seed", type=int, nargs="?", default=1)
    asked.add_argument("--minutes", type=float, default=math.inf)
    asked.add_argument("--json", type=Path)
    asked.add_argument("--kinds", nargs="*", default=list(KINDS), choices=list(KINDS))
    asked.add_argument(
        "--share",
        type=float,
        default=1.0,
        help="of the mutants that can be read and need not be, those computed",
    )
    asked.add_argument(
        "--merge", type=Path, nargs="+", metavar="FILE", help="what --json wrote, into the results"
    )
    given = asked.parse_args()
    if given.merge:
        merge(given.merge)
        return
    fleet_here(_patch)
    resource.setrlimit(
        resource.RLIMIT_AS, (MEMORY, MEMORY)
    )  # a mutant that would take more is a defect
    start, kinds = time.monotonic(), tuple(given.kinds)
    with tempfile.TemporaryDirectory(dir="/dev/shm" if Path("/dev/shm").is_dir() else None) as name:
        os.chdir(name)
        fuzz = Fuzzer(np.random.default_rng(given.seed), Path(name) / "work" / "files", given.share)
        while fuzz.counts.total() < given.count and time.monotonic() - start < 60 * given.minutes:
            fuzz.one(str(fuzz.rng.choice(kinds, p=shares(kinds))))
            if given.json and fuzz.counts.total() % 500 == 0:
                _write(given.json, fuzz, given.seed, kinds, start)
        os.chdir("/")
    sys.stdout.write(
        json.dumps(summary(fuzz, given.seed, kinds, time.monotonic() - start), indent=1) + "\n"
    )
    if given.json:
        _write(given.json, fuzz, given.seed, kinds, start)


def _write(file: Path, fuzz: Fuzzer, seed: int, kinds: tuple[str, ...], start: float) -> None:
    """The figures, and beside them the defects and what was said."""
    file.write_text(
        json.dumps(summary(fuzz, seed, kinds, time.monotonic() - start), indent=1) + "\n"
    )
    file.with_suffix(".defects.json").write_text(json.dumps(fuzz.defects, indent=1))
    file.with_suffix(".sentences.txt").write_text(
        "\n".join(f"{n:6d}  {s}" for s, n in fuzz.sentences.most_common()) + "\n"
    )


if __name__ == "__main__":
    run()
