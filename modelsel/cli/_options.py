"""The subcommands, a module each, loaded when they run; what they share."""

from __future__ import annotations

import sys
from collections.abc import Callable
from typing import Any

import click


def _parse_pairs(
    context: click.Context, option: click.Parameter, given: tuple[str, ...]
) -> dict[str, str]:
    """Read NAME=COLUMN pairs as contract name -> name in the file."""
    bad = [pair for pair in given if not all(pair.partition("="))]
    if bad:
        raise click.BadParameter(
            f'"{bad[0]}" is no NAME=COLUMN: q1_rad=J1 says that the file calls q1_rad J1.'
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


def print_json(value: Any) -> None:
    """Print a value as JSON on the output, numbers to ten digits."""
    from .._json import to_json

    click.echo(to_json(value).encode(), nl=False)  # JSON is UTF-8, whatever the terminal's encoding


def make_console() -> Any:
    """Make the console that prints tables: as wide as the terminal, 160 in a log."""
    from rich.console import Console

    return Console(width=None if sys.stdout.isatty() else 160, markup=False, emoji=False)
