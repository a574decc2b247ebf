"""DataFrames in: what a file is read as and refused with; out: what is read back."""

from __future__ import annotations

from dataclasses import fields

import numpy as np
import pandas as pd
import pytest
from builders import drawn, small_arm

from modelsel.exceptions import DataError
from modelsel.measurements.campaign.joint_path import JointPath
from modelsel.measurements.measurements import Measurements, build_measurements
from modelsel.measurements.reader import read_labels, read_measurements

ARM = (False, False)
FRAME = pd.DataFrame(
    {
        "q1_rad": [0.1, 0.1, 0.5],
        "q2_deg": [0, 0, 45],
        "x_mm": [1.0, 2, 3],
        "y_mm": [4.0, 5, 6],
        "z_mm": [7, 8, 9],
        "target": ["a", "b", "a"],
        "group": pd.Categorical(["d1", "d1", "d2"]),
        "payload_kg": [0.0, 0.0, 2.5],
        "note": ["", "x", None],
        "sx_mm": [0.1, 0.1, 0.2],
        "sy_mm": [0.1, 0.2, 0.2],
        "sz_mm": [0.3, 0.1, 0.2],
        "humidity": pd.array([40, 50, 60], dtype="Int64"),
        "qw": [1, 0, 0.71],
        "qx": [0, 1, 0],
        "qy": [0, 0, 0],
        "qz": [0, 0, 0.71],
    },
    index=[7, 7, 3],
)


def same(a: Measurements, b: Measurements, but: tuple[str, ...] = (), places: float = 0) -> None:
    for name in (
        f.name for f in fields(Measurements) if f.name not in (*but, "where")
    ):  # one is a file, one is none
        one, other = getattr(a, name), getattr(b, name)
        if name == "covariates":
            assert one.keys() == other.keys()
            one, other = (np.array([v[k] for k in sorted(v)]) for v in (one, other))
        if isinstance(one, JointPath):
            one, other = (np.array([path.opens, *path.steps.T]) for path in (one, other))
        if isinstance(one, np.ndarray):
            np.testing.assert_allclose(one, other, rtol=0, atol=places, err_msg=name)
        else:
            assert one == other, name


def test_a_frame_is_read_as_its_file(tmp_path) -> None:
    FRAME.to_csv(tmp_path / "m.csv", index=False)
    same(read_measurements(FRAME, ARM), read_measurements(tmp_path / "m.csv", ARM))
    assert read_labels(FRAME, "group").tolist() == ["d1", "d1", "d2"]


def test_measurements_are_their_own_copy() -> None:
    frame = FRAME.assign(temperature_C=[20.0, 21.0, 22.0])
    data = read_measurements(frame, ARM)
    frame.loc[:, ["temperature_C", "x_mm"]] = 99.0
    np.testing.assert_array_equal(data.covariates["temperature_C"], [20.0, 21.0, 22.0])
    assert not (data.position == 99.0).any()


def bad(**columns: object) -> pd.DataFrame:
    plain = FRAME[["q1_rad", "q2_deg", "x_mm", "y_mm", "z_mm"]].reset_index(drop=True)
    return plain.assign(**columns)


REFUSED = {
    "empty": bad(x_mm=[1.0, np.nan, 3.0]),
    "text": bad(y_mm=["4", "five", "6"]),
    "infinite": bad(z_mm=[7, np.inf, 9]),
    "degrees": bad(q1_rad=[0.1, 0.2, 90.0]),
    "half": bad(sx_mm=0.1),
    "nought": bad(sx_mm=0.1, sy_mm=[1, 0, 1], sz_mm=1),
    "quaternion": bad(qw=[1, 0, 1], qx=0, qy=0, qz=0),
    "approach": bad(approach1=[0, 1, 2], approach2=0),
    "two units": bad(x_m=1.0),
    "reading": bad(configuration=[1, 2, 2]),
    "label": bad(target=["a", None, "b"]),
    "no column": bad().drop(columns="z_mm"),
    "no unit": bad().rename(columns={"z_mm": "z"}),
    "more joints": bad(q3_rad=0.0),
    "no rows": bad().iloc[:0],
    "covariate": bad(payload_kg=[1, None, 2]),
    "grams": bad(payload_kg=[0, 8000, 8000]),
}


@pytest.mark.parametrize("case", REFUSED)
def test_a_frame_is_refused_in_a_file_s_words(case, tmp_path) -> None:
    """The sentence is the file's; the place is the row, counted from 0, where the file's line
    counts the header."""
    frame = REFUSED[case]
    frame.to_csv(tmp_path / "m.csv", index=False)
    with pytest.raises(DataError) as of_file:
        read_measurements(tmp_path / "m.csv", ARM)
    with pytest.raises(DataError) as of_frame:
        read_measurements(frame, ARM)
    one, other = of_file.value, of_frame.value
    assert other.row == (None if one.line == 1 else one.line - 2)
    assert other.line is None
    assert other.column == one.column
    head = ", ".join(
        [
            "DataFrame",
            *([f"row {other.row}"] if other.row is not None else []),
            *([f"column {other.column}"] if other.column else []),
        ]
    )
    assert str(other).startswith(f"{head}: ")
    words = (
        str(one)
        .partition(": ")[2]
        .replace("the file has", "it has")
        .replace("on line 3", "on row 1")
    )
    for given in ("z", "NAME"):
        words = words.replace(
            f'in the study file: [measurements] columns = {{ z_mm = "{given}" }} (for a command without a study file: '
            f"--column z_mm={given})",
            (
                f'by columns={{"z_mm": "{given}"}} (for a Study: measurements={{"frame": …, "columns": …}})'
            ),
        )
    assert str(other).partition(": ")[2] == words


@pytest.mark.parametrize(
    ("source", "says"),
    [
        ({"x_mm": [1]}, "found dict"),
        (bad().rename(columns={"x_mm": 3}), "called 3"),
        (pd.concat([bad(), bad()[["x_mm"]]], axis=1), "appears twice"),
    ],
)
def test_what_is_no_table_is_refused(source, says) -> None:
    with pytest.raises(DataError, match=says):
        read_measurements(source, ARM)


def test_out_and_back(rng) -> None:
    """Everything of the contract comes back: several targets and groups, covariates, uncertainties,
    orientations, a slide."""
    frame = FRAME.assign(q2_mm=FRAME["q2_deg"]).drop(columns="q2_deg")
    data = read_measurements(frame, (False, True))
    out = data.to_frame()
    assert {
        "q1_rad",
        "q2_mm",
        "x_mm",
        "sx_mm",
        "qw",
        "target",
        "group",
        "approach2",
        "humidity",
    } <= set(out.columns)
    again = read_measurements(out, (False, True))
    same(again, data, but=("notes", "path"), places=1e-15)
    # its directions of approach are given, and need not be those from the row before
    assert again.path is None
    at = drawn(small_arm(True), rng, 20).data
    same(
        read_measurements(at.to_frame(), at.prismatic), at, but=("notes", "units", "path")
    )  # drawn ones have no units as given


def test_a_part_keeps_its_rows_and_directions() -> None:
    data = read_measurements(bad(q1_rad=[0.1, 0.3, 0.2]), ARM)
    part = data.take(np.array([0, 2]))
    assert part.to_frame().index.tolist() == [0, 2]
    np.testing.assert_array_equal(read_measurements(part.to_frame(), ARM).approach, part.approach)


def test_configurations_without_positions_have_no_columns_for_them() -> None:
    data = read_measurements(bad()[["q1_rad", "q2_deg"]], ARM, positions=False)
    assert "x_mm" not in data.to_frame()


def test_a_notebook_shows_few_rows_and_no_markup_of_the_data() -> None:
    many = build_measurements(
        np.arange(400.0).reshape(200, 2), np.zeros((200, 3)), target=["<b>"] * 200
    )
    shown = many._repr_html_()
    assert "200 rows, 200 configurations" in shown
    assert "<b>" not in shown
    assert "&lt;b&gt;" in shown
    assert len(shown) < 5000
