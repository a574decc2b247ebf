"""A table of corrected commands is written as its targets are: separator, decimal mark, names, units,
order, and columns that nothing was computed of."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from click.testing import CliRunner
from wide_calibration import wide

from modelsel.calibration.calibration_file import calibration_text
from modelsel.calibration.commands.commands_table import FIGURE_COLUMNS
from modelsel.cli.main import run_command_line
from modelsel.measurements.formats.table import load_table

ROWS = np.r_[70:80]
AXES = [f"Achse {j} [°]" for j in range(1, 7)]


@pytest.fixture(scope="module")
def made():
    return wide(np.random.default_rng(3))


@pytest.fixture(scope="module")
def plan(made) -> pd.DataFrame:
    """Targets with names of a German controller, and a column of numbers that no model looks at."""
    data = made[1].data.take(ROWS)
    frame = (
        data.to_frame()
        .drop(columns=["configuration", "x_mm", "y_mm", "z_mm"])
        .reset_index(drop=True)
    )
    readings = {
        f"q{j}_{unit}": name
        for j, (unit, name) in enumerate(zip(data.units or ["rad"] * 6, AXES, strict=True), 1)
    }
    frame = frame.rename(columns=readings)
    for name in AXES:
        frame[name] = np.degrees(frame[name]).round(3)
    frame.insert(0, "Bemerkung", [f"Griff {k}" for k in range(len(frame))])
    frame.insert(3, "Vorschub", [0.25 * k for k in range(len(frame))])
    return frame


@pytest.fixture
def folder(made, tmp_path) -> Path:
    (tmp_path / "calibration.json").write_text(calibration_text(made[0]))
    return tmp_path


def compensate(folder: Path, plan: Path, out: Path, *words: str) -> None:
    mapped = [f"--column=q{j}_deg={name}" for j, name in enumerate(AXES, 1)]
    command = ["compensate", folder, plan, "--out", out, "--bound", 1e3, 1e3, *mapped, *words]
    ran = CliRunner().invoke(run_command_line, [str(word) for word in command])
    assert ran.exit_code == 0, ran.output


def check(plan: pd.DataFrame, wrote: pd.DataFrame) -> None:
    """The columns of the targets in their order, then those that are new; commands in degrees."""
    count = plan.shape[1]
    assert list(wrote)[:count] == list(plan)
    new = set(list(wrote)[count:])
    assert new - {f"approach{j}" for j in range(1, 7)} <= {"x_mm", "y_mm", "z_mm"} | FIGURE_COLUMNS
    assert wrote["Bemerkung"].tolist() == plan["Bemerkung"].tolist()
    np.testing.assert_allclose(wrote["Vorschub"].astype(float), plan["Vorschub"])
    change = wrote[AXES].astype(float) - plan[AXES]
    assert 0 < np.abs(change).max().max() < 5


@pytest.mark.parametrize(
    ("separator", "decimal", "encoding"),
    [(";", ",", "cp1252"), ("\t", ".", "utf-8"), (";", ".", "utf-16"), (",", ".", "utf-8-sig")],
)
def test_commands_are_written_as_the_targets_are(
    folder, plan, separator, decimal, encoding
) -> None:
    form = {"sep": separator, "decimal": decimal, "encoding": encoding}
    plan.to_csv(folder / "plan.csv", index=False, **form)
    compensate(folder, folder / "plan.csv", folder / "out.csv")
    check(plan, pd.read_csv(folder / "out.csv", **form))
    compensate(folder, folder / "out.csv", folder / "back.csv", "--forward")
    back = pd.read_csv(folder / "back.csv", **form)
    out = pd.read_csv(folder / "out.csv", **form)
    np.testing.assert_allclose(back[AXES], out[AXES], rtol=0, atol=1e-9)
    place = ["x_mm", "y_mm", "z_mm"]
    np.testing.assert_allclose(back[place], out[place], rtol=0, atol=1e-3)
    assert not FIGURE_COLUMNS & set(back)


def test_a_workbook_becomes_a_workbook(folder, plan) -> None:
    from openpyxl import load_workbook

    plan.to_excel(folder / "plan.xlsx", index=False, sheet_name="Griffe & Co", engine="openpyxl")
    compensate(folder, folder / "plan.xlsx", folder / "out.xlsx")
    book = load_workbook(folder / "out.xlsx")
    assert book.sheetnames == ["Griffe & Co"]
    names, *rows = book["Griffe & Co"].values
    wrote = pd.DataFrame(rows, columns=names)
    check(plan, wrote)
    assert all(isinstance(value, (int, float)) for value in wrote[AXES].to_numpy().ravel())
    compensate(folder, folder / "out.xlsx", folder / "out.parquet")
    check(
        wrote[list(plan)],
        pd.read_parquet(folder / "out.parquet").assign(
            **{name: wrote[name] - 1e-9 for name in AXES}
        ),
    )


def test_a_row_of_units_stays_and_other_units_are_kept(folder, plan) -> None:
    """Commands in gon under names without a unit: the row below the names has it."""
    bare = plan.rename(columns={name: name.removesuffix(" [°]") for name in AXES})
    own = list(bare.columns[bare.columns.str.startswith("Achse")])
    bare[own] = (bare[own] / 0.9).round(4)
    units = pd.DataFrame([{name: "gon" if name in own else "-" for name in bare}])
    whole = pd.concat([units, bare.astype(object)])
    whole.to_csv(folder / "plan.csv", index=False, sep=";")
    words = [f"--column=q{j}_deg={name}" for j, name in enumerate(own, 1)]
    command = [
        "compensate",
        folder,
        folder / "plan.csv",
        "--out",
        folder / "out.csv",
        "--bound",
        1e3,
        1e3,
        *words,
    ]
    ran = CliRunner().invoke(run_command_line, [str(word) for word in command])
    assert ran.exit_code == 0, ran.output
    wrote = load_table(folder / "out.csv")
    assert {wrote.units[name] for name in own} == {"gon"}
    for name in own:
        change = np.asarray(wrote.columns[name], float) - bare[name]
        assert 0 < np.abs(change).max() < 5


def test_positions_stay_in_metres(folder, made, plan) -> None:
    position = made[1].data.take(ROWS).position / 1e3
    placed = plan.assign(**dict(zip(("x_m", "y_m", "z_m"), position.T, strict=True)))
    placed.to_csv(folder / "plan.csv", index=False)
    compensate(folder, folder / "plan.csv", folder / "out.csv")
    wrote = pd.read_csv(folder / "out.csv")
    assert "x_mm" not in wrote
    np.testing.assert_allclose(wrote["x_m"], position[:, 0])
    compensate(folder, folder / "out.csv", folder / "back.csv", "--forward")
    back = pd.read_csv(folder / "back.csv")
    np.testing.assert_allclose(back[["x_m", "y_m", "z_m"]], position, rtol=0, atol=1e-6)


def test_a_guarded_header_is_not_guarded_twice(plan, folder) -> None:
    guarded = plan.rename(columns={"Vorschub": "'=Vorschub"})
    guarded.to_csv(folder / "plan.csv", index=False)
    compensate(folder, folder / "plan.csv", folder / "out.csv")
    assert list(pd.read_csv(folder / "out.csv"))[: guarded.shape[1]] == list(guarded)


def test_labels_of_digits_stay_labels_in_a_workbook(plan, folder) -> None:
    from openpyxl import load_workbook

    labels = [f"{k:03d}" for k in range(len(plan))]
    plan.assign(Bemerkung=labels).to_csv(folder / "plan.csv", index=False)
    compensate(folder, folder / "plan.csv", folder / "out.xlsx")
    names, *rows = load_workbook(folder / "out.xlsx").active.values
    wrote = pd.DataFrame(rows, columns=names)
    assert wrote["Bemerkung"].tolist() == labels
    assert all(isinstance(value, (int, float)) for value in wrote["Vorschub"])


def test_a_guarded_cell_is_not_guarded_twice(plan, folder) -> None:
    notes = ["'=1+1", "''=1+1", "=2+2", "Griff"] * 3
    plan.assign(Bemerkung=notes[: len(plan)]).to_csv(folder / "plan.csv", index=False)
    compensate(folder, folder / "plan.csv", folder / "out.csv")
    written = pd.read_csv(folder / "out.csv")["Bemerkung"].tolist()
    assert written[:4] == ["'=1+1", "''=1+1", "'=2+2", "Griff"]
