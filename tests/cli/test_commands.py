"""The habits of the command line: lazy commands, suggestions, a dry run that computes nothing, a
doctor, completion."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest
from click.testing import CliRunner

from modelsel.cli import doctor
from modelsel.cli.main import COMMANDS, run_command_line

PUMA = Path(__file__).parents[2] / "studies" / "puma760"


def invoked(*words: str, status: int = 0) -> str:
    ran = CliRunner().invoke(run_command_line, [str(w) for w in words])
    assert ran.exit_code == status, ran.output
    return ran.stdout + ran.stderr


@pytest.mark.parametrize("name", COMMANDS)
def test_every_command_is_there_and_says_what_it_does(name) -> None:
    said = invoked(name, "--help")
    assert f"Usage: modelsel {name}" in said
    options = {line.split()[0]: line.split()[1:] for line in said.splitlines() if "  --" in line}
    assert options.get("--json") != []
    assert f"  {name}" in invoked("--help")


def test_an_unknown_command_is_suggested() -> None:
    assert 'Did you mean "validate"?' in invoked("valdate", status=2)


def test_help_loads_no_command() -> None:
    """Nothing heavy, not even numpy, for --help."""
    code = (
        "import sys; sys.argv = ['modelsel', '--help']\nfrom modelsel.cli.main import run_command_line\n"
        "try: run_command_line()\nexcept SystemExit: pass\n"
        "print([m for m in sys.modules if m == 'numpy' or m.startswith('modelsel.com')])"
    )
    ran = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert ran.stdout.endswith("[]\n")


@pytest.mark.slow
def test_an_output_without_greek_letters_loses_no_more_than_them(tmp_path) -> None:
    """A log or a terminal of another encoding: no internal error; JSON is UTF-8 all the same."""

    def ran(encoding: str, *more: object) -> bytes:
        code = (
            "from modelsel.cli.main import run_command_line; run_command_line(prog_name='modelsel')"
        )
        return subprocess.run(
            [sys.executable, "-c", code, *map(str, more)],
            capture_output=True,
            check=True,
            env={**os.environ, "PYTHONIOENCODING": encoding},
        ).stdout

    whole = ran("utf-8", "mechanisms", "gear-ripple").decode()
    assert not whole.isascii()
    assert ran("latin-1", "mechanisms", "gear-ripple") == whole.encode("latin-1", "replace")
    assert (
        len(
            {
                ran(encoding, "mechanisms", "gear-ripple", "--json")
                for encoding in ("utf-8", "latin-1", "ascii")
            }
        )
        == 1
    )
    assert b"+ encoder-eccentricity:4" in ran(
        "ascii", "study", PUMA, "--out", tmp_path, "--no-report", "--no-sampling", "-v"
    )


@pytest.mark.integration
def test_dry_run_computes_and_writes_nothing(tmp_path, monkeypatch) -> None:
    monkeypatch.setattr(
        "modelsel.study.pipeline.runner.analyse", lambda *a, **k: pytest.fail("it computed")
    )
    said = invoked("study", PUMA, "--dry-run", "--out", tmp_path / "out")
    assert "80 configurations would fit the models, 120 would be held out" in said
    assert "result.json, report.pdf, report.html into" in " ".join(said.split())
    assert not (tmp_path / "out").exists()
    assert "report.pdf" not in invoked("study", PUMA, "--dry-run", "--no-report")
    words = ["study", str(PUMA), "--dry-run", "--json", "--out", str(tmp_path / "out")]
    found = json.loads(CliRunner().invoke(run_command_line, words).stdout)
    assert found["configurations"] == {"estimation": 80, "held_out": 120}
    (tmp_path / "study.toml").write_text(
        (PUMA / "study.toml").read_text().replace("estimation = 80", "estimation = 9999")
    )
    (tmp_path / "measurements.csv").write_text((PUMA / "measurements.csv").read_text())
    assert "9999" in invoked("study", tmp_path, "--dry-run", status=2)


def test_doctor(monkeypatch, tmp_path) -> None:
    monkeypatch.delenv("MODELSEL_DATA", raising=False)
    assert "WRONG" not in invoked("doctor")
    assert "what was planted came back" in invoked("doctor")
    monkeypatch.setenv("MODELSEL_DATA", str(tmp_path / "nowhere"))
    assert "WRONG  MODELSEL_DATA" in invoked("doctor", status=5)


def test_doctor_sees_an_old_library(monkeypatch) -> None:
    monkeypatch.setattr(doctor, "version", lambda name: "0.9.10")
    monkeypatch.setattr(
        doctor,
        "requires",
        lambda name: ["numpy>=1.26", "small>=0.9.9", "pytest>=8; extra == 'test'"],
    )
    old, fine = doctor._libraries()
    assert not old["ok"]
    assert "older than 1.26" in old["says"]
    assert fine["ok"]


@pytest.mark.skipif(os.name == "nt", reason="no bash there")
def test_completion_knows_the_commands() -> None:
    """What the shell asks is answered with the commands that begin so."""
    assert "_MODELSEL_COMPLETE=bash_complete" in invoked("completion", "bash")
    env = os.environ | {
        "_MODELSEL_COMPLETE": "bash_complete",
        "COMP_WORDS": "modelsel comp",
        "COMP_CWORD": "1",
    }
    ran = subprocess.run(
        [
            sys.executable,
            "-c",
            "from modelsel.cli.main import run_command_line; run_command_line(prog_name='modelsel')",
        ],
        env=env,
        capture_output=True,
        text=True,
        check=False,
    )
    assert {line.partition(",")[2] for line in ran.stdout.split()} == {
        "compensate",
        "compare",
        "completion",
    }


def test_columns_of_other_names(tmp_path) -> None:
    """Commands without a study take the names that a laboratory gives its columns."""
    text = (Path(__file__).parents[2] / "studies" / "puma760" / "measurements.csv").read_text(
        encoding="utf-8"
    )
    first, _, rest = text.partition("\n")
    name = first.split(",")[0]
    (tmp_path / "lab.csv").write_text(first.replace(name, "J1", 1) + "\n" + rest, encoding="utf-8")
    words = ["check", str(tmp_path / "lab.csv"), "--robot", "puma760"]
    refused = CliRunner().invoke(run_command_line, words)
    assert refused.exit_code == 3
    assert f"--column {name}=NAME" in refused.stderr
    assert CliRunner().invoke(run_command_line, [*words, "--column", f"{name}=J1"]).exit_code == 0
    wrong = CliRunner().invoke(run_command_line, [*words, "--column", "J1"])
    assert (wrong.exit_code, "is not NAME=COLUMN" in wrong.stderr) == (2, True)


def test_mechanisms_say_whose_they_are() -> None:
    said = " ".join(invoked("mechanisms", "--robot", "ur10e").split())
    assert "These are the mechanisms of ur10e; another robot's: --robot NAME" in said
