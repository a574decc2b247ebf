"""What a study left, and what is read beside it, damaged: every defect that the mutants of
tests/support/fuzz_kinds.py found, once by name."""

from __future__ import annotations

import json

import pytest
from fuzz_base import gauged_files, stored_files
from fuzz_clean import judge_of
from fuzz_engine import tried
from fuzz_judge import refusal_problems
from fuzz_kinds import KINDS, ON_DATA, ON_TARGETS


def stored(name: str, *path: str | int, value: object) -> bytes:
    """A file that a study left, with another value at a place."""
    record = json.loads(stored_files()[name])
    inner = record
    for key in path[:-1]:
        inner = inner[key]
    inner[path[-1]] = value
    return json.dumps(record).encode()


def residuals(**columns: object) -> bytes:
    """residuals.parquet with some columns replaced, or left out (None)."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    table = pq.read_table(pa.BufferReader(stored_files()["residuals.parquet"]))
    for name, values in columns.items():
        at = table.column_names.index(name)
        table = (
            table.remove_column(at)
            if values is None
            else table.set_column(at, name, pa.array(values))
        )
    out = pa.BufferOutputStream()
    pq.write_table(table, out)
    return bytes(out.getvalue())


GOOD, LOAD = stored_files, "load {i}"
FOUND_LATER = {
    "not a number": (
        "calibration",
        lambda: stored("calibration.json", "estimates", 3, "value", value=float("nan")),
        ON_TARGETS[0],
        "NaN is not a number",
    ),
    "beyond all numbers": (
        "calibration",
        lambda: GOOD()["calibration.json"].replace(b'"value": ', b'"value": 1e999, "v": ', 1),
        ON_TARGETS[0],
        "estimates.1.value: expected a finite number",
    ),
    "a number as text": (
        "calibration",
        lambda: stored("calibration.json", "estimates", 3, "value", value="1.5"),
        ON_DATA[0],
        'estimates.4.value: expected a finite number, found "1.5"',
    ),
    "true for a number": (
        "calibration",
        lambda: stored("calibration.json", "tracker_mm", 0, value=True),
        ON_DATA[0],
        "tracker_mm.1: expected a finite number, found true",
    ),
    "a frame and a half": (
        "calibration",
        lambda: stored(
            "calibration.json", "mechanisms", 0, "terms", 0, "screws", 0, "frame", value=4.5
        ),
        ON_DATA[0],
        "frame: expected a whole number, found 4.5",
    ),
    "a frame too far": (
        "calibration",
        lambda: stored(
            "calibration.json", "mechanisms", 0, "terms", 0, "screws", 0, "frame", value=9
        ),
        ON_DATA[0],
        "a screw is at a frame that its robot does not have",
    ),
    "a frame that is none": (
        "calibration",
        lambda: stored("calibration.json", "groups", 0, "rotation", 0, value=[1, 1, 0]),
        ON_DATA[0],
        "three columns are not a rotation",
    ),
    "another covariance": (
        "calibration",
        lambda: stored("calibration.json", "covariance_factor", "rows", 0, 0, value=3.0),
        ON_DATA[0],
        "its standard errors are not those of its covariance_factor",
    ),
    "a key missing": (
        "calibration",
        lambda: GOOD()["calibration.json"].replace(b'"tool_mm"', b'"tool"'),
        ON_DATA[0],
        "targets.1.tool_mm is missing",
    ),
    "a key twice": (
        "calibration",
        lambda: GOOD()["calibration.json"].replace(b"{", b'{"registered": true,', 1),
        ON_DATA[0],
        'the key "registered" stands twice',
    ),
    "no range of a joint": (
        "calibration",
        lambda: GOOD()["calibration.json"].replace(b'"q2": [', b'"q9": ['),
        "export {i} --format csv --out {o}/made",
        "its ranges lack q2",
    ),
    "nested": ("calibration", lambda: b"[" * 100_000, ON_DATA[0], "it is nested too deeply"),
    "no figure": (
        "result",
        lambda: stored("result.json", "ladder", 0, "estimation", value=None),
        LOAD,
        "ladder.1.estimation: expected a table, found null",
    ),
    "a figure of 401 digits": (
        "result",
        lambda: stored("result.json", "noise_floor", "coordinate_mm", value=10**400),
        LOAD,
        "noise_floor.coordinate_mm: expected a finite number",
    ),
    "a finding gone": (
        "result",
        lambda: stored("result.json", "findings", value=[]),
        LOAD,
        "findings has 1 where 0 belong",
    ),
    "a figure that is a list": (
        "result",
        lambda: stored("result.json", "findings", 0, "p_value", value=[0.001]),
        "report {i} --pages findings",
        "findings.1.p_value: expected a finite number, found a list of 1",
    ),
    "rows that are short": (
        "details",
        lambda: stored("details.json", "rungs", 0, "residual_mm", value=[]),
        LOAD,
        "rungs.residual_mm has 0 where 60 belong",
    ),
    "marks without a mean": (
        "details",
        lambda: stored("details.json", "findings", 0, "panels", 0, "x", value=[1.0]),
        "report {i} --pages findings",
        "findings.1.panels has",
    ),
    "no rung": (
        "details",
        lambda: stored("details.json", "base", value=99),
        "report {i}",
        "base is 99, and the ladder has",
    ),
    "lengths as text": (
        "residuals",
        lambda: residuals(base_x_mm=["a"] * 60),
        LOAD,
        "column base_x_mm holds something else",
    ),
    "an endless length": (
        "residuals",
        lambda: residuals(base_x_mm=[float("inf")] * 60),
        LOAD,
        "column base_x_mm holds",
    ),
    "no base": (
        "residuals",
        lambda: residuals(base_x_mm=None),
        LOAD,
        "column base_x_mm is missing",
    ),
    "no rows": ("residuals", lambda: b"PAR1", LOAD, "it is not a Parquet file, or it is damaged"),
}


@pytest.mark.parametrize("case", FOUND_LATER)
def test_found_later(case, tmp_path) -> None:
    """What a study left and someone damaged: refused with its place, and nothing is written."""
    kind, content, command, words = FOUND_LATER[case]
    ran = tried(tmp_path, kind, content(), command)
    assert ran.status == 2, (ran.stdout, ran.stderr)
    assert words in ran.stderr
    assert not refusal_problems(ran, (2,))


def test_what_says_the_same_is_taken(tmp_path) -> None:
    """A byte-order mark, other blanks, a key nobody knows: the same calibration."""
    more = json.loads(stored_files()["calibration.json"]) | {"remark": "measured by Ann"}
    ran = tried(tmp_path, "calibration", b"\xef\xbb\xbf" + json.dumps(more).encode(), ON_DATA[0])
    good = tried(tmp_path / "again", "calibration", stored_files()["calibration.json"], ON_DATA[0])
    assert judge_of(ON_DATA[0]).alike(ran, good)


def test_a_command_that_stands_there_twice_is_corrected_twice(tmp_path) -> None:
    """A program may come back to a pose: a row is a command, not a measurement that counts once."""
    lines = stored_files()["targets.csv"].decode().splitlines()
    ran = tried(tmp_path, "targets", "\n".join([*lines, lines[3]]).encode(), ON_TARGETS[0])
    written = ran.left["commands.csv"].decode().splitlines()
    assert len(written) == len(lines) + 1


def test_the_first_row_of_a_distance_may_stand_there_twice(tmp_path) -> None:
    """As any row that is repeated cell for cell: it counts once."""
    lines = gauged_files()["measurements.csv"].decode().splitlines()
    begins = next(line for line in lines if ",distance," in line)
    ran = tried(
        tmp_path, "gauged", "\n".join([*lines, begins]).encode(), KINDS["gauged"].commands[0]
    )
    assert not ran.status, ran.stderr
    own = [line for line in lines if f"distance,{begins.split(',')[11]}," not in line]
    ran = tried(
        tmp_path, "gauged", "\n".join([*own, begins, begins]).encode(), KINDS["gauged"].commands[0]
    )
    assert ran.status == 3
    assert "has one row" in ran.stderr


def test_a_dry_run_knows_which_rows_a_study_leaves_out(tmp_path) -> None:
    """Held-out rows of a feature that no estimation row measures."""
    content = gauged_files()["measurements.csv"].replace(
        b",same-point,cone,", b",same-point,alone,", 1
    )
    ran = tried(tmp_path, "gauged", content, KINDS["gauged"].first + " --json")
    assert not ran.status, ran.stderr
    found = json.loads(ran.stdout)
    assert any("1 held-out row is left out" in w["sentence"] for w in found["warnings"])
    assert sum(found["configurations"].values()) == found["rows"] - 1
