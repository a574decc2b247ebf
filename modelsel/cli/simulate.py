"""modelsel simulate: data with planted effects."""

from __future__ import annotations

from pathlib import Path

import click

from ..exceptions import count_words
from ._options import json_option, print_json
from ._output_path import OutputPath, check_output, check_table_path

NUMBERS = "%.9f"  # how they are written


@click.command("simulate")
@click.argument("study", type=click.Path(path_type=Path))
@click.option(
    "--out", type=OutputPath(dir_okay=False), required=True, help="CSV (or Parquet) file to write."
)
@json_option
def simulate_command(study: Path, out: Path, as_json: bool) -> None:
    """Make data with planted effects: [simulate] and [[simulate.effect]] of a study file."""
    from .._files import STUDY_FILE, write_frame
    from ..study.inputs.inputs import list_input_files
    from ..study.inputs.whole_study import read_whole_study
    from ..study.simulation import simulate_study

    path = study / STUDY_FILE if study.is_dir() else study
    read = read_whole_study(path, measured=False)
    check_output(out, list_input_files(read, path))
    check_table_path(out)
    frame = simulate_study(read, path.parent)
    write_frame(frame, out, NUMBERS)
    if as_json:
        print_json({"written": out.name, "rows": len(frame), "columns": list(frame.columns)})
    else:
        click.echo(f"Written: {out}, {count_words(len(frame), 'row')}")
