"""modelsel plan: what to measure next."""

from __future__ import annotations

from pathlib import Path

import click

from ._options import print_json, progress

PURPOSES = ("rivals", "d", "a", "o1", "o2", "o3", "o4", "o5")


@click.command()
@click.argument("study", type=click.Path(path_type=Path))
@click.option(
    "--pool",
    "pool_file",
    type=click.Path(path_type=Path),
    help="File of configurations that could be measured.",
)
@click.option(
    "--limits",
    is_flag=True,
    help="Draw the pool within the robot file's joint limits; default: as was measured.",
)
@click.option(
    "--joint",
    "joints",
    multiple=True,
    metavar="q2_deg=LOW:HIGH",
    help="Draw this joint within a range of your own.",
)
@click.option(
    "--count",
    type=click.IntRange(1),
    default=10,
    show_default=True,
    help="Configurations to choose.",
)
@click.option(
    "--for",
    "purpose",
    type=click.Choice(PURPOSES),
    help="What for; default: to tell rivals apart, else D-optimal.",
)
@click.option(
    "--size",
    type=click.FloatRange(0, min_open=True),
    help="How many more to find an effect of so many mm rms.",
)
@click.option(
    "--out",
    type=click.Path(path_type=Path, dir_okay=False),
    help="CSV file for the chosen configurations.",
)
@click.option("--json", "as_json", is_flag=True)
def plan(
    study: Path,
    pool_file: Path | None,
    limits: bool,
    joints: tuple[str, ...],
    count: int,
    purpose: str | None,
    size: float | None,
    out: Path | None,
    as_json: bool,
) -> None:
    """What to measure next: what best tells a study's rival explanations apart, or determines its
    parameters."""
    from .._files import csv_bytes, write_beside
    from ..calibration.experiment_design import more_needed
    from ..config.study_file import read_study
    from ..mechanisms.registry import with_plugins
    from ..study.planning import plan_next, sentences
    from ..study.runner import robot_of, run

    own = dict(map(_range, joints))
    if pool_file is not None and (limits or own):
        raise click.UsageError(
            "--pool gives the configurations themselves: leave --limits and --joint out."
        )
    path = study / "study.toml" if study.is_dir() else study
    read = read_study(path)
    registry, _ = with_plugins(robot=robot_of(read, path.parent))
    result = run(read, path.parent, registry=registry, say=progress(), sampling=False)
    found = plan_next(result, count, pool=pool_file, purpose=purpose, limits=limits, joints=own)
    table, known, limit = (
        found.to_frame(),
        found.configurations,
        result.record.nothing_else.detection_limit_mm,
    )
    more = None if size is None or limit is None else more_needed(limit, known, size)
    if out is not None:
        write_beside(out, csv_bytes(table, "%.6f"))
    if as_json:
        print_json(
            {
                "purpose": found.purpose,
                "pool_rows": found.rows,
                "configurations": table.to_dict("records"),
                "rivals": found.rivals,
                "alike": found.twins,
                "told_apart": found.told,
                "told_apart_random": found.random,
                "criteria": {k: {"before": a, "after": b} for k, (a, b) in found.indices.items()},
                "learning_curve": [
                    {"size_mm": s, "more_configurations": m} for s, m in found.learning
                ],
                "more_for_size": more,
            }
        )
        return
    click.echo(
        table.to_string(index=False, float_format=lambda v: f"{v:.4f}")
        if out is None
        else f"Written: {out}"
    )
    for line in sentences(found):
        click.echo(line)
    if more is not None:
        click.echo(
            f"An effect of {size:g} mm rms beyond the model is found with 90 % after {more} more configurations."
        )


def _range(text: str) -> tuple[str, tuple[float, float]]:
    """q2_deg=-90:45 -> ("q2_deg", (-90, 45))."""
    name, _, span = text.partition("=")
    low, _, high = span.partition(":")
    try:
        return name, (float(low), float(high))
    except ValueError:
        raise click.UsageError(
            f"--joint {text}: expected a joint and its range, such as q2_deg=-90:45."
        ) from None
