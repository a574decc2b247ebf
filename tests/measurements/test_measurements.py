"""Measurement files: what contract.md promises of every column, and every refusal with its file,
line and column."""

from __future__ import annotations

from dataclasses import fields
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from builders import drawn, seeds, study_with

from modelsel.exceptions import DataError
from modelsel.fitting.noise import from_repeats
from modelsel.measurements.campaign.visits import order_units
from modelsel.measurements.measurements import Measurements, build_measurements
from modelsel.measurements.reader import read_labels, read_measurements
from modelsel.robot.files import load_robot
from modelsel.study.preparation.preparation import prepare

Q = "q1_rad,q2_rad"
PLAIN = f"{Q},x_mm,y_mm,z_mm"
ARM = [False, False]


def csv(folder: Path, *lines: str, name: str = "data.csv") -> Path:
    path = folder / name
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path


def parquet(folder: Path, **columns: object) -> Path:
    import pyarrow as pa
    import pyarrow.parquet as pq

    pq.write_table(pa.table(columns), folder / "data.parquet")
    return folder / "data.parquet"


def rows(*q: tuple[float, float], tail: str = "1,2,3") -> list[str]:
    return [f"{a},{b},{tail}" for a, b in q]


def codes(data: Measurements) -> list[str]:
    return [note.code for note in data.notes]


# -- what is read
# -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("slide", ["q2_mm,250", "q2_m,0.25"])
def test_units_are_in_the_names(slide, tmp_path) -> None:
    name, value = slide.split(",")
    data = read_measurements(
        csv(tmp_path, f"q1_deg,{name},x_m,y_mm,z_m", f"90,{value},1,2,-0.5"), [False, True]
    )
    assert data.units == ("deg", name.partition("_")[2])
    np.testing.assert_allclose(data.q, [[np.pi / 2, 250]], rtol=1e-15)
    np.testing.assert_allclose(data.position, [[1000, 2, -500]], rtol=1e-15)


def test_all_columns_from_csv_and_parquet_alike(tmp_path) -> None:
    columns = {
        "q1_rad": [0.1, 0.1, 0.5],
        "q2_rad": [0, 0, 1],
        "x_mm": [1.0, 2, 3],
        "y_mm": [4.0, 5, 6],
        "z_mm": [7.0, 8, 9],
        "target": ["a", "b", "a"],
        "group": ["d1", "d1", "d2"],
        "payload_kg": [0.0, 0.0, 2.5],
        "sx_mm": [0.1, 0.1, 0.2],
        "sy_mm": [0.1, 0.2, 0.2],
        "sz_mm": [0.3, 0.1, 0.2],
        "qw": [1, 0, 0.71],
        "qx": [0, 1, 0],
        "qy": [0, 0, 0],
        "qz": [0, 0, 0.71],
        "srx_rad": [1e-3] * 3,
        "sry_rad": [1e-3] * 3,
        "srz_rad": [2e-3] * 3,
        "humidity": [0.4, 0.5, 0.6],
    }
    lines = [
        ",".join(columns),
        *(",".join(str(v) for v in row) for row in zip(*columns.values(), strict=True)),
    ]
    for path in (csv(tmp_path, *lines), parquet(tmp_path, **columns)):
        data = read_measurements(path, ARM)
        np.testing.assert_array_equal(data.q, [[0.1, 0], [0.1, 0], [0.5, 1]])
        np.testing.assert_array_equal(data.position, [[1, 4, 7], [2, 5, 8], [3, 6, 9]])
        assert data.targets == ("a", "b")
        assert data.target.tolist() == [0, 1, 0]
        assert data.groups == ("d1", "d2")
        assert data.configuration.tolist() == [0, 0, 1]
        np.testing.assert_array_equal(data.covariates["payload_kg"], [0, 0, 2.5])
        np.testing.assert_array_equal(data.covariates["humidity"], [0.4, 0.5, 0.6])
        assert set(data.covariates) == {"payload_kg", "humidity"}
        np.testing.assert_array_equal(
            data.sigma, [[0.1, 0.1, 0.3], [0.1, 0.2, 0.1], [0.2, 0.2, 0.2]]
        )
        np.testing.assert_allclose(data.rotation[0], np.eye(3))
        np.testing.assert_allclose(data.rotation[1], np.diag([1, -1, -1]))
        np.testing.assert_allclose(
            data.rotation[2], [[0, -1, 0], [1, 0, 0], [0, 0, 1]], atol=1e-15
        )  # normalised; w first
        np.testing.assert_array_equal(data.sigma_rotation[:, 2], 2e-3)


@pytest.mark.parametrize(
    "text",
    [
        "\ufeff" + PLAIN + "\r\n0,0,1,2,3\r\n",
        PLAIN.replace(",", " , ") + "\n0, 0, 1, 2, 3\n\n\n",
        '"q1_rad","q2_rad",x_mm,y_mm,z_mm\n0,"0",1,2,3',
    ],
    ids=["bom-crlf", "spaces-blank-end", "quotes-no-newline"],
)
def test_csv_as_people_write_it(text, tmp_path) -> None:
    (tmp_path / "d.csv").write_text(text, encoding="utf-8", newline="")
    assert read_measurements(tmp_path / "d.csv", ARM).position.tolist() == [[1, 2, 3]]


@pytest.mark.parametrize(
    "columns", [{"q1_deg": "J1", "x_m": "px"}, {"x_m": "px", "q1_deg": "J1"}], ids=["forth", "back"]
)
def test_mapped_columns(columns, tmp_path) -> None:
    data = read_measurements(csv(tmp_path, "J1,q2_rad,px,y_mm,z_mm", "180,1,1,2,3"), ARM, columns)
    np.testing.assert_allclose([data.q[0, 0], data.position[0, 0]], [np.pi, 1000])


def test_mapped_columns_may_change_places(tmp_path) -> None:
    """A file whose x and y are exchanged."""
    data = read_measurements(
        csv(tmp_path, PLAIN, "0,0,1,2,3"), ARM, {"x_mm": "y_mm", "y_mm": "x_mm"}
    )
    assert data.position.tolist() == [[2, 1, 3]]


def test_notes_say_what_is_ignored(tmp_path) -> None:
    header = f"{PLAIN},operator,load N,half,torque2"
    data = read_measurements(
        csv(tmp_path, header, "0,0,1,2,3,Ann,1,1,5", "1,0,1,2,3,Bob,2,,6"), ARM
    )
    assert not data.covariates
    said = {note.code: note.sentence for note in data.notes}
    assert "operator" in said["columns-ignored"]
    assert all(name in said["covariates-ignored"] for name in ("load N", "half", "torque2"))
    assert "approach-from-order" in said


def test_a_column_that_the_split_uses_is_not_said_to_be_ignored(tmp_path) -> None:
    path = csv(tmp_path, f"{PLAIN},role,operator", "0,0,1,2,3,estimation,Ann", "1,0,1,2,3,new,Bob")
    data = read_measurements(path, ARM, used=("role",))
    said = {note.code: note.sentence for note in data.notes}
    assert said["columns-ignored"] == 'Columns that hold no numbers are ignored: "operator".'


def test_a_column_that_counts_the_rows_is_no_cause(tmp_path) -> None:
    cells = [f"{0.1 * k},0,1,2,{k},{number},{number}" for k, number in enumerate((1, 2, 4, 5, 6))]
    data = read_measurements(csv(tmp_path, f"{PLAIN},No,load", *cells), ARM)
    assert set(data.covariates) == {"load"}
    assert "No" in {note.code: note.sentence for note in data.notes}["counters-ignored"]
    uneven = [f"{0.1 * k},0,1,2,{k},{number}" for k, number in enumerate((1, 3, 2, 5, 9))]
    assert set(read_measurements(csv(tmp_path, f"{PLAIN},No", *uneven), ARM).covariates) == {"No"}


def test_duplicates_count_once(tmp_path) -> None:
    """A row that repeats an earlier one cell for cell; a repeat with another position stays."""
    data = read_measurements(
        csv(tmp_path, PLAIN, *rows((0, 0), (1, 0), (0, 0)), "0,0,1,2,3.01"), ARM
    )
    assert data.row.tolist() == [0, 1, 3]
    assert "duplicate-rows" in codes(data)
    assert "1 row" in next(n.sentence for n in data.notes if n.code == "duplicate-rows")


# -- approach, move, repeats
# ------------------------------------------------------------------------------------------

WALK = [(0, 0), (1, 0), (1, 2), (1, 2), (0.5, 2), (0.5, 2.5)]
APPROACH = [
    (0, 0),
    (1, 0),
    (1, 1),
    (1, 1),
    (-1, 1),
    (-1, 1),
]  # a resting joint keeps the side of its last motion
MOVE = [
    (0, 0),
    (1, 0),
    (0, 2),
    (0, 2),
    (0.5, 0),
    (0, 0.5),
]  # the third and fourth row are one configuration


def test_approach_and_move_from_row_order(tmp_path) -> None:
    lines = [f"{a},{b},{k},2,3,t{k % 4 == 3}" for k, (a, b) in enumerate(WALK)]
    data = read_measurements(csv(tmp_path, f"{PLAIN},target", *lines), ARM)
    assert data.configuration.tolist() == [0, 1, 2, 2, 3, 4]
    np.testing.assert_array_equal(data.approach, APPROACH)
    np.testing.assert_allclose(data.move, MOVE)
    assert "approach-from-order" in codes(data)
    assert data.approach_from_order
    assert data.configurations == 5


@seeds(1, 2)
def test_order_and_groups(rng) -> None:
    """Groups interleaved, rows shuffled, the order of motion in a column: each group begins anew,
    with 0."""
    q = np.array([*WALK, *WALK], float)
    order = np.array([*range(6), *range(100, 106)], float)
    group, visit = (
        np.repeat(["first", "second"], 6),
        [f"{g}{k}" for g in "ab" for k in (0, 1, 2, 2, 4, 5)],
    )
    shuffle = rng.permutation(12)
    data = build_measurements(
        q[shuffle],
        np.zeros((12, 3)),
        group=group[shuffle],
        order=order[shuffle],
        configuration=[visit[k] for k in shuffle],
    )
    np.testing.assert_array_equal(data.approach, np.array(APPROACH * 2)[shuffle])
    np.testing.assert_allclose(data.move, np.array(MOVE * 2)[shuffle])


def test_groups_follow_one_another_by_the_clock() -> None:
    """Where one clock runs through all groups they stand in its order, whatever the rows' order;
    else in that of first rows."""
    q, x, group = (
        np.arange(6.0)[:, None].repeat(2, 1),
        np.zeros((6, 3)),
        ["tue", "tue", "mon", "mon", "wed", "wed"],
    )

    def progress(*time: float) -> list[float]:
        return (
            build_measurements(q, x, group=group, covariates={"time_s": np.array(time)}).progress
            * 5
        ).tolist()

    assert progress(10, 11, 0, 1, 20, 21) == [2, 3, 0, 1, 4, 5]
    assert progress(0, 1, 0, 1, 0, 1) == [0, 1, 2, 3, 4, 5]  # a clock that starts anew
    assert progress(10, 11, 0, 10.5, 20, 21) == [0, 1, 2, 3, 4, 5]  # groups side by side


def test_units_are_numbered_as_the_arm_came_to_them(rng) -> None:
    unit, progress = np.array([7, 3, 7, 5, 3]), np.array([0.9, 0.4, 0.1, 0.2, 0.3])
    number, first = order_units(unit, progress)
    assert number.tolist() == [0, 2, 0, 1, 2]
    assert first.tolist() == [2, 3, 4]
    mixed = rng.permutation(5)
    again, _ = order_units(unit[mixed], progress[mixed])
    assert again.tolist() == number[mixed].tolist()


def test_a_new_group_begins_a_new_configuration() -> None:
    data = build_measurements(np.zeros((4, 2)), np.zeros((4, 3)), group=["a", "a", "b", "b"])
    assert data.configuration.tolist() == [0, 0, 1, 1]
    assert len(set(data.block)) == 1
    assert not data.approach.any()


def test_given_approach_stays(tmp_path) -> None:
    data = read_measurements(
        csv(tmp_path, f"{PLAIN},approach1,approach2", "0,0,1,2,3,-1,0", "1,0,1,2,3,-1,1"), ARM
    )
    np.testing.assert_array_equal(data.approach, [[-1, 0], [-1, 1]])
    np.testing.assert_array_equal(data.move, [[0, 0], [1, 0]])
    assert "approach-from-order" not in codes(data)
    assert not data.approach_from_order
    assert not {"approach1", "approach2"} & set(data.covariates)


def test_directions_against_the_order_are_said(rng) -> None:
    """Drawn ones are; those of the order, and an arm that always comes from one side, are not."""
    q = rng.uniform(-2, 2, (40, 2))
    position = np.zeros((40, 3))
    derived = build_measurements(q, position).approach
    drawn_ones = rng.choice([-1.0, 1.0], q.shape)
    data = build_measurements(q, position, approach=drawn_ones)
    share = 100 * np.mean((drawn_ones != derived)[1:])
    (said,) = [note.sentence for note in data.notes if note.code == "approach-against-order"]
    assert f"order of the rows makes of them in {share:.0f} % of the motions" in said
    for given in (derived, np.ones(q.shape), np.zeros(q.shape)):
        data = build_measurements(q, position, approach=given)
        assert not data.notes


def test_configuration_column_joins_rows() -> None:
    data = build_measurements(
        np.array([[0.0, 0], [1, 0], [0, 0]]), np.zeros((3, 3)), configuration=[7, 3, 7]
    )
    assert data.configuration.tolist() == [0, 1, 0]
    assert data.configurations == 2


@pytest.mark.parametrize("off", [0.0, 3e-7, 9e-7], ids=lambda v: f"{v:g}rad")
@seeds(1, 2, 3)
def test_repeats_are_one_block(off, rng) -> None:
    """Readings equal to 1e-6 rad, wherever they lie and however far apart in time."""
    q = rng.uniform(-3, 3, (200, 2))
    again = np.concatenate([q, q + off * rng.choice([-1, 1], (200, 2)), rng.uniform(4, 5, (50, 2))])
    data = build_measurements(again, np.zeros((450, 3)))
    assert np.array_equal(data.block[:200], data.block[200:400])
    assert len(set(data.block)) == 250
    assert data.configurations == 450


# -- take
# -------------------------------------------------------------------------------------------------------------


def test_take_is_consistent(rng) -> None:
    """Every array by the same rows; what was derived on reading is not derived again."""
    at = drawn(
        "ur5",
        rng,
        30,
        group=np.arange(30) // 10,
        target=["a", "b"] * 15,
        sigma=rng.uniform(1, 2, (30, 3)),
    )
    data, index = at.data, rng.permutation(30)[:12]
    part = data.take(index)
    for f in fields(data):
        whole, taken = getattr(data, f.name), getattr(part, f.name)
        if isinstance(whole, np.ndarray):
            np.testing.assert_array_equal(taken, whole[index], err_msg=f.name)
            assert len(taken) == 12
        elif f.name != "covariates":
            assert taken == whole
    assert all(
        np.array_equal(part.covariates[name], values[index])
        for name, values in data.covariates.items()
    )
    mask = np.isin(np.arange(30), index)
    assert np.array_equal(data.take(mask).position, data.take(np.flatnonzero(mask)).position)
    assert len(data.take(np.zeros(30, bool))) == 0


# -- refusals
# ---------------------------------------------------------------------------------------------------------

HELD = f"{PLAIN},payload_kg,order,sx_mm,sy_mm,sz_mm,qw,qx,qy,qz,approach1,approach2,target,group,configuration"
GOOD = "0,0,1,2,3,1,5,0.1,0.1,0.1,1,0,0,0,1,-1,t,g,c"
TEXT = {"target", "group", "configuration"}


@pytest.mark.parametrize("cell", ["", "abc", "nan", "inf", "-inf", "1;5"], ids=repr)
@pytest.mark.parametrize("column", HELD.split(","))
def test_bad_cells(column, cell, tmp_path) -> None:
    """Empty, non-numeric or non-finite in a column of the contract: file, line (the header is 1)
    and column."""
    if column in TEXT and cell:
        return
    bad = GOOD.split(",")
    bad[HELD.split(",").index(column)] = cell
    with pytest.raises(DataError) as caught:
        read_measurements(
            csv(tmp_path, HELD, GOOD, GOOD.replace("3", "4"), ",".join(bad), name="run7.csv"), ARM
        )
    assert (caught.value.file, caught.value.line, caught.value.column) == ("run7.csv", 4, column)
    assert f"run7.csv, line 4, column {column}" in str(caught.value)
    assert caught.value.remedy
    assert caught.value.exit_code == 3


REFUSED = {
    "too few cells": ([PLAIN, "0,0,1,2,3", "0,0,1,2"], "line 3", "4 cells, but the header has 5"),
    "too many cells": ([PLAIN, "0,0,1,2,3,4"], "line 2", "6 cells, but the header has 5"),
    "a separator too many": ([PLAIN, "0,0,1,2,3", "0,0,1,2,3,"], "line 3", "at the row's end"),
    "an open quotation mark": (
        [PLAIN, "0,0,1,2,3", '"0,0,1,2,3', "0,0,1,2,3"],
        "line 3",
        "1 cell, but the header has 5. A quotation mark joins several cells",
    ),
    "zeros at the end": ([PLAIN, "0,0,1,2,3", "\0\0"], "line 3", "not written to its end"),
    "degrees": ([PLAIN, "0,0,1,2,3", "0,-45,1,2,3"], "line 3, column q2_rad", "looks like degrees"),
    "no unit, joint": (
        ["q1,q2_rad,x_mm,y_mm,z_mm", "0,0,1,2,3"],
        "column q1",
        "Rename it to q1_rad or q1_deg",
    ),
    "no unit, map": (
        ["q1_rad,q2_rad,x,y_mm,z_mm", "0,0,1,2,3"],
        "column x",
        'columns = { x_mm = "x" }',
    ),
    "missing": (
        ["q1_rad,x_mm,y_mm,z_mm", "0,1,2,3"],
        "data.csv",
        "column q2_rad or q2_deg is missing",
    ),
    "two units": ([f"{PLAIN},x_m", "0,0,1,2,3,1"], "data.csv", "x_mm and x_m are both there"),
    "name twice": ([f"{PLAIN},x_mm", "0,0,1,2,3,1"], "column x_mm", "appears twice"),
    "header alone": ([PLAIN], "line 1", "no rows. Each measured point is a row."),
    "one joint more": (
        [f"{PLAIN},q3_rad", "0,0,1,2,3,0"],
        "data.csv",
        "joint q3, but the robot has 2",
    ),
    "part of sigma": ([f"{PLAIN},sx_mm", "0,0,1,2,3,1"], "data.csv", "sx_mm without sy_mm, sz_mm"),
    "part of approach": (
        [f"{PLAIN},approach2", "0,0,1,2,3,1"],
        "data.csv",
        "approach2 without approach1",
    ),
    "sigma of nought": (
        [f"{PLAIN},sx_mm,sy_mm,sz_mm", "0,0,1,2,3,1,1,1", "0,0,1,2,3,1,0,1"],
        "line 3, column sy_mm",
        "above zero",
    ),
    "no quaternion": (
        [f"{PLAIN},qw,qx,qy,qz", "0,0,1,2,3,0,0,0,0"],
        "line 2, column qw",
        "length zero",
    ),
    "a quaternion of next to no length": (
        [f"{PLAIN},qw,qx,qy,qz", "0,0,1,2,3,0,0,1e-300,1e-300"],
        "line 2, column qw",
        "length zero",
    ),
    "a quaternion of another length": (
        [f"{PLAIN},qw,qx,qy,qz", "0,0,1,2,3,0.7,0.7,0,0", "1,0,1,2,3,1,1,0,0"],
        "line 3, column qw",
        "a quaternion of length 1.41, where 1 is expected",
    ),
    "empty file": ([""], "data.csv", "empty"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_refused(case, tmp_path) -> None:
    lines, place, message = REFUSED[case]
    with pytest.raises(DataError) as caught:
        read_measurements(csv(tmp_path, *lines), ARM)
    assert place in str(caught.value)
    assert message in str(caught.value)
    assert "data.csv" in str(caught.value)


def test_refused_files(tmp_path) -> None:
    (tmp_path / "odd.csv").write_bytes(PLAIN.encode() + b",na\x81ve\n0,0,1,2,3,1\n")
    (tmp_path / "no.parquet").write_bytes(b"PAR1 is how it begins")
    (tmp_path / "binary.csv").write_bytes(b"\x00\x01\x02\n")
    (tmp_path / "nothing.csv").write_bytes(b"")
    for name in (
        "odd.csv",
        "no.parquet",
        "binary.csv",
        "nothing.csv",
        "absent.csv",
        "absent.parquet",
    ):
        with pytest.raises(DataError, match=name):
            read_measurements(tmp_path / name, ARM)
    with pytest.raises(DataError, match='column "J1", given for q1_rad, is not in the file'):
        read_measurements(csv(tmp_path, PLAIN, "0,0,1,2,3"), ARM, {"q1_rad": "J1"})


def test_every_absent_column_is_named(tmp_path) -> None:
    path = csv(tmp_path, PLAIN, "0,0,1,2,3")
    mapping = {"q1_rad": "J1", "q2_rad": "q2_rda", "x_mm": "away"}
    with pytest.raises(DataError) as mapped:
        read_measurements(path, ARM, mapping)
    assert str(mapped.value) == (
        'data.csv, line 1: columns are not in the file: "J1", given for q1_rad; "q2_rda", given for '
        'q2_rad (did you mean "q2_rad"?); "away", given for x_mm. Known: q1_rad, q2_rad, x_mm, y_mm, '
        "z_mm."
    )
    with pytest.raises(DataError) as absent:
        read_measurements(csv(tmp_path, "q1_rad,x_mm,z_mm", "0,1,3"), ARM)
    assert "columns are missing: q2_rad or q2_deg; y_mm or y_m or y_in or y_inch." in str(
        absent.value
    )
    assert '{ q2_rad = "NAME1", y_mm = "NAME2" }' in str(absent.value)


def test_a_long_list_of_absent_columns_is_cut(tmp_path) -> None:
    path = csv(tmp_path, PLAIN, "0,0,1,2,3")
    mapping = {name: f"{name} {'of the controller ' * 4}" for name in PLAIN.split(",")}
    with pytest.raises(DataError, match=r" and 1 more\. Known: ") as error:
        read_measurements(path, ARM, mapping)
    assert len(str(error.value)) < 700


def test_parquet_refusals_say_the_row(tmp_path) -> None:
    """Row, counted from 0, as every reader of Parquet counts: the file has no lines."""
    path = parquet(
        tmp_path, q1_rad=[0.0, 1.0], q2_rad=[0.0, None], x_mm=[1.0, 2], y_mm=[1.0, 2], z_mm=[1.0, 2]
    )
    with pytest.raises(DataError, match=r"data\.parquet, row 1, column q2_rad"):
        read_measurements(path, ARM)


def test_a_parquet_column_of_moments_is_a_clock(tmp_path) -> None:
    steps = np.arange(3)
    moments = np.datetime64("2025-01-01T00:00:00", "us") + steps * np.timedelta64(90, "s")
    columns = dict.fromkeys(PLAIN.split(","), steps / 10)
    path = parquet(tmp_path, **columns, time_s=moments)
    assert read_measurements(path, ARM).covariates["time_s"].tolist() == [0, 90, 180]


def test_labels_of_the_split(tmp_path) -> None:
    path = csv(tmp_path, f"{PLAIN},role", "0,0,1,2,3,estimation", "1,0,1,2,3,held-out")
    assert read_labels(path, "role").tolist() == ["estimation", "held-out"]
    with pytest.raises(DataError, match=r'"rolle" is missing\. Did you mean "role"'):
        read_labels(path, "rolle")


@pytest.mark.slow
@pytest.mark.parametrize(
    ("scale", "robot", "words"),
    [
        (1e-3, "ur5", "if the positions are metres: name them x_m y_m z_m"),
        (1.0, "irb1600", 'The readings fit robot "ur5" far better'),
    ],
)
def test_far_from_nominal(scale, robot, words, rng) -> None:
    """The median nominal residual above a quarter of the length of the arm's links."""
    data = drawn("ur5", rng, 60).data
    moved = build_measurements(data.q, data.position * scale)
    with pytest.raises(DataError, match=words) as caught:
        prepare(study_with(), load_robot(robot), moved)
    assert "quarter of the length of the arm's links" in str(caught.value)


def test_an_arm_that_stands_is_read_anew(rng) -> None:
    """One configuration all the same, each row predicted from its own readings; what its target
    moved is no noise. Another configuration's readings under its number are refused."""
    q = np.repeat(rng.uniform(-1, 1, (12, 3)), 3, 0)
    table = pd.DataFrame(
        q + rng.normal(0, 1e-4, q.shape), columns=["q1_rad", "q2_rad", "q3_rad"]
    ).assign(
        x_mm=rng.normal(0, 0.1, 36),
        y_mm=rng.normal(0, 0.1, 36),
        z_mm=1.0,
        configuration=np.repeat(np.arange(12), 3),
    )
    data = read_measurements(table, (False,) * 3)
    assert data.configurations == len(np.unique(data.block)) == 12
    assert from_repeats(data, data.group) is None
    still = read_measurements(
        table.assign(q1_rad=q[:, 0], q2_rad=q[:, 1], q3_rad=q[:, 2]), (False,) * 3
    )
    assert from_repeats(still, still.group) is not None
    table.loc[7, "q2_rad"] += 0.01
    with pytest.raises(DataError, match='configuration "2" has other joint readings'):
        read_measurements(table, (False,) * 3)
