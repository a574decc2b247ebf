"""A file in the form of the one that `init` read goes into `validate` and `compensate` as it is."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from click.testing import CliRunner, Result

from modelsel.cli.main import run_command_line
from modelsel.measurements.measurements import build_measurements
from modelsel.robot.files import load_robot
from modelsel.robot.rigid import rotation_matrix
from modelsel.study.simulation import simulate_points

pytestmark = pytest.mark.integration
ROWS = 40
JOINTS = [f"A{k}" for k in range(1, 7)]


def invoked(*words: object) -> Result:
    return CliRunner().invoke(run_command_line, [str(word) for word in words])


def campaign(seed: int) -> pd.DataFrame:
    """Readings A1 … A6 [deg] and a tracker's X Y Z [mm] of an arm that is as drawn."""
    rng = np.random.default_rng(seed)
    q = rng.uniform(-1.8, 1.8, (ROWS, 6))
    at = build_measurements(q, np.zeros((ROWS, 3)))
    tool = np.array([40.0, -25, 120])
    points = simulate_points(load_robot("ur10"), tool, [], at=at, noise_mm=0.05, rng=rng)
    seen = points[["x_mm", "y_mm", "z_mm"]].to_numpy() @ rotation_matrix(2, 0.7).T
    frame = pd.DataFrame(np.degrees(q).round(5), columns=JOINTS)
    frame[["X", "Y", "Z"]] = (seen + np.array([2500, -800, 300])).round(4)
    frame.loc[[6, 11], ["X", "Y", "Z"]] = np.nan
    return frame


def write(path: Path, frame: pd.DataFrame, form: str) -> None:
    """Write rows in a form: with a row of units, in centimetres and gon, or without a header."""
    if form == "units":
        header, *lines = frame.to_csv(sep=";", decimal=",", index=False).splitlines()
        units = ["°" if name in JOINTS else "mm" for name in frame.columns]
        path.write_bytes("\r\n".join([header, ";".join(units), *lines]).encode("cp1252"))
    elif form == "gon and cm":
        sizes = {name: 0.9 if name in JOINTS else 10 for name in frame.columns}
        other = frame / pd.Series(sizes)
        other.columns = [f"{n} [{'gon' if n in JOINTS else 'cm'}]" for n in frame.columns]
        other.to_csv(path, index=False)
    else:
        frame.dropna().to_csv(path, index=False, header=False)


def read(path: Path, form: str) -> pd.DataFrame:
    """Read the table of `compensate`, written in the form of its targets, with readings A1 … A6 [deg]."""
    if form == "units":
        return pd.read_csv(path, sep=";", decimal=",", skiprows=[1], encoding="cp1252")
    there = pd.read_csv(path)
    if form == "gon and cm":
        return there.assign(**{name: 0.9 * there[f"{name} [gon]"] for name in JOINTS})
    return there.rename(columns={f"q{k}_deg": f"A{k}" for k in range(1, 7)})


@pytest.mark.slow
@pytest.mark.parametrize("form", ["units", "gon and cm", "no header"])
def test_files_of_the_form_of_the_first(form, tmp_path, monkeypatch) -> None:
    monkeypatch.chdir(tmp_path)
    write(Path("m.csv"), campaign(18), form)
    ran = invoked("init", "m.csv", "--robot", "ur10", "--yes", "--out", "s")
    assert ran.exit_code == 0, ran.output
    assert Path("s/m.csv").read_bytes() == Path("m.csv").read_bytes()
    study = Path("s/study.toml")
    study.write_text(study.read_text() + '\n[model]\ncandidates = ["encoder-scale"]\n')
    ran = invoked("study", "s", "--no-sampling", "--no-report", "--quiet", "--out", "r")
    assert ran.exit_code == 0, ran.output
    new = campaign(19)
    write(Path("n.csv"), new, form)
    judged = invoked("validate", "r", "n.csv")
    assert judged.exit_code == 0, judged.output
    assert "still valid within noise" in judged.stdout
    assert "Columns are read as in the study's file:" in judged.stdout
    figures = json.loads(invoked("validate", "r", "n.csv", "--json").stdout)
    assert figures["rows"] == ROWS - 2
    commands = new if form == "no header" else new[JOINTS]
    write(Path("p.csv"), commands, form)
    done = invoked("compensate", "r", "p.csv", "--out", "c.csv", "--forward")
    assert done.exit_code == 0, done.output
    there = read(Path("c.csv"), form)
    used = commands.dropna()
    np.testing.assert_allclose(there[JOINTS], used[JOINTS], atol=1e-4)
    seen = new.loc[used.index, ["X", "Y", "Z"]].to_numpy()
    measured = np.isfinite(seen).all(1)
    at = there[["x_mm", "y_mm", "z_mm"]].to_numpy()
    assert np.abs(at - seen)[measured].max() < 1.0


@pytest.mark.slow
def test_measured_rows_without_a_position_are_commands_too(tmp_path, monkeypatch) -> None:
    """Where a wanted position is empty, it is where the nominal robot has the target."""
    monkeypatch.chdir(tmp_path)
    write(Path("m.csv"), campaign(18), "units")
    assert invoked("init", "m.csv", "--robot", "ur10", "--yes", "--out", "s").exit_code == 0
    study = Path("s/study.toml")
    study.write_text(study.read_text() + '\n[model]\ncandidates = ["encoder-scale"]\n')
    invoked("study", "s", "--no-sampling", "--no-report", "--quiet", "--out", "r")
    done = invoked("compensate", "r", "m.csv", "--out", "c.csv")
    assert done.exit_code == 0, done.output
    assert len(read(Path("c.csv"), "units")) == ROWS
