"""modelsel report: the report of a finished study, drawn again."""

from __future__ import annotations

from pathlib import Path

import click

from .._progress import show_progress
from ._options import amount_options, choose_amount, make_console, print_json, print_written


@click.command("report")
@click.argument("folder", type=click.Path(path_type=Path, file_okay=False))
@click.option("--pages", help="Pages of report.pdf, by name, with commas; all without.")
@amount_options
@click.option("--json", "as_json", is_flag=True)
def report_command(
    folder: Path, pages: str | None, verbose: bool, quiet: bool, as_json: bool
) -> None:
    """Show a finished study and draw report.pdf and report.html again, from its folder; nothing is
    computed anew."""
    from .._files import check_writable, claim_folder
    from .._second_process import second_process
    from ..report.drawing import HALF, STEPS, DrawnAhead, draw_records
    from ..report.terminal import WIDTH, show_study
    from ..results.reading import read_records

    chosen = (
        None if pages is None else tuple(name.strip() for name in pages.split(",") if name.strip())
    )
    amount = choose_amount(verbose, quiet)
    check_writable(folder)
    with claim_folder(folder), show_progress(STEPS, hidden=quiet) as say:
        record, details = read_records(folder)
        say.clear()
        if not as_json:
            show_study(record, details, make_console(WIDTH), amount)
        if chosen is not None:
            written = draw_records(record, details, folder, chosen, say)
        else:
            with second_process() as second:
                ahead = DrawnAhead(second)
                ahead.draw(record, details, HALF)
                written = draw_records(record, details, folder, None, say, ahead)
    if as_json:
        print_json({"written": [path.name for path in written]})
    elif not quiet:
        print_written(folder, written)
