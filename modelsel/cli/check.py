"""modelsel check: what is in a measurements file."""

from __future__ import annotations

from pathlib import Path

import click

from ._options import (
    column_option,
    dh_option,
    print_json,
    read_robot_option,
    table_option,
    xacro_option,
)


@click.command("check")
@click.argument("data", type=click.Path(path_type=Path))
@click.option("--robot", required=True, help="A built-in robot's name, or a robot file.")
@click.option("--base", help="Of a URDF: the link the chain starts at; default its root.")
@click.option("--tip", help="Of a URDF: the link the chain ends at; default the longest chain's.")
@xacro_option
@dh_option
@table_option
@column_option
@click.option("--json", "as_json", is_flag=True)
def check_command(
    data: Path,
    robot: str,
    base: str | None,
    tip: str | None,
    arguments: dict[str, str],
    convention: str | None,
    sheet: str | None,
    decimal: str | None,
    columns: dict[str, str],
    as_json: bool,
) -> None:
    """What is in a measurements file, what it can tell and what it cannot."""
    from ..measurements.reader import read_measurements
    from ..measurements.table import DataFile
    from ..study.inspection import format_inspection, inspect_measurements

    named = read_robot_option(robot, base, tip, arguments, convention)
    arm = named.robot
    measured = read_measurements(DataFile(data, sheet, decimal), arm, columns)
    found = inspect_measurements(arm, measured)
    if as_json:
        print_json(found)
    else:
        for line in [*named.said, *format_inspection(found)]:
            click.echo(line)
