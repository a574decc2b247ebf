"""`python -m modelsel`: the command line where its script is not on the path."""

from .cli.main import run_command_line

run_command_line(prog_name="modelsel")
