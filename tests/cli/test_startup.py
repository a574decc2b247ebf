"""What a command does not wait for."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from modelsel.cli._options import print_prose
from modelsel.cli.main import run_command_line

SAMPLER = """
import sys
from pathlib import Path
from modelsel.cli.study import _import_sampler
import modelsel.study.pipeline.runner
_import_sampler()
print("emcee" in sys.modules, "scipy.stats" in sys.modules)
from scipy.stats import norm
_import_sampler()
print(norm.ppf(0.5))
"""
STUDY = """
import sys
from pathlib import Path
import scipy.linalg # older versions load scipy.sparse
linalg = set(sys.modules)
import modelsel.cli.study, modelsel.study.pipeline.runner
print(sorted({"scipy.stats", "scipy.sparse", "scipy.spatial", "scipy.optimize", "pandas", "emcee",
              "matplotlib", "multiprocessing", "modelsel.report.drawing"} & set(sys.modules) - linalg))
"""


def printed(code: str) -> str:
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, check=True, text=True)
    return done.stdout


@pytest.mark.integration
def test_the_sampler_comes_without_scipy_stats() -> None:
    """And leaves it to whoever asks for it."""
    assert printed(SAMPLER) == "True False\n0.0\n"


@pytest.mark.integration
def test_a_study_loads_nothing_that_it_may_not_need() -> None:
    assert printed(STUDY) == "[]\n"


INTERRUPTED = """
import runpy, sys
class Interrupted:
    def find_spec(self, name, path=None, target=None):
        if name == "click":
            raise KeyboardInterrupt
sys.meta_path.insert(0, Interrupted())
sys.argv = ["modelsel", "robots"]
runpy.run_module("modelsel", run_name="__main__")
"""
FINISHED = """
import os, runpy, signal, sys
sys.argv = ["modelsel", "robots"]
try:
    runpy.run_module("modelsel", run_name="__main__")
finally:
    os.kill(os.getpid(), signal.SIGINT)
"""


def test_an_interrupt_while_modules_are_imported_is_a_line() -> None:
    done = subprocess.run(
        [sys.executable, "-c", INTERRUPTED], check=False, capture_output=True, text=True
    )
    assert done.returncode == 130
    assert done.stderr == "modelsel: interrupted.\n"


@pytest.mark.skipif(os.name != "posix", reason="signals of POSIX")
def test_an_interrupt_after_everything_is_written_changes_nothing() -> None:
    done = subprocess.run(
        [sys.executable, "-c", FINISHED], check=False, capture_output=True, text=True
    )
    assert (done.returncode, done.stderr) == (0, "")


def test_sentences_keep_within_a_terminal_and_are_whole_in_a_pipe(monkeypatch, capsys) -> None:
    """By the terminal's width; what is indented stays so, and no word is broken."""
    words = "A sentence of many words that does not fit. " * 3 + "/a/long/path/of/one/word"
    text = f"{words}\n\n  {words}"
    print_prose(text)
    assert capsys.readouterr().out == f"{text}\n"
    monkeypatch.setattr(sys.stdout, "isatty", lambda: True, raising=False)
    monkeypatch.setenv("COLUMNS", "40")
    print_prose(text)
    said = capsys.readouterr().out.splitlines()
    first, second = said[: said.index("")], said[said.index("") + 1 :]
    assert max(map(len, said)) <= 40
    assert " ".join(first) == words
    assert all(line.startswith("  ") for line in second)


@pytest.mark.parametrize(
    ("words", "ends"),
    [
        (["export", "nowhere", "--format", "dh", "--out", "a.toml", "--base", "b"], "--urdf FILE."),
        (["plan", "a folder that is nowhere at all"], ""),
        (["plan", "x", "--joint", "q2_deg"], "such as q2_deg=-90:45."),
        (["study", "x", "--colour"], ""),
    ],
)
def test_errors_keep_within_a_terminal(words, ends, monkeypatch, capsys) -> None:
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True, raising=False)
    monkeypatch.setenv("COLUMNS", "45")
    with pytest.raises(SystemExit):
        run_command_line(words, prog_name="modelsel")
    said = capsys.readouterr().err
    assert max(map(len, said.splitlines())) <= 45
    assert " ".join(said.split()).endswith(ends)


def test_a_dry_run_keeps_within_a_terminal(monkeypatch, capsys) -> None:
    monkeypatch.setattr(sys.stdout, "isatty", lambda: True, raising=False)
    monkeypatch.setenv("COLUMNS", "80")
    study = Path(__file__).parents[2] / "studies" / "puma760" / "study.toml"
    with pytest.raises(SystemExit) as ended:
        run_command_line(["study", str(study), "--dry-run"], prog_name="modelsel")
    assert not ended.value.code
    said = capsys.readouterr().out
    assert "would be held out" in " ".join(said.split())
    assert max(map(len, said.splitlines())) <= 80
