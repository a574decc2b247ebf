"""How well modelsel names causes, against what else a user would do: drawn cases, one table.

    python -m benchmarks.naming --cases 240 --nulls 240 --triples 60 --minutes 25 --json benchmarks/results/naming.json
    python -m benchmarks.naming --cases 0 --nulls 0 --fives 100 --seed 7 --extend --json benchmarks/results/naming.json

Every case: a robot (puma760, ur10, irb120) with geometric errors, 40, 80 or 200 configurations, 0
to 3 effects drawn from the catalogue (by formulas of the benchmark's own) and from outside it,
exact kinematics, noise 0.06 mm per coordinate. Sizes are rms per coordinate beyond the geometry
over the noise, 0.3 to 5. All methods see the same candidates. The second command adds cases of five
effects at once, at 120 configurations, to those that are kept."""

from __future__ import annotations

import argparse
import json
import signal
import sys
import time
from multiprocessing import get_context
from pathlib import Path
from typing import Any

from .figures import picture
from .score import run
from .summary import summary, text

LONGEST = 120  # seconds of a case: a longer one counts as failed
FIVES = 120  # configurations of the cases of five effects

# (seed, effects, rivals, configurations)
Job = tuple[list[int], int | None, bool, int | None]


def _one(job: Job) -> dict[str, Any]:
    def stop(*_: object) -> None:
        raise TimeoutError(f"no answer in {LONGEST} s")

    signal.signal(signal.SIGALRM, stop)
    signal.alarm(LONGEST)
    try:
        return run(*job)
    except Exception as error:  # noqa: BLE001 - a case that fails is counted and told, and the others go on
        return {"seed": list(job[0]), "failed": f"{type(error).__name__}: {error}"}
    finally:
        signal.alarm(0)


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--cases", type=int, default=300)
    parser.add_argument(
        "--nulls", type=int, default=240, help="further cases with nothing in them, modelsel alone"
    )
    parser.add_argument(
        "--triples", type=int, default=0, help="further cases of three effects, modelsel alone"
    )
    parser.add_argument(
        "--fives",
        type=int,
        default=0,
        help=f"further cases of five effects at {FIVES} configurations, modelsel alone",
    )
    parser.add_argument(
        "--extend", action="store_true", help="add to the cases that the .json has already"
    )
    parser.add_argument(
        "--tabulate",
        type=Path,
        default=None,
        help="no runs: the tables of the cases in a .json or .part",
    )
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument(
        "--minutes",
        type=float,
        default=None,
        help="stop after so long, with the tables of what is done",
    )
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--json", type=Path, default=None)
    given = parser.parse_args()
    kinds = (
        (given.cases, 0, None, True, None),
        (given.nulls, 10_000, 0, False, None),
        (given.triples, 20_000, 3, False, None),
        (given.fives, 30_000, 5, False, FIVES),
    )
    jobs: list[Job] = [
        ([given.seed, start + k], *rest)
        for _, k, start, *rest in sorted(
            (
                ((k + 0.5) / number, k, start, *rest)
                for number, start, *rest in kinds
                for k in range(number)
            ),
            key=lambda job: job[:3],
        )
    ]
    if given.tabulate is not None:
        lines = given.tabulate.read_text().splitlines()
        old = (
            [json.loads(line) for line in lines]
            if given.tabulate.suffix == ".part"
            else json.loads(lines[0])["cases"]
        )
        finish(old, old[0]["seed"][0], given.json)
        return
    out: list[dict[str, Any]] = []
    if given.json is not None:
        given.json.parent.mkdir(parents=True, exist_ok=True)
        part = given.json.with_suffix(".part")
        if given.extend and given.json.is_file():
            out = json.loads(given.json.read_text())["cases"]
        if part.is_file():  # go on where it stopped
            out += [json.loads(line) for line in part.read_text().splitlines()]
    started, done = time.monotonic(), {tuple(one["seed"]) for one in out}
    jobs = [job for job in jobs if tuple(job[0]) not in done]
    with get_context("fork").Pool(given.workers) as pool:
        for k, one in enumerate(pool.imap(_one, jobs, chunksize=1), 1):
            out.append(one)
            if given.json is not None:
                with given.json.with_suffix(".part").open("a") as file:
                    file.write(json.dumps(one) + "\n")
            if given.minutes is not None and time.monotonic() - started > 60 * given.minutes:
                break
            if k % 20 == 0:
                print(
                    f"{k} of {len(jobs)}, {time.monotonic() - started:.0f} s",
                    file=sys.stderr,
                    flush=True,
                )
    finish(out, given.seed, given.json)


def short(value: Any) -> Any:
    """The same values, numbers to four digits."""
    if isinstance(value, dict):
        return {k: short(v) for k, v in value.items()}
    if isinstance(value, (list, tuple)):
        return [short(v) for v in value]
    return float(f"{value:.4g}") if isinstance(value, float) else value


def finish(cases: list[dict[str, Any]], seed: int, path: Path | None) -> None:
    table = summary(cases)
    said = text(table, seed)
    print(said)
    if path is not None:
        path.write_text(json.dumps(short({"seed": seed, "summary": table, "cases": cases})) + "\n")
        path.with_suffix(".txt").write_text(said + "\n")
        picture(table["curve"], path.with_suffix(".png"))
        path.with_suffix(".part").unlink(missing_ok=True)


if __name__ == "__main__":
    main()
