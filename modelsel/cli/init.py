"""modelsel init: a study folder from a measurements file as people have it."""

from __future__ import annotations

import shlex
from pathlib import Path
from typing import TYPE_CHECKING

import click

from ..exceptions import ModelselError, StudyError
from ._join_options import JointLog, join_option
from ._options import (
    column_option,
    dh_option,
    json_option,
    print_json,
    print_prose,
    read_robot_option,
    table_option,
    xacro_option,
)
from ._output_path import OutputPath

if TYPE_CHECKING:
    from ..measurements.recognition.column_guesses import Choice, Reading
    from ..study.drafts.new_study import StudyDraft
    from ..study.inputs.stated_setup import StatedSetup


@click.command("init")
@click.argument("file", type=click.Path(path_type=Path))
@click.option("--robot", required=True, help="A built-in robot in any spelling, or a robot file.")
@click.option(
    "--out",
    type=OutputPath(file_okay=False),
    help="Folder of the study; default the file's name without its ending.",
)
@click.option("--yes", is_flag=True, help="Ask nothing: take the best reading, and print it.")
@click.option("--base", help="Of a URDF: the link the chain starts at; default its root.")
@click.option("--tip", help="Of a URDF: the link the chain ends at; default the longest chain's.")
@table_option
@join_option
@xacro_option
@dh_option
@column_option
@click.option(
    "--tool",
    type=(float, float, float),
    metavar="X Y Z",
    help="The target in the flange frame [mm], where it is known: a first guess, or with --aligned "
    "where it is.",
)
@click.option(
    "--aligned",
    is_flag=True,
    help="Positions are in the robot's base frame already: find neither frame nor target anew.",
)
@click.option(
    "--gravity",
    type=(float, float, float),
    metavar="X Y Z",
    help="Direction of gravity in the robot's base frame: 0 0 -1 of an upright robot.",
)
@json_option
def init_command(
    file: Path,
    robot: str,
    out: Path | None,
    yes: bool,
    base: str | None,
    tip: str | None,
    sheet: str | None,
    decimal: str | None,
    log: JointLog | None,
    arguments: dict[str, str],
    convention: str | None,
    columns: dict[str, str],
    tool: tuple[float, float, float] | None,
    aligned: bool,
    gravity: tuple[float, float, float] | None,
    as_json: bool,
) -> None:
    """Write a study folder from a measurements file as it is: find the columns and their units,
    show how they are read, ask, and write what `modelsel study` runs."""
    from ..measurements.formats.table import DataFile
    from ..study.drafts.joined_study import draft_joined_study
    from ..study.drafts.new_study import MIN_SPLIT, add_orientation, describe_draft, draft_study
    from ..study.drafts.study_folder import RobotSource, check_new, write_study_folder
    from ..study.inputs.stated_setup import StatedSetup

    setup = StatedSetup(tool, aligned, gravity)
    _check_setup(setup)
    folder = out if out is not None else _name_folder(file)
    check_new(folder)
    named = read_robot_option(robot, base, tip, arguments, convention)
    arm = setup.place(named.robot)
    source = DataFile(file, sheet, decimal)
    if log is None:
        draft = draft_study(source, arm, columns)
    else:
        readings = DataFile(log.path, decimal=source.decimal)
        draft = draft_joined_study(
            source, readings, arm, columns, log.way, log.max_gap, log.clock_offset
        )
    draft = _settle(draft, yes)
    draft = _settle(add_orientation(draft), yes)
    data = draft.read()
    lines = [*named.said, *describe_draft(draft, data), *setup.describe(arm, data)]
    if not as_json:
        print_prose("\n".join(lines))
    if not yes:
        _ask_whether(f"Write a study to {folder}?")
    written = write_study_folder(
        draft, data, RobotSource(robot, base, tip, named.written), folder, setup
    )
    refusal = _find_refusal(folder) if data.configurations < MIN_SPLIT else None
    if as_json:
        paths = [str(path) for path in written]
        columns = draft.columns
        print_json({"written": paths, "columns": columns, "said": lines, "refused": refusal})
        return
    click.echo(f"Written: {', '.join(map(str, written))}")
    _say_next(folder, lines, refusal)


def _say_next(folder: Path, lines: list[str], refusal: str | None) -> None:
    """Say what comes after the study was written, of which `lines` were said."""
    from ..study.drafts.nominal_misfit import is_said_far

    place = str(folder)
    if place.startswith("-"):
        place = f"./{place}"  # else it is taken for an option
    command = f"modelsel study {shlex.quote(place)}"
    if is_said_far(lines):
        print_prose(f"Next: find out why the nominal arm does not fit, then {command}")
    elif refusal is None:
        click.echo(f"Next: {command}")
    else:
        print_prose(f"{command} refuses these measurements as they are: {refusal}")


def _find_refusal(folder: Path) -> str | None:
    """Find why a study of few configurations would be refused; None where it would not."""
    from ..study.pipeline.runner import rehearse_study

    try:
        rehearse_study(folder)
    except ModelselError as error:
        first, *_ = str(error).splitlines()
        return first
    return None


def _name_folder(file: Path) -> Path:
    """Name the study's folder like its file, without the ending. Raises StudyError where that is a
    file's name."""
    folder = Path(file.stem)
    if folder.is_file():
        raise StudyError(
            f"{folder}: the study's folder would have this name, which is a file's. Give another "
            "folder with --out."
        )
    return folder


def _check_setup(setup: StatedSetup) -> None:
    """Refuse a set-up that is not whole. Raises click.UsageError."""
    if setup.aligned and setup.tool is None:
        raise click.UsageError(
            "--aligned takes the frame as it is, and then the target must be known: give its place in "
            "the flange frame by --tool X Y Z."
        )
    if setup.gravity is not None and not any(setup.gravity):
        raise click.UsageError("--gravity is a direction: 0 0 -1 of an upright robot.")


def _settle(draft: StudyDraft, yes: bool) -> StudyDraft:
    """Ask which reading is right where several fit; with `yes` take the first, and say so."""
    if yes:
        return draft.choose_first()
    for choice in draft.choices:
        if choice.is_doubtful:
            reading = _ask_which(choice)
            draft = draft.choose(choice.what, reading)
    return draft


def _ask_which(choice: Choice) -> Reading:
    print_prose(f"Several readings of {choice.what} fit:", err=True)
    for number, reading in enumerate(choice.readings, 1):
        print_prose(f"  {number}: {reading.sentence}", err=True)
    numbers = click.IntRange(1, len(choice.readings))
    try:
        number = click.prompt("Which is right?", type=numbers, default=1, err=True)
    except click.Abort:
        click.echo(err=True)
        listed = "; or ".join(reading.words for reading in choice.readings)
        raise _refuse_unanswered(f"{choice.what} may be {listed}") from None
    return choice.readings[number - 1]


def _ask_whether(question: str) -> None:
    try:
        agreed = click.confirm(question, default=True, err=True)
    except click.Abort:
        click.echo(err=True)
        raise StudyError(
            "nothing was written: the reading above was not confirmed. Run it on a terminal to "
            "confirm, or pass --yes."
        ) from None
    if not agreed:
        raise StudyError(
            "nothing was written. Say how columns are read with --column NAME=COLUMN, --sheet or "
            "--decimal."
        )


def _refuse_unanswered(what: str) -> StudyError:
    return StudyError(
        f"nothing was written: {what}. Answer on a terminal, say --column NAME=COLUMN, or take the "
        "first reading with --yes."
    )
