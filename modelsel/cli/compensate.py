"""modelsel compensate: corrected joint commands."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
import numpy as np
from numpy.typing import NDArray

from ..exceptions import CHECK_FAILED
from ._options import column_option, print_json

if TYPE_CHECKING:
    from ..calibration.compensation import Commands
    from ..measurements.measurements import Measurements


@click.command("compensate")
@click.argument("result", type=click.Path(path_type=Path))
@click.argument("targets", type=click.Path(path_type=Path))
@click.option(
    "--out",
    type=click.Path(path_type=Path, dir_okay=False),
    required=True,
    help="CSV (or Parquet) file to write.",
)
@click.option(
    "--bound",
    nargs=2,
    type=float,
    default=(10.0, 20.0),
    show_default=True,
    metavar="MRAD MM",
    help="Largest change of a joint, and of the target, that is no mistake.",
)
@click.option(
    "--forward", is_flag=True, help="Keep the commands: write where the real target is at each."
)
@column_option
@click.option("--json", "as_json", is_flag=True)
def compensate_command(
    result: Path,
    targets: Path,
    out: Path,
    bound: tuple[float, float],
    forward: bool,
    columns: dict[str, str],
    as_json: bool,
) -> None:
    """Correct joint commands so that the real target is where it is wanted.

    TARGETS has a row a target: nominal commands q1_rad … (or _deg), wanted positions x_mm y_mm z_mm
    (left out: where the nominal robot has the target) in the tracker's frame, wanted orientations,
    and what the model needs. Commands are written in the units in which they were given."""
    from .._files import write_frame
    from ..calibration.command_notes import describe_extrapolation, describe_order_dependence
    from ..calibration.compensation import build_commands_table, correct_measurements
    from ..calibration.loading import load_calibration
    from ..measurements.reader import read_measurements

    c = load_calibration(result)
    data = read_measurements(targets, c.robot.prismatic, columns, positions=False, once=False)
    commands: Commands | None = None
    if forward:
        notes = [*describe_extrapolation(c, data), *describe_order_dependence(c, data)]
        table = build_commands_table(c, data, data.q, c.predict(data), {})
    else:
        commands, notes = correct_measurements(c, data, (bound[0] / 1e3, bound[1]), targets.name)
        table = build_commands_table(c, data, commands.q, commands.wanted, commands.figures())
    write_frame(table, out, "%.10g")
    if as_json:
        figures = {} if commands is None else _figures(commands)
        print_json({"written": out.name, "rows": len(data), "warnings": notes, **figures})
    else:
        slides = np.array(c.robot.prismatic)
        gain = "" if commands is None else _sentence(commands, slides)
        click.echo(f"Written: {out}, {len(data)} rows.{gain}")
        for note in notes:
            click.echo(f"Note: {note}")
    if commands is not None:
        _check_commands(commands, data)


def _check_commands(commands: Commands, data: Measurements) -> None:
    """Exit with CHECK_FAILED where a row is not reached or beyond a joint's limits, and say
    which."""
    missed, stuck = ~commands.reached, commands.beyond.any(1)
    if missed.any():
        click.echo(
            f"modelsel: {int(missed.sum())} rows are not reached, next to a jump of the model or at the edge of the "
            f"workspace ({data.where.listed(data.row[missed])}); {commands.where_left} says what is left.",
            err=True,
        )
    if stuck.any():
        click.echo(
            f"modelsel: {int(stuck.sum())} corrected commands lie beyond a joint's limits "
            f"({data.where.listed(data.row[stuck])}): the arm cannot take them. Choose other postures.",
            err=True,
        )
    if missed.any() or stuck.any():
        raise SystemExit(CHECK_FAILED)


def _figures(commands: Commands) -> dict[str, Any]:
    """Return the figures of --json."""
    lengths = {
        "error_before_mm": commands.before_mm,
        "expected_error_mm": commands.expected_mm,
        "model_uncertainty_mm": commands.model_mm,
    }
    if commands.before_rad is not None and commands.left_rad is not None:
        lengths["orientation_before_mrad"] = 1e3 * commands.before_rad
        lengths["orientation_left_mrad"] = 1e3 * commands.left_rad
    return {
        **{name: {"mean": rows.mean(), "max": rows.max()} for name, rows in lengths.items()},
        "largest_change": np.abs(commands.change).max(0),
        "reached": int(commands.reached.sum()),
        "beyond_limits": int(commands.beyond.any(1).sum()),
    }


def _sentence(commands: Commands, slides: NDArray[np.bool_]) -> str:
    """Describe the errors without and with correction, and the largest change of a joint."""
    before = f"{commands.before_mm.mean():.3f} mm on average and {commands.before_mm.max():.3f} mm at most"
    after = (
        f"{commands.expected_mm.mean():.3f} mm as measured is expected, {commands.model_mm.mean():.3f} mm of it from "
        f"the model{_describe_unreached(commands)}"
    )
    return (
        f" Without correction the target is off by {before}; with it, {after}. No joint changes by more than "
        f"{_describe_changes(commands, slides)}.{_describe_orientations(commands)}"
    )


def _describe_unreached(commands: Commands) -> str:
    from ..calibration.compensation import REACHED_MM

    if commands.left_mm.max() <= REACHED_MM:
        return ""
    return f" and {commands.left_mm.mean():.3f} mm from what the commands leave"


def _describe_changes(commands: Commands, slides: NDArray[np.bool_]) -> str:
    largest = np.abs(commands.change).max(0)
    kinds = ((~slides, "mrad"), (slides, "µm"))
    bounds = []
    for joints, unit in kinds:
        changes = largest[joints]
        if not len(changes):
            continue
        bound = changes.max() * 1e3
        bounds.append(f"{bound:.3g} {unit}")
    return " or ".join(bounds)


def _describe_orientations(commands: Commands) -> str:
    if commands.before_rad is None or commands.left_rad is None:
        return ""
    before = 1e3 * commands.before_rad
    left = 1e3 * commands.left_rad
    return (
        f" Orientations are off by {before.mean():.3g} mrad on average without it; with it, {left.mean():.3g} mrad on "
        f"average and {left.max():.3g} mrad at most are left."
    )
