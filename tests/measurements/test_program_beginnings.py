"""Beginnings of files are compared with those of robots' programs in a moment, whatever they are."""

from __future__ import annotations

from pathlib import Path

import pytest

from modelsel._foreign_files import describe_foreign

POSITIONS = "; shift 1\n;\n  ; two\nDECL E6POS XP1={X 1.0,Y 2.0}\n"
TARGETS = "! by hand\n!\n  ! two\nCONST robtarget p1:=[[1,2,3]];\n"


@pytest.mark.unit
@pytest.mark.parametrize(
    "text",
    [
        " ; ; ; ; ; ; ; ; ; ; ; ;\n" * 4,
        " ;" + " ; ".join(f"J{k}" for k in range(40)) + "\n1;2;3\n",
        "! ! ! ! ! ! ! ! ! ! ! ! ! ! ! ! ! ! ! ! ! ! ! ! ! ! ! ! ! ! ! !\n" * 3,
        "&a " * 60,
    ],
)
def test_columns_between_semicolons_are_no_program(text: str, tmp_path: Path) -> None:
    file = tmp_path / "table.csv"
    file.write_text(text)
    assert describe_foreign(file) is None


@pytest.mark.unit
@pytest.mark.parametrize(("text", "what"), [(POSITIONS, "KRL"), (TARGETS, "RAPID")])
def test_comments_before_the_first_point_are_passed(text: str, what: str, tmp_path: Path) -> None:
    file = tmp_path / "points.txt"
    file.write_text(text)
    found = describe_foreign(file)
    assert found is not None
    assert what in found[0]
