"""modelsel validate: a stored calibration on new data."""

from __future__ import annotations

from pathlib import Path

import click

from ..exceptions import CHECK_FAILED
from ._options import column_option, print_json, table_option


@click.command("validate")
@click.argument("result", type=click.Path(path_type=Path))
@click.argument("data", type=click.Path(path_type=Path))
@click.option(
    "--register",
    is_flag=True,
    help="The tracker or the target may have moved: find them anew, keep the arm.",
)
@table_option
@column_option
@click.option("--json", "as_json", is_flag=True)
def validate_command(
    result: Path,
    data: Path,
    register: bool,
    sheet: str | None,
    decimal: str | None,
    columns: dict[str, str],
    as_json: bool,
) -> None:
    """Whether a stored calibration still holds on new measurements; nothing of it is refitted.
    A file of the form of the study's (columns, sheet, decimal mark) goes in as it is."""
    from ..calibration.command_notes import describe_extrapolation
    from ..calibration.loading import load_calibration
    from ..calibration.validation import describe_same_data, describe_verdict, judge
    from ..measurements.reader import read_measurements
    from ..measurements.table import hash_source, load_table
    from ..study.new_study import TOLD_NOTES

    c = load_calibration(result)
    source = c.form.open(data, sheet, decimal)
    table = load_table(source)
    mapping, mapped = c.form.read_columns(table, columns)
    measured = read_measurements(table, c.robot, mapping)
    found = judge(c, measured, register)
    said, beyond = describe_verdict(measured, found), describe_extrapolation(c, measured)
    beyond = [*describe_same_data(c, hash_source(data)), *beyond]
    warnings = [*found.doubts, *beyond]
    if as_json:
        print_json(
            {
                "sentence": said[0],
                "drifted": found.drifted,
                "factor": found.factor,
                "p_value": found.p,
                "rms_mm": found.rms_mm,
                "expected_rms_mm": found.expected_rms_mm,
                "rows": len(measured),
                "beyond_noise": [
                    {"row": int(measured.row[k]), "standardised": found.size[k]}
                    for k in found.worst
                ],
                "registered": None
                if found.moved is None
                else dict(
                    zip(("tracker_mm", "tracker_rad", "target_mm"), found.moved, strict=True)
                ),
                "warnings": warnings,
                "columns": mapping,
            }
        )
    else:
        for line in [mapped, *(n.sentence for n in measured.notes if n.code in TOLD_NOTES)]:
            if line:
                click.echo(line)
        for line in found.doubts:
            click.echo(f"Check the data: {line}")
        for line in said:
            click.echo(line)
        for line in beyond:
            click.echo(f"Note: {line}")
    if found.drifted:
        raise SystemExit(CHECK_FAILED)
