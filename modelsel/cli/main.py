"""The command line; every command is a module of its own, imported when it runs."""

from __future__ import annotations

import contextlib
import io
import os
import shlex
import signal
import sys
from collections.abc import Iterator
from importlib import import_module
from pathlib import Path
from typing import Any, TextIO

import click

from .._version import VERSION
from ._options import fold_prose, print_prose

for _threads in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(_threads, "1")  # before numpy loads: the same bytes on any machine
# else pydantic looks through every installed package for plug-ins of its own
os.environ.setdefault("PYDANTIC_DISABLE_PLUGINS", "__all__")

INTERRUPTED = 130
RESUMES = ("study", "fleet")  # commands that take up what was interrupted


COMMANDS = {  # name: what `modelsel --help` says of it; modelsel/cli/<name>.py has it
    "init": "Write a study from a measurements file as it is.",
    "study": "Run a study: what is wrong, the ladder of models, the gain.",
    "report": "Draw the report of a finished study again.",
    "fleet": "Run many studies as one job.",
    "check": "What is in a measurements file, what it can tell and what it cannot.",
    "mechanisms": "The registry of error mechanisms: equations, units, where each acts.",
    "robots": "The built-in nominal robots, each with its source.",
    "simulate": "Make data with planted effects.",
    "plan": "What to measure next: what tells rivals apart, or determines parameters best.",
    "compensate": "Joint commands whose real position is the wanted one.",
    "validate": "Whether a stored calibration still holds on new data.",
    "compare": "What changed between two campaigns.",
    "export": "A calibration as URDF, DH, MDH, JSON, CSV, Python or lookup table.",
    "doctor": "Whether this installation works, and with what.",
    "completion": "Shell completion: what to put into your shell's start-up file.",
}


@contextlib.contextmanager
def _terminable() -> Iterator[None]:
    """End a command on SIGTERM as Ctrl-C does; outside the main thread signals stay as they are."""
    try:
        before = signal.signal(signal.SIGTERM, signal.default_int_handler)
    except ValueError:
        yield
        return
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)


class _Unread(io.FileIO):
    """An output whose reader may be gone, as behind `| head`: what nobody reads is dropped, and the
    command goes on to write its files. What cannot be written is said once."""

    is_lost = False

    def write(self, data: Any) -> int:
        """Write bytes, or drop them where nobody reads."""
        if self.is_lost:
            return len(data)
        try:
            return super().write(data) or 0
        except OSError as error:
            self.is_lost = True
            if isinstance(error, BrokenPipeError):
                return len(data)
            raise


def _prepare_streams() -> None:
    """Open streams that a caller has closed, on nothing; show ? on a terminal or in a log for a ± or
    α that its encoding lacks, and all the rest; go on where nobody reads."""
    for name, mode in (("stdin", "r"), ("stdout", "w"), ("stderr", "w")):
        if getattr(sys, name) is None:
            nothing = Path(os.devnull).open(mode, encoding="utf-8")  # noqa: SIM115 - for good
            setattr(sys, name, nothing)
    output = sys.stdout
    if os.name == "posix" and output is not None and output is sys.__stdout__:
        sys.stdout = _reopen(output)
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="replace")


def _reopen(stream: Any) -> TextIO:
    """Open an output again as one whose reader may be gone."""
    raw = _Unread(stream.fileno(), "w", closefd=False)
    buffer = io.BufferedWriter(raw)
    return io.TextIOWrapper(buffer, encoding=stream.encoding, line_buffering=stream.isatty())


def _fold_message(error: click.ClickException) -> click.ClickException:
    """Fold what a usage error says, which click leaves as it is, at the terminal's width."""
    begins = "Error: "
    folded = "\n".join(fold_prose(begins + error.format_message(), sys.stderr))
    said = folded.removeprefix(begins)
    error.format_message = lambda: said  # type: ignore[method-assign]
    return error


class _Lazy(click.Group):
    """Finds a command by its name and imports it only then; says errors in one place: one clear
    message, the right exit status, no traceback without --debug."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        return list(COMMANDS)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        if cmd_name not in COMMANDS:
            from ..exceptions import suggest

            ctx.fail(f'No such command "{cmd_name}". {suggest(cmd_name, COMMANDS)}')
        found: click.Command = getattr(
            import_module(f".{cmd_name}", __package__), f"{cmd_name}_command"
        )
        return found

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        commands = list(COMMANDS.items())
        with formatter.section("Commands"):
            formatter.write_dl(commands)

    def invoke(self, ctx: click.Context) -> Any:
        from ..exceptions import ModelselError

        _prepare_streams()
        try:
            with _terminable():
                return super().invoke(ctx)
        except ModelselError as error:
            if ctx.params.get("debug"):
                raise
            for line in str(error).splitlines():
                print_prose(f"modelsel: {line}", err=True)
            sys.exit(error.exit_code)
        except KeyboardInterrupt:
            resumes = ctx.invoked_subcommand in RESUMES and "--resume" not in sys.argv
            again = [*sys.argv[1:], *(["--resume"] if resumes else [])]
            click.echo(f"modelsel: interrupted; to go on: modelsel {shlex.join(again)}", err=True)
            sys.exit(INTERRUPTED)
        except OSError as error:
            if ctx.params.get("debug"):
                raise
            where = error.filename or "the file system"
            print_prose(f"modelsel: {where}: {error.strerror or error}.", err=True)
            sys.exit(2)
        except click.ClickException as error:
            raise _fold_message(error) from None
        except (click.exceptions.Exit, click.Abort):
            raise
        except (
            Exception
        ) as error:  # the last resort: an internal error is said, not thrown at the user
            if ctx.params.get("debug"):
                raise
            print_prose(
                f"modelsel: internal error: {type(error).__name__}: {error}. Run again with --debug before the command "
                "and report what it prints.",
                err=True,
            )
            sys.exit(1)


@click.group("modelsel", cls=_Lazy, context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(VERSION, prog_name="modelsel")
@click.option("--debug", is_flag=True, help="Show the traceback of an error.")
def run_command_line(debug: bool) -> None:
    """What a robot's model gets wrong, why, and what is gained by saying so."""
