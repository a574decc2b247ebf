"""modelsel validate: a stored calibration on new data."""

from __future__ import annotations

from pathlib import Path

import click

from ..exceptions import CHECK_FAILED
from ._join_options import JointLog, join_option
from ._options import column_option, json_option, print_json, print_prose, table_option


@click.command("validate")
@click.argument("result", type=click.Path(path_type=Path))
@click.argument("data", type=click.Path(path_type=Path))
@click.option(
    "--register",
    is_flag=True,
    help="The instrument or the target may have moved: find them anew, keep the arm.",
)
@join_option
@table_option
@column_option
@json_option
def validate_command(
    result: Path,
    data: Path,
    register: bool,
    log: JointLog | None,
    sheet: str | None,
    decimal: str | None,
    columns: dict[str, str],
    as_json: bool,
) -> None:
    """Whether a stored calibration still holds on new measurements; nothing of it is refitted.
    A file of the form of the study's (columns, sheet, decimal mark) goes in as it is; points and
    readings in two files do with --joints."""
    from ..calibration.commands.command_notes import describe_extrapolation
    from ..calibration.loading import load_calibration
    from ..calibration.validation.validation import judge
    from ..calibration.validation.verdict_sentences import describe_verdict
    from ..measurements.reader import read_measurements
    from ..study.drafts.new_study import TOLD_NOTES
    from ._later_files import count_own, load_later

    c = load_calibration(result)
    later = load_later(c, c.form.open(data, sheet, decimal), log, columns)
    measured = read_measurements(later.table, c.robot, later.columns)
    found = judge(c, measured, register)
    said, beyond = describe_verdict(measured, found), describe_extrapolation(c, measured)
    own_rows = count_own(c, measured)
    beyond = [*later.describe_own(c, own_rows, len(measured)), *beyond]
    warnings = [*found.doubts, *beyond]
    if as_json:
        print_json(
            {
                "sentence": said[0],
                "drifted": found.drifted,
                "factor": found.factor,
                "whitened_factor": found.whitened_factor,
                "p_value": found.p,
                "rms_mm": found.rms_mm,
                "expected_rms_mm": found.expected_rms_mm,
                "orientation_rms_rad": found.turned_rad,
                "rows": len(measured),
                "rows_of_estimation": own_rows,
                "without_pattern": found.patternless,
                "beyond_noise": [
                    {"row": int(measured.row[k]), "standardised": found.size[k]}
                    for k in found.worst
                ],
                "left_out": [int(measured.row[k]) for k in found.left_out],
                "registered": None
                if found.moved is None
                else dict(
                    zip(("tracker_mm", "tracker_rad", "target_mm"), found.moved, strict=True)
                ),
                "warnings": warnings,
                "columns": later.columns,
            }
        )
    else:
        for line in [*later.said, *(n.sentence for n in measured.notes if n.code in TOLD_NOTES)]:
            print_prose(line)
        for line in found.doubts:
            print_prose(f"Check the data: {line}")
        for line in said:
            print_prose(line)
        for line in beyond:
            print_prose(f"Note: {line}")
    if found.drifted:
        raise SystemExit(CHECK_FAILED)
