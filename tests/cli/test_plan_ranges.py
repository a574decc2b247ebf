"""Ranges of joints that a plan cannot draw in, and pools that it cannot read, are refused before the study runs."""

from __future__ import annotations

from pathlib import Path

import pytest
from click.testing import CliRunner

from modelsel.cli.main import run_command_line

STUDY = 'name = "a"\n[robot]\nname = "irb120"\nregister = true\n[measurements]\nfile = "none.csv"\n'


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ("q9_deg=3:30", '"q9_deg" is not a joint of irb120'),
        ("q2_deg=30:-30", "from a lower to a higher number, found 30 to -30"),
    ],
)
def test_a_wrong_range_is_refused_before_the_study_runs(
    tmp_path: Path, given: str, said: str
) -> None:
    (tmp_path / "study.toml").write_text(STUDY)
    result = CliRunner().invoke(run_command_line, ["plan", str(tmp_path), "--joint", given])
    assert result.exit_code != 0
    assert said in " ".join(result.output.split())
    assert "none.csv" not in result.output


def write_study(folder: Path, more: str = "") -> None:
    """Write a study whose measurements hold nothing that could be fitted."""
    (folder / "study.toml").write_text(STUDY + more)
    (folder / "none.csv").write_text("")


@pytest.mark.parametrize(
    ("pool", "said"),
    [
        ("", "pool.csv"),
        (None, "pool.csv"),
        ("q1_deg,q2_deg,q3_deg,q4_deg,q5_deg\n1,2,3,4,5\n", "q6"),
    ],
)
def test_a_pool_that_cannot_be_read_is_refused_before_the_study_runs(
    tmp_path: Path, pool: str | None, said: str
) -> None:
    """An empty file, a folder, a file that lacks a joint."""
    write_study(tmp_path)
    path = tmp_path / "pool.csv"
    if pool is None:
        path.mkdir()
    else:
        path.write_text(pool)
    result = CliRunner().invoke(run_command_line, ["plan", str(tmp_path), "--pool", str(path)])
    assert result.exit_code == 3
    assert said in " ".join(result.output.split())
    assert "none.csv" not in result.output


def test_a_pool_may_have_the_names_of_the_studys_file(tmp_path: Path) -> None:
    """It is read; the study's own file is refused next."""
    names = ", ".join(f'q{k}_deg = "J{k}"' for k in range(1, 7))
    write_study(tmp_path, f"columns = {{{names}}}\n")
    path = tmp_path / "pool.csv"
    path.write_text("J1,J2,J3,J4,J5,J6\n1,2,3,4,5,6\n")
    result = CliRunner().invoke(run_command_line, ["plan", str(tmp_path), "--pool", str(path)])
    assert result.exit_code == 3
    assert "none.csv" in result.output
    assert "pool.csv" not in result.output
