"""Corrected commands as programs: each as its controller's documentation writes one, with numbers
that come back, and foreign text in comments alone."""

from __future__ import annotations

import re
import runpy
import sys
import types
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from click.testing import CliRunner
from own_urdf import calibrated

from modelsel._choices import TARGET_FORMS
from modelsel.calibration.calibration_file import calibration_text
from modelsel.calibration.export.robot_programs import LANGUAGES, round_commands, write_program
from modelsel.cli.main import run_command_line
from modelsel.exceptions import StudyError
from modelsel.measurements.reader import read_measurements
from modelsel.robot.files import load_robot

SUFFIX = {"robodk": "py", "urscript": "script", "krl": "src", "rapid": "mod", "ls": "ls"}
Q = np.radians([[10.5, -20.25, 30, 0, 45, -60], [0.001, 90, -90, 180, -180, 359.5]])
TURNS = (False,) * 6
# as the manuals write them: URScript manual, movej; KRL quick guide (KSS 8), names and PTP {A1 …};
# RAPID reference, jointtarget and MoveAbsJ; a program that a Fanuc controller saved as ASCII
SAMPLES = {
    "urscript": """def pick():
  # from a study
  movej([0.183259571, -0.353429174, 0.523598776, 0.000000000, 0.785398163, -1.047197551], a=0.5, v=0.25)
  movej([0.000017453, 1.570796327, -1.570796327, 3.141592654, -3.141592654, 6.274458661], a=0.5, v=0.25)
end
""",
    "krl": """&ACCESS RVP
&REL 1
DEF pick( )
; from a study
;FOLD INI
BAS (#INITMOV,0 )
;ENDFOLD (INI)
BAS (#VEL_PTP,10 )
PTP {A1 10.500000,A2 -20.250000,A3 30.000000,A4 0.000000,A5 45.000000,A6 -60.000000}
PTP {A1 0.001000,A2 90.000000,A3 -90.000000,A4 180.000000,A5 -180.000000,A6 359.500000}
END
""",
    "rapid": """MODULE pick
  ! from a study
  CONST jointtarget p1:=[[10.500000,-20.250000,30.000000,0.000000,45.000000,-60.000000],[9E9,9E9,9E9,9E9,9E9,9E9]];
  CONST jointtarget p2:=[[0.001000,90.000000,-90.000000,180.000000,-180.000000,359.500000],[9E9,9E9,9E9,9E9,9E9,9E9]];
  PROC run_pick()
    MoveAbsJ p1\\NoEOffs,v50,fine,tool0;
    MoveAbsJ p2\\NoEOffs,v50,fine,tool0;
  ENDPROC
ENDMODULE
""",
    "ls": """/PROG  PICK
/ATTR
COMMENT\t\t= "modelsel";
LINE_COUNT\t= 5;
DEFAULT_GROUP\t= 1,*,*,*,*;
/MN
   1:  !from a study    ;
   2:  UFRAME_NUM=0    ;
   3:  UTOOL_NUM=1    ;
   4:J P[1] 10% FINE    ;
   5:J P[2] 10% FINE    ;
/POS
P[1]{
   GP1:
\tUF : 0, UT : 1,\t
\tJ1=    10.500 deg,\tJ2=   -20.250 deg,\tJ3=    30.000 deg,
\tJ4=     0.000 deg,\tJ5=    45.000 deg,\tJ6=   -60.000 deg
};
P[2]{
   GP1:
\tUF : 0, UT : 1,\t
\tJ1=     0.001 deg,\tJ2=    90.000 deg,\tJ3=   -90.000 deg,
\tJ4=   180.000 deg,\tJ5=  -180.000 deg,\tJ6=   359.500 deg
};
/END
""",
}


@pytest.mark.parametrize("form", SAMPLES)
def test_samples(form) -> None:
    text = write_program(form, Path("pick.x"), Q, TURNS, ["from a study"])
    assert text.replace("\r\n", "\n") == SAMPLES[form]
    lines_end = "\n" if form == "urscript" else "\r\n"
    assert text.count("\n") == text.count(lines_end)


class Station:
    """RoboDK's station, as far as a script of targets uses it."""

    def __init__(self, picked: bool = True):
        self.picked = picked
        self.targets: dict[str, list[float]] = {}

    def ItemUserPick(self, message, kind):
        assert kind == 2
        return self

    def Valid(self):
        return self.picked

    def Parent(self):
        return "base"

    def AddTarget(self, name, parent, robot):
        assert (parent, robot) == ("base", self)
        self.name = name
        return self

    def setAsJointTarget(self):
        self.targets[self.name] = []

    def setJoints(self, joints):
        self.targets[self.name] = joints


def run_robodk(text: str, monkeypatch, picked: bool = True) -> Station:
    station = Station(picked)
    stub = types.ModuleType("robodk.robolink")
    stub.ITEM_TYPE_ROBOT = 2
    stub.Robolink = lambda: station
    monkeypatch.setitem(sys.modules, "robodk", types.ModuleType("robodk"))
    monkeypatch.setitem(sys.modules, "robodk.robolink", stub)
    script = Path("pick.py")
    script.write_text(text)
    runpy.run_path(str(script))
    script.unlink()
    return station


def test_robodk_script(monkeypatch, tmp_path) -> None:
    monkeypatch.chdir(tmp_path)
    text = write_program("robodk", Path("pick.py"), Q, TURNS, ["from a study"])
    targets = run_robodk(text, monkeypatch).targets
    assert list(targets) == ["pick_1", "pick_2"]
    np.testing.assert_allclose(list(targets.values()), np.degrees(Q), atol=1e-9)
    with pytest.raises(SystemExit, match="No robot was picked"):
        run_robodk(text, monkeypatch, picked=False)


def test_script_of_the_docs_writes_the_targets_of_a_station(monkeypatch, tmp_path) -> None:
    """Run against a station of two targets; the file is read as planned commands."""
    monkeypatch.chdir(tmp_path)
    page = Path(__file__).parents[3] / "docs" / "how-to" / "your-files.md"
    _, _, rest = page.read_text(encoding="utf-8").partition("## Targets of RoboDK")
    script, _, _ = rest.partition("```python\n")[2].partition("```")
    degrees = np.degrees(Q)

    class Target:
        def __init__(self, k: int):
            self.k = k

        def Name(self) -> str:
            return f"Target {self.k}"

        def Joints(self) -> Target:
            return self

        def list(self) -> list[float]:
            return degrees[self.k].tolist()

    stub = types.ModuleType("robodk.robolink")
    stub.ITEM_TYPE_TARGET = 6
    items = {6: [Target(k) for k in range(len(Q))]}
    stub.Robolink = lambda: types.SimpleNamespace(ItemList=items.__getitem__)
    monkeypatch.setitem(sys.modules, "robodk", types.ModuleType("robodk"))
    monkeypatch.setitem(sys.modules, "robodk.robolink", stub)
    Path("list_targets.py").write_text(script)
    runpy.run_path("list_targets.py")
    data = read_measurements("targets.csv", len(Q[0]) * [False], positions=False)
    np.testing.assert_allclose(data.q, Q, atol=1e-12)


def numbers_of(form: str, text: str) -> list[list[float]]:
    """The joint values of a program, read as its controller reads them."""
    number = r"-?\d+\.\d+"
    if form == "ls":
        _, _, points = text.partition("/POS")
        return [
            [float(v) for v in re.findall(rf"J\d= *({number})", point)]
            for point in points.split("};")[:-1]
        ]
    start = {"robodk": '    ("', "urscript": "  movej(", "krl": "PTP {", "rapid": "  CONST"}[form]
    lines = [line for line in text.splitlines() if line.startswith(start)]
    cut = {"urscript": "],", "rapid": "],["}.get(form, "\0")
    return [[float(v) for v in re.findall(number, line.partition(cut)[0])] for line in lines]


@pytest.mark.parametrize("form", SUFFIX)
def test_numbers_come_back(form, rng) -> None:
    q = rng.uniform(-6, 6, (40, 6))
    text = write_program(form, Path("a.x"), q, TURNS, [])
    back = np.array(numbers_of(form, text))
    back = back if form == "urscript" else np.radians(back)
    np.testing.assert_array_equal(back, round_commands(form, q, TURNS))
    unit = 1 if form == "urscript" else np.pi / 180
    assert np.abs(back - q).max() <= 0.5001 * 10.0 ** -LANGUAGES[form].digits * unit


@pytest.mark.parametrize("form", ["robodk", "krl", "ls"])
def test_slides_are_in_mm(form) -> None:
    q = np.array([[0.5, 123.456]])
    text = write_program(form, Path("a.x"), q, (False, True), [])
    assert numbers_of(form, text)[0] == pytest.approx([np.degrees(0.5), 123.456], abs=1e-3)
    assert ("J2=   123.456  mm" in text) == (form == "ls")


@pytest.mark.parametrize(
    ("form", "slides", "says"),
    [
        ("urscript", (False,) * 7, "URScript moves 6 joints, and the robot has 7"),
        ("rapid", (False,) * 7, "RAPID moves 1 to 6 joints"),
        ("krl", (False,) * 7, "KRL moves 1 to 6 joints"),
        ("rapid", (True, False), "joint 1 slides"),
        ("urscript", (False,) * 5 + (True,), "joint 6 slides"),
    ],
)
def test_joints_that_a_language_lacks(form, slides, says) -> None:
    with pytest.raises(StudyError, match=says):
        write_program(form, Path("a.x"), np.zeros((1, len(slides))), slides, [])


@pytest.mark.parametrize(
    "name", ["", "1a", "a b", "a-b", "ä", "a()", "a\nb", "END", "p1", "x" * 33, 'a"', "a;b"]
)
@pytest.mark.parametrize("form", SUFFIX)
def test_names_that_no_program_has(form, name) -> None:
    """Refused with one that is valid."""
    with pytest.raises(StudyError) as refused:
        write_program(form, Path(f"{name}.x"), Q, TURNS, [])
    advice = str(refused.value).partition("Call it ")[2].rstrip(".")
    write_program(form, Path(advice), Q, TURNS, [])


def test_a_name_with_a_blank_needs_no_other_word() -> None:
    with pytest.raises(StudyError, match=r"Call it Mein_Programm\.mod\."):
        write_program("rapid", Path("Mein Programm.mod"), Q, TURNS, [])


HOSTILE = (
    '"""\nimport os; os.system("touch hit")\n"""',
    "'''); end; popup('x') #",
    "*/ ;ENDFOLD %{PE} {} ! \\ / $OUT[1]=TRUE",
    "x\r\nHALT\r\nMoveAbsJ [[0",
    "Jürgen — 測試 \u202e\u2028 ;\x00/POS",
    "{0.__class__}{rows}",
)


@pytest.mark.parametrize("comment", HOSTILE)
@pytest.mark.parametrize("form", SUFFIX)
def test_foreign_text_stays_a_comment(form, comment, monkeypatch, tmp_path) -> None:
    """All lines but comments are those of a harmless text; nothing runs."""
    monkeypatch.chdir(tmp_path)

    def write(text: str) -> list[str]:
        lines = write_program(form, Path("pick.x"), Q, TURNS, [text]).splitlines()
        marks = {"urscript": "  # ", "krl": "; ", "rapid": "  ! "}
        if form == "ls":
            # line numbers follow from the number of remarks
            code = [re.sub(r"^ +\d+:", "", line) for line in lines if ":  !" not in line]
            return [line for line in code if "LINE_COUNT" not in line]
        if form == "robodk":
            return lines[
                lines.index(
                    'Run it in RoboDK (Tools, Run Script): it adds a joint target a command to the robot that you pick."""'
                ) :
            ]
        return [line for line in lines if not line.startswith(marks[form])]

    assert write(comment) == write("harmless")
    text = write_program(form, Path("pick.x"), Q, TURNS, [comment])
    text.encode("ascii")
    if form == "robodk":
        assert len(run_robodk(text, monkeypatch).targets) == 2
        assert text.count('"""') == 2
    assert not list(tmp_path.iterdir())


# -- the command


@pytest.fixture(scope="module")
def cell(tmp_path_factory):
    """A folder with a calibrated UR5 of a hostile name, and commands for it."""
    folder = tmp_path_factory.mktemp("cell")
    c = calibrated(load_robot("ur5"), np.random.default_rng(9))
    c = replace(c, study='x"""; import os', targets=("a;b",))
    (folder / "calibration.json").write_text(calibration_text(c))
    q = np.random.default_rng(1).uniform(-20, 20, (5, 6))
    q += np.array([0, -60, 80, -110, -90, 0])
    columns = [f"q{k}_deg" for k in range(1, 7)]
    pd.DataFrame(q, columns=columns).to_csv(folder / "targets.csv", index=False)
    return folder


def compensate(folder: Path, *words: object):
    return CliRunner().invoke(
        run_command_line, ["compensate", str(folder), str(folder / "targets.csv"), *map(str, words)]
    )


@pytest.mark.parametrize("form", SUFFIX)
def test_command(form, cell, tmp_path) -> None:
    """A program has the commands of the table."""
    table, program = tmp_path / "t.csv", tmp_path / f"pick.{SUFFIX[form]}"
    assert compensate(cell, "--out", table).exit_code == 0
    ran = compensate(cell, "--out", program, "--format", form)
    assert ran.exit_code == 0, ran.output
    wanted = pd.read_csv(table)[[f"q{k}_deg" for k in range(1, 7)]].to_numpy()
    found = np.array(numbers_of(form, program.read_text()))
    if form == "urscript":
        found = np.degrees(found)
    digits = 0.00051 if form == "ls" else 6e-7
    np.testing.assert_allclose(found, wanted, rtol=0, atol=digits)
    assert ("the decimals of the file move the target by" in ran.output) == (form == "ls")
    assert "5 joint commands, corrected by" in program.read_text()


def test_forms_of_the_command_are_the_languages() -> None:
    assert ("csv", *LANGUAGES) == TARGET_FORMS


def test_decimals_are_measured(cell, tmp_path) -> None:
    """What an LS file's 0.001 deg cost: no more than half of it in every joint, at a metre."""
    ran = compensate(cell, "--out", tmp_path / "a.ls", "--format", "ls")
    (cost,) = re.findall(r"move the target by ([\d.]+) mm", ran.output)
    assert 0.001 < float(cost) < 6 * np.radians(0.0005) * 1200


def test_no_program_of_what_is_not_reached(cell, tmp_path) -> None:
    """A wanted position beyond the arm: nothing is written."""
    columns = [f"q{k}_deg" for k in range(1, 7)]
    row = pd.DataFrame([[0.0] * 6 + [5000.0, 0, 0]], columns=[*columns, "x_mm", "y_mm", "z_mm"])
    row.to_csv(tmp_path / "far.csv", index=False)
    out = tmp_path / "far.src"
    words = ["compensate", cell, tmp_path / "far.csv", "--out", out, "--bound", 1e5, 1e5]
    ran = CliRunner().invoke(run_command_line, [*map(str, words), "--format", "krl"])
    assert ran.exit_code == 5
    assert "1 row is not reached" in ran.output
    assert "no program was written" in ran.output
    assert "error_left_mm" not in ran.output
    assert not out.exists()


def test_forward_corrects_nothing(cell, tmp_path) -> None:
    ran = compensate(cell, "--forward", "--format", "krl", "--out", tmp_path / "a.src")
    assert ran.exit_code == 2
    assert "it goes with --format csv" in ran.output


def test_a_semicolon_of_a_note_is_a_comma_in_a_comment() -> None:
    """A semicolon may end a comment; without a mark two clauses run into one another."""
    text = write_program("krl", Path("pick.src"), Q, TURNS, ["seen; there it extrapolates."])
    assert "; seen, there it extrapolates." in text
