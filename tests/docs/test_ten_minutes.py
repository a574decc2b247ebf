"""From a tracker's file to a corrected program: the page's commands, run in its order on the files of
an arm that this test simulates, print what it shows; the corrected program is right on that arm.
`python tests/rewrite.py ten_minutes` writes the shown output anew."""

from __future__ import annotations

import contextlib
import re
import shlex
import tempfile
import textwrap
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from click.testing import CliRunner
from shown_code import ROOT, fenced

from modelsel.cli.main import run_command_line
from modelsel.robot.files import load_robot
from modelsel.robot.kinematics import forward
from modelsel.robot.rigid import rotation_matrix

PAGE = ROOT / "docs" / "how-to" / "ten-minutes.md"
AGAIN = "python tests/rewrite.py ten_minutes writes it anew"
ROBOT = load_robot("irb120")
# the reflector on the flange, and the tracker's frame
TOOL, TURN, SHIFT = np.array([35.0, -20.0, 85.0]), rotation_matrix(2, 0.9), [2400.0, -700.0, 250.0]
NOISE_MM = 0.03
POSES = 90


def real(q: np.ndarray) -> np.ndarray:
    """Where the reflector of the real arm is in frame 0: zeros off, an uneven gear, a coupled
    wrist."""
    off = q + np.array([0, 1.1e-3, -0.8e-3, 0.5e-3, 1.5e-3, 0])
    off[:, 1] += 6e-4 * np.sin(q[:, 1] + 0.5)
    off[:, 4] += 5e-4 * q[:, 3]
    return forward(ROBOT, off, TOOL)


def seen(q: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """What the tracker measures, in its own frame."""
    return real(q) @ TURN.T + SHIFT + rng.normal(0, NOISE_MM, (len(q), 3))


def numbers(row: np.ndarray, between: str, mark: str = ".") -> str:
    return between.join(f"{value:.4f}".replace(".", mark) for value in row)


def workshop(folder: Path, text: str) -> None:
    """What the page starts with: the tracker's export, the controller's log, the program's
    targets."""
    rng = np.random.default_rng(12)
    q = np.radians(np.degrees(0.9 * ROBOT.draw(rng, POSES)).round(4))
    points = [
        f"A,  Cell 4,  P{k:03d},  {numbers(row, ',  ')}" for k, row in enumerate(seen(q, rng), 1)
    ]
    head = ["// Spatial Analyzer", "// Working frame: A::WORLD, millimetres"]
    (folder / "points.txt").write_text("\n".join([*head, *points]) + "\n")
    # two poses that the tracker did not catch
    log = [f"P{k:03d};{numbers(row, ';', ',')}" for k, row in enumerate(np.degrees(q), 1)]
    log += ["P091;0,0;0,0;0,0;0,0;0,0;0,0", "P092;5,0;5,0;5,0;5,0;5,0;5,0"]
    (folder / "log.csv").write_text("\n".join(["Punkt;J1;J2;J3;J4;J5;J6", *log]) + "\n")
    (folder / "pick.csv").write_text(fenced("csv", text)[0])


def commanded(program: Path) -> np.ndarray:
    """The joint commands of a RAPID module (m, 6) [rad]."""
    rows = re.findall(r"\[\[([-\d., ]+)\],", program.read_text(encoding="ascii"))
    return np.radians([[float(cell) for cell in row.split(",")] for row in rows])


def measure_again(folder: Path) -> None:
    """The corrected program run on the arm, and measured by the tracker."""
    q = commanded(folder / "pick.mod")
    columns = {f"q{k}_deg": np.degrees(column) for k, column in enumerate(q.T, 1)}
    x = seen(q, np.random.default_rng(13))
    table = pd.DataFrame(columns | dict(zip(("x_mm", "y_mm", "z_mm"), x.T, strict=True)))
    table.to_csv(folder / "again.csv", index=False)


def show(line: str) -> str:
    """A command and what it prints, folded; of a study nothing, of which the page shows nothing."""
    ran = CliRunner().invoke(run_command_line, shlex.split(line))
    assert ran.exit_code == 0, (line, ran.output)
    rows = [] if line.startswith("study ") else ran.stdout.splitlines()
    folded = [
        textwrap.fill(row, 112, subsequent_indent="    ", break_on_hyphens=False) for row in rows
    ]
    return "\n".join([f"$ modelsel {line}", *folded]) + "\n"


def run_page(text: str, folder: Path) -> list[tuple[str, str]]:
    """(as shown, as it is now) of every console block."""
    workshop(folder, text)
    blocks = []
    with contextlib.chdir(folder):
        for block in fenced("console", text):
            now = ""
            for line in re.findall(r"^\$ modelsel (.*)$", block, re.MULTILINE):
                if "again.csv" in line:
                    measure_again(folder)
                now += show(line)
            blocks.append((block, now))
    return blocks


@pytest.fixture(scope="module")
def done(tmp_path_factory) -> tuple[Path, list[tuple[str, str]]]:
    folder = tmp_path_factory.mktemp("ten")
    return folder, run_page(PAGE.read_text(encoding="utf-8"), folder)


def test_commands_print_what_is_shown(done) -> None:
    _, blocks = done
    ran = [line.split()[2] for shown, _ in blocks for line in shown.splitlines() if "$" in line]
    assert ran == ["init", "study", "compensate", "validate"]
    for shown, now in blocks:
        assert shown == now, AGAIN


def test_program_moves_the_arm_where_the_page_says(done) -> None:
    """On the simulated arm the reflector goes where the registered drawing has it, in the tracker's
    frame."""
    folder, _ = done
    with contextlib.chdir(folder):
        show("compensate reports/cell4 pick.csv --out table.csv")
    planned = np.radians(pd.read_csv(folder / "pick.csv").to_numpy(float))
    wanted = pd.read_csv(folder / "table.csv")[["x_mm", "y_mm", "z_mm"]].to_numpy()
    corrected = commanded(folder / "pick.mod")
    assert corrected.shape == planned.shape
    before, after = (
        np.linalg.norm(real(q) @ TURN.T + SHIFT - wanted, axis=1) for q in (planned, corrected)
    )
    # the wanted places are those of the drawing, but for where registration puts its base
    placed = np.linalg.norm(forward(ROBOT, planned, TOOL) @ TURN.T + SHIFT - wanted, axis=1)
    assert placed.max() < 1
    text = " ".join(PAGE.read_text(encoding="utf-8").split())
    assert f"{before.mean():.2f} mm off on average" in text
    assert f"with the corrected program {after.mean():.3f} mm" in text
    assert after.max() < 0.2 * before.mean()


def test_report_is_there(done) -> None:
    folder, _ = done
    report = folder / "reports" / "cell4" / "report.pdf"
    assert report.stat().st_size > 10_000


def rewrite() -> None:
    """The page's shown output as it is now."""
    text = PAGE.read_text(encoding="utf-8")
    with tempfile.TemporaryDirectory() as folder:
        for old, new in run_page(text, Path(folder)):
            text = text.replace(f"```console\n{old}", f"```console\n{new}")
    PAGE.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    rewrite()
