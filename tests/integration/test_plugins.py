"""A package from outside: begun by the tool, tried by its laws, built, installed, found in a study;
a broken one stops none."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from modelsel import read_study, simulate_study
from modelsel.calibration.loading import load_calibration
from modelsel.cli.main import run_command_line
from modelsel.cli.plugins import Trial, load_plugin, render_plugin, try_mechanisms
from modelsel.config.study_tables import ModelTable
from modelsel.exceptions import StudyError
from modelsel.mechanisms.causes import Named, Number, q
from modelsel.mechanisms.registry import (
    BUILTIN,
    PerJoint,
    every,
    find_entry_problem,
    mechanism,
    with_plugins,
)
from modelsel.mechanisms.terms import Mechanism, Screw, Term
from modelsel.robot.files import load_robot
from modelsel.study.pipeline.runner import run_study
from modelsel.testing import LawBroken, check_mechanism, find_broken_laws

PUMA = load_robot("puma760")
STUDY = """name = "outside"
seed = 1
[robot]
name = "puma760"
tool_mm = [40, -25, 100]
[measurements]
file = "measurements.csv"
[split]
estimation = 60
[model]
candidates = ["hose-twist", "wrist-coupling", "gear-eccentricity"]
[simulate]
configurations = 90
noise_mm = 0.04
[[simulate.effect]]
frame = 4
axis = "rz"
cause = "sin(q4+q6)"
size = 1e-3
"""


def command(*words: str, cwd: Path, path: Path | None = None) -> subprocess.CompletedProcess[str]:
    code = "from modelsel.cli.main import run_command_line; run_command_line()"
    env = os.environ | ({} if path is None else {"PYTHONPATH": str(path)})
    return subprocess.run(
        [sys.executable, "-c", code, *words],
        cwd=cwd,
        env=env,
        capture_output=True,
        text=True,
        check=False,
    )


@pytest.fixture(scope="module")
def installed(tmp_path_factory) -> Path:
    """The tool's own skeleton, built as a wheel without a network and installed into a folder of
    its own."""
    here = tmp_path_factory.mktemp("outside")
    begun = command("mechanisms", "--new", "hose-twist", cwd=here)
    assert begun.returncode == 0, begun.stderr
    pip = [sys.executable, "-m", "pip", "--disable-pip-version-check", "-q"]
    offline = ["--no-index", "--no-deps"]
    subprocess.run(
        [*pip, "wheel", *offline, "--no-build-isolation", "-w", "dist", "./hose-twist"],
        cwd=here,
        check=True,
    )
    (wheel,) = (here / "dist").glob("*.whl")
    subprocess.run(
        [*pip, "install", *offline, "--target", str(here / "site"), str(wheel)],
        cwd=here,
        check=True,
    )
    return here


@pytest.mark.slow
def test_an_outside_package_is_built_installed_and_found(installed) -> None:
    shown = command("mechanisms", "hose-twist", cwd=installed, path=installed / "site")
    assert shown.stdout.startswith("hose-twist: The hose pack twists joint 4"), shown.stderr
    assert (
        command("mechanisms", "hose-twist", cwd=installed).returncode == 2
    )  # without it nobody knows it
    (installed / "study.toml").write_text(STUDY)
    assert (
        command("simulate", "study.toml", "--out", "measurements.csv", cwd=installed).returncode
        == 0
    )
    quick = ("--json", "--no-report", "--no-sampling")
    ran = command(
        "study", "study.toml", "--out", "out", *quick, cwd=installed, path=installed / "site"
    )
    assert ran.returncode == 0, ran.stderr
    (finding,) = json.loads(ran.stdout)["findings"]
    assert finding["credible_set"][0]["mechanism"] == "hose-twist"
    assert finding["estimate"][0]["value"] == pytest.approx(1e-3, rel=0.1)
    assert load_calibration(installed / "out").model.names == (
        "geometric",
        "hose-twist",
    )  # without the package
    refused = command("study", "study.toml", "--out", "out", cwd=installed)
    assert refused.returncode == 2
    assert 'unknown mechanism "hose-twist"' in refused.stderr


def test_skeleton_obeys_the_laws(installed) -> None:
    ran = command("mechanisms", "--test", "hose-twist/hose_twist.py", cwd=installed)
    assert ran.returncode == 0, ran.stdout
    assert ran.stdout.count("obeys the laws") == 10
    by_name = command(
        "mechanisms",
        "--test",
        "hose_twist",
        "--robot",
        "ur5",
        cwd=installed,
        path=installed / "site",
    )
    assert by_name.stdout == "hose-twist on ur5: obeys the laws\n"


WRONG = """from modelsel.mechanisms.causes import q, Named
from modelsel.mechanisms.terms import Mechanism, Screw, Term
def lever(robot):
    return Mechanism("lever", (Term("k", (Screw(2, "rz", Named("q3", "mm")),)),), "Wrong unit.", "k", "nowhere")
def raises(robot):
    return 1 / 0
def mechanisms():
    return {"lever": lever, "raises": raises, "geometric": lever, "long-arm": lambda robot: None}
"""


def test_what_is_wrong_is_said(tmp_path) -> None:
    (tmp_path / "wrong.py").write_text(WRONG)
    ran = CliRunner().invoke(
        run_command_line, ["mechanisms", "--test", str(tmp_path / "wrong.py"), "--robot", "puma760"]
    )
    assert ran.exit_code == 5
    assert "lever on puma760: L5:" in ran.output
    assert "raises on puma760: ZeroDivisionError" in ran.output
    assert "long-arm applies to none" in ran.output
    (tmp_path / "empty.py").write_text("x = 1\n")
    for path, says in (
        (tmp_path / "empty.py", "no attribute 'mechanisms'"),
        (tmp_path / "none.py", "cannot be loaded"),
    ):
        with pytest.raises(StudyError, match=says):
            load_plugin(str(path))


def test_a_broken_plugin_is_listed_and_stops_nothing(tmp_path, monkeypatch) -> None:
    (tmp_path / "wrong.py").write_text(WRONG)
    info = tmp_path / "wrong-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: wrong\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text(
        "[modelsel.mechanisms]\nwrong = wrong:mechanisms\ngone = nowhere:mechanisms\n"
    )
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setattr("sys.dont_write_bytecode", True)
    registry, out = with_plugins(robot=PUMA)
    assert set(registry) == {*BUILTIN, "lever", "long-arm"}
    assert out["gone"].startswith("ModuleNotFoundError")
    assert out["wrong, raises"].startswith("ZeroDivisionError")
    assert out["wrong, geometric"] == 'the name "geometric" is taken'
    ran = CliRunner().invoke(run_command_line, ["mechanisms", "backlash"])
    assert ran.exit_code == 0
    assert "plug-in wrong, raises is left out: ZeroDivisionError" in ran.output
    monkeypatch.delitem(sys.modules, "wrong")


OWN = """from dataclasses import dataclass
from modelsel.mechanisms.causes import Applied, Named, q
from modelsel.mechanisms.registry import PerJoint
from modelsel.mechanisms.terms import Mechanism, Screw, Term
@dataclass(frozen=True)
class Squared(Named):
    def of(self, state):
        return state.value(self.name) ** 2
def bent(robot):
    return Mechanism("bent", (Term("k", (Screw(4, "rz", 2.0 * Squared("q4", "rad") + 1.0),)),), "It bends.", "k", "nowhere")
def mechanisms():
    return {"bent": bent}
"""


@pytest.fixture
def own_cause(tmp_path, monkeypatch) -> Path:
    """A study beside an installed plug-in whose mechanism has a cause of a class of its own."""
    (tmp_path / "own.py").write_text(OWN)
    info = tmp_path / "own-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: own\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text("[modelsel.mechanisms]\nown = own:mechanisms\n")
    (tmp_path / "study.toml").write_text(STUDY.replace("hose-twist", "gear-eccentricity"))
    simulate_study(tmp_path).to_csv(tmp_path / "measurements.csv", index=False)
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setattr("sys.dont_write_bytecode", True)
    yield tmp_path
    sys.modules.pop("own", None)


def test_a_cause_that_no_calibration_can_store_is_refused_before_the_work(own_cause) -> None:
    """The plug-in is left out, and why is said; a study that names it is refused; nothing is
    written."""
    says = "Squared is a kind of cause of its own, which no calibration can store: build it of those in modelsel.mechanisms.causes."
    quick = ["--no-report", "--no-sampling"]
    study, out = own_cause / "study.toml", own_cause / "out"
    ran = CliRunner().invoke(run_command_line, ["study", str(study), "--out", str(out), *quick])
    assert ran.exit_code == 0, ran.output
    assert f"plug-in own, bent is left out: {says}" in ran.stderr
    assert load_calibration(out).model.names[0] == "geometric"
    study.write_text(study.read_text().replace('"wrist-coupling"', '"bent"'))
    ran = CliRunner().invoke(
        run_command_line, ["study", str(study), "--out", str(own_cause / "other"), *quick]
    )
    assert ran.exit_code == 2
    assert says in ran.stderr
    assert 'unknown mechanism "bent"' in ran.stderr
    assert not (own_cause / "other").exists()


@pytest.mark.parametrize(
    "model",
    [
        {"candidates": "all"},
        {"candidates": ["bent"]},
        {"base": ["geometric", "bent"]},
        {"ladder": [["bent"]]},
    ],
)
def test_a_registry_with_such_a_cause_is_refused_before_the_work(model, own_cause) -> None:
    from own import mechanisms

    steps: list[str] = []
    whole = read_study(own_cause).model_copy(update={"model": ModelTable(**model)})
    with pytest.raises(StudyError, match="bent: Squared is a kind of cause of its own"):
        run_study(whole, own_cause, registry={**BUILTIN, **mechanisms()}, say=steps.append)
    assert steps == ["reading measurements.csv"]


def bad(**changes: object) -> Mechanism:
    whole = {
        "name": "m",
        "terms": (Term("k", (Screw(2, "rz", q(3)),), (1e-5, 1e-3)),),
        "sentence": "One.",
        "equation": "k",
        "source": "here",
    }
    return Mechanism(**(whole | changes))


@pytest.mark.parametrize(
    ("wrong", "says"),
    [
        (bad(sentence="no stop"), "full stop"),
        (bad(source=""), "lacks a name"),
        (bad(terms=(Term("k", (Screw(2, "rz", q(3)),), (1e-3, 1e-5)),)), "from low to high"),
        (bad(terms=(Term("k", (Screw(2, "rz", q(3)),), sign=3),)), "its sign is 3"),
        (bad(terms=(Term("k", (Screw(7, "rz", Number(1.0)),)),)), "moves nothing|moves no"),
        (bad(terms=(Term("k", (Screw(2, "rz", q(3)),), (0.0, 10.0)),)), "moves the target"),
        (bad(terms=2 * (Term("k", (Screw(2, "rz", q(3)),)),)), "repeats a symbol"),
    ],
)
def test_laws_say_what_is_wrong(wrong, says, rng) -> None:
    assert any(re.search(says, text) for text in find_broken_laws(wrong, PUMA, rng)), (
        find_broken_laws(wrong, PUMA, rng)
    )
    with pytest.raises(LawBroken):
        check_mechanism(wrong, PUMA, rng)


def test_a_covariate_of_ones_own_is_drawn(rng) -> None:
    assert (
        find_broken_laws(
            bad(terms=(Term("k", (Screw(2, "rz", Named("current_A", "A")),), (1e-5, 1e-3)),)),
            PUMA,
            rng,
        )
        == []
    )
    assert find_broken_laws(mechanism("backlash:3", PUMA), PUMA, rng) == []


def test_unsound() -> None:
    assert "calls itself" in find_entry_problem("other", lambda robot: bad(), PUMA)
    assert "does not have" in find_entry_problem(
        "m", lambda robot: bad(terms=(Term("k", (Screw(9, "rz", q(3)),)),)), PUMA
    )
    assert find_entry_problem("m", lambda robot: bad(), PUMA) is None


@pytest.mark.parametrize("name", ["Hose", "2nd", "a b", "../x", "é"])
def test_a_name_that_cannot_be_one(name) -> None:
    with pytest.raises(StudyError, match="cannot name a mechanism"):
        render_plugin(name)


def test_same_robots_same_words(tmp_path) -> None:
    (tmp_path / "wrong.py").write_text(WRONG)
    entries = {"m": lambda robot: bad()}
    assert (
        try_mechanisms(entries, [PUMA])
        == try_mechanisms(entries, [PUMA])
        == [Trial("m", "puma760", [])]
    )
    assert np.all([trial.robot for trial in try_mechanisms(entries, [PUMA, load_robot("ur5")])])


def test_a_name_that_is_taken_obeys_no_law(tmp_path) -> None:
    """As an installed plug-in it is left out, however lawful it is."""
    (trial,) = try_mechanisms({"geometric": lambda robot: bad(name="geometric")}, [PUMA])
    assert "taken by a built-in mechanism" in " ".join(trial.broken)
    module = 'def mechanisms():\n    return {"geometric": lambda robot: None}\n'
    (tmp_path / "dup.py").write_text(module)
    words = ["mechanisms", "--test", str(tmp_path / "dup.py")]
    ran = CliRunner().invoke(run_command_line, words)
    assert ran.exit_code == 5
    assert ran.stdout.startswith("geometric: this name is taken by a built-in mechanism")


def test_long_numbers_of_causes_are_rounded() -> None:
    ran = CliRunner().invoke(
        run_command_line, ["mechanisms", "counterbalance", "--robot", "irb1600"]
    )
    assert "sin(q2+1.571)" in ran.stdout


def test_joints_may_be_numbers() -> None:
    """Those that the robot has are built, as by a function that returns them."""

    def build(robot, joint):
        return bad(name=f"m:{joint}", terms=(Term(f"k{joint}", (Screw(joint, "rz", q(3)),)),))

    listed = every(PUMA, {"m": PerJoint(build, (1, 3, 7))})
    assert listed == every(PUMA, {"m": PerJoint(build, lambda robot: (1, 3))})
    repeated = every(PUMA, {"m": PerJoint(build, (1, 2, 3, 3))})
    assert repeated == every(PUMA, {"m": PerJoint(build, range(1, 4))})
    assert [one.name for one in listed] == ["m:1", "m:3"]
