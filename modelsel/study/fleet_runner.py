"""Run many studies as one job on dask.distributed, and fit measurement sets too large for memory.

A study runs on a worker exactly as it runs alone, and writes the same files into its own folder. A
study that fails is reported and stops nothing else; a worker that dies is replaced and its studies
run again. Results do not depend on the workers: every study has its own seed, and the parts of a
set are merged in their order.
"""

from __future__ import annotations

import hashlib
import io
import json
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from itertools import chain
from pathlib import Path
from typing import Any

from .._files import claim_folder, csv_bytes, write_atomically
from .._json import to_json
from .._progress import News, keep_silent
from .._typing import Say
from .._workers import count_cores
from ..config.fleet_file import Fleet, PartsTable, Task, WrongStudy, find_files
from ..config.study_file import find_data
from ..exceptions import CHECK_FAILED, DataError, ModelselError, StudyError, count_words
from ..fitting.design import Model
from ..mechanisms.registry import mechanism, with_plugins
from ..report.drawing import draw
from ..report.pages.fleet_summary import write_summary
from ..results.storage import REPORTS, WRITES
from ..robot.files import builtin_names, load_robot
from ..robot.kinematics import Robot
from ..selection.streaming import Parts, fit_parts, list_parts
from .found_names import write_found_names
from .inputs.inputs import read_nominal_robot
from .pipeline.pipeline import record_provenance
from .pipeline.runner import run_study
from .scheduler_address import check_scheduler_address
from .tables.robot_tables import read_any_robot

Row = dict[str, Any]  # of the summary: a value for each of SUMMARY_COLUMNS

SUMMARY_COLUMNS = (
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
    "found_as",
)
SCHEDULER_TIMEOUT_S = 20


@dataclass(frozen=True)
class FleetOptions:
    """How a fleet is run.

    `sampling`: whether the posteriors are sampled; `resume`: keep studies that are finished;
    `reports`: draw the reports, too; `retries`: of a study whose worker died.
    """

    sampling: bool = True
    resume: bool = False
    reports: bool = False
    retries: int = 3


@contextmanager
def cluster(workers: int | None = None, scheduler: str | None = None) -> Iterator[Any]:
    """Open a dask client of a running scheduler, or of workers of this machine.

    By default there is one worker per core, of one thread each. Raises StudyError.
    """
    try:
        import dask
        from distributed import Client, LocalCluster
    except ImportError:
        raise StudyError(
            "fleet: dask.distributed is not installed: pip install 'modelsel[fleet]'"
        ) from None
    if scheduler is not None:
        check_scheduler_address(scheduler)
        try:
            client = Client(scheduler, timeout=SCHEDULER_TIMEOUT_S, set_as_default=False)
        except (OSError, ValueError) as error:
            raise StudyError(f"--scheduler {scheduler}: {error}") from None
        with client:
            yield client
        return
    quiet = {
        # what watches workers and event loops takes time of the core that a study could have
        "distributed.worker.profile.enabled": False,
        "distributed.admin.tick.interval": "1s",
        "distributed.admin.system-monitor.interval": "5s",
        "distributed.admin.system-monitor.disk": False,
        "distributed.worker.daemon": False,
        "distributed.logging.distributed": "error",  # a study may have workers itself
        "distributed.worker.memory.terminate": False,
        "distributed.nanny.pre-spawn-environ.MALLOC_TRIM_THRESHOLD_": None,
    }
    with (
        dask.config.set(quiet),
        LocalCluster(
            n_workers=workers or count_cores(),
            threads_per_worker=1,
            processes=True,
            dashboard_address=None,
            silence_logs=50,
        ) as local,
        Client(local, set_as_default=False) as client,
    ):
        yield client


def run_fleet(
    fleet: Fleet,
    out: Path,
    client: Any,
    options: FleetOptions = FleetOptions(),
    *,
    say: Say = keep_silent,
) -> list[Row]:
    """Run every study and fit every measurement set of a fleet, each into its folder below `out`.

    Returns a row of the summary for each, in the fleet's order. Raises nothing for a study that
    fails: its row says why.
    """
    out = out.resolve()
    rows: dict[str, Row] = {}
    tasks = fleet.tasks
    count = len(tasks)
    sound, wrong = _divide(tasks)
    if options.resume:
        for task in sound:
            name = task.name
            folder = out / name
            if _is_finished(task, folder, options):
                rows[name] = _read_row(name, folder)
    say(f"running {count_words(count, 'study')}")
    if rows:
        done = len(rows)
        verb = "is" if done == 1 else "are"
        say(News(f"{done} of {count} {verb} finished already", done / count, kept=True))
    waiting = [task for task in sound if task.name not in rows]
    finished = _run_tasks(waiting, out, client, options)
    for row in chain(wrong, finished):
        name = row["name"]
        state = row["state"]
        rows[name] = row
        share = len(rows) / count
        say(News(f"{len(rows)} of {count}  {name}: {state}", share, kept=True))
    for part in fleet.parts:
        name = part.name
        folder = out / name
        try:
            row = fit_measurement_set(part, fleet.folder, folder, client)
        except Exception as error:  # noqa: BLE001 - whatever breaks in one set, the job goes on
            row = _make_broken_row(name, error)
        rows[name] = row
        state = row["state"]
        say(f"{name}: {state}")
    names = [task.name for task in tasks]
    names += [part.name for part in fleet.parts]
    return [rows[name] for name in names]


def _divide(tasks: Sequence[Task | WrongStudy]) -> tuple[list[Task], list[Row]]:
    """Divide studies into those that can be run, and the rows of those that cannot be read."""
    sound = list[Task]()
    wrong = list[Row]()
    for task in tasks:
        if isinstance(task, WrongStudy):
            row = _make_failed_row(task.name, task.why, StudyError.exit_code)
            wrong.append(row)
        else:
            sound.append(task)
    return sound, wrong


def _run_tasks(
    tasks: Sequence[Task], out: Path, client: Any, options: FleetOptions
) -> Iterator[Row]:
    """Run studies on the workers and yield their rows as they are completed."""
    from distributed import as_completed

    names = {}
    for task in tasks:
        folder = str(out / task.name)
        future = client.submit(run_task, task, folder, options, pure=False, retries=options.retries)
        names[future] = task.name
    for future in as_completed(list(names), loop=client.loop):
        error = future.exception()
        if error is None:
            yield future.result()
        else:
            yield _make_broken_row(names[future], error)


def run_task(task: Task, out: str, options: FleetOptions) -> Row:
    """Run one study on a worker, from its file to all it writes, and return its row."""
    folder = Path(out)
    try:
        with claim_folder(folder):
            registry, _ = with_plugins()
            result = run_study(
                task.study, task.folder, registry=registry, sampling=options.sampling
            )
            result.save(folder)
            if options.reports:
                draw(folder)
    except ModelselError as error:
        return _make_failed_row(task.name, str(error), error.exit_code)
    return _read_row(task.name, folder)


def _is_finished(task: Task, folder: Path, options: FleetOptions) -> bool:
    """Return whether a folder holds all of this study: same data, study, robot and versions."""
    files = (*WRITES, *REPORTS) if options.reports else WRITES
    paths = [folder / file for file in files]
    if not all(path.is_file() for path in paths):
        return False
    study = task.study
    try:
        record = _read_record(folder)
        path = find_data(study.measurements.file, task.folder)
        data = path.read_bytes()
        robot = read_nominal_robot(study, task.folder)
    except (OSError, ValueError, StudyError):
        return False
    data_sha256 = hashlib.sha256(data).hexdigest()
    provenance = record_provenance(study, robot, data_sha256)
    if record.get("provenance") != provenance:
        return False
    is_sampled = record.get("sampling") is not None
    return is_sampled or not options.sampling


def _read_record(folder: Path, file: str = "result.json") -> dict[str, Any]:
    path = folder / file
    content = path.read_bytes()
    text = content.decode("utf-8")
    record: dict[str, Any] = json.loads(text)
    return record


def _read_row(name: str, folder: Path) -> Row:
    """Return the row of a study from its result.json and the place of its base in details.json."""
    record = _read_record(folder)
    ladder = record["ladder"]
    place = _read_record(folder, "details.json")["base"]
    nominal, base, chosen = ladder[0], ladder[place], ladder[-1]
    named = [name for name in chosen["mechanisms"] if name not in base["mechanisms"]]
    codes = dict.fromkeys(warning["code"] for warning in record["warnings"])
    sampling = record["sampling"]
    converged = sampling is None or sampling["converged"]
    return {
        "name": name,
        "state": "done",
        "exit": 0 if converged else CHECK_FAILED,
        "robot": record["robot"],
        "estimation": record["configurations"]["estimation"],
        "held_out": record["configurations"]["held_out"],
        "noise_mm": record["noise_floor"]["coordinate_mm"],
        "nominal_mm": nominal["held_out"]["mean_mm"],
        "base_mm": base["held_out"]["mean_mm"],
        "chosen_mm": chosen["held_out"]["mean_mm"],
        "rank": chosen["rank"],
        "found": " + ".join(named),
        "warnings": " + ".join(codes),
        "why": "",
        "found_as": write_found_names(named, record.get("findings", ())),
    }


def _make_failed_row(name: str, why: str, code: int) -> Row:
    row: Row = dict.fromkeys(SUMMARY_COLUMNS)
    row |= {"name": name, "state": "failed", "found": "", "warnings": "", "why": why, "exit": code}
    return row | {"found_as": ""}


def _make_broken_row(name: str, error: BaseException) -> Row:
    kind = type(error).__name__
    reason = f"{kind}: {error}"
    why = f"internal error: {reason}"
    return _make_failed_row(name, why, 1)


def fit_measurement_set(table: PartsTable, folder: Path, out: Path, client: Any) -> Row:
    """Fit a measurement set in parts on the workers, write parts.json, and return its row."""
    try:
        files = _find_files_of_set(table, folder)
        robot = _read_robot_of_set(table, folder)
        registry, _ = with_plugins()
        model = Model(tuple(mechanism(name, robot, registry) for name in table.base))
        x, y, z = table.tool_mm
        source = Parts(robot, (x, y, z), list_parts(files), partial(map_on_workers, client))
        fitted, cv = fit_parts(source, model, table.folds)
    except ModelselError as error:
        return _make_failed_row(table.name, str(error), error.exit_code)
    estimate = [
        {"symbol": term.symbol, "unit": term.unit, "value": value, "standard_error": error}
        for term, value, error in zip(
            model.terms, fitted.theta, fitted.standard_errors, strict=True
        )
    ]
    record = {
        "schema": 1,
        "name": table.name,
        "robot": robot.name,
        "base": list(table.base),
        "rows": len(source),
        "pieces": len(source.parts),
        "rank": fitted.rank,
        "sigma_mm": fitted.sigma,
        "cv_rms_mm": cv.rms * 3**0.5,
        "estimate": estimate,
    }
    write_atomically(out / "parts.json", to_json(record).encode())
    return _make_failed_row(table.name, "", 0) | {
        "state": "done",
        "robot": robot.name,
        "estimation": len(source),
        "held_out": 0,
        "noise_mm": fitted.sigma,
        "rank": fitted.rank,
    }


def _read_robot_of_set(table: PartsTable, folder: Path) -> Robot:
    if table.robot in builtin_names():
        return load_robot(table.robot)
    return read_any_robot(folder / table.robot)


def _find_files_of_set(table: PartsTable, folder: Path) -> list[Path]:
    """Return the files that the set's patterns match. Raises DataError where there are none."""
    files: list[Path] = []
    for pattern in table.files:
        files += find_files(folder, pattern, problems=[])
    if not files:
        raise DataError(
            f"no file matches {', '.join(table.files)}.",
            remedy="Patterns are relative to the fleet file.",
        )
    return [path.resolve() for path in files]


def map_on_workers(client: Any, work: Callable[[Any], Any], items: Sequence[Any]) -> list[Any]:
    """Map work over the items on the workers, results in the items' order; re-raise its errors."""
    futures = client.map(work, items, pure=False, retries=0)
    results = client.gather(futures)
    return list(results)


def save_summary(rows: Sequence[Row], out: Path, name: str | None = None) -> list[Path]:
    """Write summary.csv and summary.parquet, a line per study, and return their paths.

    With a fleet's `name` also summary.pdf. The same results give the same bytes.
    """
    import pandas as pd

    columns = list(SUMMARY_COLUMNS)
    frame = pd.DataFrame(list(rows), columns=columns)
    parquet = io.BytesIO()
    frame.to_parquet(parquet, index=False)
    paths = [out / "summary.csv", out / "summary.parquet"]
    write_atomically(paths[0], csv_bytes(frame, "%.10g"))
    write_atomically(paths[1], parquet.getvalue())
    if name is not None:
        paths.append(out / "summary.pdf")
        write_atomically(paths[2], write_summary(name, rows, out))
    return paths
