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
    help="Most that a joint, and the target, may be changed by.",
)
@click.option(
    "--forward", is_flag=True, help="Change no command: say where the real target is at each."
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
    """Joint commands whose real position is the wanted one.

    TARGETS has a row a target: nominal commands q1_rad … (or _deg), wanted positions x_mm y_mm z_mm
    (left out: where the nominal robot has the target) in the tracker's frame, wanted orientations,
    and what the model needs as well. Commands are written in the units that they were given in."""
    from .._files import write_frame
    from ..calibration.compensation import (
        build_commands_table,
        describe_extrapolation,
        describe_limit_violations,
        describe_order_dependence,
        refuse_large_changes,
    )
    from ..calibration.compensation import compensate_commands as corrected
    from ..calibration.loading import load_calibration
    from ..calibration.prediction import predict
    from ..measurements.reader import read_measurements

    c = load_calibration(result)
    data = read_measurements(targets, c.robot.prismatic, columns, positions=False, once=False)
    made, said = (
        corrected(c, data),
        [*describe_extrapolation(c, data), *describe_order_dependence(c, data)],
    )
    if forward:
        frame = build_commands_table(c, data, data.q, predict(c, c.problem(data)), {})
    else:
        refuse_large_changes(c, made, data, (bound[0] / 1e3, bound[1]), targets.name)
        said += describe_limit_violations(made)
        frame = build_commands_table(c, data, made.q, made.wanted, made.figures())
    write_frame(frame, out, "%.10g")
    if as_json:
        print_json(
            {
                "written": out.name,
                "rows": len(data),
                "warnings": said,
                **({} if forward else _figures(made)),
            }
        )
    else:
        click.echo(
            f"Written: {out}, {len(data)} rows."
            + ("" if forward else _sentence(made, np.array(c.robot.prismatic)))
        )
        for line in said:
            click.echo(f"Note: {line}")
    if forward:
        return
    stuck = made.beyond.any(1)
    if not made.reached.all():
        missed = data.where.listed(data.row[~made.reached])
        click.echo(
            f"modelsel: {int((~made.reached).sum())} rows are not reached, next to a jump of the model or at the edge of "
            f"the workspace ({missed}); {made.where_left} says what is left.",
            err=True,
        )
    if stuck.any():
        click.echo(
            f"modelsel: {int(stuck.sum())} corrected commands lie beyond a joint's limits "
            f"({data.where.listed(data.row[stuck])}): the arm cannot take them. Choose other postures.",
            err=True,
        )
    if stuck.any() or not made.reached.all():
        raise SystemExit(CHECK_FAILED)


def _figures(made: Commands) -> dict[str, Any]:
    turned = (
        {}
        if made.before_rad is None or made.left_rad is None
        else {
            "orientation_before_mrad": {
                "mean": 1e3 * made.before_rad.mean(),
                "max": 1e3 * made.before_rad.max(),
            },
            "orientation_left_mrad": {
                "mean": 1e3 * made.left_rad.mean(),
                "max": 1e3 * made.left_rad.max(),
            },
        }
    )
    return {
        "error_before_mm": {"mean": made.before_mm.mean(), "max": made.before_mm.max()},
        "expected_error_mm": {"mean": made.expected_mm.mean(), "max": made.expected_mm.max()},
        "model_uncertainty_mm": {"mean": made.model_mm.mean(), "max": made.model_mm.max()},
        **turned,
        "largest_change": np.abs(made.change).max(0),
        "reached": int(made.reached.sum()),
        "beyond_limits": int(made.beyond.any(1).sum()),
    }


def _sentence(made: Commands, slides: NDArray[np.bool_]) -> str:
    from ..calibration.compensation import REACHED_MM

    before = f"{made.before_mm.mean():.3f} mm on average and {made.before_mm.max():.3f} mm at most"
    left = (
        ""
        if made.left_mm.max() <= REACHED_MM
        else f" and {made.left_mm.mean():.3f} mm from what the commands leave"
    )
    after = f"{made.expected_mm.mean():.3f} mm as measured is expected, {made.model_mm.mean():.3f} mm of it from the model{left}"
    turned = (
        ""
        if made.before_rad is None or made.left_rad is None
        else (
            f" Orientations are off by {1e3 * made.before_rad.mean():.3g} mrad on average without it; with it, "
            f"{1e3 * made.left_rad.mean():.3g} mrad on average and {1e3 * made.left_rad.max():.3g} mrad at most are left."
        )
    )
    most = np.abs(made.change).max(0)
    bounds = [
        f"{most[some].max() * 1e3:.3g} {unit}"
        for some, unit in ((~slides, "mrad"), (slides, "µm"))
        if some.any()
    ]
    return (
        f" Without correction the target is off by {before}; with it, {after}. No joint changes by more than "
        f"{' or '.join(bounds)}.{turned}"
    )
