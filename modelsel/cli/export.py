"""modelsel export: a calibration in other programs' forms."""

from __future__ import annotations

import math
import re
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from .._choices import EXPORT_FORMS
from ..exceptions import CHECK_FAILED, write_rounded
from ._options import json_option, print_json, print_prose, xacro_option
from ._output_path import OutputPath, check_output

# of a length [mm] or an angle [deg] in a note: a terminal shows four decimals of it
LONG_DECIMAL = re.compile(r"-?\d+\.\d{5,}")
if TYPE_CHECKING:
    from ..calibration.calibration import Calibration
    from ..calibration.export.form import Exported
    from ..calibration.export.grid_options import GridOptions

ROUNDING_MM = 1e-6  # below it a difference is rounding
EXACT_MM = 1e-3  # 1 µm: what a form can carry must come back
ERRORS = ("rows", "nominal_rms_mm", "file_rms_mm", "model_rms_mm")


@click.command("export")
@click.argument("result", type=click.Path(path_type=Path))
@click.option(
    "--format", "form", type=click.Choice(EXPORT_FORMS), required=True, help="What to write."
)
@click.option("--out", type=OutputPath(dir_okay=False), required=True, help="The file.")
@click.option(
    "--urdf",
    type=click.Path(path_type=Path, dir_okay=False),
    help="Your URDF of this arm: it comes back with other origins. Without it, the study's own.",
)
@click.option("--base", help="Link of that URDF where the arm's chain starts.")
@click.option("--tip", help="Link of that URDF where the arm's chain ends.")
@xacro_option
@click.option(
    "--joints",
    metavar="LIST",
    help="Of a grid: up to three joints, such as 1,2,3 or 1=-90:90,2 (degrees or mm).",
)
@click.option(
    "--at",
    multiple=True,
    metavar="NAME=VALUE",
    help="Of a grid: where another joint (q5_deg=-90) or covariate is held; may be repeated.",
)
@click.option(
    "--within",
    type=click.FloatRange(min=1e-4),
    metavar="MM",
    help="Of a grid: the largest error allowed between its points.  [default: 0.01]",
)
@json_option
def export_command(
    result: Path,
    form: str,
    out: Path,
    urdf: Path | None,
    base: str | None,
    tip: str | None,
    arguments: dict[str, str],
    joints: str | None,
    at: tuple[str, ...],
    within: float | None,
    as_json: bool,
) -> None:
    """Write a stored calibration (a study's folder, its result.json or calibration.json) in another
    form.

    The file is read back and compared with the fit; what the form cannot carry is listed.
    """
    from .._files import write_atomically
    from ..calibration.export import attach_urdf, export_grid
    from ..calibration.export import export as exported
    from ..calibration.loading import load_calibration
    from ..robot.xacro_files import describe_expansion, expand_xacro, is_xacro

    if urdf is not None and form != "urdf":
        raise click.UsageError("--urdf goes with --format urdf.")
    if urdf is None and (base or tip):
        raise click.UsageError("--base and --tip choose a chain of --urdf FILE.")
    if arguments and (urdf is None or not is_xacro(urdf)):
        raise click.UsageError("--xacro gives arguments to --urdf FILE.xacro.")
    if form != "grid" and (joints or at or within):
        raise click.UsageError("--joints, --at and --within go with --format grid.")
    check_output(out, (result,) if urdf is None else (result, urdf))
    calibration = load_calibration(result)
    if urdf is not None:
        text = None
        if is_xacro(urdf):
            text = expand_xacro(urdf, arguments)
            print_prose(describe_expansion(urdf, arguments), err=as_json)
        calibration = attach_urdf(calibration, urdf, base, tip, text)
    if form == "grid":
        made = export_grid(calibration, _read_grid_options(calibration, joints, at, within))
    else:
        made = exported(calibration, form)
    write_atomically(out, made.text.encode())
    if as_json:
        print_json({"written": out.name, "format": form, **_to_dict(made)})
    else:
        _print_export(made, out)
    if form not in ("table", "grid") and made.error_mm > EXACT_MM:
        print_prose("modelsel: the file does not carry the geometry to 1 µm.", err=True)
        raise SystemExit(CHECK_FAILED)


def _read_grid_options(
    c: Calibration, joints: str | None, at: tuple[str, ...], within: float | None
) -> GridOptions:
    """Read the options of a grid. Raises UsageError for what is not written as they are."""
    from ..calibration.export.grid_options import GridOptions, default_joints, read_ranges

    numbers = default_joints(c)
    ranges: dict[int, tuple[float, float]] = {}
    if joints is not None:
        numbers, ranges = read_ranges(c, joints)
    held = {}
    for pair in at:
        name, _, value = pair.partition("=")
        try:
            held[name] = float(value)
        except ValueError:
            held[name] = math.nan
        if not math.isfinite(held[name]):
            raise click.UsageError(f"--at {pair}: expected NAME=NUMBER, as q5_deg=-90.")
    nearest = GridOptions.largest_mm if within is None else within
    if not math.isfinite(nearest):
        raise click.UsageError("--within: expected a length in mm.")
    return GridOptions(numbers, nearest, held, ranges)


def _to_dict(made: Exported) -> dict[str, Any]:
    """Return what is to be known of an export as JSON values."""
    rms, largest = made.left_out_mm
    return {
        "round_trip_mm": made.error_mm,
        "configurations": made.configurations,
        "left_out": made.left_out,
        "left_out_mm": {"rms": rms, "max": largest},
        "errors": None if made.errors is None else dict(zip(ERRORS, made.errors, strict=True)),
        "worse_than_nominal": made.worse is not None,
        "notes": made.notes,
    }


def _print_export(made: Exported, out: Path) -> None:
    from ..calibration.export.form import write_difference

    if made.worse is not None:
        print_prose(f"Warning: {made.worse}.")
    exact = made.error_mm < ROUNDING_MM
    size = "less than 0.001 µm" if exact else f"at most {write_difference(made.error_mm)}"
    print_prose(
        f"Written: {out}. Read back, it differs from the calibrated model by {size} in what it can carry, over "
        f"{made.configurations:,} configurations."
    )
    if made.left_out:
        rms, largest = made.left_out_mm
        print_prose(
            f"It cannot carry {'; '.join(made.left_out)}: the whole model differs from it by {write_rounded(rms)} mm rms, "
            f"{write_rounded(largest)} mm at most. `--format python` writes a function that carries all of it."
        )
    for line in made.table:
        click.echo(line)
    for note in made.notes:
        shown = LONG_DECIMAL.sub(lambda match: f"{float(match[0]):.4f}", note)
        print_prose(f"Note: {shown}.")
