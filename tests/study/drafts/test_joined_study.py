"""A tracker's export and a joint log, in two files: joined by name, time or order, and what has no
partner is said."""

from __future__ import annotations

import copy
import itertools
import json
import re
import shutil
from functools import cache

import numpy as np
import pytest
from click.testing import CliRunner, Result

from modelsel.cli.main import run_command_line
from modelsel.exceptions import DataError
from modelsel.measurements.formats.table import DataFile, load_table
from modelsel.measurements.measurements import build_measurements
from modelsel.measurements.pairing.joining import find_joins, join_tables
from modelsel.measurements.pairing.leftover_points import find_repeated_name
from modelsel.measurements.reader import read_measurements
from modelsel.robot.files import load_robot
from modelsel.robot.rigid import rotation_matrix
from modelsel.study.drafts.joined_study import draft_joined_study
from modelsel.study.simulation import simulate_points

ROWS = 40
TOOLS = np.array([[40.0, -25, 120], [-60, 10, 90]])


@cache
def campaign(tool: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """Readings [deg] (m, 6) and the tracker's positions [mm] (m, 3)."""
    rng = np.random.default_rng(5)
    q = rng.uniform(-1.8, 1.8, (ROWS, 6))
    at = build_measurements(q, np.zeros((ROWS, 3)))
    points = simulate_points(load_robot("ur10"), TOOLS[tool], [], at=at, noise_mm=0.05, rng=rng)
    seen = points[["x_mm", "y_mm", "z_mm"]].to_numpy() @ rotation_matrix(2, 0.7).T
    return np.degrees(q).round(5), (seen + np.array([2500, -800, 300])).round(6)


def numbers(row: np.ndarray, mark: str = ", ") -> str:
    return mark.join(f"{value:.6f}" for value in row)


def spatial_analyzer(names: list[str], header: bool = True) -> str:
    """As its manual describes the ASCII export: comments with //, collection, group and target,
    then x y z; without a header line."""
    _, x = campaign()
    comments = ["// SA Version: 2023.2", "// Working frame: A::WORLD"] if header else []
    lines = [
        f"A,  Robot,  {name},  {numbers(row, ',  ')}" for name, row in zip(names, x, strict=True)
    ]
    return "\n".join([*comments, *lines]) + "\n"


def polyworks(names: list[str]) -> str:
    """A table of measured against nominal points, in millimetres."""
    _, x = campaign()
    head = "Name;Nominal X;Nominal Y;Nominal Z;Measured X;Measured Y;Measured Z;Deviation"
    lines = [
        f"{name};{numbers(np.round(row), ';')};{numbers(row, ';')};0,1".replace(".", ",")
        for name, row in zip(names, x, strict=True)
    ]
    return "\n".join([head, *lines]) + "\n"


def leica(start: int = 8 * 3600, step: float = 11.0) -> str:
    """Point, coordinates, date and time of day; blanks between."""
    _, x = campaign()
    lines = [
        f"{k + 1} {numbers(row, ' ')} 21.05.2026 {clock(start + step * k)}"
        for k, row in enumerate(x)
    ]
    return "\n".join(lines) + "\n"


def to_contract(text: str, separator: str, columns: dict[int, str]) -> str:
    """The same lines below names of the contract, where these are the columns to keep."""
    lines = [line.split(separator) for line in text.splitlines()]
    kept = [separator.join(line[k] for k in columns) for line in lines]
    return "\n".join([separator.join(columns.values()), *kept]) + "\n"


def clock(seconds: float) -> str:
    whole = int(seconds)
    return f"{whole // 3600:02d}:{whole // 60 % 60:02d}:{seconds % 60:06.3f}"


def log(names: list[str]) -> str:
    """A controller's log with a name, its own position, and a header."""
    q, x = campaign()
    head = "Punkt;A1;A2;A3;A4;A5;A6;X;Y;Z"
    lines = [
        f"{name};{numbers(row, ';')};{numbers(own + 1, ';')}"
        for name, row, own in zip(names, q, x, strict=True)
    ]
    return "\n".join([head, *lines]) + "\n"


def dense_log(start: int = 8 * 3600, step: float = 11.0) -> str:
    """Ten readings around every point, the arm standing, and the time of day."""
    q, _ = campaign()
    lines = ["Time,J1,J2,J3,J4,J5,J6"]
    for k, row in enumerate(q):
        moments = [start + step * k + tick * 0.1 + 0.02 for tick in range(-5, 5)]
        lines += [f"{clock(moment)},{numbers(row, ',')}" for moment in moments]
    return "\n".join(lines) + "\n"


def plain_log() -> str:
    """A number and six readings in radians, as a script on the controller prints them."""
    q, _ = campaign()
    rows = [f"{k + 1},{numbers(np.radians(row), ',')}" for k, row in enumerate(q)]
    return "\n".join(rows) + "\n"


NAMES = [f"P{k + 1:03d}" for k in range(ROWS)]


@pytest.fixture(autouse=True)
def _here(tmp_path, monkeypatch) -> None:
    monkeypatch.chdir(tmp_path)


def invoked(*words: str) -> Result:
    fixed = ("init", "points.txt", "--joints", "log.txt", "--robot", "ur10", "--yes", "--out", "s")
    return CliRunner().invoke(run_command_line, [*fixed, *words])


def written(tmp_path, points: str, readings: str) -> None:
    (tmp_path / "points.txt").write_text(points, encoding="utf-8")
    (tmp_path / "log.txt").write_text(readings, encoding="utf-8")


def check(folder, rows: list[int]) -> None:
    """The study's measurements are the campaign's rows, in the order of the log."""
    q, x = campaign()
    data = read_measurements(folder / "s" / "measurements.csv", load_robot("ur10"))
    assert np.allclose(np.degrees(data.q), q[rows], atol=2e-4)
    assert np.allclose(data.position, x[rows], atol=1e-6)


ALL = list(range(ROWS))
PAIRS = {
    "Spatial Analyzer, names": (spatial_analyzer(NAMES), log(NAMES), 'by name ("point" = "Punkt")'),
    "numbers and names": (
        spatial_analyzer([f"A::Robot::{k + 1}" for k in range(ROWS)]),
        log(NAMES),
        "by name",
    ),
    "PolyWorks": (polyworks(NAMES), log(NAMES), 'by name ("Name" = "Punkt")'),
    "no header in either": (
        "\n".join(f"{k + 1},  {numbers(x)}" for k, x in enumerate(campaign()[1])),
        plain_log(),
        'by name ("point" = "point")',
    ),
    "Leica, time": (
        leica(),
        dense_log(),
        'by nearest time ("time" and "Time", at most 0.0200 s apart)',
    ),
    "order": (
        "X;Y;Z\n" + "\n".join(numbers(x, ";") for x in campaign()[1]),
        log(NAMES),
        "row by row, in their order",
    ),
}


@pytest.mark.parametrize("pair", PAIRS)
def test_two_files_become_one_study(pair, tmp_path) -> None:
    points, readings, words = PAIRS[pair]
    written(tmp_path, points, readings)
    ran = invoked()
    assert ran.exit_code == 0, ran.output
    assert f"Joined {words}" in ran.stdout
    assert f": {ROWS} of {ROWS} points." in ran.stdout
    assert "the nominal arm fits to 0.0" in ran.stdout
    check(tmp_path, ALL)
    dry = CliRunner().invoke(run_command_line, ["study", "s", "--dry-run"])
    assert dry.exit_code == 0, dry.output


def test_rows_in_another_order_and_missing_ones_are_said(tmp_path) -> None:
    """Point 3 was not measured, reading 7 not logged, and the export is sorted otherwise."""
    points = spatial_analyzer(NAMES).splitlines()
    del points[2 + 2]
    readings = log(NAMES).splitlines()
    del readings[1 + 6]
    written(tmp_path, "\n".join([*points[:2], *reversed(points[2:])]), "\n".join(readings))
    ran = invoked()
    assert ran.exit_code == 0, ran.output
    assert f": {ROWS - 2} of {ROWS - 1} points." in ran.stdout
    line = 2 + ROWS - 1 - 5
    assert f"(points.txt, line {line})" in ran.stdout
    assert "(log.txt, line 4)." in ran.stdout
    assert "the controller's own coordinates: X, Y, Z" in ran.stdout
    check(tmp_path, [k for k in ALL if k not in (2, 6)])
    # the arm went to the place that was not measured: the next row is approached from there
    data = read_measurements(tmp_path / "s" / "measurements.csv", load_robot("ur10"))
    q, _ = campaign()
    assert (data.approach[2] == np.sign(q[3] - q[2])).all()
    assert not (np.sign(q[3] - q[2]) == np.sign(q[3] - q[1])).all()


@pytest.mark.parametrize("again", ["P006_2", "P006 (2)", "P006-rep"])
def test_a_repeated_shot_is_a_row_of_its_own(again, tmp_path) -> None:
    """The first shot of point 6 is 0.7 mm off; it was shot again, which the joint log does not know."""
    _, x = campaign()
    good = x[5] + 0.01
    lines = [f"{name},{numbers(row, ',')}" for name, row in zip(NAMES, x, strict=True)]
    lines[5] = f"P006,{numbers(x[5] + 0.4, ',')}"
    lines.insert(6, f"{again},{numbers(good, ',')}")
    written(tmp_path, "\n".join(["Point,X,Y,Z", *lines]), log(NAMES))
    ran = invoked()
    assert ran.exit_code == 0, ran.output
    assert f": {ROWS + 1} of {ROWS + 1} points." in ran.stdout
    assert "Taken for a repeated shot" in ran.stdout
    assert "the study" not in ran.stdout.partition("Taken for")[2].partition("\n")[0]
    assert f"{again} (points.txt, line 8)" in ran.stdout
    data = read_measurements(tmp_path / "s" / "measurements.csv", load_robot("ur10"))
    assert (len(data), data.configurations) == (ROWS + 1, ROWS)
    assert np.allclose(data.position[6], good, atol=1e-6)


def test_fixed_points_at_the_start_and_the_end_tell_the_drift(tmp_path) -> None:
    _, x = campaign()
    lines = [f"{name},robot,{numbers(row, ',')}" for name, row in zip(NAMES, x, strict=True)]
    first = "NEST_A_start,drift,100,200,300"
    last = "NEST_A_end,drift,100,200.03,300.04"
    written(
        tmp_path, "\n".join(["Point,Group,X [mm],Y [mm],Z [mm]", first, *lines, last]), log(NAMES)
    )
    ran = invoked()
    assert ran.exit_code == 0, ran.output
    assert "the fixed points moved: NEST_A by 0.050 mm." in ran.stdout
    assert "NEST_A_start (drift), NEST_A_end (drift) (points.txt, lines 2, 43)" in ran.stdout
    assert "as groups" not in ran.stdout


def test_clocks_that_differ_are_told_where_names_join(tmp_path) -> None:
    """A log 37 s behind, joined by name: said, and nothing else changes."""
    q, x = campaign()
    points = ["Point,X,Y,Z,Date,Time"]
    readings = ["time,Punkt,J1,J2,J3,J4,J5,J6,speed_pct,RMS,load_kg"]
    for k, name in enumerate(NAMES):
        seen = clock(9 * 3600 + 40.0 * k)
        logged = clock(9 * 3600 + 40.0 * k - 37.0)
        points.append(f"{name},{numbers(x[k], ',')},2025-06-17,{seen}")
        readings.append(
            f"2025-06-17T{logged},{name},{numbers(q[k], ',')},30,{0.01 + 0.001 * (k % 5)},{k % 3}"
        )
    written(tmp_path, "\n".join(points), "\n".join(readings))
    ran = invoked()
    assert ran.exit_code == 0, ran.output
    assert "The joint log's clock is 37.0 s behind the instrument's" in ran.stdout
    assert 'Looked at as possible causes of errors, too: "RMS".' in ran.stdout
    assert 'nothing can depend on it: "speed_pct".' in ran.stdout
    assert "payload_kg: its weight is taken to act at the target" in ran.stdout
    check(tmp_path, ALL)


@pytest.mark.parametrize("name", ["P031", "P031_2_x", "Q9_2", "P1_2"])
def test_other_names_are_no_repeats(name) -> None:
    assert find_repeated_name(name, {"P031", "P2", "P1", name}, {"P031", "P2", "P1_2"}) is None


@pytest.mark.parametrize(
    "header", ["Collection,Reflector,Point,X,Y,Z", "Job,Group,Point,X,Y,Z", ""]
)
def test_two_reflectors_by_group(header, tmp_path) -> None:
    """A group per reflector, every point name twice, whatever the column is called."""
    _, first = campaign(0)
    _, second = campaign(1)
    lines = [
        f"A,{group},{name},{numbers(row, ',')}"
        for group, x in (("SMR1", first), ("SMR2", second))
        for name, row in zip(NAMES, x, strict=True)
    ]
    written(tmp_path, "\n".join([header, *lines]).lstrip(), log(NAMES))
    ran = invoked()
    assert ran.exit_code == 0, ran.output
    data = read_measurements(tmp_path / "s" / "measurements.csv", load_robot("ur10"))
    assert data.targets == ("SMR1", "SMR2")
    assert (len(data), data.configurations) == (2 * ROWS, ROWS)


def test_points_measured_twice_are_not_two_reflectors(tmp_path) -> None:
    """Two groups of one reflector, a tenth of a millimetre apart: repeats."""
    _, x = campaign()
    lines = [
        f"A,{group},{name},{numbers(row + shift, ',')}"
        for group, shift in (("morning", 0.0), ("evening", 0.1))
        for name, row in zip(NAMES, x, strict=True)
    ]
    written(tmp_path, "\n".join(lines), log(NAMES))
    assert invoked().exit_code == 0
    data = read_measurements(tmp_path / "s" / "measurements.csv", load_robot("ur10"))
    assert (len(data), len(data.targets)) == (2 * ROWS, 1)


def shifted() -> tuple[str, str]:
    """As many rows, but the clocks say that every point belongs to the reading before it."""
    q, x = campaign()
    points = ["Time;X;Y;Z"]
    points += [f"{clock(3600 + 10 * k)};{numbers(row, ';')}" for k, row in enumerate(x)]
    readings = ["Time;J1;J2;J3;J4;J5;J6"]
    readings += [f"{clock(3600 + 10 * (k + 1))};{numbers(row, ';')}" for k, row in enumerate(q)]
    return "\n".join(points), "\n".join(readings)


def test_of_two_ways_that_differ_the_arm_tells(tmp_path) -> None:
    written(tmp_path, *shifted())
    ran = invoked()
    assert ran.exit_code == 0, ran.output
    assert "Joined by order, the nominal arm fits to 0.0" in ran.stdout
    check(tmp_path, ALL)


def test_where_the_arm_fits_neither_both_are_told(tmp_path) -> None:
    points, readings = shifted()
    written(tmp_path, points, readings)
    robot = load_robot("ur5")
    files = (DataFile(tmp_path / "points.txt"), DataFile(tmp_path / "log.txt"))
    with pytest.raises(DataError, match=r"in two ways that differ.*--join time or --join order"):
        draft_joined_study(*files, robot, {})
    asked = draft_joined_study(*files, robot, {}, "order")
    assert len(asked.table) == ROWS


def test_files_that_nothing_joins_are_refused_with_every_reason(tmp_path) -> None:
    points = "\n".join(spatial_analyzer([f"K{7000 + k}" for k in range(ROWS)]).splitlines()[:-3])
    written(tmp_path, points, log(NAMES))
    ran = invoked()
    assert ran.exit_code == 3
    said = ran.stderr
    assert 'by name: "point" and "Punkt" have 0 of 37 points in common' in said
    assert "by time: points.txt has no column of times" in said
    assert f"by order: {ROWS - 3} points and {ROWS} rows" in said
    wanted = invoked("--join", "time")
    assert wanted.exit_code == 3
    assert "by order" not in wanted.stderr


def test_times_too_far_apart_are_no_match(tmp_path) -> None:
    written(tmp_path, leica(), dense_log(start=8 * 3600 + 4))
    ran = invoked()
    assert ran.exit_code == 3
    assert f"0 of {ROWS} points have readings within 0.5 s; the median gap is 3.52 s" in ran.stderr
    assert invoked("--max-gap", "4").exit_code == 0


def test_a_spoilt_coordinate_is_told_in_its_own_file(tmp_path) -> None:
    points = spatial_analyzer(NAMES).splitlines()
    points.insert(2, "Collection, Group, Point, X, Y, Z")
    points[10] = points[10].rpartition(",")[0] + ", lost"
    written(tmp_path, "\n".join(points), log(NAMES))
    ran = invoked()
    assert ran.exit_code == 3
    assert "points.txt, line 11, column Z: expected a finite number" in ran.stderr


def test_a_spoilt_reading_is_told_in_the_log(tmp_path) -> None:
    readings = log(NAMES).splitlines()
    cells = readings[9].split(";")
    readings[9] = ";".join([*cells[:3], "?", *cells[4:]])
    written(tmp_path, spatial_analyzer(NAMES), "\n".join(readings))
    ran = invoked()
    assert ran.exit_code == 3
    assert (
        "log.txt, line 10, column A3" in ran.stderr
        or "log.txt, line 10, column q3_deg" in ran.stderr
    )


def test_the_rows_of_a_join_keep_the_lines_of_the_log(tmp_path) -> None:
    written(tmp_path, spatial_analyzer(NAMES), log(NAMES))
    points = load_table(DataFile(tmp_path / "points.txt", headerless=True))
    readings = load_table(tmp_path / "log.txt")
    joins, reasons = find_joins(points, readings, 0.5)
    assert set(joins) == {"name", "order"}
    assert set(reasons) == {"time"}
    joined = join_tables(points, readings, joins["name"])
    assert [joined.where.number(row) for row in (0, ROWS - 1)] == [2, ROWS + 1]


def test_a_log_without_rows_is_told(tmp_path) -> None:
    written(tmp_path, spatial_analyzer(NAMES), "Time,J1,J2,J3,J4,J5,J6\n")
    ran = invoked()
    assert (ran.exit_code, "log.txt, line 1: a header, but no rows" in ran.stderr) == (3, True)


def test_json_says_what_was_done(tmp_path) -> None:
    written(tmp_path, spatial_analyzer(NAMES), log(NAMES))
    told = json.loads(invoked("--json").stdout)
    assert told["columns"]["q1_deg"] == "A1"
    assert any("Joined by name" in sentence for sentence in told["said"])


@pytest.mark.parametrize(
    ("comment", "factor", "column"),
    [
        ("// Units: Inches, Degrees, Fahrenheit", 25.4, "x_in"),
        ("// Units: Meters", 1000.0, "x_m"),
        ("// Units: mm", 1.0, "x_mm"),
    ],
)
def test_a_comment_says_the_unit_of_the_positions(tmp_path, comment, factor, column) -> None:
    """As Spatial Analyzer writes it; the values alone would be taken for mm."""
    q, x = campaign()
    head = f"{comment}\n" + ",".join([f"J{k}" for k in range(1, 7)] + list("XYZ"))
    rows = [numbers(row, ",") for row in np.hstack([q, x / factor])]
    file = tmp_path / "m.csv"
    file.write_text("\n".join([head, *rows]) + "\n")
    ran = CliRunner().invoke(
        run_command_line,
        ["init", str(file), "--robot", "ur10", "--yes", "--out", str(tmp_path / "s")],
    )
    assert ran.exit_code == 0, ran.output
    unit = {"x_in": "inches"}.get(column, column[2:])
    said = f'"X", "Y", "Z" are in {unit}, as the comment on line 1 says.'
    assert said in ran.stdout
    assert "the nominal arm fits to 0.0" in ran.stdout
    names = {f"q{k}_deg": f"J{k}" for k in range(1, 7)}
    mapped = {axis + column[1:]: axis.upper() for axis in "xyz"}
    data = read_measurements(file, load_robot("ur10"), names | mapped)
    np.testing.assert_allclose(data.position, x, atol=1e-3)
    other = "m" if column == "x_mm" else "mm"
    wrong = {f"{axis}_{other}": axis.upper() for axis in "xyz"}
    with pytest.raises(
        DataError, match=f'read as x_{other}, but the line of units says "{column[2:]}"'
    ):
        read_measurements(file, load_robot("ur10"), names | wrong)
    file.write_text(file.read_text().replace("X,Y,Z", "X [km],Y [m],Z [mm]"))
    with pytest.raises(DataError, match="says that lengths are in"):
        load_table(file)


def test_joined_points_keep_the_unit_of_their_comment(tmp_path) -> None:
    names = [f"P{k}" for k in range(ROWS)]
    _, x = campaign()
    rows = [f"A, Robot, {name}, {numbers(row / 25.4)}" for name, row in zip(names, x, strict=True)]
    (tmp_path / "p.txt").write_text("\n".join(["// Units: Inches", *rows]) + "\n")
    (tmp_path / "log.csv").write_text(log(names))
    robot = load_robot("ur10")
    draft = draft_joined_study(
        DataFile(tmp_path / "p.txt"), DataFile(tmp_path / "log.csv"), robot, {}
    )
    assert draft.columns["x_in"] == "X"
    np.testing.assert_allclose(draft.read().position, x, atol=1e-3)


def two_files(tmp_path, ahead: float = 0.0) -> tuple[DataFile, DataFile]:
    """An instrument's points, the first and last of a nest on the floor, and a log without names
    whose clock is ahead; times at odd intervals."""
    q, x = campaign()
    seconds = np.cumsum(np.random.default_rng(4).uniform(8, 40, ROWS)) + 8 * 3600
    lines = ["Group,Point,X,Y,Z,Timestamp", f"Nest,N1,1,2,3,2026-05-21 {clock(seconds[0] - 60)}"]
    lines += [
        f"Robot,P{k},{numbers(x[k], ',')},2026-05-21 {clock(seconds[k])}" for k in range(ROWS)
    ]
    lines += [f"Nest,N1,1,2,3,2026-05-21 {clock(seconds[-1] + 60)}"]
    (tmp_path / "p.txt").write_text("\n".join(lines) + "\n")
    rows = [f"2026-05-21 {clock(seconds[k] + ahead)},{numbers(q[k], ',')}" for k in range(ROWS)]
    head = ",".join(["Time", *(f"J{k}" for k in range(1, 7))])
    (tmp_path / "log.csv").write_text("\n".join([head, *rows]) + "\n")
    return DataFile(tmp_path / "p.txt"), DataFile(tmp_path / "log.csv")


def test_points_left_out_are_named_and_times_are_kept(tmp_path) -> None:
    draft = draft_joined_study(*two_files(tmp_path), load_robot("ur10"), {})
    said = " ".join(draft.remarks)
    assert "Points without joint readings: N1 (Nest) (2 times) (p.txt, lines 2, 43)." in said
    time_s = draft.read().covariates["time_s"]
    assert time_s[0] == pytest.approx(60, abs=0.01)
    assert (np.diff(time_s) > 7).all()


def test_a_constant_clock_offset_is_proposed_not_used(tmp_path) -> None:
    files = two_files(tmp_path, ahead=3731.0)
    robot = load_robot("ur10")
    with pytest.raises(
        DataError, match="3731 s ahead: 40 gaps are about equal; --clock-offset 3731"
    ):
        draft_joined_study(*files, robot, {}, "time")
    with pytest.raises(DataError, match=r"Say --clock-offset or --max-gap") as refused:
        draft_joined_study(*files, robot, {})
    assert "or of times" not in str(refused.value)
    draft = draft_joined_study(*files, robot, {}, "time", clock_offset=3731.0)
    assert len(draft.read()) == ROWS


def standing_log(ahead: float, rng: np.random.Generator) -> str:
    """Readings twice a second of an arm that stands for about six of eleven seconds at every pose and
    goes on to the next; the times of a clock that is `ahead`."""
    q, _ = campaign()
    arrives = 8 * 3600 + 11.0 * np.arange(ROWS) - rng.uniform(2, 4, ROWS)
    leaves = arrives + 6
    moments = np.arange(arrives[0] - 20, leaves[-1] + 20, 0.5)
    knots = np.stack([arrives, leaves], 1).ravel()
    at = np.stack([np.interp(moments, knots, np.repeat(column, 2)) for column in q.T], 1)
    rows = [f"{clock(t + ahead)},{numbers(row, ',')}" for t, row in zip(moments, at, strict=True)]
    return "\n".join(["Time,J1,J2,J3,J4,J5,J6", *rows]) + "\n"


READINGS = {0: "Time"} | {k: f"q{k}_deg" for k in range(1, 7)}
POSITIONS = {1: "x_mm", 2: "y_mm", 3: "z_mm", 5: "Time"}


BY_TIME = ("--join", "time")
AHEAD = {"readings near": (9, 25), "none near": (1000, 4000), "behind": (-60, -9)}
CONTRACTS = ("", "points", "log", "points and log")
# Every offset and every file below the contract's names at once, each way; the rest are slow
CLOCKS = {
    ("readings near", (), ""),
    ("none near", (), "points"),
    ("behind", BY_TIME, "log"),
    ("readings near", BY_TIME, "points and log"),
}


@pytest.mark.parametrize(
    ("ahead", "way", "contract"),
    [
        pytest.param(*clock, marks=() if clock in CLOCKS else pytest.mark.slow)
        for clock in itertools.product(AHEAD, ((), BY_TIME), CONTRACTS)
    ],
)
def test_a_dense_log_whose_clock_differs_is_told_by_the_arm(ahead, way, contract, tmp_path) -> None:
    """Whether the wrong readings are near in time or none are, and whatever columns are called: the
    offset is proposed, nothing is written; with it the rows are the campaign's."""
    rng = np.random.default_rng(535)
    seconds = rng.uniform(*AHEAD[ahead])
    points, readings = leica(), standing_log(seconds, rng)
    if "points" in contract:
        points = to_contract(points, " ", POSITIONS)
    if "log" in contract:
        readings = to_contract(readings.split("\n", 1)[1], ",", READINGS)
    written(tmp_path, points, readings)
    ran = invoked(*way)
    assert ran.exit_code == 3, ran.output
    assert not (tmp_path / "s").exists()
    found = re.search(r"say --clock-offset (\S+) \((\S+) to (\S+) s fit alike", ran.stderr)
    assert found, ran.stderr
    offset, first, last = map(float, found.groups())
    assert first - 0.5 < seconds < last + 0.5
    assert abs(offset - seconds) < 5
    ran = invoked("--clock-offset", found[1])
    assert ran.exit_code == 0, ran.output
    check(tmp_path, ALL)


def test_readings_of_an_arm_in_motion_are_told(tmp_path) -> None:
    """Of a clock that is a little ahead, six points have readings of the way to their pose: the arm
    fits in the median, and what is wrong is said. With the offset that is proposed nothing is."""
    rng = np.random.default_rng(559)
    lags = np.sort(copy.deepcopy(rng).uniform(2, 4, ROWS))
    written(tmp_path, leica(), standing_log(lags[6], rng))
    ran = invoked()
    assert ran.exit_code == 0, ran.output
    assert f"of {ROWS} points have the readings of an arm in motion: " in ran.stdout
    found = re.search(r"say --clock-offset (\S+) \(", " ".join(ran.stdout.split()))
    assert found, ran.stdout
    shutil.rmtree("s")
    ran = invoked("--clock-offset", found[1])
    assert "in motion" not in ran.stdout
    check(tmp_path, ALL)


@pytest.mark.integration
@pytest.mark.parametrize(
    ("count", "told"),
    [
        (ROWS, "No offset was found at which the nominal arm fits."),
        (11, "An offset at which the nominal arm fits was not looked for, since"),
    ],
)
def test_clocks_that_explain_nothing_are_doubted(count, told, tmp_path) -> None:
    """The readings are mixed up: no offset fits, and that the clocks may differ is said. Of few
    points none is looked for."""
    rng = np.random.default_rng(584)
    log_lines = standing_log(0.0, rng).splitlines()
    mixed = [line.split(",") for line in log_lines[1:]]
    lines = [f"{t},{j2},{j1},{j3},{j5},{j4},{j6}" for t, j1, j2, j3, j4, j5, j6 in mixed]
    points = "\n".join(leica().splitlines()[:count]) + "\n"
    written(tmp_path, points, "\n".join([log_lines[0], *lines]) + "\n")
    ran = invoked()
    assert ran.exit_code == 0, ran.output
    assert told in ran.stdout


def test_swapped_files_are_told(tmp_path) -> None:
    points, readings = two_files(tmp_path)
    with pytest.raises(DataError, match=r"the other way round: p\.txt, and --joints log\.csv"):
        draft_joined_study(readings, points, load_robot("ur10"), {})


def test_what_was_compared_by_name_is_told(tmp_path) -> None:
    points, _ = two_files(tmp_path)
    (tmp_path / "log.csv").write_text(log([f"P{k % 20}" for k in range(ROWS)]))
    with pytest.raises(
        DataError, match=r'"Point" and "\w+" have 20 of 42 .* stands 2 times in log'
    ):
        draft_joined_study(points, DataFile(tmp_path / "log.csv"), load_robot("ur10"), {}, "name")


def test_full_names_tell_the_reflectors(tmp_path) -> None:
    """Collection, group and point in one word, and nothing else but X Y Z."""
    lines = [
        f"Job1::SMR{tool + 1}::{name} {numbers(row, ' ')}"
        for tool in range(2)
        for name, row in zip(NAMES, campaign(tool)[1], strict=True)
    ]
    written(tmp_path, "\n".join(lines), log(NAMES))
    ran = invoked()
    assert ran.exit_code == 0, ran.output
    assert '"Group" tells the reflectors of one configuration apart.' in ran.stdout
    data = read_measurements(tmp_path / "s" / "measurements.csv", load_robot("ur10"))
    assert data.targets == ("SMR1", "SMR2")
    assert (len(data), data.configurations) == (2 * ROWS, ROWS)


def test_a_name_that_stands_twice_is_no_reason_to_join_row_by_row(tmp_path) -> None:
    twice = [*NAMES[:10], NAMES[3], *NAMES[11:]]
    written(tmp_path, spatial_analyzer(NAMES), log(twice))
    ran = invoked()
    assert ran.exit_code == 3
    assert '"p004" stands 2 times in its column "Punkt"' in ran.stderr
    assert "or say --join order" in ran.stderr
    assert invoked("--join", "order").exit_code == 0


def test_times_that_are_used_are_not_said_to_be_unused(tmp_path) -> None:
    written(tmp_path, leica(), dense_log())
    ran = invoked()
    assert '"time" of the points is time_s, from the first point on.' in ran.stdout
    unused = [line for line in ran.stdout.splitlines() if line.startswith("Not used")]
    assert not any('"Time"' in line or '"time"' in line for line in unused)


def test_numbers_and_times_that_joined_are_no_causes(tmp_path) -> None:
    """A number of the point in the log, in another order; then seconds since 1970 in both files."""
    q, x = campaign()
    order = np.random.default_rng(3).permutation(ROWS)
    readings = [f"{k + 1},{numbers(q[k], ',')}" for k in order]
    head = ",".join(["pt", *(f"J{k}" for k in range(1, 7))])
    written(tmp_path, spatial_analyzer(NAMES), "\n".join([head, *readings]) + "\n")
    ran = invoked()
    assert '= "pt"): 40 of 40 points.' in ran.stdout
    assert "possible causes" not in ran.stdout
    seconds = 1743724195.0 + np.cumsum(np.random.default_rng(4).uniform(8, 40, ROWS))
    points = [f"{numbers(x[k], ',')},{seconds[k]:.3f}" for k in range(ROWS)]
    readings = [f"{seconds[k]:.3f},{numbers(q[k], ',')}" for k in range(ROWS)]
    points = ["X,Y,Z,stamp", *points]
    written(tmp_path, "\n".join(points), "\n".join([head.replace("pt", "timestamp"), *readings]))
    shutil.rmtree("s")
    ran = invoked()
    assert '"stamp" of the points is time_s, from the first point on.' in ran.stdout
    assert "possible causes" not in ran.stdout
    data = read_measurements(tmp_path / "s" / "measurements.csv", load_robot("ur10"))
    assert set(data.covariates) == {"time_s"}
