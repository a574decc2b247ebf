"""Load what drawing a report needs before there is anything to draw, in a process that waits for it."""

from __future__ import annotations

from importlib import import_module

MODULES = ("modelsel.report.drawing", "matplotlib.figure", "matplotlib.backends.backend_svg")


def load_drawing() -> None:
    """Import what takes longer than a small study's pictures."""
    for name in MODULES:
        import_module(name)
