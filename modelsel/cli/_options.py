"""The subcommands, a module each, loaded when they run; what they share."""

from __future__ import annotations

import shutil
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, TextIO

import click

from ..exceptions import StudyError, count_words

# words of --decimal
DECIMAL_MARKS = {"comma": ",", "point": "."}

if TYPE_CHECKING:
    from ..report.terminal import Amount
    from ..robot.kinematics import Robot


LOG_WIDTH = 160  # columns


def _parse_pairs(
    context: click.Context, option: click.Parameter, given: tuple[str, ...]
) -> dict[str, str]:
    """Read NAME=COLUMN pairs as contract name -> name in the file."""
    bad = [pair for pair in given if not all(pair.partition("="))]
    if bad:
        raise click.BadParameter(
            f'"{bad[0]}" is not NAME=COLUMN: q1_rad=J1 says that the file calls q1_rad J1.'
        )
    return dict(pair.split("=", 1) for pair in given)


def column_option(command: Callable[..., Any]) -> Callable[..., Any]:
    """Add the option --column, of commands that read a data file without a study: `columns`, as
    [measurements] columns has them."""
    return click.option(
        "--column",
        "columns",
        multiple=True,
        metavar="NAME=COLUMN",
        callback=_parse_pairs,
        help="A column that the file calls otherwise: q1_rad=J1. May be repeated.",
    )(command)


def _read_mark(context: click.Context, option: click.Parameter, given: str | None) -> str | None:
    """Return the decimal mark of a word: comma, point."""
    return None if given is None else DECIMAL_MARKS[given]


def table_option(command: Callable[..., Any]) -> Callable[..., Any]:
    """Add the options --sheet and --decimal, of commands that read a table without a study: `sheet`
    and the mark `decimal`."""
    decimal = click.option(
        "--decimal",
        type=click.Choice(list(DECIMAL_MARKS)),
        callback=_read_mark,
        help="The decimal mark, where the file's numbers leave it open.",
    )
    sheet = click.option("--sheet", help="Of a spreadsheet: the sheet, where several hold a table.")
    return sheet(decimal(command))


def _parse_arguments(
    context: click.Context, option: click.Parameter, given: tuple[str, ...]
) -> dict[str, str]:
    """Read name:=value pairs, as xacro's own command has them."""
    bad = [pair for pair in given if not all(pair.partition(":="))]
    if bad:
        raise click.BadParameter(f'"{bad[0]}" is not name:=value: ur_type:=ur10e, for instance.')
    return dict(pair.split(":=", 1) for pair in given)


def json_option(command: Callable[..., Any]) -> Callable[..., Any]:
    """Add the option --json: `as_json`."""
    return click.option("--json", "as_json", is_flag=True, help="Print JSON instead of words.")(
        command
    )


def xacro_option(command: Callable[..., Any]) -> Callable[..., Any]:
    """Add the option --xacro, of commands that take a robot file: `arguments` of a xacro file."""
    return click.option(
        "--xacro",
        "arguments",
        multiple=True,
        metavar="NAME:=VALUE",
        callback=_parse_arguments,
        help="An argument of a xacro file: ur_type:=ur10e. May be repeated.",
    )(command)


def dh_option(command: Callable[..., Any]) -> Callable[..., Any]:
    """Add the option --dh, of commands that take a robot file: `convention` of a table of DH
    parameters."""
    return click.option(
        "--dh",
        "convention",
        type=click.Choice(("standard", "modified")),
        help="Of a table of DH parameters: its convention, where the table leaves it open.",
    )(command)


@dataclass(frozen=True)
class RobotOption:
    """The robot that a command names, the text of a robot file that was `written` for it (of a xacro
    file, of a table), and what is `said` of how it was read."""

    robot: Robot
    written: bytes | None = None
    said: tuple[str, ...] = ()


def read_robot_option(
    robot: str,
    base: str | None = None,
    tip: str | None = None,
    arguments: Mapping[str, str] = MappingProxyType({}),
    convention: str | None = None,
) -> RobotOption:
    """Read the robot that a command names: built in, a robot file, a table of DH parameters, or a
    xacro file. Raises StudyError."""
    from ..robot.files import is_robot_file, load_robot, read_robot
    from ..robot.urdf import read_urdf_text
    from ..robot.xacro_files import describe_expansion, expand_xacro, is_xacro
    from ..study.tables.robot_tables import is_robot_table, read_robot_table

    path = Path(robot)
    if is_xacro(path):
        text = expand_xacro(path, arguments)
        arm = read_urdf_text(text, path.name, base, tip)
        expanded = (describe_expansion(path, arguments), _describe_chain(arm))
        return RobotOption(arm, text.encode(), expanded)
    if arguments:
        raise StudyError("--xacro gives arguments to a xacro file: --robot FILE.xacro.")
    if is_robot_table(path):
        arm, text, said = read_robot_table(path, convention)
        return RobotOption(arm, text.encode(), (said,))
    if convention is not None:
        raise StudyError("--dh says the convention of a table of DH parameters: --robot FILE.csv.")
    if is_robot_file(robot):
        return RobotOption(read_robot(path, base, tip))
    return RobotOption(load_robot(robot))


def _describe_chain(arm: Robot) -> str:
    """Say which chain of a URDF is the arm's, and whether its links have masses."""
    chain = "" if arm.urdf is None else f"from {arm.urdf.base} to {arm.urdf.tip}"
    masses = sum(joint.mass is not None for joint in arm.joints)
    said = f"masses of {masses} of {arm.n} links were read" if masses else "no masses were read"
    return f"The chain goes {chain}: {count_words(arm.n, 'joint')}; {said}."


def amount_options(command: Callable[..., Any]) -> Callable[..., Any]:
    """Add --verbose and --quiet, of commands that show a study."""
    verbose = click.option(
        "-v",
        "--verbose",
        is_flag=True,
        help="Show the tables, the error map, every finding in full, and all notes.",
    )
    quiet = click.option(
        "-q", "--quiet", is_flag=True, help="Show the verdict alone, and no progress."
    )
    return verbose(quiet(command))


def choose_amount(verbose: bool, quiet: bool) -> Amount:
    """Return how much of a study is shown. Raises click.UsageError for both options."""
    from ..report.terminal import Amount

    if verbose and quiet:
        raise click.UsageError("--verbose shows more, --quiet less: give one of them.")
    if verbose:
        return Amount.EVERYTHING
    return Amount.VERDICT if quiet else Amount.SUMMARY


def print_json(value: Any) -> None:
    """Print a value as JSON on the output, numbers to ten digits."""
    from .._json import to_json

    click.echo(to_json(value).encode(), nl=False)  # JSON is UTF-8, whatever the terminal's encoding


def make_console(most: int = LOG_WIDTH) -> Any:
    """Make the console that prints tables: as wide as the terminal, or as a log has room, but not
    wider than `most` columns."""
    from rich.console import Console

    terminal = shutil.get_terminal_size().columns if sys.stdout.isatty() else LOG_WIDTH
    return Console(width=min(terminal, most), markup=False, emoji=False)


def print_prose(text: str, err: bool = False) -> None:
    """Print sentences: on a terminal within its width, no word broken; a pipe gets them as they are."""
    for line in fold_prose(text, sys.stderr if err else sys.stdout):
        click.echo(line, err=err)


def fold_prose(text: str, stream: TextIO) -> list[str]:
    """Fold sentences at the width of a terminal; as they are, a line each, for any other stream."""
    from ..report.text_tables import fold_text

    width = shutil.get_terminal_size().columns if stream.isatty() else 0
    lines = []
    for line in text.splitlines() or [""]:
        if 0 < width < len(line):
            indent = line[: len(line) - len(line.lstrip())]
            lines += fold_text(line.lstrip(), width, indent)
        else:
            lines.append(line)
    return lines


def print_written(folder: Path, files: Sequence[Path]) -> None:
    """Print which files were written into a folder, and the folder in one piece."""
    from ..report.text_tables import fold_text

    names = ", ".join(path.name for path in files)
    for line in fold_text(f"Written into {folder}: {names}", 80, hanging="    "):
        click.echo(line)
