"""What the benchmarks by lines share: many studies of every line over processes, kept as they end,
and rates with their intervals."""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from dataclasses import asdict
from multiprocessing import get_context
from pathlib import Path
from typing import Any

from scipy.stats import beta

# (line, seed, number of the study)
Job = tuple[str, int, int]


def interval(hits: int, of: int) -> str:
    """A rate with its Clopper-Pearson 95 % interval."""
    low = beta.ppf(0.025, hits, of - hits + 1) if hits else 0.0
    high = beta.ppf(0.975, hits + 1, of - hits) if hits < of else 1.0
    return f"{hits / of:.3f} [{low:.3f}, {high:.3f}]"


def count_most(names: Iterable[str], most: int = 4) -> str:
    return ", ".join(f"{name} {count}" for name, count in Counter(names).most_common(most)) or "-"


def build_parser(
    words: str, lines: Sequence[str], studies: int, seed: int
) -> argparse.ArgumentParser:
    """Build the parser of what every benchmark by lines may be asked for."""
    parser = argparse.ArgumentParser(description=words)
    parser.add_argument("--studies", type=int, default=studies, help="studies of every line")
    parser.add_argument("--seed", type=int, default=seed)
    parser.add_argument("--lines", nargs="*", choices=list(lines), default=list(lines))
    parser.add_argument("--workers", type=int, default=1)
    parser.add_argument(
        "--keep", type=Path, help="studies done, a line each; a run goes on from it"
    )
    parser.add_argument("--out", type=Path)
    return parser


def name_command(module: str, asked: argparse.Namespace, lines: Sequence[str]) -> str:
    """The command that gives the same studies."""
    chosen = "" if asked.lines == list(lines) else " --lines " + " ".join(asked.lines)
    return f"python -m benchmarks.{module} --studies {asked.studies} --seed {asked.seed}{chosen}"


def run_lines(
    asked: argparse.Namespace, lines: Sequence[str], kind: type, run_one: Callable[[Job], Any]
) -> list[Any]:
    """Run what is asked for and not kept yet; all studies of it, in the order of the lines."""
    kept = read_studies(asked.keep, kind)
    old = [s for s in kept if s.line in asked.lines and s.number < asked.studies]
    have = {(s.line, s.number) for s in old}
    jobs = [
        (name, asked.seed, k)
        for k in range(asked.studies)
        for name in asked.lines
        if (name, k) not in have
    ]
    studies = old + run_jobs(run_one, jobs, asked.workers, asked.keep, len(asked.lines))
    order = list(lines)
    return sorted(studies, key=lambda s: (order.index(s.line), s.number))


def read_studies(path: Path | None, kind: type) -> list[Any]:
    """Read the studies that an earlier run kept."""
    if path is None or not path.exists():
        return []
    kept = [json.loads(line) for line in path.read_text().splitlines()]
    return [
        kind(**{k: _freeze(v) if isinstance(v, list) else v for k, v in own.items()})
        for own in kept
    ]


def _freeze(values: list) -> tuple:
    return tuple(_freeze(v) if isinstance(v, list) else v for v in values)


def run_jobs(
    run_one: Callable[[Job], Any], jobs: Sequence[Job], workers: int, keep: Path | None, every: int
) -> list[Any]:
    """Run studies over processes; keep each as it ends, and print progress after `every` of them."""
    done: list[Any] = []
    started = time.monotonic()
    with get_context("fork").Pool(workers) as pool:
        for study in pool.imap_unordered(run_one, jobs):
            done.append(study)
            if keep is not None:
                with keep.open("a") as file:
                    file.write(json.dumps(asdict(study)) + "\n")
            if len(done) % every == 0:
                passed = time.monotonic() - started
                print(f"{len(done)} of {len(jobs)}, {passed:.0f} s", file=sys.stderr, flush=True)
    return done
