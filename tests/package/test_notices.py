"""Codes of warnings: each is described once, in modelsel.notices."""

from __future__ import annotations

import ast
from pathlib import Path

import pytest

import modelsel
from modelsel.notices import ALARM_OF_FAULT, ALARMS, CODES, NOISE_CODES, Note


def test_every_code_is_described() -> None:
    package = Path(modelsel.__file__).parent
    given = set()
    for path in package.rglob("*.py"):
        text = path.read_text(encoding="utf-8")
        if "Note" not in text:
            continue
        for node in ast.walk(ast.parse(text)):
            if isinstance(node, ast.Call) and getattr(node.func, "id", "") == "Note":
                given |= {a.value for a in node.args[:1] if isinstance(a, ast.Constant)}
    assert given
    assert given <= CODES.keys()
    assert ALARMS.keys() <= CODES.keys()
    assert {*ALARM_OF_FAULT.values(), *NOISE_CODES} <= ALARMS.keys()


def test_a_code_that_nobody_described_makes_no_note() -> None:
    with pytest.raises(KeyError, match="no-such-code"):
        Note("no-such-code", "something.")
