"""modelsel compensate: corrected joint commands."""
from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
import numpy as np
from numpy.typing import NDArray

from ..words.errors import CHECK_FAILED
from . import mapped, print_json

if TYPE_CHECKING:
    from ..use.compensate import Commands


@click.command()
@click.argument("result", type=click.Path(path_type=Path))
@click.argument("targets", type=click.Path(path_type=Path))
@click.option("--out", type=click.Path(path_type=Path, dir_okay=False), required=True, help="CSV (or Parquet) file to write.")
@click.option("--bound", nargs=2, type=float, default=(10.0, 20.0), show_default=True, metavar="MRAD MM",
              help="Most that a joint, and the target, may be changed by.")
@click.option("--forward", is_flag=True, help="Change no command: say where the real target is at each.")
@mapped
@click.option("--json", "as_json", is_flag=True)
def compensate(result: Path, targets: Path, out: Path, bound: tuple[float, float], forward: bool, columns: dict[str, str],
               as_json: bool) -> None:
    """Joint commands whose real position is the wanted one.

    TARGETS has a row a target: nominal commands q1_rad … (or _deg), wanted positions x_mm y_mm z_mm (left out: where the nominal
    robot has the target) in the tracker's frame, wanted orientations, and what the model needs beside them. Commands are
    written in rad (mm where a joint slides).
    """
    from ..data.io import read_measurements
    from ..telling.write import write_frame
    from ..use.calibration import load_calibration, predict
    from ..use.compensate import commands_frame, outside, refuse
    from ..use.compensate import compensate as corrected
    c = load_calibration(result)
    data = read_measurements(targets, c.robot.prismatic, columns, positions=False, once=False)
    made, said = corrected(c, data), outside(c, data)
    if forward:
        frame = commands_frame(c, data, data.q, predict(c, c.scene(data)), {})
    else:
        refuse(c, made, data, (bound[0] / 1e3, bound[1]), targets.name)
        frame = commands_frame(c, data, made.q, made.wanted, made.figures())
    write_frame(frame, out, "%.10g")
    if as_json:
        print_json({"written": out.name, "rows": len(data), "warnings": said, **({} if forward else _figures(made))})
    else:
        click.echo(f"Written: {out}, {len(data)} rows." + ("" if forward else _sentence(made, np.array(c.robot.prismatic))))
        for line in said:
            click.echo(f"Note: {line}")
    if not forward and not made.reached.all():
        places = data.where.listed(data.row[~made.reached])
        click.echo(f"modelsel: {int((~made.reached).sum())} rows are not reached, beside a jump of the model or at the edge of "
                   f"the workspace ({places}); error_left_mm says what is left.", err=True)
        raise SystemExit(CHECK_FAILED)


def _figures(made: Commands) -> dict[str, Any]:
    return {"error_before_mm": {"mean": made.before_mm.mean(), "max": made.before_mm.max()},
            "expected_error_mm": {"mean": made.expected_mm.mean(), "max": made.expected_mm.max()},
            "model_uncertainty_mm": {"mean": made.model_mm.mean(), "max": made.model_mm.max()},
            "largest_change": np.abs(made.change).max(0), "reached": int(made.reached.sum())}


def _sentence(made: Commands, slides: NDArray[np.bool_]) -> str:
    before = f"{made.before_mm.mean():.3f} mm on average and {made.before_mm.max():.3f} mm at most"
    after = f"{made.expected_mm.mean():.3f} mm as measured is expected, {made.model_mm.mean():.3f} mm of it from the model"
    most = np.abs(made.change).max(0)
    bounds = [f"{most[some].max() * 1e3:.3g} {unit}" for some, unit in ((~slides, "mrad"), (slides, "µm")) if some.any()]
    return (f" Without correction the target is off by {before}; with it, {after}. No joint changes by more than "
            f"{' or '.join(bounds)}.")
