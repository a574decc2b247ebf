"""`modelsel init`: from files as other programs write them to a study that runs, no file edited."""

from __future__ import annotations

import json
import re
import tomllib
import warnings
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from click.testing import CliRunner, Result

from modelsel import load_result
from modelsel.cli.main import run_command_line
from modelsel.measurements.measurements import build_measurements
from modelsel.measurements.reader import read_measurements
from modelsel.robot.files import load_robot
from modelsel.robot.rigid import rotation_matrix
from modelsel.study.simulation import simulate_points

TOOL = np.array([40.0, -25, 120])


def campaign(rows: int = 40, largest: float = 1.8, robot: str = "ur10") -> pd.DataFrame:
    """Readings in degrees J1 … J6 and a tracker's X Y Z of an arm that is as drawn."""
    rng = np.random.default_rng(18)
    q = rng.uniform(-largest, largest, (rows, 6))
    q[0, 0] = largest
    at = build_measurements(q, np.zeros((rows, 3)))
    points = simulate_points(load_robot(robot), TOOL, [], at=at, noise_mm=0.05, rng=rng)
    seen = points[["x_mm", "y_mm", "z_mm"]].to_numpy() @ rotation_matrix(2, 0.7).T
    frame = pd.DataFrame(np.degrees(q).round(5), columns=[f"J{k}" for k in range(1, 7)])
    frame[["X", "Y", "Z"]] = (seen + np.array([2500, -800, 300])).round(4)
    return frame


def invoked(*words: object, answers: str | None = None) -> Result:
    return CliRunner().invoke(run_command_line, [str(word) for word in words], input=answers)


@pytest.fixture(autouse=True)
def _here(tmp_path, monkeypatch) -> None:
    monkeypatch.chdir(tmp_path)


@pytest.mark.slow
def test_german_excel_to_a_study_that_runs(tmp_path) -> None:
    """Semicolons, decimal commas, Windows-1252; a robot by another spelling; no option but --yes."""
    frame = campaign()
    frame["Temperatur [°C]"] = np.linspace(20, 24, len(frame)).round(1)
    frame["Prüfer"] = "Jörg"
    file = tmp_path / "Messung 3.csv"
    frame.to_csv(file, sep=";", decimal=",", index=False, encoding="cp1252")
    ran = invoked("init", file, "--robot", "UR 10", "--yes")
    assert ran.exit_code == 0, ran.output
    said = ran.stdout.splitlines()
    assert said[:6] == [
        "Robot: ur10, 6 joints, links of 1,683 mm in all.",
        (
            "Messung 3.csv is read as it is: text in Windows-1252, cells separated by semicolons, "
            "decimal commas."
        ),
        'The joint readings: "J1" to "J6" in degrees (up to 103).',
        said[3],
        'Also: "Temperatur [°C]" as temperature_C (20 to 24).',
        "40 rows, 40 configurations.",
    ]
    assert "the nominal arm fits to 0.0" in said[6]
    page = Path(__file__).parents[2] / "docs" / "how-to" / "your-files.md"
    shown = "```text\n" + "\n".join(said[:8]) + "\n```"
    assert shown in page.read_text(encoding="utf-8"), shown
    assert said[8] == 'Not used: "Prüfer".'
    assert said[-1] == "Next: modelsel study 'Messung 3'"
    folder = tmp_path / "Messung 3"
    assert (folder / file.name).read_bytes() == file.read_bytes()
    study = tomllib.loads((folder / "study.toml").read_text(encoding="utf-8"))
    assert study["measurements"]["columns"]["temperature_C"] == "Temperatur [°C]"
    assert study["split"] == {"estimation": 24}
    ran = invoked("study", folder, "--no-report", "--no-sampling", "--out", "out")
    assert ran.exit_code == 0, ran.output
    result = json.loads((tmp_path / "out" / "result.json").read_text())
    assert result["ladder"][0]["estimation"]["rms_mm"] < 0.2
    assert [w["code"] for w in result["warnings"]].count("file-format") == 1


def test_a_missed_shot_is_left_out_and_said(tmp_path) -> None:
    frame = campaign()
    frame["Remark"] = ""
    frame.loc[6, ["X", "Y", "Z"]] = np.nan
    frame.loc[6, "Remark"] = "beam broken"
    file = tmp_path / "shots.csv"
    frame.to_csv(file, index=False)
    ran = invoked("init", file, "--robot", "ur10", "--yes")
    assert ran.exit_code == 0, ran.output
    assert "Left out, because there is no position: line 8 (beam broken); its joint" in ran.stdout
    assert "39 rows, 39 configurations." in ran.stdout
    assert (tmp_path / "shots" / "shots.csv").read_bytes() == file.read_bytes()
    dry = invoked("study", "shots", "--dry-run")
    assert (dry.exit_code, "ur10, 39 rows" in dry.stdout) == (0, True)


def test_missed_shots_hide_no_column_and_no_unit(tmp_path) -> None:
    """Orientation, temperature and a unit that is converted are found although cells are empty."""
    named = dict(zip("123", "ABC", strict=True))
    frame = poses("ZYX").rename(columns=named)
    frame["Temp_C"] = np.linspace(20, 24, len(frame)).round(1)
    frame[["X", "Y", "Z"]] /= 10
    frame = frame.rename(columns={axis: f"{axis} [cm]" for axis in "XYZ"})
    frame.loc[[6, 11], [*"ABC", "X [cm]", "Y [cm]", "Z [cm]", "Temp_C"]] = np.nan
    frame.to_csv("m.csv", index=False)
    ran = invoked("init", "m.csv", "--robot", "ur10", "--yes")
    assert ran.exit_code == 0, ran.output
    assert '"Z [cm]" from cm to mm' in ran.stdout
    assert '"A B C" by the convention KUKA' in ran.stdout
    assert '"Temp_C" as temperature_C' in ran.stdout
    dry = invoked("study", "m", "--dry-run")
    assert (dry.exit_code, "ur10, 38 rows" in dry.stdout) == (0, True)


def test_what_is_shown_is_confirmed_before_anything_is_written(tmp_path) -> None:
    campaign().to_csv("m.csv", index=False)
    silent = invoked("init", "m.csv", "--robot", "ur10")
    assert (silent.exit_code, "--yes" in silent.stderr) == (2, True)
    assert '"J1" to "J6" in degrees' in silent.stdout
    assert silent.stderr.splitlines()[-1].startswith("modelsel: nothing was written")
    no = invoked("init", "m.csv", "--robot", "ur10", answers="n\n")
    assert (no.exit_code, "nothing was written" in no.stderr) == (2, True)
    assert not (tmp_path / "m").exists()
    assert invoked("init", "m.csv", "--robot", "ur10", answers="y\n").exit_code == 0
    again = invoked("init", "m.csv", "--robot", "ur10", "--yes")
    assert (again.exit_code, "already exists" in again.stderr) == (2, True)


@pytest.mark.parametrize(("unit", "factor"), [("rad", np.pi / 180), ("deg", 1.0)])
def test_the_arm_decides_between_units_that_both_fit(unit, factor) -> None:
    """Readings within 1.4 radians, or 1.4 degrees of an arm that hardly moves."""
    largest = 1.4 * np.pi / 180 / factor
    frame = campaign(largest=largest)
    frame.iloc[:, :6] *= factor
    frame.to_csv("m.csv", index=False)
    ran = invoked("init", "m.csv", "--robot", "ur10", "--yes", "--json")
    assert ran.exit_code == 0, ran.output
    told = json.loads(ran.stdout)
    assert told["columns"][f"q1_{unit}"] == "J1"
    assert "the nominal arm then fits to 0.0" in " ".join(told["said"])
    assert "Not sure" not in " ".join(told["said"])


def with_two_positions() -> None:
    """The controller's own position beside the tracker's."""
    frame = campaign()
    for axis in "XYZ":
        frame[f"TCP_{axis}"] = frame[axis] + 0.01
    frame.to_csv("m.csv", index=False)


def test_a_doubtful_reading_is_asked() -> None:
    with_two_positions()
    ran = invoked("init", "m.csv", "--robot", "ur10", "--json", answers="2\ny\n")
    # the test runner of older versions of click shows the answers before
    told = json.loads(ran.stdout.removeprefix(" 2\n y\n"))
    assert told["columns"]["x_mm"] == "TCP_X"
    assert '1: "X", "Y" and "Z" in mm' in ran.stderr


def test_a_doubtful_reading_is_refused_with_both_where_nobody_answers(tmp_path) -> None:
    with_two_positions()
    ran = invoked("init", "m.csv", "--robot", "ur10")
    assert ran.exit_code == 2
    assert '"X", "Y" and "Z" in mm; or "TCP_X", "TCP_Y" and "TCP_Z" in mm' in ran.stderr
    assert not (tmp_path / "m").exists()


def test_with_yes_the_first_is_taken_and_the_other_told() -> None:
    with_two_positions()
    ran = invoked("init", "m.csv", "--robot", "ur10", "--yes")
    assert 'Not sure: the position may also be "TCP_X", "TCP_Y" and "TCP_Z" in mm.' in ran.stdout
    assert "The nominal arm fits 2 positions of every row; one of them alone is used." in ran.stdout
    assert "write a row for each" in ran.stdout


def test_columns_that_the_user_says_go_first() -> None:
    frame = campaign().rename(columns={"X": "east", "Y": "north", "Z": "up"})
    frame.to_csv("m.csv", index=False)
    words = ("init", "m.csv", "--robot", "ur10", "--yes")
    refused = invoked(*words)
    assert refused.exit_code == 3
    assert "nothing looks like the position" in refused.stderr
    assert "--column x_mm=NAME" in refused.stderr
    said = [f"--column={a}_mm={b}" for a, b in zip("xyz", ("east", "north", "up"), strict=True)]
    assert invoked(*words, *said).exit_code == 0


def test_a_robot_file_and_a_sheet_go_into_the_folder(tmp_path) -> None:
    from importlib.resources import files

    text = files("modelsel").joinpath("robot", "catalogue", "ur10.toml").read_text()
    (tmp_path / "cell.toml").write_text(text)
    with pd.ExcelWriter("m.xlsx", engine="openpyxl") as book:
        campaign().to_excel(book, sheet_name="Mai", index=False)
        campaign().to_excel(book, sheet_name="Juni", index=False)
    words = ("init", "m.xlsx", "--robot", "cell.toml", "--yes", "--out", "new")
    refused = invoked(*words)
    assert (refused.exit_code, '"Mai", "Juni"' in refused.stderr) == (3, True)
    assert invoked(*words, "--sheet", "Juni").exit_code == 0
    assert {path.name for path in (tmp_path / "new").iterdir()} == {
        "cell.toml",
        "m.xlsx",
        "study.toml",
    }
    assert invoked("study", "new", "--dry-run").exit_code == 0


@pytest.mark.slow
def test_another_robot_is_told_by_its_misfit() -> None:
    campaign().to_csv("m.csv", index=False)
    ran = invoked("init", "m.csv", "--robot", "ur5", "--yes")
    assert ran.exit_code == 0
    assert "that is far." in ran.stdout
    assert 'The readings fit robot "ur10"' in ran.stdout
    assert "Next: find out why the nominal arm does not fit, then modelsel study m\n" in ran.stdout
    unknown = invoked("init", "m.csv", "--robot", "ur1", "--yes", "--out", "other")
    assert unknown.exit_code == 2
    assert 'unknown robot "ur1". Did you mean "ur10"' in unknown.stderr


@pytest.mark.parametrize("order", ["joints", "points"])
def test_without_a_header_the_arm_tells_the_order(order) -> None:
    frame = campaign()
    columns = list(frame.columns)
    columns = columns if order == "joints" else [*columns[6:], *columns[:6]]
    frame[columns].to_csv("m.csv", index=False, header=False)
    ran = invoked("init", "m.csv", "--robot", "ur10", "--yes")
    assert ran.exit_code == 0, ran.output
    first = "joint readings, then X, Y, Z" if order == "joints" else "X, Y, Z, then joint"
    assert f"Without a header: {first}" in ran.stdout
    assert invoked("study", "m", "--dry-run").exit_code == 0
    other = invoked("init", "m.csv", "--robot", "ur5", "--yes", "--out", "n")
    assert (other.exit_code, "there is no header" in other.stderr) == (3, True)
    fewer = invoked("init", "m.csv", "--robot", "fr3", "--yes", "--out", "n")
    assert (fewer.exit_code, "are not the readings of 7 joints" in fewer.stderr) == (3, True)


def test_other_units_are_converted_and_said() -> None:
    frame = campaign()
    frame.iloc[:, 6:] /= 25.4
    frame.iloc[:, :6] /= 0.9
    named = {f"J{k}": f"J{k} [gon]" for k in range(1, 7)} | {a: f"{a} (inch)" for a in "XYZ"}
    frame.rename(columns=named).to_csv("m.csv", index=False)
    ran = invoked("init", "m.csv", "--robot", "ur10", "--yes")
    assert ran.exit_code == 0, ran.output
    assert '"X (inch)", "Y (inch)" and "Z (inch)" in inches' in ran.stdout
    assert '"J6 [gon]" from gon to rad' in ran.stdout
    assert "the nominal arm fits to 0.0" in ran.stdout
    assert invoked("study", "m", "--dry-run").exit_code == 0


@pytest.mark.integration
@pytest.mark.parametrize(
    ("size", "words"), [(1.0, "degrees"), (1 / 0.9, "gon"), (np.pi / 180, "radians")]
)
@pytest.mark.parametrize("place", ["name", "row"])
def test_the_arm_tells_what_grad_is(size, words, place) -> None:
    frame = campaign()
    frame.iloc[:, :6] *= size
    if place == "name":
        frame = frame.rename(columns={f"J{k}": f"J{k} [Grad]" for k in range(1, 7)})
        frame.to_csv("m.csv", index=False)
    else:
        units = pd.DataFrame([["[Grad]"] * 6 + ["[mm]"] * 3], columns=frame.columns)
        pd.concat([units, frame]).to_csv("m.csv", index=False)
    ran = invoked("init", "m.csv", "--robot", "ur10", "--yes")
    assert ran.exit_code == 0, ran.output
    assert f' in {words} (their "Grad" ' in ran.stdout
    assert "the nominal arm then fits to 0.0" in ran.stdout
    assert "Not sure" not in ran.stdout
    assert invoked("study", "m", "--dry-run").exit_code == 0
    assert Path("m/measurements.csv").exists() == (words != "degrees")


@pytest.mark.slow
def test_grad_that_no_arm_tells_is_asked() -> None:
    frame = campaign()
    frame[["X", "Y", "Z"]] = frame[["X", "Y", "Z"]].to_numpy()[::-1]
    frame.rename(columns={f"J{k}": f"J{k} [Grad]" for k in range(1, 7)}).to_csv(
        "m.csv", index=False
    )
    silent = invoked("init", "m.csv", "--robot", "ur10")
    assert silent.exit_code == 2
    assert '"J1 [Grad]" to "J6 [Grad]" in degrees' in silent.stderr
    assert '"J1 [Grad]" to "J6 [Grad]" in gon' in silent.stderr
    assert not Path("m").exists()
    ran = invoked("init", "m.csv", "--robot", "ur10", "--yes")
    assert 'may also be "J1 [Grad]" to "J6 [Grad]" in gon' in ran.stdout


def test_a_named_column_is_converted_to_the_unit_that_is_wanted() -> None:
    """A hint that says --column leads to a command that is not refused."""
    frame = campaign()
    frame.iloc[:, :6] /= 0.9
    names = {f"J{k}": f"S{k} [gon]" for k in range(1, 7)}
    frame.rename(columns=names).to_csv("m.csv", index=False)
    refused = invoked("init", "m.csv", "--robot", "ur10", "--yes")
    assert refused.exit_code == 3
    assert '"S1 [gon]", "S2 [gon]"' in refused.stderr
    said = [word for k in range(1, 7) for word in ("--column", f"q{k}_deg=S{k} [gon]")]
    ran = invoked("init", "m.csv", "--robot", "ur10", "--yes", *said)
    assert ran.exit_code == 0, ran.output
    assert "the nominal arm fits to 0.0" in ran.stdout


def test_a_spoilt_cell_in_another_unit_is_told_under_its_own_name() -> None:
    """One cell that is no number leaves neither its column unconverted nor its name changed."""
    frame = campaign().astype(object)
    frame.iloc[:, :6] = (frame.iloc[:, :6].astype(float) / 0.9).astype(object)
    frame.loc[12, "J2"] = "?"
    units = pd.DataFrame([["gon"] * 6 + ["mm"] * 3], columns=frame.columns)
    pd.concat([units, frame]).to_csv("m.csv", index=False)
    ran = invoked("init", "m.csv", "--robot", "ur10", "--yes")
    assert ran.exit_code == 3
    assert 'line 15, column J2: expected a finite number, found "?"' in ran.stderr


def test_a_clock_is_the_time_and_commanded_positions_are_named() -> None:
    frame = campaign()
    frame["Uhrzeit"] = [f"{8 + k // 30:02d}:{k % 30 * 2:02d}:00" for k in range(len(frame))]
    frame["Prüfer"] = "Jörg"
    frame["Name"] = [f"P {k}" for k in range(len(frame))]
    frame["Soll X"] = frame["X"].round()
    frame.to_csv("m.csv", index=False)
    ran = invoked("init", "m.csv", "--robot", "ur10", "--yes")
    assert ran.exit_code == 0, ran.output
    assert '"Uhrzeit" as time_s (0 to 4680 s from the first row on)' in ran.stdout
    assert 'Commanded, not measured, and not used: "Soll X".' in ran.stdout
    assert 'Not used: "Prüfer".' in ran.stdout
    table = tomllib.loads(Path("m/study.toml").read_text(encoding="utf-8"))
    columns = table["measurements"]["columns"]
    assert columns["time_s"] == "Uhrzeit"
    data = read_measurements("m/m.csv", load_robot("ur10"), columns)
    assert data.covariates["time_s"][[0, 1, 30]].tolist() == [0.0, 120.0, 3600.0]


@pytest.mark.parametrize("days", ["04/0{}/2025", "0{}.04.2025", "2025-04-0{}"])
def test_a_date_of_its_own_goes_before_the_time(days) -> None:
    """US, German and ISO dates; two shots a day."""
    frame = campaign()
    frame["Date"] = [days.format(1 + k // 10) for k in range(len(frame))]
    frame["Time"] = [f"{8 + k % 10:02d}:00:00" for k in range(len(frame))]
    frame.to_csv("m.csv", index=False)
    ran = invoked("init", "m.csv", "--robot", "ur10", "--yes")
    assert f'"Time" with "Date" as time_s (0 to {3 * 86400 + 9 * 3600} s' in ran.stdout
    assert "Not used" not in ran.stdout
    study = tomllib.loads(Path("m/study.toml").read_text(encoding="utf-8"))
    data = read_measurements("m.csv", load_robot("ur10"), study["measurements"]["columns"])
    assert data.covariates["time_s"][[0, 1, 10]].tolist() == [0.0, 3600.0, 86400.0]
    assert "columns-ignored" not in {note.code for note in data.notes}


def test_a_clock_that_goes_back_is_no_time() -> None:
    frame = campaign()
    frame["Uhrzeit"] = [f"{(23 + k // 30) % 24:02d}:{k % 30 * 2:02d}" for k in range(len(frame))]
    frame.to_csv("m.csv", index=False)
    ran = invoked("init", "m.csv", "--robot", "ur10", "--yes")
    assert 'Not used: "Uhrzeit".' in ran.stdout


def test_a_seventh_reading_is_not_cut_off() -> None:
    frame = campaign()
    frame.insert(6, "J7", 0.0)
    frame.to_csv("m.csv", index=False)
    ran = invoked("init", "m.csv", "--robot", "ur10", "--yes")
    assert (ran.exit_code, "ur10 has 6 joints" in ran.stderr) == (3, True)


@pytest.mark.parametrize("title", ["", "Campaign of May\n"])
def test_a_header_alone_is_told(title, tmp_path) -> None:
    (tmp_path / "m.csv").write_text(f"{title}J1,J2,J3,J4,J5,J6,X,Y,Z\n")
    ran = invoked("init", "m.csv", "--robot", "ur10", "--yes")
    assert (ran.exit_code, "a header, but no rows" in ran.stderr) == (3, True)
    six = ",".join(f"q{j}_rad" for j in range(1, 7))
    (tmp_path / "m.csv").write_text(f"{title}{six},x_mm,y_mm,z_mm\n")
    for command in ("init", "check"):
        checked = invoked(command, "m.csv", "--robot", "ur10")
        assert checked.exit_code == 3
        assert checked.stderr == ran.stderr


def test_a_sheet_of_a_text_table_is_refused() -> None:
    campaign().to_csv("m.csv", index=False)
    ran = invoked("init", "m.csv", "--robot", "ur10", "--yes", "--sheet", "May")
    assert (ran.exit_code, "has no sheets" in ran.stderr) == (3, True)


# -- orientations
# --------------------------------------------------------------------------------------------


def poses(order: str, turned: bool = True) -> pd.DataFrame:
    """The campaign with the target's orientation in the tracker's frame (or, not `turned`, in the
    robot's own), as angles in degrees about the axes of `order`, intrinsic."""
    from scipy.spatial.transform import Rotation

    from modelsel.robot.kinematics import pose

    frame = campaign()
    q = np.radians(frame.iloc[:, :6].to_numpy())
    flange = pose(load_robot("ur10"), q, TOOL).axes[-1, :3].transpose(2, 1, 0)
    tracker = rotation_matrix(2, 0.7) if turned else np.eye(3)
    on_flange = Rotation.from_euler("XYZ", [20, 40, 70], degrees=True).as_matrix()
    seen = Rotation.from_matrix(tracker @ flange @ on_flange)
    values = np.degrees(seen.as_rotvec()) if order == "vector" else seen.as_euler(order, True)
    return frame.join(pd.DataFrame(values.round(5), columns=["1", "2", "3"]))


@pytest.mark.parametrize(
    ("order", "letters", "expected"),
    [
        ("ZYX", ["A", "B", "C"], {"kuka_a_deg": "A", "kuka_b_deg": "B", "kuka_c_deg": "C"}),
        ("ZYX", ["R", "P", "W"], {"fanuc_w_deg": "W", "fanuc_p_deg": "P", "fanuc_r_deg": "R"}),
        ("XYZ", ["Rx [°]", "Ry [°]", "Rz [°]"], {"staubli_rx_deg": "Rx [°]"}),
        ("ZYX", ["Rz", "Ry", "Rx"], {"yaskawa_rx_deg": "Rx", "yaskawa_rz_deg": "Rz"}),
        ("vector", ["Rx", "Ry", "Rz"], {"ur_rx_deg": "Rx", "ur_rz_deg": "Rz"}),
        ("ZYX", ["C", "B", "A"], {"roll_deg": "A", "pitch_deg": "B", "yaw_deg": "C"}),
    ],
)
def test_the_arm_tells_the_convention(order, letters, expected) -> None:
    named = dict(zip("123", letters, strict=True))
    poses(order).rename(columns=named).to_csv("m.csv", index=False)
    ran = invoked("init", "m.csv", "--robot", "ur10", "--yes", "--json")
    assert ran.exit_code == 0, ran.output
    told = json.loads(ran.stdout)
    assert expected.items() <= told["columns"].items()
    assert "from the nominal arm's" in " ".join(told["said"])
    assert invoked("study", "m", "--dry-run").exit_code == 0


@pytest.mark.parametrize("name", ["pose.orientation.{}", "quat_{}", "Q{} [actual]"])
@pytest.mark.parametrize("turned", [True, False])
def test_the_quaternion_of_a_pose_is_the_orientation(turned, name) -> None:
    """As ROS calls it, x before w; it is no position, and no cause where it is the controller's."""
    from scipy.spatial.transform import Rotation

    frame = poses("vector", turned)
    angles = np.radians(frame[["1", "2", "3"]].to_numpy())
    names = [name.format(letter) for letter in "xyzw"]
    turns = pd.DataFrame(Rotation.from_rotvec(angles).as_quat().round(7), columns=names)
    frame = frame.drop(columns=["1", "2", "3"]).join(turns)
    frame.rename(columns={axis: f"pose.position.{axis}" for axis in "XYZ"}).to_csv("m.csv")
    ran = invoked("init", "m.csv", "--robot", "ur10", "--yes", "--json")
    assert ran.exit_code == 0, ran.output
    told = json.loads(ran.stdout)
    mapped = dict(zip(("qx", "qy", "qz", "qw"), names, strict=True))
    assert (mapped.items() <= told["columns"].items()) == turned
    said = " ".join(told["said"])
    assert said.count("The orientation: ") == turned
    assert "possible causes" not in said
    assert invoked("study", "m", "--dry-run").exit_code == 0


@pytest.mark.parametrize("names", ["A B C", "Winkel_A Winkel_B Winkel_C"])
def test_the_angle_c_with_degrees_below_it_is_no_temperature(names, tmp_path) -> None:
    """KUKA's A B C with a row of units of degree signs, through init and study."""
    named = dict(zip("123", names.split(), strict=True))
    frame = poses("ZYX").rename(columns=named)
    frame["Temp_C"] = np.linspace(20, 24, len(frame)).round(1)
    header, *lines = frame.to_csv(sep=";", decimal=",", index=False).splitlines()
    units = ";".join(["°"] * 6 + ["mm"] * 3 + ["°"] * 3 + ["°C"])
    text = "\r\n".join([header, units, *lines])
    (tmp_path / "m.csv").write_bytes(text.encode("cp1252"))
    ran = invoked("init", "m.csv", "--robot", "ur10", "--yes", "--json")
    assert ran.exit_code == 0, ran.output
    columns = json.loads(ran.stdout)["columns"]
    assert columns["kuka_c_deg"] == names.split()[2]
    assert columns["temperature_C"] == "Temp_C"
    assert invoked("study", "m", "--dry-run").exit_code == 0
    mapped = [f"--column={name}={given}" for name, given in columns.items()]
    assert invoked("check", "m.csv", "--robot", "ur10", *mapped).exit_code == 0


def test_inverted_orientations_are_said() -> None:
    from scipy.spatial.transform import Rotation

    frame = poses("ZYX")
    turned = Rotation.from_euler("ZYX", frame[["1", "2", "3"]].to_numpy(), degrees=True)
    frame[["Yaw", "Pitch", "Roll"]] = turned.inv().as_euler("ZYX", degrees=True)
    frame.drop(columns=["1", "2", "3"]).to_csv("m.csv", index=False)
    ran = invoked("init", "m.csv", "--robot", "ur10", "--yes")
    assert "they are the nominal arm's inverted" in ran.stdout
    assert "possible causes" not in ran.stdout


def test_a_controllers_own_orientation_is_left_out_and_said() -> None:
    """In the robot's base frame beside a tracker's positions: it follows by no convention."""
    named = dict(zip("123", "ABC", strict=True))
    poses("ZYX", turned=False).rename(columns=named).to_csv("m.csv", index=False)
    ran = invoked("init", "m.csv", "--robot", "ur10", "--yes")
    assert 'Orientations are left out: read as "A B C"' in ran.stdout
    assert "kuka" not in (ran.stdout.split("Written")[1])


def test_positions_that_no_instrument_gives_are_told() -> None:
    """A log with the controller's own X Y Z: computed, not measured."""
    frame = campaign()
    q = np.radians(frame.iloc[:, :6].to_numpy())
    from modelsel.robot.kinematics import forward

    frame[["X", "Y", "Z"]] = forward(load_robot("ur10"), q, TOOL).round(4)
    frame.to_csv("m.csv", index=False)
    ran = invoked("init", "m.csv", "--robot", "ur10", "--yes")
    assert "These positions look computed" in ran.stdout


@pytest.mark.slow
def test_numbers_that_are_far_off_are_explained() -> None:
    """As the set-up check of a study would: another unit, another built-in robot."""
    frame = campaign()
    frame[["X", "Y", "Z"]] /= 25.4
    frame.to_csv("m.csv", index=False)
    ran = invoked("init", "m.csv", "--robot", "ur10", "--yes")
    assert ran.exit_code == 0, ran.output
    assert "that is far." in ran.stdout
    assert re.search(
        r"The positions fit ([\d,]+ times|far) better .* if the positions are inches", ran.stdout
    )
    campaign().to_csv("n.csv", index=False)
    other = invoked("init", "n.csv", "--robot", "ur5", "--yes")
    assert re.search(
        r'The readings fit robot "ur10" ([\d,]+ times|far) better than "ur5"', other.stdout
    )


SAID = {"inches": ("[inch]", 25.4), "m": ("[m]", 1e3)}


@pytest.mark.parametrize("unit", SAID)
@pytest.mark.parametrize("by", ["name", "comment"])
def test_a_unit_that_contradicts_the_numbers_is_told_with_both_readings(unit, by) -> None:
    """Millimetres under a name, or below a comment, that says more: no arm reaches so far."""
    frame = campaign()
    mark, size = SAID[unit]
    text = frame.to_csv(index=False)
    if by == "name":
        text = frame.rename(columns={axis: f"{axis} {mark}" for axis in "XYZ"}).to_csv(index=False)
    else:
        text = f"// Units: {unit}\n{text}"
    Path("m.csv").write_text(text)
    ran = invoked("init", "m.csv", "--robot", "ur10", "--yes", "--out", "s")
    assert ran.exit_code == 3
    (sentence,) = ran.stderr.splitlines()
    assert f"the file says {unit} of " in sentence
    points = frame[["X", "Y", "Z"]].to_numpy()
    spread = np.median(np.linalg.norm(points - np.median(points, axis=0), axis=1))
    assert f"lie more than {spread * size:,.0f} mm from their middle" in sentence
    assert f"read as mm it is {spread:,.0f} mm" in sentence
    assert not Path("s").exists()


@pytest.mark.slow
@pytest.mark.parametrize(
    ("mark", "size", "said"),
    [("[cm]", 1.0, "millimetres and not centimetres"), ("[mm]", 1 / 25.4, "are inches")],
)
def test_a_unit_that_the_arm_contradicts_is_told_by_init_and_study(mark, size, said) -> None:
    frame = campaign()
    frame[["X", "Y", "Z"]] *= size
    frame.rename(columns={axis: f"{axis} {mark}" for axis in "XYZ"}).to_csv("m.csv", index=False)
    ran = invoked("init", "m.csv", "--robot", "ur10", "--yes", "--out", "s")
    assert ran.exit_code == 0, ran.output
    assert said in ran.stdout
    refused = invoked("study", "s")
    assert refused.exit_code == 3
    assert said in refused.stderr


def test_a_wide_campaign_in_its_unit_is_read() -> None:
    """Of two stations of the tracker, each in its own frame; and in metres and inches."""
    frame = campaign()
    frame.loc[20:, ["X", "Y", "Z"]] += 40_000
    frame["group"] = [1] * 20 + [2] * 20
    names = {f"J{k}": f"q{k}_deg" for k in range(1, 7)}
    robot = load_robot("ur10")
    for unit, size in (("mm", 1.0), ("m", 1e-3), ("in", 1 / 25.4)):
        table = frame.rename(columns=names | {a: f"{a.lower()}_{unit}" for a in "XYZ"})
        table[[f"{a}_{unit}" for a in "xyz"]] *= size
        data = read_measurements(table, robot)
        np.testing.assert_allclose(data.position, frame[["X", "Y", "Z"]], atol=1e-9)


@pytest.mark.slow
def test_targets_and_pool_have_the_names_of_the_study() -> None:
    """J1 to J6 with decimal commas: as under the contract's names, in degrees, to the last digit."""
    frame = campaign()
    frame.to_csv("m.csv", sep=";", decimal=",", index=False)
    assert invoked("init", "m.csv", "--robot", "ur10", "--yes", "--out", "s").exit_code == 0
    study = Path("s/study.toml")
    study.write_text(study.read_text() + '\n[model]\ncandidates = ["encoder-scale"]\n')
    assert invoked("study", "s", "--no-sampling", "--no-report", "--quiet").exit_code == 0
    joints = {f"J{k}": f"q{k}_deg" for k in range(1, 7)}
    wanted = {axis: f"{axis.lower()}_mm" for axis in "XYZ"}
    corrected = []
    for names in ([*joints], [*joints, *wanted]):
        own = frame[names].head(5)
        own.to_csv("own.csv", sep=";", decimal=",", index=False)
        own.rename(columns=joints | wanted).to_csv("plain.csv", index=False)
        both = []
        for file in ("own.csv", "plain.csv"):
            ran = invoked(
                "compensate", "reports/s", file, "--out", "out.csv", "--bound", "900", "900"
            )
            assert ran.exit_code == 0, ran.output
            form = {"sep": ";", "decimal": ","} if file == "own.csv" else {}
            both.append(pd.read_csv("out.csv", **form).rename(columns=joints | wanted))
        pd.testing.assert_frame_equal(*both)
        assert list(both[0])[:6] == [*joints.values()]
        corrected.append(both[0])
    assert not np.allclose(corrected[0]["q1_deg"], corrected[1]["q1_deg"], atol=1e-9)
    calibration = load_result("reports/s").calibration
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        table = calibration.correct(frame[[*joints]].head(5))
    np.testing.assert_allclose(table["q1_deg"], corrected[0]["q1_deg"], atol=1e-8)
    own = frame[[*joints]].head(20)
    own.to_csv("own.csv", sep=";", decimal=",", index=False)
    planned = invoked("plan", "s", "--pool", "own.csv", "--count", "3")
    assert planned.exit_code == 0, planned.output


@pytest.mark.slow
def test_a_file_of_the_form_of_the_study_goes_into_check_and_validate() -> None:
    """The calibration knows the columns and the decimal comma; nothing is mapped by hand."""
    frame = campaign()
    frame.to_csv("m.csv", sep=";", decimal=",", index=False)
    assert invoked("init", "m.csv", "--robot", "ur10", "--yes", "--out", "s").exit_code == 0
    checked = invoked("check", "s")
    assert checked.exit_code == 0, checked.output
    assert "40 rows, 40 configurations" in checked.stdout
    assert invoked("check", "s", "--robot", "ur10").exit_code == 2
    assert invoked("check", "m.csv").exit_code == 2
    study = Path("s/study.toml")
    study.write_text(study.read_text() + '\n[model]\ncandidates = ["encoder-scale"]\n')
    ran = invoked("study", "s", "--no-sampling", "--no-report", "--quiet", "--out", "r")
    assert ran.exit_code == 0, ran.output
    stored = json.loads(Path("r/calibration.json").read_text())["file_form"]
    assert stored["columns"]["x_mm"] == "X"
    again = invoked("validate", "r", "m.csv", "--json")
    assert again.exit_code == 0, again.output
    assert json.loads(again.stdout)["rows"] == 40
    plain = frame.rename(columns={f"J{k}": f"q{k}_deg" for k in range(1, 7)})
    plain.rename(columns={a: f"{a.lower()}_mm" for a in "XYZ"}).to_csv("plain.csv", index=False)
    assert invoked("validate", "r", "plain.csv").exit_code == 0
    (Path("s")).rename("cell")
    Path("reports").mkdir()
    Path("r").rename("reports/cell")
    same = invoked("compare", "cell", "reports/cell")
    assert same.exit_code == 0, same.output
    planned = invoked("plan", "reports/cell", "--count", "3")
    assert planned.exit_code == 0, planned.output
    Path("cell").rename("elsewhere")
    lost = invoked("plan", "reports/cell")
    assert lost.exit_code == 2
    assert "the folder of its study, with study.toml, was expected" in lost.stderr
    other = invoked("compare", "elsewhere", "reports/cell")
    assert other.exit_code == 2
    assert "its report's folder was expected" in other.stderr


UNITS = [
    ("Temp (F)", "temperature_C", "68 to 77 °F", np.linspace(68, 77, 40), (20.0, 25.0)),
    ("T [K]", "temperature_C", "293.1 to 298.1 K", np.linspace(293.15, 298.15, 40), (20.0, 25.0)),
    ("Time [min]", "time_s", "0 to 78 min", np.arange(40) * 2.0, (0.0, 4680.0)),
    ("time_ms", "time_s", "0 to 3.9e+04 ms", np.arange(40) * 1000, (0.0, 39.0)),
    ("t [h]", "time_s", "0 to 3.9 h", np.arange(40) / 10, (0.0, 14040.0)),
]


@pytest.mark.parametrize(("name", "wanted", "said", "values", "ends"), UNITS)
def test_temperatures_and_times_in_other_units_are_converted(
    name, wanted, said, values, ends
) -> None:
    frame = campaign()
    frame[name] = values
    frame.to_csv("m.csv", index=False)
    ran = invoked("init", "m.csv", "--robot", "ur10", "--yes")
    assert ran.exit_code == 0, ran.output
    assert f'Also: "{name}" as {wanted} ({said}).' in ran.stdout
    assert f'Converted: "{name}" from ' in ran.stdout
    assert "Not used" not in ran.stdout
    data = read_measurements("m.csv", load_robot("ur10"), _columns())
    np.testing.assert_allclose(data.covariates[wanted][[0, -1]], ends, atol=1e-9)


@pytest.mark.parametrize(("name", "size"), [("timestamp", 1), ("Time", 1), ("timestamp_ms", 1000)])
def test_seconds_since_1970_are_the_time(name, size) -> None:
    frame = campaign()
    frame[name] = (1741773000 + 30 * np.arange(40)) * size
    frame.to_csv("m.csv", index=False)
    ran = invoked("init", "m.csv", "--robot", "ur10", "--yes")
    assert f'Also: "{name}" as time_s (0 to 1170 s from the first row on).' in ran.stdout
    assert "possible causes" not in ran.stdout


def _columns(folder: str = "m") -> dict[str, str]:
    text = Path(folder, "study.toml").read_text(encoding="utf-8")
    return tomllib.loads(text)["measurements"]["columns"]


@pytest.mark.parametrize("unit", ["µm", "mm", "", "U95"])
def test_uncertainties_are_mapped_where_their_unit_is_said(unit) -> None:
    frame = campaign()
    size = 30.0 if unit == "µm" else 0.03
    names = [f"U95 {axis} [mm]" if unit == "U95" else f"s{axis} [{unit}]" for axis in "XYZ"]
    if not unit:
        names = ["sX", "sY", "sZ"]
    frame[names] = size * np.random.default_rng(4).uniform(1, 1.1, (40, 3))
    frame.to_csv("m.csv", index=False)
    ran = invoked("init", "m.csv", "--robot", "ur10", "--yes")
    assert "possible causes" not in ran.stdout
    data = read_measurements("m.csv", load_robot("ur10"), _columns())
    if unit in ("µm", "mm"):
        assert f'Also: "{" ".join(names)}" as sx_mm sy_mm sz_mm.' in ran.stdout
        np.testing.assert_allclose(data.sigma, 0.0315, rtol=0.1)
        return
    assert data.sigma is None
    quoted = ", ".join(f'"{name}"' for name in names)
    assert f"are ignored: {quoted}. Map one standard deviation in mm" in ran.stdout


def write_quaternions(columns: list[str]) -> None:
    """Write poses into m.csv, x, y, z and w of their quaternions under some names."""
    from scipy.spatial.transform import Rotation

    frame = poses("ZYX")
    turned = Rotation.from_euler("ZYX", frame[["1", "2", "3"]].to_numpy(), degrees=True)
    frame[columns] = turned.as_quat()
    frame.drop(columns=["1", "2", "3"]).to_csv("m.csv", index=False)


def test_uncertainties_of_spatial_analyzer_are_offered() -> None:
    """Of Ux Uy Uz it is not said how many deviations they are: they are no causes, and offered."""
    frame = campaign()
    names = ["Ux", "Uy", "Uz", "RMS"]
    frame[names] = np.random.default_rng(743).uniform(0.02, 0.03, (40, 4)).round(4)
    frame.to_csv("m.csv", index=False)
    ran = invoked("init", "m.csv", "--robot", "ur10", "--yes")
    assert "possible causes" not in ran.stdout
    options = ["--column", "sx_mm=Ux", "--column", "sy_mm=Uy", "--column", "sz_mm=Uz"]
    assert f"are standard deviations in mm: {' '.join(options)}." in ran.stdout
    ran = invoked("init", "m.csv", "--robot", "ur10", "--yes", "--out", "s", *options)
    assert ran.exit_code == 0, ran.output
    assert "standard deviations" not in ran.stdout
    data = read_measurements("s/m.csv", load_robot("ur10"), _columns("s"))
    np.testing.assert_allclose(data.sigma, frame[names[:3]])


def test_of_two_kinds_of_uncertainties_none_is_offered() -> None:
    """It ended in an internal error."""
    frame = campaign()
    names = ["Ux", "Uy", "Uz", "U95 X", "U95 Y", "U95 Z"]
    frame[names] = np.random.default_rng(760).uniform(0.02, 0.03, (40, 6)).round(4)
    frame.to_csv("m.csv", index=False)
    ran = invoked("init", "m.csv", "--robot", "ur10", "--yes")
    assert ran.exit_code == 0, ran.output
    assert "standard deviations" not in ran.stdout
    assert "possible causes" not in ran.stdout


def test_a_timestamp_beside_another_tools_target_is_no_clock_in_seconds() -> None:
    """It was read as one of Universal Robots, whatever column began with their word."""
    frame = campaign()
    frame["target_speed"] = 0.25
    frame["timestamp"] = 1000 * np.arange(len(frame))
    frame.to_csv("m.csv", index=False)
    ran = invoked("init", "m.csv", "--robot", "ur10", "--yes")
    assert ran.exit_code == 0, ran.output
    assert "as time_s" not in ran.stdout


def test_the_clock_of_a_ur_is_the_time() -> None:
    frame = campaign()
    seconds = 80 + np.random.default_rng(781).uniform(5, 20, 40).cumsum().round(3)
    frame.columns = [*(f"actual_q_{k}" for k in range(6)), "X", "Y", "Z"]
    frame.assign(timestamp=seconds).to_csv("m.csv", index=False)
    ran = invoked("init", "m.csv", "--robot", "ur10", "--yes")
    assert 'Also: "timestamp" as time_s (' in ran.stdout
    assert "possible causes" not in ran.stdout
    frame.assign(stamp=seconds).to_csv("other.csv", index=False)
    ran = invoked("init", "other.csv", "--robot", "ur10", "--yes")
    assert 'If "stamp" is a time in seconds: --column time_s=stamp.' in ran.stdout


@pytest.mark.parametrize("rows", [6, 1])
def test_too_few_configurations_are_said_instead_of_the_next_command(rows) -> None:
    frame = campaign().head(rows)
    pd.concat([frame] * 3).to_csv("m.csv", index=False)
    ran = invoked("init", "m.csv", "--robot", "ur10", "--yes")
    assert ran.exit_code == 0, ran.output
    assert "modelsel study m refuses these measurements as they are: " in ran.stdout
    assert "Next: " not in ran.stdout
    refused = invoked("study", "m", "--no-report")
    assert refused.exit_code == 4
    ran = invoked("init", "m.csv", "--robot", "ur10", "--yes", "--out", "s", "--json")
    said = json.loads(ran.stdout)["refused"]
    assert said in " ".join(refused.stderr.split())
    campaign(20).to_csv("enough.csv", index=False)
    ran = invoked("init", "enough.csv", "--robot", "ur10", "--yes")
    assert "Next: modelsel study enough" in ran.stdout


def test_a_rigid_body_of_motion_capture_has_its_quaternion() -> None:
    """OptiTrack's two rows of headers: Rotation over X Y Z W, Position over X Y Z; and what the
    body's markers leave, the same in every row, names no target."""
    from scipy.spatial.transform import Rotation

    frame = poses("vector")
    turned = Rotation.from_rotvec(np.radians(frame[["1", "2", "3"]].to_numpy())).as_quat()
    table = np.column_stack([turned, frame[["X", "Y", "Z"]], np.full(40, 0.0003)]).round(7)
    above = ["", "", *["Rotation"] * 4, *["Position"] * 3, "Mean Marker Error"]
    names = ["Frame", "Time (Seconds)", *"XYZW", *"XYZ", ""]
    lines = ["Format Version,1.23,Rotation Type,Quaternion", ",".join(above), ",".join(names)]
    lines += [",".join(map(str, [600 * k, 5.0 * k, *row])) for k, row in enumerate(table)]
    Path("m.csv").write_text("\n".join(lines) + "\n")
    readings = frame.iloc[:, :6].assign(time_s=5.0 * np.arange(40))
    readings.to_csv("log.csv", index=False)
    files = ("m.csv", "--joints", "log.csv")
    ran = invoked("init", *files, "--robot", "ur10", "--yes", "--json")
    assert ran.exit_code == 0, ran.output
    told = json.loads(ran.stdout)
    expected = {f"q{letter.lower()}": f"Rotation {letter}" for letter in "XYZW"}
    assert expected.items() <= told["columns"].items()
    assert told["columns"]["x_mm"] == "Position X"
    assert "target" not in told["columns"]
    assert 'errors, are ignored: "Mean Marker Error".' in " ".join(told["said"])


def test_quaternions_that_are_used_are_said() -> None:
    write_quaternions(["qx", "qy", "qz", "qw"])
    ran = invoked("init", "m.csv", "--robot", "ur10", "--yes")
    assert "The orientation: qw qx qy qz, unit quaternions" in ran.stdout


def test_quaternions_in_another_order_are_told() -> None:
    """As `study` tells it; the columns qw qx qy qz hold x, y, z, w."""
    write_quaternions(["qw", "qx", "qy", "qz"])
    ran = invoked("init", "m.csv", "--robot", "ur10", "--yes")
    assert "(qw qx qy qz hold x, y, z, w): rename these columns to qx qy qz qw." in ran.stdout


@pytest.mark.parametrize("w", [0, 3])
@pytest.mark.parametrize("first", [0, 1])
def test_numbered_quaternions_are_read_as_the_arm_tells(first, w) -> None:
    """w is the first or the last of q0 to q3, or of ABB's q1 to q4."""
    from scipy.spatial.transform import Rotation

    frame = poses("ZYX")
    turned = Rotation.from_euler("ZYX", frame[["1", "2", "3"]].to_numpy(), degrees=True)
    xyzw = turned.as_quat()
    names = [f"q{first + k}" for k in range(4)]
    frame[names] = np.roll(xyzw, 1, axis=1) if w == 0 else xyzw
    frame.drop(columns=["1", "2", "3"]).to_csv("m.csv", index=False)
    ran = invoked("init", "m.csv", "--robot", "ur10", "--yes", "--json")
    assert ran.exit_code == 0, ran.output
    mapped = json.loads(ran.stdout)["columns"]
    wanted = ("qw", "qx", "qy", "qz") if w == 0 else ("qx", "qy", "qz", "qw")
    assert dict(zip(wanted, names, strict=True)).items() <= mapped.items()


OTHER_COLUMNS = {
    "X1 Y1 Z1 X2 Y2 Z2": "every row has 2 positions (X1 Y1 Z1, X2 Y2 Z2). Write a row for each",
    "Range Az El": '"Range", "Az", "El" look like an instrument\'s distance and angles',
    "X_mm Y_cm Z_m": 'the columns of the position have several units: "X_mm", "Y_cm", "Z_m".',
}


@pytest.mark.parametrize("names", OTHER_COLUMNS)
def test_what_stands_in_place_of_a_position_is_said(names) -> None:
    frame = campaign().drop(columns=["X", "Y", "Z"])
    for k, name in enumerate(names.split()):
        frame[name] = np.random.default_rng(k).uniform(0, 900, len(frame))
    frame.to_csv("m.csv", index=False)
    ran = invoked("init", "m.csv", "--robot", "ur10", "--yes")
    assert ran.exit_code == 3
    assert OTHER_COLUMNS[names] in ran.stderr


SPOILT = {
    "{}°": 'found "1.5°" (40 such cells). Write the number alone: 1.5. Its unit',
    "{} deg": "Write the number alone: 1.5.",
    "({})": "Write a minus before a negative number: -1.5.",
    "{}-": "Write a minus before a negative number: -1.5.",
    "{}D+00": "Write the exponent with an E: 1.5E+00.",
    "12°30'{}": "Write the angles in decimal degrees.",
    "oops": 'found "oops" (40 such cells). Correct the cell',
}


@pytest.mark.parametrize("written", SPOILT)
def test_cells_that_are_no_numbers_are_told_where_the_names_are_right(written) -> None:
    """Of joints and of coordinates; by `init`, and by a command that only reads the file."""
    for first in ("J1", "X"):
        frame = campaign()
        columns = [name for name in frame if (name[0] == "J") == (first == "J1")]
        frame[columns] = frame[columns].astype(object)
        frame.loc[:, columns] = written.format(1.5)
        frame.to_csv("m.csv", index=False)
        for words in (("init", "m.csv", "--yes"), ("check", "m.csv")):
            ran = invoked(*words, "--robot", "ur10")
            assert ran.exit_code == 3
            assert f"m.csv, line 2, column {first}: expected a finite number" in ran.stderr
            assert SPOILT[written] in ran.stderr


def test_a_sliding_joint_is_asked_for_in_mm() -> None:
    frame = campaign().rename(columns={f"J{k}": f"axle{k}" for k in range(1, 7)})
    frame.to_csv("m.csv", index=False)
    joints = ['kind = "prismatic"', *[""] * 5]
    robot = "".join(
        f"[[joint]]\nxyz_mm = [100, 0, 0]\naxis = [0, 0, 1]\n{kind}\n" for kind in joints
    )
    Path("arm.toml").write_text(f'name = "gantry"\nsource = "a test"\n{robot}')
    ran = invoked("init", "m.csv", "--robot", "arm.toml", "--yes")
    assert ran.exit_code == 3
    assert "--column q1_mm=NAME, and so on (q1_mm and q2_deg to q6_deg)" in ran.stderr


def test_why_the_nominal_arm_is_not_tried() -> None:
    frame = campaign()
    frame.iloc[:, :5] = frame.iloc[0, :5].to_numpy()
    frame.to_csv("m.csv", index=False)
    ran = invoked("init", "m.csv", "--robot", "ur10", "--yes")
    assert "on these configurations: only joint 6 moves, which does not tell where" in ran.stdout
    campaign(8).to_csv("n.csv", index=False)
    ran = invoked("init", "n.csv", "--robot", "ur10", "--yes")
    assert "Too few configurations to try the nominal arm on." in ran.stdout


def test_converted_columns_keep_their_names_in_sentences() -> None:
    frame = campaign()
    frame[["X", "Y", "Z"]] /= 10
    frame.rename(columns={axis: f"{axis}_cm" for axis in "XYZ"}).to_csv("m.csv", index=False)
    ran = invoked("init", "m.csv", "--robot", "ur10", "--yes")
    assert 'The position: "X_cm", "Y_cm" and "Z_cm" in mm, converted.' in ran.stdout
    ran = invoked("check", "m.csv", "--robot", "ur10")
    assert 'The position looks like "X_cm", "Y_cm" and "Z_cm" in mm, converted.' in ran.stderr
    assert "--column z_mm=Z_cm)" in ran.stderr
    mapped = [f"--column=q{k}_deg=J{k}" for k in range(1, 7)]
    mapped += [f"--column={axis.lower()}_mm={axis}_cm" for axis in "XYZ"]
    assert invoked("check", "m.csv", "--robot", "ur10", *mapped).exit_code == 0


def test_folders_that_are_named_like_files(tmp_path) -> None:
    campaign().to_csv("data", index=False)
    campaign().to_csv("-x.csv", index=False)
    ran = invoked("init", "data", "--robot", "ur10", "--yes")
    assert ran.exit_code == 2
    assert "data: the study's folder would have this name, which is a file's." in ran.stderr
    ran = invoked("init", "./-x.csv", "--robot", "ur10", "--yes")
    assert ran.stdout.splitlines()[-1] == "Next: modelsel study ./-x"
    assert (tmp_path / "-x" / "study.toml").is_file()


@pytest.mark.parametrize("value", [0, -999])
def test_one_number_for_all_coordinates_is_told(value) -> None:
    frame = campaign()
    frame.loc[[4, 9], ["X", "Y", "Z"]] = value
    frame.to_csv("m.csv", index=False)
    ran = invoked("init", "m.csv", "--robot", "ur10", "--yes")
    said = f"Lines 6, 11 have one number for x, y and z ({value}): no position, if"
    assert said in ran.stdout
    assert f"Note: {said}" in invoked("check", "m").stdout


PROGRAMS = {
    "p.mod": (
        "MODULE Poses\n  CONST jointtarget p1:=[[1,2,3,4,5,6]];\nENDMODULE\n",
        "a RAPID program",
    ),
    "p.dat": ("&ACCESS RVP\nDEFDAT POSES\nDECL E6AXIS XP1={A1 1,A2 2}\n", "a KRL program"),
    "p.txt": ("; taught\nXP1={A1 1.0,A2 2.0,A3 3,A4 4,A5 5,A6 6}\n", "a list of KRL positions"),
    "p2.txt": ("DECL E6POS XP1={X 1.0,Y 2.0,Z 3,A 4,B 5,C 6}\n", "a list of KRL positions"),
    "p3.txt": ("CONST jointtarget p1:=[[1,2,3,4,5,6]];\n", "a list of RAPID targets"),
    "p.ls": ("/PROG  PICK\n/ATTR\n", "a TP program of Fanuc"),
    "p.script": ("def pick():\n  movej([0,0,0,0,0,0])\nend\n", "a program of Universal Robots"),
}


@pytest.mark.parametrize("name", PROGRAMS)
def test_a_robots_program_is_named(name) -> None:
    text, what = PROGRAMS[name]
    campaign().to_csv("m.csv", index=False)
    Path(name).write_text(text)
    ran = invoked("init", "m.csv", "--joints", name, "--robot", "ur10", "--yes")
    assert ran.exit_code == 3
    assert f"{name}: this is {what}; programs are not read. Give a table" in ran.stderr


@pytest.mark.parametrize(
    ("name", "text", "says"),
    [
        (
            "~$m.xlsx",
            "\5Me" + 9 * " \0",
            "Excel's lock file of a workbook that is open, without its",
        ),
        (".~lock.m.xlsx#", ",me,pc,today;", "this is LibreOffice's lock file of a workbook"),
        ("t.xlsx", "J1;J2\n1;2\n", "this is text, not a workbook, though its name ends in .xlsx"),
        (
            "t.xls",
            "J1\tJ2\n1\t2\n",
            "though its name ends in .xls. Give it an ending of text: .csv",
        ),
    ],
)
def test_what_is_no_workbook_is_told(name, text, says) -> None:
    Path(name).write_text(text)
    ran = invoked("init", name, "--robot", "ur10", "--yes")
    assert ran.exit_code == 3
    assert f"{name}: this is " in ran.stderr
    assert says in ran.stderr
    if "~" in name:
        assert "Give m.xlsx." in ran.stderr


@pytest.mark.parametrize("line", [2, 20])
def test_an_open_quotation_mark_is_told(line) -> None:
    """Else every row after it is one cell, and lost."""
    lines = campaign().assign(day="day 1").to_csv(index=False).splitlines()
    lines[line - 1] = f'"{lines[line - 1]}'
    Path("m.csv").write_text("\n".join(lines))
    ran = invoked("init", "m.csv", "--robot", "ur10", "--yes")
    assert ran.exit_code == 3
    assert f"m.csv, line {line}: an open quotation mark" in ran.stderr


def test_a_link_to_nowhere_is_told() -> None:
    campaign().to_csv("m.csv", index=False)
    Path("link").symlink_to("nowhere")
    ran = invoked("init", "m.csv", "--robot", "ur10", "--yes", "--out", "link")
    assert ran.exit_code == 2
    assert "link: a link to a folder that is not there." in ran.stderr


def test_a_single_column_in_celsius_is_the_temperature() -> None:
    frame = campaign()
    frame["Luft"] = np.linspace(20, 24, len(frame)).round(1)
    units = pd.DataFrame([["°"] * 6 + ["mm"] * 3 + ["°C"]], columns=frame.columns)
    pd.concat([units, frame]).to_csv("m.csv", index=False)
    ran = invoked("init", "m.csv", "--robot", "ur10", "--yes")
    assert '"Luft" as temperature_C (20 to 24)' in ran.stdout


@pytest.mark.parametrize(
    ("frame", "says"),
    [
        (
            pd.DataFrame({"joints": ["[0.1, -1.2, 3e-3]"] * 3, "xyz": ["(1.0, 2.0, 3.0)"] * 3}),
            'the cells of columns "joints" and "xyz" hold several numbers each',
        ),
        (
            pd.DataFrame({"": ["J1", "J2", "X"], **{str(k): [1.5, 2.5, 3.5] for k in range(20)}}),
            'the names stand in the first column ("J1", "J2", "X" …)',
        ),
    ],
)
def test_tables_that_are_laid_out_otherwise_are_told(frame, says) -> None:
    has_names = "" not in frame
    frame.to_csv("m.csv", index=False, header=has_names)
    ran = invoked("init", "m.csv", "--robot", "ur10", "--yes")
    assert ran.exit_code == 3
    assert says in ran.stderr


def test_rows_that_stand_there_twice_are_told() -> None:
    frame = campaign()
    pd.concat([frame, frame.iloc[:2]]).to_csv("m.csv", index=False)
    ran = invoked("init", "m.csv", "--robot", "ur10", "--yes")
    assert "2 rows repeat an earlier row cell for cell and are counted once." in ran.stdout


@pytest.mark.parametrize("count", [5, 7])
def test_other_numbers_of_joints_are_told(count) -> None:
    frame = campaign().rename(columns={f"J{j}": f"q{j - 1}" for j in range(1, 7)})
    if count == 5:
        frame = frame.drop(columns="q5")
    else:
        frame.insert(6, "q6", 0.0)
    frame.to_csv("m.csv", index=False)
    ran = invoked("init", "m.csv", "--robot", "ur10", "--yes")
    assert ran.exit_code == 3
    assert f'"q0" to "q{count - 1}" are {count} readings, but ur10 has 6 joints.' in ran.stderr
    assert "--column q1_deg=q0, and so on" in ran.stderr


@pytest.mark.parametrize(
    ("absent", "says"),
    [
        (
            ["J4"],
            '"J5" and "J6" look like joint readings, but joint 4 of 6 has no column. Add it; or',
        ),
        (["J1"], "but joint 1 of 6 has no column. Add it; or"),
        (["J2", "J4"], "but joints 2 and 4 of 6 have no column. Add them; or"),
    ],
)
def test_joints_without_a_column_are_named(absent, says) -> None:
    campaign().drop(columns=absent).to_csv("m.csv", index=False)
    ran = invoked("init", "m.csv", "--robot", "ur10", "--yes")
    assert ran.exit_code == 3
    assert says in ran.stderr
    assert "--column q1_deg=NAME" in ran.stderr


@pytest.mark.parametrize("name", ["marker", "Punktgruppe", "Group"])
def test_a_column_that_tells_targets_apart_is_the_target(name) -> None:
    """Every configuration with three reflectors, a row each."""
    frame = campaign(30)
    q = np.radians(frame.filter(like="J").to_numpy())
    at = build_measurements(q, np.zeros((30, 3)))
    parts = []
    for k, tool in enumerate(([40.0, -25, 120], [-60.0, 20, 130], [10.0, 80, 90])):
        rng = np.random.default_rng(k)
        points = simulate_points(
            load_robot("ur10"), np.array(tool), [], at=at, noise_mm=0.05, rng=rng
        )
        part = frame.assign(**{name: f"M{k + 1}"})
        part[["X", "Y", "Z"]] = points[["x_mm", "y_mm", "z_mm"]].to_numpy()
        parts.append(part)
    pd.concat(parts).sort_index(kind="stable").to_csv("m.csv", index=False)
    ran = invoked("init", "m.csv", "--robot", "ur10", "--yes")
    assert f'Also: "{name}" as reflectors' in ran.stdout
    assert "90 rows, 30 configurations, 3 targets." in ran.stdout
    table = tomllib.loads(Path("m/study.toml").read_text(encoding="utf-8"))
    assert table["measurements"]["columns"]["target"] == name
    assert "group" not in table["measurements"]["columns"]


def test_a_folder_in_the_place_of_a_file_is_named(tmp_path) -> None:
    ran = invoked("init", tmp_path, "--robot", "ur10", "--yes", "--out", "o")
    assert f"{tmp_path.name}: it is a folder." in ran.stderr
    here = invoked("init", ".", "--robot", "ur10", "--yes", "--out", "o")
    assert ".: it is a folder." in here.stderr


def test_one_file_of_two_asks_for_the_other() -> None:
    frame = campaign()
    frame.insert(0, "Name", [f"P{k}" for k in range(len(frame))])
    frame[["Name", "X", "Y", "Z"]].to_csv("points.csv", index=False)
    ran = invoked("init", "points.csv", "--robot", "ur10", "--yes")
    assert ran.exit_code == 3
    assert "it holds points only" in ran.stderr
    assert "--joints LOG" in ran.stderr
    frame.drop(columns=["X", "Y", "Z"]).to_csv("log.csv", index=False)
    ran = invoked("init", "log.csv", "--robot", "ur10", "--yes")
    assert ran.exit_code == 3
    assert "it holds joint readings only" in ran.stderr
    assert "modelsel init POINTS --joints log.csv" in ran.stderr
    both = invoked("init", "points.csv", "--joints", "log.csv", "--robot", "ur10", "--yes")
    assert both.exit_code == 0, both.output


def test_joints_as_the_german_pendant_of_a_ur_calls_them() -> None:
    names = ["Basis", "Schulter", "Ellbogen", *(f"Handgelenk {k}" for k in (1, 2, 3))]
    frame = campaign()
    frame.columns = [*names, *frame.columns[6:]]
    frame.to_csv("m.csv", index=False)
    ran = invoked("init", "m.csv", "--robot", "ur10", "--yes")
    assert 'The joint readings: "Basis" to "Handgelenk 3"' in ran.stdout


@pytest.mark.parametrize(
    ("stem", "why"),
    [
        ("x" * 210, "it has 210 characters"),
        ("a\u202eb", "it holds U+202E (right-to-left override)"),
    ],
)
def test_a_folder_whose_name_no_study_can_have_is_refused_with_the_option(stem, why) -> None:
    """Before anything is asked; another folder is all that it takes."""
    campaign().to_csv(f"{stem}.csv", index=False)
    words = ["init", f"{stem}.csv", "--robot", "ur10", "--yes"]
    ran = invoked(*words)
    assert ran.exit_code == 2
    assert ran.stdout == ""
    assert f"the study would be called as its folder, and this is not a name: {why}" in ran.stderr
    assert "Give another folder with --out." in ran.stderr
    assert invoked(*words, "--out", "short").exit_code == 0
