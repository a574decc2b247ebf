"""A fleet is given by its file or by the folder of it, as a study is; a study file is none."""

from __future__ import annotations

from click.testing import CliRunner

from modelsel.cli.main import run_command_line


def test_a_folder_stands_for_its_fleet_file(tmp_path) -> None:
    ran = CliRunner().invoke(run_command_line, ["fleet", str(tmp_path)])
    assert ran.exit_code == 2
    assert f"{tmp_path / 'fleet.toml'}: there is no such fleet file" in ran.stderr
    (tmp_path / "fleet.toml").write_text('name = "cells"\nstudies = ["none"]\n')
    ran = CliRunner().invoke(run_command_line, ["fleet", str(tmp_path)])
    assert "fleet.toml" in ran.stderr
    assert "none" in ran.stderr


def test_a_study_file_is_no_fleet_file(tmp_path) -> None:
    path = tmp_path / "study.toml"
    path.write_text(
        'name = "cell"\nseed = 1\n[robot]\nname = "ur5"\n[measurements]\nfile = "m.csv"\n'
    )
    ran = CliRunner().invoke(run_command_line, ["fleet", str(path)])
    assert ran.exit_code == 2
    assert "study.toml: this is a study file, not a fleet file. modelsel study" in ran.stderr
    assert "unknown key" not in ran.stderr
