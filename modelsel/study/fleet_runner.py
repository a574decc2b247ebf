"""Many studies as one job on dask.distributed, and measurement sets that are never held whole.

A study runs on a worker exactly as alone and writes what it writes alone into its own folder; what
fails is said and stops nothing else. A worker that dies is replaced and its studies run again.
Results do not depend on the workers: every study has its own seed, and pieces are merged in their
order."""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from .._files import claim_folder, csv_bytes, write_atomically
from .._json import to_json
from ..config.fleet_file import Fleet, PartsTable, Task, find_files
from ..config.study_file import find_data
from ..exceptions import CHECK_FAILED, DataError, ModelselError, StudyError
from ..fitting.design import Model
from ..mechanisms.registry import mechanism, with_plugins
from ..report.drawing import draw
from ..report.pages.fleet_summary import write_summary
from ..results.storage import WRITES
from ..robot.files import builtin_names, load, read_robot
from ..selection.streaming import Parts, fit_parts, list_parts
from .pipeline import provenance
from .runner import run

if TYPE_CHECKING:
    from rich.console import Console

Row = dict[str, Any]
RETRIES = 3  # of a study whose worker died
ERRORS = ("nominal", "base", "chosen")


@contextmanager
def cluster(workers: int | None = None, scheduler: str | None = None) -> Iterator[Any]:
    """A dask client: of a running scheduler, or of workers of this machine, one thread each. Raises
    StudyError."""
    try:
        import dask
        from distributed import Client, LocalCluster
    except ImportError:
        raise StudyError(
            "fleet: dask.distributed is not installed: pip install 'modelsel[fleet]'"
        ) from None
    if scheduler is not None:
        try:
            client = Client(scheduler, timeout=20, set_as_default=False)
        except (OSError, ValueError) as error:
            raise StudyError(f"--scheduler {scheduler}: {error}") from None
        with client:
            yield client
        return
    quiet = {
        "distributed.worker.daemon": False,
        "distributed.logging.distributed": "error",  # a study may have workers itself
        "distributed.worker.memory.terminate": False,
        "distributed.nanny.pre-spawn-environ.MALLOC_TRIM_THRESHOLD_": None,
    }
    with (
        dask.config.set(quiet),
        LocalCluster(
            n_workers=workers or os.cpu_count() or 1,
            threads_per_worker=1,
            processes=True,
            dashboard_address=None,
            silence_logs=50,
        ) as here,
        Client(here, set_as_default=False) as client,
    ):
        yield client


def run_fleet(
    fleet: Fleet,
    out: Path,
    client: Any,
    *,
    sampling: bool = True,
    resume: bool = False,
    reports: bool = False,
    say: Callable[[str], None] = lambda _: None,
) -> list[Row]:
    """Every study and measurement set of a fleet, each into its folder below `out`, with its
    `reports` drawn or to be drawn later; a row of the summary for each, in the fleet's order.
    Nothing is raised for a study that fails: its row says why."""
    from distributed import as_completed

    out = out.resolve()
    rows: dict[str, Row] = {}
    waiting = {}
    for task in fleet.tasks:
        if resume and _finished(task, out / task.name, sampling, reports):
            rows[task.name] = _row(
                task.name, json.loads((out / task.name / "result.json").read_text(encoding="utf-8"))
            )
        else:
            waiting[
                client.submit(
                    _one, task, str(out / task.name), sampling, reports, pure=False, retries=RETRIES
                )
            ] = task.name
    if rows:
        say(f"{len(rows)} of {len(fleet.tasks)} are finished already")
    for future in as_completed(list(waiting), loop=client.loop):
        name = waiting[future]
        error = future.exception()
        rows[name] = future.result() if error is None else _broken(name, error)
        say(f"{len(rows)} of {len(fleet.tasks)}  {name}: {rows[name]['state']}")
    for part in fleet.parts:
        try:
            rows[part.name] = _whole_set(part, fleet.folder, out / part.name, client)
        except Exception as error:  # noqa: BLE001 - whatever breaks in one set, the job goes on and its row says what
            rows[part.name] = _broken(part.name, error)
        say(f"{part.name}: {rows[part.name]['state']}")
    return [rows[name] for name in (*(t.name for t in fleet.tasks), *(p.name for p in fleet.parts))]


def _one(task: Task, out: str, sampling: bool, reports: bool) -> Row:
    """On a worker: one study, from its file to all it writes."""
    try:
        with claim_folder(Path(out)):
            result = run(task.study, task.folder, registry=with_plugins()[0], sampling=sampling)
            result.save(Path(out))
            if reports:
                draw(Path(out))
    except ModelselError as error:
        return _failed(task.name, str(error), error.exit_code)
    return _row(task.name, json.loads((Path(out) / "result.json").read_text(encoding="utf-8")))


def _finished(task: Task, folder: Path, sampling: bool, reports: bool) -> bool:
    """Whether the folder holds all of this study: same data, same study, same versions."""
    if not all(
        (folder / name).is_file()
        for name in (*WRITES, *(("report.pdf", "report.html") if reports else ()))
    ):
        return False
    try:
        there = json.loads((folder / "result.json").read_text(encoding="utf-8"))
        data = hashlib.sha256(
            find_data(task.study.measurements.file, task.folder).read_bytes()
        ).hexdigest()
    except (OSError, ValueError):
        return False
    same = there.get("provenance") == provenance(task.study, data)
    return bool(same and (not sampling or there.get("sampling") is not None))


def _row(name: str, result: Row) -> Row:
    """A study's line in the summary."""
    ladder = result["ladder"]
    last, sampled = ladder[-1], result["sampling"]
    return {
        "name": name,
        "state": "done",
        "exit": 0 if sampled is None or sampled["converged"] else CHECK_FAILED,
        "robot": result["robot"],
        "estimation": result["configurations"]["estimation"],
        "held_out": result["configurations"]["held_out"],
        "noise_mm": result["noise_floor"]["coordinate_mm"],
        "nominal_mm": ladder[0]["held_out"]["mean_mm"],
        "base_mm": ladder[1 if len(ladder) > 1 else 0]["held_out"]["mean_mm"],
        "chosen_mm": last["held_out"]["mean_mm"],
        "rank": last["rank"],
        "found": " + ".join(
            m
            for m in last["mechanisms"]
            if m not in ladder[1 if len(ladder) > 1 else 0]["mechanisms"]
        ),
        "warnings": " + ".join(dict.fromkeys(w["code"] for w in result["warnings"])),
        "why": "",
    }


def _failed(name: str, why: str, code: int) -> Row:
    return dict.fromkeys(_COLUMNS) | {
        "name": name,
        "state": "failed",
        "exit": code,
        "found": "",
        "warnings": "",
        "why": why,
    }


def _broken(name: str, error: BaseException) -> Row:
    return _failed(name, f"internal error: {type(error).__name__}: {error}", 1)


_COLUMNS = (
    "name",
    "state",
    "exit",
    "robot",
    "estimation",
    "held_out",
    "noise_mm",
    "nominal_mm",
    "base_mm",
    "chosen_mm",
    "rank",
    "found",
    "warnings",
    "why",
)


def _whole_set(table: PartsTable, folder: Path, out: Path, client: Any) -> Row:
    """A measurement set in pieces: fitted on the workers, parts.json written."""
    try:
        problems: list[str] = []
        files = [path for pattern in table.files for path in find_files(folder, pattern, problems)]
        if not files:
            raise DataError(
                f"no file matches {', '.join(table.files)}.",
                remedy="Patterns are relative to the fleet file.",
            )
        robot = (
            load(table.robot)
            if table.robot in builtin_names()
            else read_robot(folder / table.robot)
        )
        model = Model(tuple(mechanism(name, robot, with_plugins()[0]) for name in table.base))
        x, y, z = table.tool_mm
        source = Parts(
            robot,
            (x, y, z),
            list_parts([path.resolve() for path in files]),
            partial(_on_workers, client),
        )
        fitted, cv = fit_parts(source, model, table.folds)
    except ModelselError as error:
        return _failed(table.name, str(error), error.exit_code)
    found = {
        "schema": 1,
        "name": table.name,
        "robot": robot.name,
        "base": list(table.base),
        "rows": len(source),
        "pieces": len(source.parts),
        "rank": fitted.rank,
        "sigma_mm": fitted.sigma,
        "cv_rms_mm": cv.rms * 3**0.5,
        "estimate": [
            {"symbol": t.symbol, "unit": t.unit, "value": v, "standard_error": s}
            for t, v, s in zip(model.terms, fitted.theta, fitted.standard_errors, strict=True)
        ],
    }
    write_atomically(out / "parts.json", to_json(found).encode())
    return _failed(table.name, "", 0) | {
        "state": "done",
        "robot": robot.name,
        "estimation": len(source),
        "held_out": 0,
        "noise_mm": fitted.sigma,
        "rank": fitted.rank,
    }


def _on_workers(client: Any, work: Callable[[Any], Any], items: Sequence[Any]) -> list[Any]:
    """map on the workers, results in the items' order; an error of the work is raised here."""
    return list(client.gather(client.map(work, items, pure=False, retries=0)))


def save_summary(rows: Sequence[Row], out: Path, name: str | None = None) -> list[Path]:
    """summary.csv and summary.parquet, a line a study, and for a fleet's `name` summary.pdf; the
    same bytes for the same results."""
    import io

    import pandas as pd

    frame = pd.DataFrame(list(rows), columns=list(_COLUMNS))
    buffer = io.BytesIO()
    frame.to_parquet(buffer, index=False)
    paths = [out / "summary.csv", out / "summary.parquet"]
    write_atomically(paths[0], csv_bytes(frame, "%.10g"))
    write_atomically(paths[1], buffer.getvalue())
    if name is not None:
        paths.append(out / "summary.pdf")
        write_atomically(paths[2], write_summary(name, rows, out))
    return paths


def show_fleet(rows: Sequence[Row], console: Console) -> None:
    """The summary on a terminal: a line a study, mean held-out errors in mm; then what failed and
    why."""
    from rich.table import Table
    from rich.text import Text

    from ..results.study_sentences import format_mm

    table = Table(title="Mean held-out error [mm]")
    for name, side in (
        ("study", "left"),
        ("configurations", "right"),
        *((what, "right") for what in ERRORS),
        ("found", "left"),
    ):
        table.add_column(name, justify=side)  # type: ignore[arg-type]
    for row in rows:
        if row["state"] == "done":
            table.add_row(
                Text(row["name"]),
                f"{row['estimation'] + row['held_out']:,}",
                *(format_mm(row[f"{what}_mm"]) for what in ERRORS),
                Text(row["found"] or "–"),
            )
    console.print(table)
    for row in rows:
        if row["state"] != "done":
            console.print(f"{row['name']} failed: {row['why']}", markup=False, emoji=False)
