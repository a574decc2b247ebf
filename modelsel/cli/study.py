"""modelsel study: run a study."""

from __future__ import annotations

import gc
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from ..exceptions import CHECK_FAILED
from ._options import make_console, make_progress, print_json

if TYPE_CHECKING:
    from ..study.result import Result

COLLECT = 50_000  # new values between two looks of Python's garbage collector


@click.command("study")
@click.argument("study", type=click.Path(path_type=Path))
@click.option(
    "--out",
    type=click.Path(path_type=Path, file_okay=False),
    help="Output folder; default reports/<study folder>.",
)
@click.option("--no-report", is_flag=True, help="Leave out report.pdf and report.html.")
@click.option("--no-sampling", is_flag=True, help="Leave out the sampling of the posterior.")
@click.option("--json", "as_json", is_flag=True, help="Print result.json instead of tables.")
@click.option(
    "--dry-run",
    is_flag=True,
    help="Read and check everything, say what would be done, compute and write nothing.",
)
@click.option(
    "--resume", is_flag=True, help="Go on where an interrupted run of the same study stopped."
)
def study_command(
    study: Path,
    out: Path | None,
    no_report: bool,
    no_sampling: bool,
    as_json: bool,
    dry_run: bool,
    resume: bool,
) -> None:
    """Run a study: what is wrong, the ladder of models, the gain on held-out configurations."""
    gc.set_threshold(
        COLLECT
        # a study makes many small values and drops few: looking for lost ones costs a twentieth of it
    )
    from .._files import check_writable, claim_folder
    from ..config.study_file import read_study
    from ..exceptions import StudyError
    from ..mechanisms.registry import with_plugins
    from ..report.drawing import draw
    from ..results.storage import WRITES
    from ..study.checkpoint import Checkpoint
    from ..study.inputs import read_nominal_robot
    from ..study.runner import rehearse_study, run_study

    path = study / "study.toml" if study.is_dir() else study
    read = read_study(path)
    registry, broken = with_plugins(robot=read_nominal_robot(read, path.parent))
    for name, why in broken.items():
        click.echo(f"modelsel: plug-in {name} is left out: {why}", err=True)
    folder = out if out is not None else Path("reports") / path.resolve().parent.name
    check_writable(folder)
    if dry_run:
        found = rehearse_study(read, path.parent, registry=registry)
        if as_json:
            print_json(found | {"writes": list(WRITES)})
        else:
            click.echo(_would(found, folder, WRITES))
        return
    say = make_progress()
    with claim_folder(folder):
        keeper = Checkpoint(folder, resume)
        result = run_study(
            read,
            path.parent,
            registry=registry,
            say=say,
            sampling=not no_sampling,
            checkpoint=keeper,
        )
        try:
            written = result.save(folder)
        except StudyError:  # what was computed is at least told
            _tell(result, as_json)
            raise
        keeper.clear()
        _tell(result, as_json)
        written += [] if no_report else draw(folder, say=say)
    if not as_json:
        click.echo(f"Written: {', '.join(map(str, written))}")
    sampling = result.record.sampling
    if sampling is not None and not sampling.converged:
        raise SystemExit(CHECK_FAILED)


def _tell(result: Result, as_json: bool) -> None:
    if as_json:
        click.echo(result.to_json(), nl=False)
    else:
        from ..report.terminal import show_study

        show_study(result.record, result.details, make_console())


def _would(found: dict[str, Any], folder: Path, writes: tuple[str, ...]) -> str:
    counts = found["configurations"]
    base = ", ".join(found["base"])
    registered = ""
    if found["registered"]:
        registered = ", tracker and target found first"
    cells = ""
    if found["cells"]:
        cells = ", and any cell of the error map"
    files = ", ".join(writes)
    said = (
        f"{found['study']}: {found['robot']}, {found['rows']} rows; {counts['estimation']} configurations would estimate, "
        f"{counts['held_out']} would be held out{registered}. Base: {base}, {found['base_parameters']} parameters; "
        f"{found['mechanisms']} mechanisms may extend it{cells}. Would write {files} into {folder}."
    )
    lines = [said]
    for warning in found["warnings"]:
        sentence = warning["sentence"]
        lines.append(f"Note: {sentence}")
    return "\n".join(lines)
