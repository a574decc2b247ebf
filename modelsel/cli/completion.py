"""modelsel completion: the shell's own script."""

from __future__ import annotations

import click


@click.command()
@click.argument("shell", type=click.Choice(("bash", "zsh", "fish")))
def completion(shell: str) -> None:
    """Print the completion script of a shell: bash, zsh or fish.

    For instance: modelsel completion bash > ~/.modelsel-complete, and `. ~/.modelsel-complete` in
    ~/.bashrc."""
    from click.shell_completion import get_completion_class

    from .main import main

    made = get_completion_class(shell)
    assert made is not None
    click.echo(made(main, {}, "modelsel", "_MODELSEL_COMPLETE").source())
