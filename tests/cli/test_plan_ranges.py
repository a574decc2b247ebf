"""Ranges of joints that a plan cannot draw in are refused before the study runs."""

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
