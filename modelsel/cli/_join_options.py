"""The options of commands that take an instrument's points and a log of joint readings in two
files."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import wraps
from pathlib import Path
from typing import Any

import click


@dataclass(frozen=True)
class JointLog:
    """A log of joint readings, and how points belong to it: the `way` (None: that which fits), the
    seconds that times may differ, and by how much its clock is ahead."""

    path: Path
    way: str | None
    max_gap: float
    clock_offset: float


def join_option(command: Callable[..., Any]) -> Callable[..., Any]:
    """Add the options --joints, --join, --max-gap and --clock-offset: a JointLog as `log`, None
    where there is no log."""

    @wraps(command)
    def joining(
        joints: Path | None, join: str | None, max_gap: float, clock_offset: float, **others: Any
    ) -> Any:
        if joints is None and (join is not None or clock_offset):
            raise click.UsageError("--join and --clock-offset go with --joints LOG.")
        log = None
        if joints is not None:
            log = JointLog(joints, join, max_gap, clock_offset)
        return command(log=log, **others)

    options = (
        click.option(
            "--joints",
            type=click.Path(path_type=Path),
            help="A log of joint readings, where the file has an instrument's points alone.",
        ),
        click.option(
            "--join",
            type=click.Choice(("name", "time", "order")),
            help="How the points belong to the readings; default the way that fits.",
        ),
        click.option(
            "--max-gap",
            type=click.FloatRange(0, min_open=True),
            default=0.5,
            show_default=True,
            help="Seconds that the times of a point and of its readings may differ.",
        ),
        click.option(
            "--clock-offset",
            type=float,
            default=0.0,
            metavar="SECONDS",
            help="By how much the clock of the log of --joints is ahead of the instrument's.",
        ),
    )
    for option in reversed(options):
        joining = option(joining)
    return joining
