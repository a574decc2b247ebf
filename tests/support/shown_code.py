"""Blocks of code that a page shows, and what they print."""

from __future__ import annotations

import contextlib
import io
import re
from pathlib import Path

ROOT = Path(__file__).parents[2]

SHOWN = re.compile(r"```python\n(.*?)```\n\n```text\n(.*?)```", re.DOTALL)


def fenced(language: str, text: str) -> list[str]:
    return re.findall(rf"```{language}\n(.*?)```", text, re.DOTALL)


def printed(blocks: list[str], names: dict[str, object]) -> list[str]:
    """What each block prints, run in order in one namespace, from the folder that the README stands
    in."""
    out = []
    with contextlib.chdir(ROOT):
        for block in blocks:
            with contextlib.redirect_stdout(io.StringIO()) as stream:
                exec(compile(block, "README.md", "exec"), names)  # noqa: S102 - our own page
            out.append(stream.getvalue())
    return out
