"""modelsel report: the report of a finished study, drawn again."""

from __future__ import annotations

from collections.abc import Sequence
from difflib import get_close_matches
from pathlib import Path
from typing import TYPE_CHECKING

import click

from .._progress import show_progress
from ..exceptions import StudyError, choice_list
from ._options import (
    amount_options,
    choose_amount,
    json_option,
    make_console,
    print_json,
    print_written,
)

if TYPE_CHECKING:
    from .._typing import Say
    from ..results.schemas.details_schema import DetailsRecord
    from ..results.schemas.schema import StudyRecord


@click.command("report")
@click.argument("folder", type=click.Path(path_type=Path))
@click.option(
    "--pages", help="Some pages by name, with commas: into report-pages.pdf beside the full report."
)
@click.option(
    "--summary", is_flag=True, help="Two pages: into report-summary.pdf beside the full report."
)
@amount_options
@json_option
def report_command(
    folder: Path, pages: str | None, summary: bool, verbose: bool, quiet: bool, as_json: bool
) -> None:
    """Show a finished study and draw report.pdf and report.html again, from its folder; nothing is
    computed anew."""
    from .._files import check_writable, claim_folder
    from ..calibration.loading import find_report_folder
    from ..report.drawing import STEPS, draw_records, draw_summary
    from ..report.terminal import WIDTH, show_study
    from ..results.reading import read_records

    chosen = (
        None if pages is None else tuple(name.strip() for name in pages.split(",") if name.strip())
    )
    if summary and chosen is not None:
        raise click.UsageError(
            "--summary is two pages of its own: leave out --pages, or --summary."
        )
    if chosen is not None:
        _check_pages(chosen)
    amount = choose_amount(verbose, quiet)
    _check_folder(folder)
    if not (folder / "result.json").is_file():
        folder = find_report_folder(folder)
    check_writable(folder)
    with claim_folder(folder), show_progress(STEPS, hidden=quiet) as say:
        record, details = read_records(folder)
        say.clear()
        if not as_json:
            show_study(record, details, make_console(WIDTH), amount)
        if summary:
            written = draw_summary(record, details, folder, say)
        elif chosen is not None:
            written = draw_records(record, details, folder, chosen, say)
        else:
            written = _draw_whole(record, details, folder, say)
    if as_json:
        print_json({"written": [path.name for path in written]})
    elif not quiet:
        print_written(folder, written)


def _check_folder(path: Path) -> None:
    """Refuse a file in a folder's place, and a folder that is not there. Raises StudyError."""
    from ..results.reading import REMEDY

    if not path.exists():
        raise StudyError(f"{path}: there is no such folder; {REMEDY}.")
    if not path.is_file():
        return
    folder = path.parent
    is_finished = (folder / "result.json").is_file()
    question = f" Is it {folder}?" if is_finished else ""
    raise StudyError(
        f"{path}: this is a file; the folder of a finished study is expected.{question}"
    )


def _check_pages(chosen: Sequence[str]) -> None:
    """Refuse names of pages that there are not, before anything is shown. Raises StudyError."""
    from ..report.drawing import PAGES

    unknown = [name for name in chosen if name not in PAGES]
    if not unknown:
        return
    word = "page" if len(unknown) == 1 else "pages"
    quoted = choice_list([f'"{name}"' for name in unknown])
    near = get_close_matches(unknown[0], PAGES, n=1)
    hint = f' Did you mean "{near[0]}"?' if near else ""
    raise StudyError(f"--pages: no {word} {quoted}.{hint} Pages: {', '.join(PAGES)}.")


def _draw_whole(record: StudyRecord, details: DetailsRecord, folder: Path, say: Say) -> list[Path]:
    """Draw the full report, half of its pictures in a second process. Files written."""
    from .._second_process import second_process
    from ..report.drawing import HALF, DrawnAhead, draw_records

    with second_process() as second:
        ahead = DrawnAhead.draw(second, record, details, HALF)
        return draw_records(record, details, folder, None, say, ahead)
