"""modelsel completion: the shell's own script."""

from __future__ import annotations

import click


@click.command("completion")
@click.argument("shell", type=click.Choice(("bash", "zsh", "fish")))
def completion_command(shell: str) -> None:
    """Print the completion script of a shell: bash, zsh or fish.

    For instance: modelsel completion bash > ~/.modelsel-complete, and `. ~/.modelsel-complete` in
    ~/.bashrc."""
    from click.shell_completion import get_completion_class

    from .main import run_command_line

    made = get_completion_class(shell)
    assert made is not None
    click.echo(made(run_command_line, {}, "modelsel", "_MODELSEL_COMPLETE").source())
