"""The command line; every command imports what it needs when it runs."""
from __future__ import annotations

import os
import shlex
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

for _threads in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(_threads, "1")  # before numpy loads: the same bytes on any machine

import click

from .version import VERSION

UNCONVERGED, INTERRUPTED = 5, 130


class _Errors(click.Group):
    """Says errors in one place: one clear message, the right exit status, no traceback without --debug."""

    def invoke(self, ctx: click.Context) -> Any:
        from .errors import ModelselError
        try:
            return super().invoke(ctx)
        except ModelselError as error:
            if ctx.params.get("debug"):
                raise
            for line in str(error).splitlines():
                click.echo(f"modelsel: {line}", err=True)
            sys.exit(error.exit_code)
        except KeyboardInterrupt:
            again = [*sys.argv[1:], *(["--resume"] if "study" in sys.argv and "--resume" not in sys.argv else [])]
            click.echo(f"modelsel: interrupted; to go on: modelsel {shlex.join(again)}", err=True)
            sys.exit(INTERRUPTED)
        except BrokenPipeError:
            sys.exit(0)
        except OSError as error:
            if ctx.params.get("debug"):
                raise
            click.echo(f"modelsel: {error.filename or 'the file system'}: {error.strerror or error}.", err=True)
            sys.exit(2)
        except (click.exceptions.Exit, click.ClickException, click.Abort):
            raise
        except Exception as error:  # the last resort: an internal error is said, not thrown at the user
            if ctx.params.get("debug"):
                raise
            click.echo(f"modelsel: internal error: {type(error).__name__}: {error}. Run again with --debug before the command "
                       "and report what it prints.", err=True)
            sys.exit(1)


@click.group(cls=_Errors, context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(VERSION, prog_name="modelsel")
@click.option("--debug", is_flag=True, help="Show the traceback of an error.")
def main(debug: bool) -> None:
    """What a robot's model gets wrong, why, and what is gained by saying so."""


def _json(value: Any) -> None:
    from .result import dumps
    click.echo(dumps(value), nl=False)


def _console() -> Any:
    from rich.console import Console
    return Console(width=None if sys.stdout.isatty() else 160)


def _progress() -> Callable[[str], None]:
    """Progress as plain lines on the error stream: each says what starts, with the seconds so far."""
    import time
    start = time.perf_counter()
    return lambda what: click.echo(f"{time.perf_counter() - start:6.1f} s  {what}", err=True)


@main.command()
@click.argument("study", type=click.Path(path_type=Path))
@click.option("--out", type=click.Path(path_type=Path, file_okay=False), help="Output folder; default reports/<study folder>.")
@click.option("--no-report", is_flag=True, help="Leave out report.pdf and report.html.")
@click.option("--no-sampling", is_flag=True, help="Leave out the sampling of the posterior.")
@click.option("--json", "as_json", is_flag=True, help="Print result.json instead of tables.")
@click.option("--resume", is_flag=True, help="Go on where an interrupted run of the same study stopped.")
def study(study: Path, out: Path | None, no_report: bool, no_sampling: bool, as_json: bool, resume: bool) -> None:
    """Run a study: what is wrong, the ladder of models, the gain on held-out configurations."""
    from .checkpoint import Checkpoint
    from .config import read_study
    from .registry import with_plugins
    from .report.drawing import draw, save_details
    from .study import run, save
    from .write import check_writable
    path = study / "study.toml" if study.is_dir() else study
    read = read_study(path)
    registry, broken = with_plugins()
    for name, why in broken.items():
        click.echo(f"modelsel: plug-in {name} is left out: {why}", err=True)
    folder = out if out is not None else Path("reports") / path.resolve().parent.name
    check_writable(folder)
    say = _progress()
    result = run(read, path.parent, registry=registry, say=say, sampling=not no_sampling, checkpoint=Checkpoint(folder, resume))
    save(result, folder)
    if as_json:
        click.echo(result.to_json(), nl=False)
    else:
        from .tables import show
        show(result, _console())
    save_details(result, folder)
    written = [folder / "result.json", folder / "details.json", *([] if no_report else draw(folder, say=say))]
    if not as_json:
        click.echo(f"Written: {', '.join(map(str, written))}")
    if result.confidence.sampling is not None and not result.confidence.sampling.converged:
        sys.exit(UNCONVERGED)


@main.command()
@click.argument("folder", type=click.Path(path_type=Path, file_okay=False))
@click.option("--pages", help="Pages of report.pdf, by name, with commas; all without.")
@click.option("--json", "as_json", is_flag=True)
def report(folder: Path, pages: str | None, as_json: bool) -> None:
    """Draw report.pdf and report.html of a finished study again, from its folder; nothing is computed anew."""
    from .report.drawing import draw
    chosen = None if pages is None else tuple(name.strip() for name in pages.split(",") if name.strip())
    written = draw(folder, chosen, _progress())
    if as_json:
        _json({"written": [path.name for path in written]})
    else:
        click.echo(f"Written: {', '.join(map(str, written))}")


@main.command()
@click.argument("fleet", type=click.Path(path_type=Path, dir_okay=False))
@click.option("--out", type=click.Path(path_type=Path, file_okay=False), help="Output folder; default reports/<fleet folder>.")
@click.option("--workers", type=click.IntRange(1), help="Workers on this machine; default one a core.")
@click.option("--scheduler", help="Address of a running dask scheduler, tcp://HOST:PORT, instead of workers here.")
@click.option("--no-sampling", is_flag=True, help="Leave out the sampling of the posteriors.")
@click.option("--resume", is_flag=True, help="Keep the studies that are finished, of the same data, study and version.")
@click.option("--json", "as_json", is_flag=True, help="Print the summary as JSON instead of a table.")
def fleet(fleet: Path, out: Path | None, workers: int | None, scheduler: str | None, no_sampling: bool, resume: bool,
          as_json: bool) -> None:
    """Run many studies as one job, and fit measurement sets that come in many files."""
    from .fleet import cluster, run_fleet, save_summary, show
    from .fleetfile import read_fleet
    from .write import check_writable
    read = read_fleet(fleet)
    folder = out if out is not None else Path("reports") / fleet.resolve().parent.name
    check_writable(folder)
    with cluster(workers, scheduler) as client:
        rows = run_fleet(read, folder, client, sampling=not no_sampling, resume=resume, say=_progress())
    written = save_summary(rows, folder)
    if as_json:
        _json({"fleet": read.name, "studies": rows})
    else:
        show(rows, _console())
        click.echo(f"Written: {', '.join(map(str, written))}")
    worst = max((row["exit"] for row in rows), default=0)
    if worst:
        sys.exit(worst)


@main.command()
@click.argument("data", type=click.Path(path_type=Path))
@click.option("--robot", required=True, help="A built-in robot's name, or a robot file.")
@click.option("--json", "as_json", is_flag=True)
def check(data: Path, robot: str, as_json: bool) -> None:
    """What is in a measurements file, what it can tell and what it cannot."""
    from .inspect import describe, sentences
    from .io import read_measurements
    from .robotfile import load, read_robot
    arm = read_robot(Path(robot)) if robot.endswith((".toml", ".urdf", ".xml")) else load(robot)
    found = describe(arm, read_measurements(data, [j.prismatic for j in arm.joints]))
    if as_json:
        _json(found)
    else:
        for line in sentences(found):
            click.echo(line)


@main.command()
@click.argument("name", required=False)
@click.option("--robot", default="puma760", show_default=True, help="The arm to show them on.")
@click.option("--json", "as_json", is_flag=True)
def mechanisms(name: str | None, robot: str, as_json: bool) -> None:
    """The registry of error mechanisms: equations, units, where each acts."""
    from .inspect import mechanism_card
    from .registry import every, parts, with_plugins
    from .robotfile import load
    registry, broken = with_plugins()
    arm = load(robot)
    built = parts(name, arm, registry) if name else every(arm, registry)
    alike: dict[str, int] = {}
    for m in built:
        alike[m.name] = alike.get(m.name, 0) + 1
    cards = [mechanism_card(m) | {"constants": alike[m.name]} for m in {m.name: m for m in reversed(built)}.values()][::-1]
    if as_json:
        _json({"robot": robot, "mechanisms": cards, "broken_plugins": broken})
        return
    for card in cards:
        scanned = f" ({card['constants']} constants are scanned; this is one)" if card["constants"] > 1 else ""
        click.echo(f"{card['name']}: {card['sentence']}{scanned}")
        if name:
            click.echo(f"    equation  {card['equation']}\n    source    {card['source']}")
            for term in card["terms"]:
                click.echo(f"    {term['symbol']:8} [{term['unit']}]  {', '.join(term['screws'])}{term['expected']}")
    if name and not cards:
        click.echo(f"{name} does not apply to {robot}.")
    if not name:
        absent = [stem for stem in registry if not parts(stem, arm, registry)]
        if absent:
            click.echo(f"Not on {robot}: {', '.join(absent)}.")
    for plugin, why in broken.items():
        click.echo(f"plug-in {plugin} could not be loaded: {why}")


@main.command()
@click.argument("name", required=False)
@click.option("--json", "as_json", is_flag=True)
def robots(name: str | None, as_json: bool) -> None:
    """The built-in nominal robots, each with its source."""
    from .inspect import robot_card
    from .robotfile import builtin_names, load
    cards = [robot_card(load(n)) for n in ([name] if name else builtin_names())]
    if as_json:
        _json({"robots": cards})
        return
    for card in cards:
        click.echo(f"{card['name']}: {card['joints']} joints, reach {card['reach_mm']:.0f} mm. {card['source']}")
        if name:
            for k, joint in enumerate(card["chain"], 1):
                click.echo(f"  joint {k} ({joint['kind']}), limits {joint['limits']}, mass {joint['mass_kg']}")
                for row in joint["transform_mm"]:
                    click.echo("    " + " ".join(f"{v:10.4f}" for v in row))


@main.command()
@click.argument("study", type=click.Path(path_type=Path))
@click.option("--out", type=click.Path(path_type=Path, dir_okay=False), required=True, help="CSV (or Parquet) file to write.")
@click.option("--json", "as_json", is_flag=True)
def simulate(study: Path, out: Path, as_json: bool) -> None:
    """Make data with planted effects: [simulate] and [[simulate.effect]] of a study file."""
    from .config import read_study
    from .study import simulate_study
    from .write import write_beside
    path = study / "study.toml" if study.is_dir() else study
    frame = simulate_study(read_study(path), path.parent)
    if out.suffix.lower() in (".parquet", ".pq"):
        write_beside(out, frame.to_parquet(index=False))
    else:
        write_beside(out, frame.to_csv(index=False, float_format="%.9f", lineterminator="\n").encode())
    if as_json:
        _json({"written": out.name, "rows": len(frame), "columns": list(frame.columns)})
    else:
        click.echo(f"Written: {out}, {len(frame)} rows")


if __name__ == "__main__":
    main()
