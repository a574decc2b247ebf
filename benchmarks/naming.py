"""How well modelsel names causes, against what else a user would do: drawn cases, one table.

    python -m benchmarks.naming --cases 300 --nulls 240 --seed 1 --json benchmarks/results/naming.json

Every case: a robot (puma760, ur10, irb120) with geometric errors, 40, 80 or 200 configurations, 0 to 3 effects drawn from the
catalogue (by formulas of the benchmark's own) and from outside it, exact kinematics, noise 0.06 mm per coordinate. Sizes are
rms per coordinate beyond the geometry over the noise, 0.3 to 5. All methods see the same candidates.
"""
from __future__ import annotations

import argparse
import json
import os
import sys
import time
from multiprocessing import get_context
from pathlib import Path
from typing import Any

for _name in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(_name, "1")

from .figures import picture
from .score import run
from .summary import summary, text


def _one(job: tuple[list[int], int | None, bool]) -> dict[str, Any]:
    return run(*job)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cases", type=int, default=300)
    parser.add_argument("--nulls", type=int, default=240, help="further cases with nothing in them, modelsel alone")
    parser.add_argument("--triples", type=int, default=0, help="further cases of three effects, modelsel alone")
    parser.add_argument("--tabulate", type=Path, default=None, help="no runs: the tables of the cases in a .json or .part")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--json", type=Path, default=None)
    given = parser.parse_args()
    jobs: list[tuple[list[int], int | None, bool]] = [([given.seed, k], None, True) for k in range(given.cases)]
    jobs += [([given.seed, 10_000 + k], 0, False) for k in range(given.nulls)]
    jobs += [([given.seed, 20_000 + k], 3, False) for k in range(given.triples)]
    if given.tabulate is not None:
        lines = given.tabulate.read_text().splitlines()
        old = [json.loads(line) for line in lines] if given.tabulate.suffix == ".part" else json.loads(lines[0])["cases"]
        finish(old, given.seed, None)
        return
    if given.json is not None:
        given.json.parent.mkdir(parents=True, exist_ok=True)
        given.json.with_suffix(".part").write_text("")
    started, out = time.monotonic(), []
    with get_context("fork").Pool(given.workers) as pool:
        for k, one in enumerate(pool.imap(_one, jobs, chunksize=1), 1):
            out.append(one)
            if given.json is not None:
                with given.json.with_suffix(".part").open("a") as part:
                    part.write(json.dumps(one) + "\n")
            if k % 20 == 0:
                print(f"{k} of {len(jobs)}, {time.monotonic() - started:.0f} s", file=sys.stderr, flush=True)
    finish(out, given.seed, given.json)


def finish(cases: list[dict[str, Any]], seed: int, path: Path | None) -> None:
    table = summary(cases)
    said = text(table, seed)
    print(said)
    if path is not None:
        path.write_text(json.dumps({"seed": seed, "summary": table, "cases": cases}) + "\n")
        path.with_suffix(".txt").write_text(said + "\n")
        picture(table["curve"], path.with_suffix(".png"))
        path.with_suffix(".part").unlink(missing_ok=True)



if __name__ == "__main__":
    main()
