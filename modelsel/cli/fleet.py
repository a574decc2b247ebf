"""modelsel fleet: many studies as one job."""

from __future__ import annotations

from pathlib import Path

import click

from .._progress import show_progress
from ._options import make_console, print_json, print_written
from ._output_path import OutputPath


@click.command("fleet")
@click.argument("fleet", type=click.Path(path_type=Path))
@click.option(
    "--out", type=OutputPath(file_okay=False), help="Output folder; default reports/<fleet folder>."
)
@click.option(
    "--workers", type=click.IntRange(1), help="Workers on this machine; by default one per core."
)
@click.option(
    "--scheduler",
    help="Address of a running dask scheduler, tcp://HOST:PORT, instead of workers here.",
)
@click.option(
    "--no-report", is_flag=True, help="Leave out report.pdf and report.html of every study."
)
@click.option("--no-sampling", is_flag=True, help="Leave out the sampling of the posteriors.")
@click.option(
    "--resume",
    is_flag=True,
    help="Keep the studies that are finished, of the same data, study and version.",
)
@click.option(
    "--json", "as_json", is_flag=True, help="Print the summary as JSON instead of a table."
)
def fleet_command(
    fleet: Path,
    out: Path | None,
    workers: int | None,
    scheduler: str | None,
    no_report: bool,
    no_sampling: bool,
    resume: bool,
    as_json: bool,
) -> None:
    """Run many studies as one job, and fit measurement sets that come in many files. FLEET is a
    fleet file, or the folder of its fleet.toml."""
    from .._files import check_writable, claim_folder
    from ..config.fleet_file import read_fleet
    from ..report.terminal_fleet import write_fleet
    from ..study.fleet_runner import FleetOptions, cluster, run_fleet, save_summary

    if fleet.is_dir():
        fleet = fleet / "fleet.toml"
    read = read_fleet(fleet)
    folder = out if out is not None else Path("reports") / fleet.resolve().parent.name
    check_writable(folder)
    options = FleetOptions(sampling=not no_sampling, resume=resume, reports=not no_report)
    with claim_folder(folder):
        with cluster(workers, scheduler) as client, show_progress() as say:
            rows = run_fleet(read, folder, client, options, say=say)
        written = save_summary(rows, folder, read.name)
    if as_json:
        print_json({"fleet": read.name, "studies": rows})
    else:
        for line in write_fleet(rows, make_console().width):
            click.echo(line)
        print_written(folder, written)
    worst = max((row["exit"] for row in rows), default=0)
    if worst:
        raise SystemExit(worst)
