"""A Python module of a calibration: the program of `exported.py`, which is the same for every arm, and data, which are only data.

Names come from files that anyone may have written. They are written as literals, read back as literals, and never run here.
"""
from __future__ import annotations

import ast
from importlib.resources import files
from pprint import pformat
from typing import Any

START = "DATA: Data = "      # of the last line of exported.py, and of what a module has in its place


def program() -> str:
    """The text of exported.py up to its data."""
    text = files(__package__).joinpath("exported.py").read_text(encoding="utf-8")
    before, _, data = text.rpartition(START)
    assert data == "{}\n"
    return before


def module_of(data: dict[str, Any]) -> str:
    """The module's text: the program, then its data as one literal of plain ASCII, so that no letter in it changes how the lines
    are read."""
    literal = pformat(data, width=130, sort_dicts=False)
    return f"{program()}{START}{literal.encode('ascii', 'backslashreplace').decode()}\n"


def data_in(text: str) -> dict[str, Any]:
    """The data of a module's text, read as a literal. Raises ValueError where the text is another program, or its data are no
    literal."""
    before, _, literal = text.partition(f"\n{START}")
    if f"{before}\n" != program():
        raise ValueError("not a module of `modelsel export --format python`")
    data: dict[str, Any] = ast.literal_eval(literal)
    return data
