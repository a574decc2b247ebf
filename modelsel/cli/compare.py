"""modelsel compare: two campaigns on one robot."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from ._options import json_option, print_json, print_prose
from ._output_path import OutputPath, check_output

if TYPE_CHECKING:
    from ..calibration.comparison.campaigns import Comparison


@click.command("compare")
@click.argument("before", type=click.Path(path_type=Path))
@click.argument("after", type=click.Path(path_type=Path))
@click.option(
    "--html",
    "page",
    type=OutputPath(dir_okay=False),
    help="Write a page that shows both studies beside each other; BEFORE and AFTER are their folders.",
)
@json_option
def compare_command(before: Path, after: Path, page: Path | None, as_json: bool) -> None:
    """What changed between two campaigns, each a study's folder, result.json or
    calibration.json."""
    from dataclasses import asdict

    from .._files import write_atomically
    from ..calibration.comparison.campaigns import compare_campaigns as compared
    from ..calibration.comparison.comparison_sentences import describe_comparison
    from ..calibration.loading import load_calibration

    if page is not None:
        check_output(page, (before, after), "--html")
    found = compared(load_calibration(before), load_calibration(after))
    if page is not None:
        write_atomically(page, _write_page(before, after, found))
    if as_json:
        print_json({"sentences": describe_comparison(found), **asdict(found)})
    else:
        for line in describe_comparison(found):
            print_prose(line)
        if page is not None:
            click.echo(f"Written: {page}")


def _write_page(before: Path, after: Path, found: Comparison) -> bytes:
    from ..calibration.loading import find_report_folder
    from ..report.comparison_page import Campaign, write_comparison_page
    from ..results.reading import read_records

    folders = []
    for path in (before, after):
        folder = find_report_folder(path) if path.is_dir() else path.parent
        folders.append(folder)
    records = [read_records(folder) for folder in folders]
    names = [record.study for record, _ in records]
    is_same_name = names[0] == names[1]
    if is_same_name:
        names = [
            f"{folder.resolve().name}: {name}" for folder, name in zip(folders, names, strict=True)
        ]
    named_records = zip(names, records, strict=True)
    first, second = (Campaign(name, *both) for name, both in named_records)
    return write_comparison_page((first, second), found)
