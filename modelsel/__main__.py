"""The command line: `modelsel`, and `python -m modelsel` where its script is not on the path."""

from __future__ import annotations

import signal
import sys

INTERRUPTED = 130


def main() -> None:
    """Run the command line. Ctrl-C ends it with a line, also while its modules are imported, and no
    longer once everything is written."""
    try:
        from .cli.main import run_command_line

        run_command_line(prog_name="modelsel")
    except KeyboardInterrupt:
        sys.stderr.write("modelsel: interrupted.\n")
        sys.exit(INTERRUPTED)
    finally:
        signal.signal(signal.SIGINT, signal.SIG_IGN)


if __name__ == "__main__":
    main()
