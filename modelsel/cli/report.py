"""modelsel report: the report of a finished study, drawn again."""

from __future__ import annotations

from pathlib import Path

import click

from .._progress import show_progress
from ._options import print_json


@click.command("report")
@click.argument("folder", type=click.Path(path_type=Path, file_okay=False))
@click.option(
    "--pages", help="Some pages by name, with commas: into report-pages.pdf beside the full report."
)
@click.option(
    "--summary", is_flag=True, help="Two pages: into report-summary.pdf beside the full report."
)
@click.option("--json", "as_json", is_flag=True)
def report_command(folder: Path, pages: str | None, summary: bool, as_json: bool) -> None:
    """Draw report.pdf and report.html of a finished study again, from its folder; nothing is
    computed anew."""
    from .._files import check_writable, claim_folder
    from .._second_process import second_process
    from ..report.drawing import HALF, STEPS, DrawnAhead, draw_records, draw_summary
    from ..results.reading import read_records

    chosen = (
        None if pages is None else tuple(name.strip() for name in pages.split(",") if name.strip())
    )
    if summary and chosen is not None:
        raise click.UsageError(
            "--summary is two pages of its own: leave out --pages, or --summary."
        )
    check_writable(folder)
    with claim_folder(folder), show_progress(STEPS) as say:
        if summary:
            written = draw_summary(folder, say)
        elif chosen is not None:
            written = draw_records(*read_records(folder), folder, chosen, say)
        else:
            record, details = read_records(folder)
            with second_process() as second:
                ahead = DrawnAhead(second)
                ahead.draw(record, details, HALF)
                written = draw_records(record, details, folder, None, say, ahead)
    if as_json:
        print_json({"written": [path.name for path in written]})
    else:
        click.echo(f"Written: {', '.join(map(str, written))}")
