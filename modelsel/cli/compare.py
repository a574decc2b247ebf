"""modelsel compare: two campaigns on one robot."""

from __future__ import annotations

from pathlib import Path

import click

from ._options import print_json


@click.command("compare")
@click.argument("before", type=click.Path(path_type=Path))
@click.argument("after", type=click.Path(path_type=Path))
@click.option("--json", "as_json", is_flag=True)
def compare_command(before: Path, after: Path, as_json: bool) -> None:
    """What changed between two campaigns, each a study's folder, result.json or
    calibration.json."""
    from dataclasses import asdict

    from ..calibration.campaigns import compare_campaigns as compared
    from ..calibration.campaigns import describe_comparison
    from ..calibration.loading import load_calibration

    found = compared(load_calibration(before), load_calibration(after))
    if as_json:
        print_json({"sentences": describe_comparison(found), **asdict(found)})
    else:
        for line in describe_comparison(found):
            click.echo(line)
