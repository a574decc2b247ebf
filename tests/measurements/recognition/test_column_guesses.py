"""Columns by other names: guessed with their units, proposed once for all, with every reading that
fits."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest

from modelsel.exceptions import DataError
from modelsel.measurements.formats.column_names import parse_column_name
from modelsel.measurements.formats.row_places import Where
from modelsel.measurements.formats.table import Table, load_table
from modelsel.measurements.reader import read_measurements
from modelsel.measurements.recognition.column_guesses import guess_columns

TURNING = (False,) * 6
XYZ = ("X", "Y", "Z")


def table_of(
    joints: list[str], axes: tuple[str, ...] = XYZ, largest: float = 170.0, extent: float = 1500.0
) -> Table:
    """Twenty rows whose largest reading and extent are given."""
    rng = np.random.default_rng(3)
    q = rng.uniform(-1, 1, (20, len(joints))) * largest
    q[0, 0] = largest
    x = rng.uniform(0, 1, (20, len(axes))) * extent
    x[0], x[1] = 0, extent
    columns = {name: q[:, k] for k, name in enumerate(joints)}
    return Table(columns | {name: x[:, k] for k, name in enumerate(axes)}, Where("m.csv"))


def numbered(form: str, first: int = 1) -> list[str]:
    return [form.format(first + k) for k in range(6)]


@pytest.mark.parametrize(
    ("form", "first"),
    [
        ("J{}", 1),
        ("A{}", 1),
        ("joint_{}", 1),
        ("Q{}_DEG", 1),
        ("Joint {} (deg)", 1),
        ("Achse {} [°]", 1),
        ("actual_q_{}", 0),
        ("panda_joint{}", 1),
        ("J{} ist", 1),
        ("rax_{}", 1),
        ("theta{}", 1),
        ("q[{}]", 0),
        ("q({}) [deg]", 1),
        ("actual_q[{}]", 0),
        ("field.position{}", 0),
        ("joint_states.position[{}]", 0),
        ("/joint_states/position.{}", 0),
    ],
)
def test_joints_by_the_names_of_other_programs(form, first) -> None:
    names = numbered(form, first)
    choice, _ = guess_columns(table_of(names), TURNING)
    (reading,) = choice.readings
    assert reading.columns == {f"q{k + 1}_deg": name for k, name in enumerate(names)}


def test_joints_that_a_driver_calls_by_name() -> None:
    """ROS' driver of Universal Robots, in the order of its joint_states: by the alphabet."""
    names = [f"{part}_joint" for part in ("elbow", "shoulder_lift", "shoulder_pan")]
    names += [f"wrist_{k}_joint" for k in (1, 2, 3)]
    choice, _ = guess_columns(table_of(names, largest=3.1), TURNING)
    (reading,) = choice.readings
    assert reading.columns["q1_rad"] == "shoulder_pan_joint"
    assert reading.columns["q3_rad"] == "elbow_joint"
    assert reading.columns["q6_rad"] == "wrist_3_joint"


@pytest.mark.parametrize(
    ("largest", "units"),
    [(170.0, ["deg"]), (9.0, ["deg", "rad"]), (3.1, ["rad"]), (0.9, ["rad", "deg"])],
)
def test_degrees_or_radians_by_range(largest, units) -> None:
    choice, _ = guess_columns(table_of(numbered("J{}"), largest=largest), TURNING)
    assert [next(iter(reading.columns)) for reading in choice.readings] == [
        f"q1_{unit}" for unit in units
    ]
    assert choice.is_doubtful == (len(units) > 1)


@pytest.mark.parametrize(
    ("axes", "extent", "expected"),
    [
        (("X", "Y", "Z"), 1500.0, ["x_mm"]),
        (("X", "Y", "Z"), 1.5, ["x_m"]),
        (("X", "Y", "Z"), 15.0, ["x_mm", "x_m"]),
        (("X [mm]", "Y [mm]", "Z [mm]"), 1.5, ["x_mm"]),
        (("Pos.X", "Pos.Y", "Pos.Z"), 1500.0, ["x_mm"]),
        (("X [inch]", "Y [inch]", "Z [inch]"), 60.0, ["x_in"]),
        (("dX", "dY", "dZ"), 1500.0, []),
        (("X", "Y", "Height"), 1500.0, []),
    ],
)
def test_positions(axes, extent, expected) -> None:
    _, choice = guess_columns(table_of(numbered("J{}"), axes, extent=extent), TURNING)
    assert [next(iter(reading.columns)) for reading in choice.readings] == expected


def test_measured_goes_before_nominal_and_two_of_a_kind_are_doubtful() -> None:
    six = ("Nominal X", "Nominal Y", "Nominal Z", "Measured X", "Measured Y", "Measured Z")
    _, choice = guess_columns(table_of(numbered("J{}"), six), TURNING)
    assert [reading.columns["x_mm"] for reading in choice.readings] == ["Measured X"]
    six = ("TCP_X", "TCP_Y", "TCP_Z", "X", "Y", "Z")
    _, choice = guess_columns(table_of(numbered("J{}"), six), TURNING)
    assert [reading.columns["x_mm"] for reading in choice.readings] == ["TCP_X", "X"]


def test_readings_go_before_speeds_currents_and_temperatures() -> None:
    """Columns that are numbered alike: T1 … T6 are not a second arm."""
    many = [*numbered("T{}"), *numbered("J{}"), *numbered("J{} current"), *numbered("qd{}")]
    choice, _ = guess_columns(table_of(many), TURNING)
    assert [reading.columns["q6_deg"] for reading in choice.readings] == ["J6"]


def test_a_unit_below_the_name_decides(tmp_path) -> None:
    path = tmp_path / "m.csv"
    head = ["J1;J2;J3;X;Y;Z", "[rad];[rad];[rad];[m];[m];[m]"]
    rows = [f"{k / 10};{k / 20};{k / 30};{k};{k + 1};{k * 2}" for k in range(1, 9)]
    path.write_text("\n".join([*head, *rows]) + "\n")
    joints, axes = guess_columns(load_table(path), (False,) * 3)
    assert [dict(choice.readings[0].columns) for choice in (joints, axes)] == [
        {"q1_rad": "J1", "q2_rad": "J2", "q3_rad": "J3"},
        {"x_m": "X", "y_m": "Y", "z_m": "Z"},
    ]
    columns = {"q1_deg": "J1", "q2_deg": "J2", "q3_deg": "J3", "x_m": "X", "y_m": "Y", "z_m": "Z"}
    with pytest.raises(DataError, match=r"column J1: it is read as q1_deg, .* says \"\[rad\]\""):
        read_measurements(path, (False,) * 3, columns)


def test_all_columns_are_proposed_at_once(tmp_path) -> None:
    path = tmp_path / "lab.csv"
    table = table_of(numbered("J{}"))
    pd.DataFrame(dict(table.columns)).to_csv(path, index=False)
    with pytest.raises(DataError) as caught:
        read_measurements(path, TURNING)
    assert str(caught.value) == (
        "lab.csv, line 1: 9 columns do not have the names of a measurements file. "
        'The joint readings look like "J1" to "J6" in degrees (up to 170). '
        'The position looks like "X", "Y" and "Z" in mm (over a range of 1500). '
        'Map them in the study file: [measurements] columns = { q1_deg = "J1", q2_deg = "J2", '
        'q3_deg = "J3", q4_deg = "J4", q5_deg = "J5", q6_deg = "J6", x_mm = "X", y_mm = "Y", '
        'z_mm = "Z" } (for a command without a study file: --column q1_deg=J1 --column q2_deg=J2 '
        "--column q3_deg=J3 --column q4_deg=J4 --column q5_deg=J5 --column q6_deg=J6 "
        "--column x_mm=X --column y_mm=Y --column z_mm=Z). "
        "modelsel init lab.csv --robot NAME writes a study that does."
    )
    names = {name: f"{name} of the arm [deg]" for name in table.columns if name.startswith("J")}
    pd.DataFrame(dict(table.columns)).rename(columns=names).to_csv(path, index=False)
    with pytest.raises(DataError, match=r"'q1_deg=J1 of the arm \[deg\]' and so on\)") as caught:
        read_measurements(path, TURNING)
    assert len(str(caught.value)) < 700
    guesses = guess_columns(table, TURNING)
    columns = {k: v for choice in guesses for k, v in choice.readings[0].columns.items()}
    pd.DataFrame(dict(table.columns)).to_csv(path, index=False)
    data = read_measurements(path, TURNING, columns)
    assert np.allclose(np.degrees(data.q[:, 5]), table.columns["J6"])


def test_both_readings_are_told_and_a_frame_is_mapped_by_python() -> None:
    frame = pd.DataFrame(dict(table_of(numbered("J{}"), largest=0.9).columns))
    with pytest.raises(DataError, match=r"in radians \(up to 0\.9\), or .* in degrees") as caught:
        read_measurements(frame, TURNING)
    assert 'columns={"q1_rad": "J1"' in str(caught.value)
    assert "modelsel init" not in str(caught.value)


def test_what_is_not_found_is_said() -> None:
    frame = pd.DataFrame(dict(table_of(numbered("J{}"), ("Height", "Width", "Depth")).columns))
    with pytest.raises(DataError, match="Nothing looks like the position"):
        read_measurements(frame, TURNING)


@pytest.mark.parametrize(
    ("name", "quantity", "number", "unit"),
    [
        ("Q1_DEG", "joint", 1, "deg"),
        ("A1 in °", "joint", 1, "deg"),
        ("X [mm]", "x", None, "mm"),
        ("x/mm", "x", None, "mm"),
        ("X [inch]", "x", None, "in"),
        ("J01", "joint", 1, None),
        ("qd1", None, None, None),
        ("Rx", None, None, None),
        ("Point Name", None, None, None),
        ("Euler_C", None, None, None),
        ("Temp_C", None, None, "C"),
    ],
)
def test_names_taken_apart(name, quantity, number, unit) -> None:
    parsed = parse_column_name(name)
    assert (parsed.quantity, parsed.number, parsed.unit) == (quantity, number, unit)
