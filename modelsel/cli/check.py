"""modelsel check: what is in a measurements file."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from ._options import (
    column_option,
    dh_option,
    json_option,
    print_json,
    print_prose,
    read_robot_option,
    table_option,
    xacro_option,
)


@click.command("check")
@click.argument("data", type=click.Path(path_type=Path))
@click.option("--robot", help="A built-in robot's name, or a robot file; of a study, its own.")
@click.option("--base", help="Of a URDF: the link the chain starts at; default its root.")
@click.option("--tip", help="Of a URDF: the link the chain ends at; default the longest chain's.")
@xacro_option
@dh_option
@table_option
@column_option
@json_option
def check_command(
    data: Path,
    robot: str | None,
    base: str | None,
    tip: str | None,
    arguments: dict[str, str],
    convention: str | None,
    sheet: str | None,
    decimal: str | None,
    columns: dict[str, str],
    as_json: bool,
) -> None:
    """What is in a measurements file, what it can tell and what it cannot. DATA is the file, or a
    study's folder: its file and its robot, with the study's tool and registration. The exit status
    of a study that `modelsel study` would refuse is that of the refusal."""
    from ..measurements.formats.table import DataFile
    from ..measurements.reader import read_measurements
    from ..study.inspection.inspection import inspect_measurements
    from ..study.inspection.inspection_text import format_inspection

    said: tuple[str, ...] = ()
    if data.is_dir() or data.suffix == ".toml":
        if any((robot, base, tip, arguments, convention, sheet, decimal, columns)):
            raise click.UsageError(
                "a study has its own robot and columns: give its folder alone, or the file with --robot."
            )
        found = _inspect_study(data)
    elif robot is None:
        raise click.UsageError("--robot NAME is needed with a file; a study's folder has its own.")
    else:
        named = read_robot_option(robot, base, tip, arguments, convention)
        arm, said = named.robot, named.said
        measured = read_measurements(DataFile(data, sheet, decimal), arm, columns)
        found = inspect_measurements(arm, measured)
    if as_json:
        print_json(found)
    else:
        for line in [*said, *format_inspection(found)]:
            print_prose(line)
    refused = found.get("study", {}).get("exit")
    if refused:
        raise SystemExit(refused)


def _inspect_study(path: Path) -> dict[str, Any]:
    """Describe the measurements of a study, and its robot as the study has it."""
    from ..mechanisms.registry import with_plugins
    from ..study.inputs.whole_study import open_study
    from ..study.inspection.study_inspection import inspect_study

    study, folder = open_study(path, None)
    registry, _ = with_plugins()
    return inspect_study(study, folder, registry)
