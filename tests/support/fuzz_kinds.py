"""The kinds of file that are broken: the good files about each, what breaks it, the commands that
read it."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
from fuzz_base import FLEET, STUDY, base_files, gauged_files, stored_files
from fuzz_files import toml_mutant
from fuzz_gauged import gauged_mutant
from fuzz_json import json_mutant
from fuzz_parquet import columns_of, parquet_mutant, parquet_of, residuals_mutant
from fuzz_tables import csv_mutant, csv_of, grid_of
from fuzz_urdf import urdf_mutant
from fuzz_words import ANY, Mutant

from modelsel.robot.plain_values import robot_from_record
from modelsel.robot.urdf_writer import write_urdf

Files = dict[str, bytes]


@dataclass(frozen=True)
class Kind:
    """`file` of the good `files` is broken by `mutant`; of `commands` one is drawn each time ({i}:
    the folder of the files, {o}: the output's). `first` reads and writes nothing: only a part of
    what passes it goes on. `among`: what is written lies among the files. `share` of the
    mutants."""

    file: str
    files: Callable[[], Files]
    mutant: Callable[[bytes, np.random.Generator], Mutant]
    commands: tuple[str, ...]
    share: float
    first: str = ""
    among: bool = False


def _text(
    make: Callable[[str, np.random.Generator], Mutant],
) -> Callable[[bytes, np.random.Generator], Mutant]:
    return lambda content, rng: make(content.decode(), rng)


def _told(text: str, rng: np.random.Generator) -> Mutant:
    """A broken table that is not fitted: numbers of another size are told of, and a command may
    stand there twice."""
    mutant = csv_mutant(text, rng)
    return (
        replace(mutant, expect=ANY)
        if mutant.name in ("values in another unit than the name's", "a row twice")
        else mutant
    )


def _base(old: str = "", new: str = "", **files: bytes) -> Files:
    return (
        base_files()
        | {"study.toml": STUDY.replace(old, new).encode()}
        | {k.replace("_", "."): v for k, v in files.items()}
    )


def _table() -> str:
    return base_files()["measurements.csv"].decode()


def _fleet() -> Files:
    grid = grid_of(_table())
    days = {
        f"day{k}.parquet": parquet_of(columns_of(csv_of([grid[0], *grid[1 + k :: 2]]).decode()))
        for k in range(2)
    }
    return (
        {f"arm/{name}": content for name, content in _base().items()}
        | days
        | {"fleet.toml": FLEET.encode()}
    )


@cache
def _with_urdf() -> dict[str, bytes]:
    """What a study leaves, its robot read from a URDF."""
    files = stored_files()
    record = json.loads(files["calibration.json"])
    robot = robot_from_record(record["robot"])
    text = write_urdf(robot, {}, {}, ["kept"])
    record["urdf"] = {"base": "base", "tip": "flange", "text": text}
    return files | {"calibration.json": json.dumps(record, indent=1).encode()}


DRY = "study {i}/study.toml --out {o} --no-sampling --dry-run"
RUN = ("study {i}/study.toml --out {o} --no-sampling --no-report",)
FORMS = ("urdf", "dh", "mdh", "hayati", "json", "csv", "python", "table")
ON_TARGETS = (
    "compensate {i} {i}/targets.csv --out {o}/commands.csv --bound 100 20 --json",
    "compensate {i} {i}/targets.csv --out {o}/commands.csv --forward --json",
    "compensate {i} {i}/targets.csv --out {o}/go.src --format krl --bound 100 20 --json",
)
ON_DATA = (
    "validate {i} {i}/measurements.csv --json",
    "validate {i} {i}/measurements.csv --register --json",
)
ON_CALIBRATION = (
    *ON_TARGETS,
    *ON_DATA,
    "compare {i} {i}/other.json --json",
    "compare {i}/other.json {i} --json",
    *(f"export {{i}} --format {form} --out {{o}}/made --json" for form in FORMS),
    "export {i} --format grid --joints 1,3 --within 0.5 --out {o}/made --json",
)
PAGES = (
    "report {i} --pages first,map --json",
    "report {i} --pages findings --json",
    "report {i} --json",
)
ON_RESULT = (*(9 * ("load {i}",)), *PAGES)

KINDS = {
    "csv": Kind("measurements.csv", _base, _text(csv_mutant), RUN, 0.32, DRY),
    "parquet": Kind(
        "measurements.parquet",
        lambda: _base(
            "measurements.csv",
            "measurements.parquet",
            measurements_parquet=parquet_of(columns_of(_table())),
        ),
        lambda _, rng: parquet_mutant(_table(), rng),
        RUN,
        0.14,
        DRY,
    ),
    "study": Kind("study.toml", _base, _text(toml_mutant), RUN, 0.2, DRY),
    "robot": Kind("robot.toml", _base, _text(toml_mutant), RUN, 0.12, DRY),
    "urdf": Kind(
        "robot.urdf", lambda: _base("robot.toml", "robot.urdf"), _text(urdf_mutant), RUN, 0.14, DRY
    ),
    "fleet": Kind(
        "fleet.toml",
        _fleet,
        _text(toml_mutant),
        ("fleet {i}/fleet.toml --out {o} --no-sampling",),
        0.08,
    ),
    "calibration": Kind("calibration.json", _with_urdf, _text(json_mutant), ON_CALIBRATION, 0.25),
    "targets": Kind(
        "targets.csv",
        stored_files,
        _text(_told),
        (
            *ON_TARGETS,
            "plan {i}/study.toml --pool {i}/targets.csv --count 3 --out {o}/plan.csv --json",
        ),
        0.15,
    ),
    "measured": Kind(
        "measurements.csv",
        stored_files,
        _text(_told),
        (*ON_DATA, "check {i}/measurements.csv --robot {i}/robot.toml --json"),
        0.15,
    ),
    "result": Kind("result.json", stored_files, _text(json_mutant), ON_RESULT, 0.12, among=True),
    "details": Kind("details.json", stored_files, _text(json_mutant), ON_RESULT, 0.08, among=True),
    "residuals": Kind(
        "residuals.parquet", stored_files, residuals_mutant, ("load {i}",), 0.05, among=True
    ),
    "gauged": Kind("measurements.csv", gauged_files, _text(gauged_mutant), RUN, 0.15, DRY),
    "features": Kind("study.toml", gauged_files, _text(toml_mutant), RUN, 0.05, DRY),
}
FIRST = tuple(KINDS)[:6]  # the files a newcomer writes: 2,000 mutants of these with every change
LATER = tuple(KINDS)[6:]  # what a study leaves, and what is read beside it


def shares(kinds: tuple[str, ...]) -> np.ndarray:
    """How often each is drawn, in all one."""
    share = np.array([KINDS[kind].share for kind in kinds])
    return np.asarray(share / share.sum())
