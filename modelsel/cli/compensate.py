"""modelsel compensate: corrected joint commands."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
import numpy as np
from numpy.typing import NDArray

from .._choices import TARGET_FORMS
from ..exceptions import CHECK_FAILED, count_words, write_rounded
from ._join_options import JointLog, join_option
from ._options import column_option, json_option, print_json, print_prose, table_option
from ._output_path import OutputPath, check_output, check_table_path

if TYPE_CHECKING:
    import pandas as pd

    from ..calibration.calibration import Calibration
    from ..calibration.commands.commands_table import CarriedColumns
    from ..calibration.commands.compensation import Commands
    from ..measurements.formats.table import DataFile
    from ..measurements.measurements import Measurements
    from ._later_files import LaterFiles

# of an angle that is told: what is smaller is rounding
LEAST_MRAD = 1e-6


def _check_bound(
    context: click.Context, option: click.Parameter, bound: tuple[float, float]
) -> tuple[float, float]:
    """Refuse a bound that nothing can be beyond, or within."""
    is_positive = [0 < limit < np.inf for limit in bound]
    if not all(is_positive):
        raise click.UsageError("--bound takes two numbers above 0, in mrad and in mm.")
    return bound


@click.command("compensate")
@click.argument("result", type=click.Path(path_type=Path))
@click.argument("targets", type=click.Path(path_type=Path))
@click.option(
    "--out",
    type=OutputPath(dir_okay=False),
    required=True,
    help="File to write: as the targets are, .xlsx or .parquet.",
)
@click.option(
    "--format",
    "form",
    type=click.Choice(TARGET_FORMS),
    default="csv",
    show_default=True,
    help="A table, targets for RoboDK, or a program: URScript, KRL, RAPID, Fanuc's LS.",
)
@click.option(
    "--bound",
    nargs=2,
    type=float,
    default=(10.0, 20.0),
    callback=_check_bound,
    show_default=True,
    metavar="MRAD MM",
    help="Largest change of a joint, and of the target, that is not taken for a mistake.",
)
@click.option(
    "--forward", is_flag=True, help="Keep the commands: write where the real target is at each."
)
@click.option(
    "--at",
    multiple=True,
    metavar="NAME=VALUE",
    help="A value of all rows that the file has no column of: payload_kg=3. May be repeated.",
)
@join_option
@table_option
@column_option
@json_option
def compensate_command(
    result: Path,
    targets: Path,
    out: Path,
    form: str,
    bound: tuple[float, float],
    forward: bool,
    at: tuple[str, ...],
    log: JointLog | None,
    sheet: str | None,
    decimal: str | None,
    columns: dict[str, str],
    as_json: bool,
) -> None:
    """Correct joint commands so that the real target is where it is wanted.

    TARGETS is a table with one row per target: nominal commands q1_rad … (or _deg), wanted positions x_mm y_mm z_mm
    (left out: where the nominal robot has the target) in the tracker's frame, wanted orientations,
    and what the model needs; or the columns, sheet and decimal mark of the study's own file. A
    table has commands in the units in which they were given; a program
    has the units of its language, slow moves, and is called as its file is."""
    from ..calibration.commands.commands_table import (
        build_commands_table,
        find_carried_columns,
        list_point_names,
    )
    from ..calibration.held_values import check_values, hold_values, read_held_values
    from ..calibration.loading import load_calibration
    from ..measurements.reader import read_measurements
    from ._later_files import load_later

    if forward and form != "csv":
        raise click.UsageError("--forward corrects no command: it goes with --format csv.")
    _check_out(out, form, (result, targets, *(() if log is None else (log.path,))))
    c = load_calibration(result)
    file = c.form.open(targets, sheet, decimal)
    later = load_later(c, file, log, columns).matched()
    held = hold_values(c, later.table, read_held_values(at))
    data = read_measurements(held, c.robot, later.columns, positions=False, once=False)
    check_values(c, data)
    carried = find_carried_columns(c, held, later.columns)
    commands: Commands | None = None
    skipped: list[str] = []
    if forward:
        table, notes = _tabulate_real(c, data, carried)
    else:
        found = _correct(c, data, bound, targets.name)
        commands, data, notes, skipped = found
        figures = commands.figures()
        table = build_commands_table(c, data, commands.q, commands.wanted, figures, carried)
        notes += later.note_own(c, data)
    if commands is None or form == "csv":
        named = replace(later, table=held)
        _write_table(c, table, None if log else file, named, data.row, out, commands is None)
    else:
        _check_commands(commands, data, skipped, written=False)
        points = list_point_names(data, carried)
        notes += _write_program(c, data, commands, form, out, notes, points)
    if as_json:
        totals = {} if commands is None else _figures(commands)
        said = {"written": out.name, "rows": len(data), "warnings": notes, "left_out": skipped}
        print_json(said | totals)
    else:
        slides = np.array(c.robot.prismatic)
        gain = "" if commands is None else _sentence(commands, slides)
        written = f"Written: {out}, {count_words(len(data), 'row')}.{gain}"
        print_prose("\n".join([*later.said, written, *(f"Note: {note}" for note in notes)]))
    if commands is not None:
        _check_commands(commands, data, skipped)


def _check_out(out: Path, form: str, inputs: Sequence[Path]) -> None:
    """Refuse an output file that would replace another, or whose ending is no table's where it is
    one. Raises StudyError."""
    from ..measurements.formats.table_writer import WORKBOOK_SUFFIX

    check_output(out, inputs)
    if form == "csv":
        check_table_path(out, WORKBOOK_SUFFIX)


def _write_table(
    c: Calibration,
    table: pd.DataFrame,
    file: DataFile | None,
    later: LaterFiles,
    rows: NDArray[np.intp],
    out: Path,
    forward: bool,
) -> None:
    """Write a table of commands in the form of the `file` of targets; of rows that were joined, or have
    no header, under the names of a measurements file. Raises StudyError."""
    from .._files import write_atomically
    from ..calibration.commands.targets_form import arrange_as_targets
    from ..measurements.formats.table_writer import TableStyle, encode_table, find_table_style

    style = TableStyle()
    if file is not None:
        style = find_table_style(file, later.table)
        if later.table.where.header and later.table.length_unit is None:
            prismatic = c.robot.prismatic
            table = arrange_as_targets(table, later.table, later.columns, prismatic, rows, forward)
        else:
            style = replace(style, units=None)
    write_atomically(out, encode_table(table, out.suffix, style))


def _tabulate_real(
    c: Calibration, data: Measurements, carried: CarriedColumns
) -> tuple[pd.DataFrame, list[str]]:
    """Tabulate where the real target is at planned commands, and note what the answer rests on."""
    from ..calibration.commands.command_notes import (
        describe_extrapolation,
        describe_order_dependence,
    )
    from ..calibration.commands.commands_table import build_commands_table
    from ..calibration.prediction import predict_poses

    extrapolated = describe_extrapolation(c, data)
    ordered = describe_order_dependence(c, data)
    real = predict_poses(c, data)
    table = build_commands_table(c, real, data.readings, real.position, {}, carried)
    return table, [*extrapolated, *ordered]


def _correct(
    c: Calibration, data: Measurements, bound: tuple[float, float], file: str
) -> tuple[Commands, Measurements, list[str], list[str]]:
    """Correct planned commands within a bound (mrad, mm): they, the rows that they are of, the notes
    on them, and sentences on the rows that cannot be corrected. Without these the others are
    corrected again, as the arm then comes to them from elsewhere. Raises DataError where they are
    most."""
    from ..calibration.commands.compensation import compensate_commands, note_commands
    from ..calibration.commands.large_changes import (
        describe_new_order,
        describe_skipped,
        find_skipped,
        leave_out_rows,
    )

    bound_mrad, bound_mm = bound
    bounds = (bound_mrad / 1e3, bound_mm)
    skipped = []
    while True:  # every round leaves out a row at least
        commands = compensate_commands(c, data)
        beyond = find_skipped(c, commands, data, bounds, file)
        if not beyond.any():
            break
        skipped += describe_skipped(c, commands, data, bounds, beyond)
        data = leave_out_rows(data, beyond)
    notes = note_commands(c, commands, data)
    if skipped:
        notes += describe_new_order(c, data)
    return commands, data, notes, skipped


def _write_program(
    c: Calibration,
    data: Measurements,
    commands: Commands,
    form: str,
    out: Path,
    notes: Sequence[str],
    points: Sequence[str],
) -> list[str]:
    """Write the commands as a program, its points under their names, and note what its decimals cost. Raises StudyError."""
    from .._files import write_atomically
    from ..calibration.commands.compensation import REACHED_MM
    from ..calibration.export.robot_programs import round_commands, write_program
    from ..calibration.prediction import predict
    from ..robot.coupling import angles_of

    expected = commands.expected_mm.max()
    comments = [
        f"{count_words(len(data), 'joint command')}, corrected by modelsel. Study {c.study}, robot {c.robot.name}.",
        f"Expected error of the target: {write_rounded(expected)} mm rms at the least certain point; single errors exceed it.",
        *notes,
        "Moves are slow and stop at every point. Check the path before the arm runs it.",
    ]
    slides = c.robot.prismatic
    text = write_program(form, out, commands.q, slides, comments, points)
    write_atomically(out, text.encode("ascii"))
    at = [
        predict(c, c.problem(replace(data, q=angles_of(c.robot.coupling, q))))
        for q in (commands.q, round_commands(form, commands.q, slides))
    ]
    moved = float(np.linalg.norm(at[1] - at[0], axis=1).max())
    if moved <= REACHED_MM:
        return []
    return [f"the decimals of the file move the target by {write_rounded(moved, 2)} mm at most."]


def _check_commands(
    commands: Commands, data: Measurements, skipped: Sequence[str], written: bool = True
) -> None:
    """Exit with CHECK_FAILED where a row is left out, not reached or beyond a joint's limits, and
    say which; and whether there is a file."""
    missed, stuck = ~commands.reached, commands.beyond.any(1)
    for sentence in skipped:
        print_prose(f"modelsel: {sentence}", err=True)
    if missed.any():
        rows = count_words(int(missed.sum()), "row")
        verb = "is" if missed.sum() == 1 else "are"
        print_prose(
            f"modelsel: {rows} {verb} not reached, next to a jump of the model or at the edge of the "
            f"workspace ({data.where.listed(data.row[missed])}); {_where_left(commands, written)}.",
            err=True,
        )
    if stuck.any():
        commands_beyond = count_words(int(stuck.sum()), "corrected command")
        verb = "lies" if stuck.sum() == 1 else "lie"
        print_prose(
            f"modelsel: {commands_beyond} {verb} beyond a joint's limits "
            f"({data.where.listed(data.row[stuck])}): the arm cannot take them. Choose other postures.",
            err=True,
        )
    if missed.any() or stuck.any() or skipped:
        if not written:
            print_prose("modelsel: no program was written.", err=True)
        raise SystemExit(CHECK_FAILED)


def _where_left(commands: Commands, written: bool) -> str:
    if written:
        return f"{commands.where_left} says what is left"
    return f"up to {write_rounded(commands.left_mm.max())} mm are left"


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
    if commands.model_rad is not None:
        lengths["orientation_uncertainty_mrad"] = 1e3 * commands.model_rad
    return {
        **{name: {"mean": rows.mean(), "max": rows.max()} for name, rows in lengths.items()},
        "largest_change": np.abs(commands.change).max(0),
        "reached": int(commands.reached.sum()),
        "beyond_limits": int(commands.beyond.any(1).sum()),
    }


def _sentence(commands: Commands, slides: NDArray[np.bool_]) -> str:
    """Describe the errors without and with correction, and the largest change of a joint."""
    many = len(commands.before_mm) > 1
    on_average = " on average" if many else ""
    before = f"{commands.before_mm.mean():.3f} mm{on_average}"
    if many:
        before += f" and {commands.before_mm.max():.3f} mm at most"
    after = (
        f"an error of {commands.expected_mm.mean():.3f} mm{on_average} is expected when it is measured, of which the "
        f"model's own uncertainty is {commands.model_mm.mean():.3f} mm{_describe_unreached(commands)}"
    )
    return (
        f" Without correction the target is off by {before}; with it, {after}. No joint changes by more than "
        f"{_describe_changes(commands, slides)}.{_describe_orientations(commands)}"
    )


def _describe_unreached(commands: Commands) -> str:
    from ..calibration.commands.compensation import REACHED_MM

    if commands.left_mm.max() <= REACHED_MM:
        return ""
    return f" and what the commands leave {commands.left_mm.mean():.3f} mm"


def _describe_changes(commands: Commands, slides: NDArray[np.bool_]) -> str:
    largest = np.abs(commands.change).max(0)
    kinds = ((~slides, "mrad"), (slides, "µm"))
    bounds = []
    for joints, unit in kinds:
        changes = largest[joints]
        if not len(changes):
            continue
        bound = changes.max() * 1e3
        bounds.append(f"{write_rounded(bound)} {unit}")
    return " or ".join(bounds)


def _describe_orientations(commands: Commands) -> str:
    if commands.before_rad is None or commands.left_rad is None:
        return ""
    before = 1e3 * commands.before_rad
    left = 1e3 * commands.left_rad
    mean_left, most_left = (_write_angle(value) for value in (left.mean(), left.max()))
    known = "; how well the model knows them cannot be told, since its study measured none"
    if commands.model_rad is not None:
        uncertainty = 1e3 * commands.model_rad
        known = (
            f", to which the model's own uncertainty adds {write_rounded(uncertainty.mean())} mrad"
        )
    return (
        f" Orientations are off by {write_rounded(before.mean())} mrad on average without it; with it, {mean_left} on "
        f"average and {most_left} at most are left{known}."
    )


def _write_angle(mrad: float) -> str:
    """Write an angle; one that is nothing but rounding as a bound."""
    if mrad < LEAST_MRAD:
        return f"less than {LEAST_MRAD:f} mrad"
    return f"{write_rounded(mrad)} mrad"
