"""modelsel plan: what to measure next."""

from __future__ import annotations

import re
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from .._choices import PLAN_PURPOSES
from .._progress import show_progress
from ._options import json_option, make_console, print_json, print_prose, table_option
from ._output_path import OutputPath, check_output, check_table_path

# sizes of effects [mm] that are asked for
MIN_SIZE_MM, MAX_SIZE_MM = 1e-6, 1e4

# names of the columns of joint readings
READING = re.compile(r"q\d+_")

if TYPE_CHECKING:
    import pandas as pd

    from ..config.study_file import Study
    from ..measurements.formats.table import DataFile
    from ..robot.kinematics import Robot
    from ..study.pipeline.result import Result
    from ..study.planning.planning import MeasurementPlan


def _check_size(
    context: click.Context, option: click.Parameter, size: float | None
) -> float | None:
    """Refuse a size of an effect that no arm's error has, or that is no number."""
    if size is None or MIN_SIZE_MM <= size <= MAX_SIZE_MM:
        return size
    raise click.BadParameter(
        f"expected a length from {MIN_SIZE_MM:f} to {MAX_SIZE_MM:g} mm, found {size:g}."
    )


@click.command("plan")
@click.argument("study", type=click.Path(path_type=Path))
@click.option(
    "--pool",
    "pool_file",
    type=click.Path(path_type=Path),
    help="File of the configurations that could be measured.",
)
@click.option(
    "--limits",
    is_flag=True,
    help="Draw the pool within the robot file's joint limits; default: within the measured ranges.",
)
@click.option(
    "--joint",
    "joints",
    multiple=True,
    metavar="q2_deg=LOW:HIGH",
    help="Draw this joint within the given range.",
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
    type=click.Choice(PLAN_PURPOSES),
    help="Purpose; default: to tell rivals apart where there are any, else D-optimal.",
)
@click.option(
    "--size",
    type=float,
    callback=_check_size,
    help="Say how many more configurations an effect of this size (mm rms) needs.",
)
@click.option(
    "--repeats",
    type=click.IntRange(2),
    metavar="TIMES",
    help="Measure some of them so many times in all, in separate rounds: what does not repeat is told by that.",
)
@click.option(
    "--out",
    type=OutputPath(dir_okay=False),
    help="CSV (or Parquet) file to write the chosen configurations to.",
)
@table_option
@json_option
def plan_command(
    study: Path,
    pool_file: Path | None,
    limits: bool,
    joints: tuple[str, ...],
    count: int,
    purpose: str | None,
    size: float | None,
    repeats: int | None,
    out: Path | None,
    sheet: str | None,
    decimal: str | None,
    as_json: bool,
) -> None:
    """Choose what to measure next: to tell a study's rival explanations apart, or to determine its
    parameters."""
    from .._files import write_frame
    from ..measurements.formats.table import DataFile
    from ..mechanisms.registry import with_plugins
    from ..study.inputs.inputs import find_study_file, list_input_files
    from ..study.inputs.whole_study import read_study_robot, read_whole_study
    from ..study.pipeline.runner import run_study
    from ..study.pipeline.steps import list_steps
    from ..study.planning.configuration_pool import check_joint_ranges
    from ..study.planning.planning import plan_next

    ranges = dict(map(_range, joints))
    if pool_file is not None and (limits or ranges):
        raise click.UsageError(
            "--pool gives the configurations themselves: leave --limits and --joint out."
        )
    if pool_file is None and (sheet or decimal):
        raise click.UsageError("--sheet and --decimal say how the file of --pool is read.")
    pool = None if pool_file is None else DataFile(pool_file, sheet, decimal)
    path = find_study_file(study)
    read = read_whole_study(path)
    if out is not None:
        pools = [] if pool_file is None else [pool_file]
        check_output(out, (*list_input_files(read, path), *pools))
        check_table_path(out)
    robot = read_study_robot(read, path.parent)
    check_joint_ranges(robot, ranges)
    _check_pool(pool, read, robot)
    registry, _ = with_plugins(robot=robot)
    planning = "choosing configurations"
    with show_progress([*list_steps(read, sampling=False), planning]) as say:
        result = run_study(read, path.parent, registry=registry, say=say, sampling=False)
        say(planning)
        planned = plan_next(
            result, count, pool=pool, purpose=purpose, limits=limits, joints=ranges, repeats=repeats
        )
    table = planned.to_frame()
    more = _count_more(result, planned, size)
    if out is not None:
        write_frame(table, out, "%.6f")
    if as_json:
        configurations = table.to_dict("records")
        print_json(_to_dict(planned) | {"configurations": configurations, "more_for_size": more})
        return
    _print_configurations(table, out)
    _print_words(planned, repeats, size, more)


def _check_pool(pool: DataFile | None, study: Study, robot: Robot) -> None:
    """Refuse a pool that cannot be read before the study runs. Raises DataError."""
    from ..study.pipeline.result import find_file_form
    from ..study.planning.planning import read_pool

    if pool is None:
        return
    form = find_file_form(study)
    read_pool(pool, robot, form)


def _print_words(
    planned: MeasurementPlan, repeats: int | None, size: float | None, more: int | None
) -> None:
    """Print what is said of a plan, of the rounds of repeats that are asked for, and of a size
    [mm]."""
    from ..study.planning.learning_curve import describe_size
    from ..study.planning.planning import format_plan

    for line in [*format_plan(planned), *_offer_rounds(planned, repeats)]:
        print_prose(line)
    if size is not None and more is not None:
        print_prose(describe_size(planned, size, more))


def _print_configurations(table: pd.DataFrame, out: Path | None) -> None:
    """Print where the configurations are written; else the configurations, numbered, as tables that
    fit the terminal: readings, directions of approach, and the rest, beside each other where they
    have room."""
    from ..report.terminal import WIDTH
    from ..report.text_tables import write_numbered_tables

    if out is not None:
        print_prose(f"Written: {out}")
        return
    groups: list[dict[str, list[str]]] = [{}, {}, {}]
    for column, values in table.items():
        name = str(column)
        group = groups[_find_group(name)]
        group[name] = list(map(_write_value, values.tolist()))
    filled = [group for group in groups if group]
    width = make_console(WIDTH).width
    tables = write_numbered_tables(filled, width)
    text = "\n\n".join("\n".join(lines) for lines in tables)
    click.echo(text)


def _write_value(value: float) -> str:
    """Write a reading or a covariate; a direction is a whole number."""
    return str(value) if isinstance(value, int) else f"{value:.4f}"


def _find_group(name: str) -> int:
    """Return which of the tables has a column: readings, approaches, the rest."""
    if READING.match(name):
        return 0
    return 1 if name.startswith("approach") else 2


def _offer_rounds(planned: MeasurementPlan, asked: int | None) -> list[str]:
    """Say which option writes the rounds of repeats that a plan proposes, where none are `asked`."""
    if planned.repeats is None or asked is not None:
        return []
    times = planned.repeats.times
    return [f"--repeats {times} writes these rounds, each in another order."]


def _count_more(result: Result, planned: MeasurementPlan, size: float | None) -> int | None:
    """Count the further configurations that an effect of a size [mm] needs; None where no size is
    given, or no detection limit is known."""
    from ..calibration.experiment_design import count_more_needed

    limit = result.record.nothing_else.detection_limit_mm
    if size is None or limit is None:
        return None
    return count_more_needed(limit, planned.configurations, size)


def _to_dict(planned: MeasurementPlan) -> dict[str, Any]:
    """Return the plan as JSON values, without its configurations."""
    criteria = planned.indices.items()
    return {
        "purpose": planned.purpose,
        "pool_rows": planned.rows,
        "configurations": [],
        "rivals": planned.rivals,
        "alike": planned.twins,
        "told_apart": planned.probabilities,
        "told_apart_random": planned.random_probability,
        "criteria": {
            name: {"before": before, "after": after} for name, (before, after) in criteria
        },
        "learning_curve": [
            {"size_mm": size, "more_configurations": more} for size, more in planned.learning
        ],
        "repeats": _describe_repeats(planned),
    }


def _describe_repeats(planned: MeasurementPlan) -> dict[str, Any] | None:
    """Describe which configurations to measure again, by their rows in the plan, from 0."""
    repeats = planned.repeats
    if repeats is None:
        return None
    return {
        "plan_rows": repeats.numbers,
        "times": repeats.times,
        "degrees_of_freedom": repeats.freedom,
        "relative_standard_error": repeats.precision,
    }


def _range(text: str) -> tuple[str, tuple[float, float]]:
    """Read q2_deg=-90:45 -> ("q2_deg", (-90, 45))."""
    name, _, span = text.partition("=")
    low, _, high = span.partition(":")
    try:
        return name, (float(low), float(high))
    except ValueError:
        raise click.UsageError(
            f"--joint {text}: expected a joint and its range, such as q2_deg=-90:45."
        ) from None
