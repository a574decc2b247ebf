"""modelsel study: run a study."""
from __future__ import annotations

from pathlib import Path

import click

from . import console, progress


@click.command()
@click.argument("study", type=click.Path(path_type=Path))
@click.option("--out", type=click.Path(path_type=Path, file_okay=False), help="Output folder; default reports/<study folder>.")
@click.option("--no-report", is_flag=True, help="Write result.json only.")
@click.option("--no-sampling", is_flag=True, help="Leave out the sampling of the posterior.")
@click.option("--json", "as_json", is_flag=True, help="Print result.json instead of tables.")
@click.option("--resume", is_flag=True, help="Go on where an interrupted run of the same study stopped.")
def study(study: Path, out: Path | None, no_report: bool, no_sampling: bool, as_json: bool, resume: bool) -> None:
    """Run a study: what is wrong, the ladder of models, the gain on held-out configurations."""
    from ..config import read_study
    from ..registry import with_plugins
    from ..study import robot_of, run, save
    from ..write import check_writable
    path = study / "study.toml" if study.is_dir() else study
    read = read_study(path)
    registry, broken = with_plugins(robot=robot_of(read, path.parent))
    for name, why in broken.items():
        click.echo(f"modelsel: plug-in {name} is left out: {why}", err=True)
    folder = out if out is not None else Path("reports") / path.resolve().parent.name
    check_writable(folder)
    result = run(read, path.parent, registry=registry, say=progress())
    save(result, folder)
    if as_json:
        click.echo(result.to_json(), nl=False)
    else:
        from ..tables import show
        show(result, console())
        click.echo(f"Written: {folder / 'result.json'}, {folder / 'calibration.json'}")
