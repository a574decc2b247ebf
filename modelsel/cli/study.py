"""modelsel study: run a study."""

from __future__ import annotations

import gc
import shlex
import sys
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import click

from .._progress import show_progress
from .._workers import COLLECT
from ..exceptions import CHECK_FAILED, count_words
from ._options import (
    amount_options,
    choose_amount,
    make_console,
    print_json,
    print_prose,
    print_written,
)
from ._output_path import OutputPath, describe_other_result

if TYPE_CHECKING:
    from .._progress import Progress
    from .._second_process import SecondProcess
    from ..config.study_file import Study
    from ..mechanisms.registry import Registry
    from ..report.terminal import Amount
    from ..study.pipeline.checkpoint import Checkpoint
    from ..study.pipeline.result import Result


@click.command("study")
@click.argument("study", type=click.Path(path_type=Path))
@click.option(
    "--out", type=OutputPath(file_okay=False), help="Output folder; default reports/<study folder>."
)
@click.option("--no-report", is_flag=True, help="Leave out report.pdf and report.html.")
@click.option("--no-sampling", is_flag=True, help="Leave out the sampling of the posterior.")
@amount_options
@click.option("--json", "as_json", is_flag=True, help="Print result.json instead of words.")
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
    verbose: bool,
    quiet: bool,
    as_json: bool,
    dry_run: bool,
    resume: bool,
) -> None:
    """Run a study: what is wrong, the ladder of models, the gain on held-out configurations."""
    gc.set_threshold(COLLECT)
    from .._files import STUDY_FILE, check_writable, claim_folder
    from ..mechanisms.registry import with_plugins
    from ..results.storage import REPORTS, WRITES, find_reports
    from ..study.inputs.whole_study import read_study_robot, read_whole_study
    from ..study.pipeline.checkpoint import Checkpoint
    from ..study.pipeline.runner import rehearse_study
    from ..study.pipeline.steps import list_steps

    path = study / STUDY_FILE if study.is_dir() else study
    read = read_whole_study(path)
    robot = read_study_robot(read, path.parent)
    registry, broken = with_plugins(robot=robot)
    for name, why in broken.items():
        print_prose(f"modelsel: plug-in {name} is left out: {why}", err=True)
    folder = out if out is not None else Path("reports") / path.resolve().parent.name
    check_writable(folder)
    if dry_run:
        found = rehearse_study(read, path.parent, registry=registry)
        files = WRITES if no_report else (*WRITES, *REPORTS)
        if as_json:
            print_json(found | {"writes": list(files)})
        else:
            print_prose(_describe_dry_run(found, folder, files))
        return
    steps = list_steps(read, not no_sampling)
    if not no_report:
        from ..report.drawing import STEPS

        steps += STEPS
    earlier = find_reports(folder)
    _warn_of_replacing(folder, read.name, robot.name)
    amount = None if as_json else choose_amount(verbose, quiet)
    with claim_folder(folder), show_progress(steps, hidden=quiet) as progress:
        run = _Run(folder, registry, progress, amount, not no_sampling, not no_report)
        result, written = run.complete(read, path.parent, Checkpoint(folder, resume))
    if amount is not None and not quiet:
        print_written(folder, written)
        _print_removed(folder, earlier)
    sampling = result.record.sampling
    if sampling is not None and not sampling.converged:
        raise SystemExit(CHECK_FAILED)


class _Run(NamedTuple):
    """How the command runs one study, and what it shows meanwhile."""

    folder: Path
    registry: Registry
    progress: Progress
    amount: Amount | None  # None: result.json instead of words
    sampling: bool
    report: bool

    def complete(self, study: Study, folder: Path, keeper: Checkpoint) -> tuple[Result, list[Path]]:
        """Analyse and show the findings; sample while the report is drawn; write.

        Returns the result and the files written."""
        from .._second_process import second_process
        from ..report.imports_ahead import load_drawing
        from ..study.pipeline.runner import run_study

        with second_process() as second:
            if self.report:
                second.ask(load_drawing)
            result = run_study(
                study,
                folder,
                registry=self.registry,
                say=self.progress,
                sampling=False,
                checkpoint=keeper,
            )
            self._tell_analysis(result)
            if self.report:
                return self._sample_and_draw(result, keeper, second)
            result = self._sample(result, keeper)
            return result, self._save(result, keeper)

    def _sample(self, result: Result, keeper: Checkpoint) -> Result:
        from ..study.pipeline.pipeline import sample_posterior

        if not self.sampling:
            return result
        _import_sampler()
        return sample_posterior(result, self.registry, self.progress, keeper)

    def _sample_and_draw(
        self, result: Result, keeper: Checkpoint, second: SecondProcess
    ) -> tuple[Result, list[Path]]:
        """Sample while a second process draws the pages that sampling does not change."""
        from ..report.drawing import HALF, UNSAMPLED_PAGES, DrawnAhead, draw_records

        pages = UNSAMPLED_PAGES if self.sampling else HALF
        ahead = DrawnAhead.draw(second, result.record, result.details, pages)
        result = self._sample(result, keeper)
        record, details = result.record, result.details
        written = self._save(result, keeper)
        written += draw_records(record, details, self.folder, say=self.progress, ahead=ahead)
        return result, written

    def _save(self, result: Result, keeper: Checkpoint) -> list[Path]:
        """Write the result's files; show what was computed even where they cannot be written."""
        try:
            written = result.save(self.folder)
        finally:
            self._tell_rest(result)
        keeper.clear()
        return written

    def _tell_analysis(self, result: Result) -> None:
        from ..report.terminal import WIDTH, show_analysis

        self.progress.clear()
        if self.amount is not None:
            console = make_console(WIDTH)
            show_analysis(result.record, result.details, console, self.amount)

    def _tell_rest(self, result: Result) -> None:
        from ..report.terminal import WIDTH, show_sampling

        self.progress.clear()
        if self.amount is None:
            click.echo(result.to_json(), nl=False)
        else:
            show_sampling(result.record, make_console(WIDTH), self.amount)


def _import_sampler() -> None:
    """Import emcee without scipy.stats.

    Only a move that is not used here needs scipy.stats, and importing it takes longer than a small
    study. Hiding a module is safe here alone: the process belongs to the command."""
    if "emcee" in sys.modules or "scipy.stats" in sys.modules:
        return
    sys.modules["scipy.stats"] = None  # type: ignore[assignment]
    try:
        import_module("emcee")
    finally:
        del sys.modules["scipy.stats"]


def _warn_of_replacing(folder: Path, study: str, robot: str) -> None:
    """Say that a folder has another study's result, before this run takes its place."""
    other = describe_other_result(folder, study, robot)
    if other is not None:
        print_prose(f"modelsel: {other}", err=True)


def _print_removed(folder: Path, earlier: list[str]) -> None:
    """Print which reports of an earlier result were removed, and the command that draws them again."""
    from ..report.text_tables import fold_text

    removed = [name for name in earlier if not (folder / name).exists()]
    if not removed:
        return
    again = f"modelsel report {shlex.quote(str(folder))}"
    names = ", ".join(removed)
    said = f"Removed, as they showed an earlier result: {names}. Drawn anew by: {again}"
    for line in fold_text(said, 80, hanging="    "):
        click.echo(line)


def _describe_dry_run(found: dict[str, Any], folder: Path, writes: tuple[str, ...]) -> str:
    """Describe what a study would do and write, followed by its warnings."""
    from ..study.inspection.inspection_text import describe_folds

    counts = found["configurations"]
    base = ", ".join(found["base"])
    registered = ""
    if found["registered"]:
        registered = ", instrument and target found first"
    cells = ""
    if found["cells"]:
        cells = ", and any cell of the error map"
    if found["own_explanations"]:
        cells += f", and {found['own_explanations']} explanations of the study's own"
    files = ", ".join(writes)
    said = (
        f"{found['study']}: {found['robot']}, {count_words(found['rows'], 'row')}; {count_words(counts['estimation'], 'configuration')} would fit the models, "
        f"{counts['held_out']} would be held out{registered}. Base: {base}, {count_words(found['base_parameters'], 'parameter')}; "
        f"{found['mechanisms']} mechanisms may extend it{cells}. Would write {files} into {folder}."
    )
    lines = [said]
    if found["nested_folds"]:
        lines.append(describe_folds(found["nested_folds"]))
    for warning in found["warnings"]:
        sentence = warning["sentence"]
        lines.append(f"Note: {sentence}")
    return "\n".join(lines)
