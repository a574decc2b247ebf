"""modelsel compare: two campaigns on one robot."""

from __future__ import annotations

from pathlib import Path

import click

from ._options import print_json


@click.command()
@click.argument("before", type=click.Path(path_type=Path))
@click.argument("after", type=click.Path(path_type=Path))
@click.option("--json", "as_json", is_flag=True)
def compare(before: Path, after: Path, as_json: bool) -> None:
    """What changed between two campaigns, each a study's folder, result.json or
    calibration.json."""
    from dataclasses import asdict

    from ..calibration.campaigns import compare as compared
    from ..calibration.campaigns import sentences
    from ..calibration.storage import load_calibration

    found = compared(load_calibration(before), load_calibration(after))
    if as_json:
        print_json({"sentences": sentences(found), **asdict(found)})
    else:
        for line in sentences(found):
            click.echo(line)
