"""The subcommands, a module each, loaded when they run; what they share."""
from __future__ import annotations

import sys
from collections.abc import Callable
from typing import Any

import click


def print_json(value: Any) -> None:
    """A value as JSON on the output, numbers to ten digits."""
    from ..telling.result import dumps
    click.echo(dumps(value), nl=False)


def console() -> Any:
    """Where tables are printed: as wide as the terminal, 160 in a log."""
    from rich.console import Console
    return Console(width=None if sys.stdout.isatty() else 160)


def progress() -> Callable[[str], None]:
    """Progress as plain lines on the error stream: each says what starts, with the seconds so far."""
    import time
    start = time.perf_counter()
    return lambda what: click.echo(f"{time.perf_counter() - start:6.1f} s  {what}", err=True)
