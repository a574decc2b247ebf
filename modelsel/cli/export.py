"""modelsel export: a calibration in other programs' forms."""

from __future__ import annotations

from pathlib import Path

import click

from ..exceptions import CHECK_FAILED
from ._options import print_json

FORMS = ("urdf", "dh", "mdh", "json", "csv", "python", "table")
ROUNDING_MM = 1e-6  # below it a difference is the computer's
EXACT_MM = 1e-3  # 1 µm: what a form can carry must come back


@click.command()
@click.argument("result", type=click.Path(path_type=Path))
@click.option("--format", "form", type=click.Choice(FORMS), required=True, help="What to write.")
@click.option(
    "--out", type=click.Path(path_type=Path, dir_okay=False), required=True, help="The file."
)
@click.option("--json", "as_json", is_flag=True)
def export(result: Path, form: str, out: Path, as_json: bool) -> None:
    """Write a stored calibration (a study's folder, its result.json or calibration.json) in another
    form.

    The file is read back and held against the fit; what the form cannot carry is said.
    """
    from .._files import write_atomically
    from ..calibration.export import export as exported
    from ..calibration.storage import load_calibration

    made = exported(load_calibration(result), form)
    write_atomically(out, made.text.encode())
    if as_json:
        print_json(
            {
                "written": out.name,
                "format": form,
                "round_trip_mm": made.error_mm,
                "configurations": made.configurations,
                "left_out": made.left_out,
                "left_out_mm": {"rms": made.left_out_mm[0], "max": made.left_out_mm[1]},
                "errors": None
                if made.errors is None
                else dict(
                    zip(
                        ("rows", "nominal_rms_mm", "file_rms_mm", "model_rms_mm"),
                        made.errors,
                        strict=True,
                    )
                ),
                "worse_than_nominal": made.worse is not None,
                "notes": made.notes,
            }
        )
    else:
        if made.worse is not None:
            click.echo(f"Warning: {made.worse}.")
        size = (
            "less than 0.001 µm"
            if made.error_mm < ROUNDING_MM
            else f"at most {made.error_mm * 1e3:.2g} µm"
        )
        click.echo(
            f"Written: {out}. Read back, it differs from the calibrated model by {size} in what it can carry, over "
            f"{made.configurations} configurations."
        )
        if made.left_out:
            rms, most = made.left_out_mm
            click.echo(
                f"It cannot carry {'; '.join(made.left_out)}: the whole model differs from it by {rms:.3g} mm rms, "
                f"{most:.3g} mm at most. `--format python` writes a function that has all of it."
            )
        for note in made.notes:
            click.echo(f"Note: {note}.")
    if form != "table" and made.error_mm > EXACT_MM:
        click.echo("modelsel: the file does not carry the geometry to 1 µm.", err=True)
        raise SystemExit(CHECK_FAILED)
