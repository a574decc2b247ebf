"""benchmarks.stated: how the curve is counted."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
if not (ROOT / "benchmarks").is_dir():
    pytest.skip("a source distribution has no benchmarks", allow_module_level=True)
sys.path.append(str(ROOT))

from benchmarks import stated  # noqa: E402

pytestmark = pytest.mark.unit


def study(line: str, number: int, *claims: tuple[str, tuple, tuple]) -> stated.Study:
    kept = tuple(("name", level, p, right) for level, p, right in claims)
    return stated.Study(line, number, "puma760", ("planted",), kept, 1.0)


def test_the_curve_counts_what_is_claimed_and_every_level(tmp_path: Path) -> None:
    deep = ("cause", (1.0, 0.99, 0.95, 0.92), (True, True, True, False))
    shallow = ("place", (0.6, 0.2, 0.0, 0.0), (True, False, False, False))
    studies = [study("listed", 0, deep, shallow), study("unlisted", 0, shallow)]
    assert studies[0].claimed == [(0.92, False), (0.6, True)]
    assert len(studies[0].every) == 8
    assert stated.bin_pairs(studies[0].every) == [
        (0.1, pytest.approx(0.2), 0, 1),
        (0.5, pytest.approx(0.6), 1, 1),
        (0.9, pytest.approx(0.935), 1, 2),
        (0.99, pytest.approx(0.995), 2, 2),
    ]
    text = stated.tabulate(studies, "command")
    assert "listed effects          1  0.000 [0.000, 0.975]" in text
    assert "planted planted; claimed name (cause 0.92)" in text
    stated.draw_picture(studies, tmp_path / "curve.png")
    assert (tmp_path / "curve.png").stat().st_size > 5_000
