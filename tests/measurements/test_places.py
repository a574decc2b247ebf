"""The place of every value: lines of a file, rows of a DataFrame or of Parquet, from reading to the
last message."""

from __future__ import annotations

import numpy as np
import pytest
from report_studies import read_source, terminal_lines

from modelsel.config.study_file import Study
from modelsel.exceptions import DataError
from modelsel.measurements.measurements import build_measurements
from modelsel.measurements.reader import read_measurements
from modelsel.report import drawing
from modelsel.report.document import collect_blocks
from modelsel.robot.files import load_robot
from modelsel.study.pipeline.runner import run_study
from modelsel.study.simulation import simulate_points


def spoilt(tmp_path, kind: str, rng: np.random.Generator) -> tuple[object, np.ndarray, str]:
    """(source, rows whose positions are exchanged in pairs, how its user calls them) of an arm of
    three joints."""
    robot = load_robot("ur5")
    frame = simulate_points(
        robot,
        np.array([30.0, 0, 90]),
        [],
        at=build_measurements(robot.draw(rng, 60), np.zeros((60, 3))),
        noise_mm=0.02,
        rng=rng,
    )
    frame["operator"] = "Ann"
    bad = np.sort(rng.choice(60, 4, replace=False))
    place = [frame.columns.get_loc(f"{axis}_mm") for axis in "xyz"]
    frame.iloc[bad, place] = frame.iloc[bad[::-1], place].to_numpy()
    if kind == "frame":
        return (
            frame.set_index(np.arange(1000, 1060)),
            bad,
            f"rows {', '.join(map(str, bad))}, counted from 0",
        )
    if kind == "parquet":
        frame.to_parquet(tmp_path / "data.parquet")
        return tmp_path / "data.parquet", bad, f"rows {', '.join(map(str, bad))}, counted from 0"
    lines = bad + 2
    if kind == "csv with line breaks in cells":
        above = int(rng.integers(0, bad[1]))
        frame.loc[above, "operator"] = 'Ann,\nthen "Bob"\r\nand Carol'
        lines = lines + 2 * (bad > above)
    frame.to_csv(tmp_path / "data.csv", index=False, lineterminator="\n")
    text = (
        (tmp_path / "data.csv").read_bytes().decode().replace("\r\n", "\n").split("\n")
    )  # as an editor counts
    for row, line in zip(bad, lines, strict=True):
        assert text[line - 1].startswith(f"{frame.iloc[row, 0]:.6f}"[:6])
    return tmp_path / "data.csv", bad, f"lines {', '.join(map(str, lines))}"


@pytest.mark.integration
@pytest.mark.parametrize("kind", ["frame", "parquet", "csv", "csv with line breaks in cells"])
def test_rows_are_called_as_their_user_counts(kind, rng, tmp_path) -> None:
    """A fault of the data, from reading to the last message: terminal, result, report of the run
    and of its folder."""
    source, bad, words = spoilt(tmp_path, kind, rng)
    study = Study(
        name="x",
        robot={"name": "ur5", "tool_mm": [30.0, 0.0, 90.0]},
        measurements=source,
        split={"estimation": 60},
        model={"candidates": ["wrist-coupling"]},
    )
    result = run_study(study, tmp_path, sampling=False)
    assert result.record.outliers == bad.tolist()
    assert f"({words})" in " ".join(f.sentence for f in result.diagnosis.faults)
    assert any(
        f"Outliers left out: 4 rows ({words})." in sentence
        for sentence in terminal_lines(result.record, result.details)
    )
    result.save(tmp_path / "out")
    pages = collect_blocks(
        read_source(tmp_path / "out"),
        {"outliers": drawing.PAGES["outliers"], "findings": drawing.PAGES["findings"]},
    )
    shown = [block["text"] for block in pages if block["kind"] == "text"]
    assert any(f"Outliers left out: 4 rows ({words})." in text for text in shown)
    assert any(f"4 rows of the measurements ({words})" in text for text in shown)


def test_a_row_group_counts_from_the_start_of_its_file(tmp_path, rng) -> None:
    import pyarrow as pa
    import pyarrow.parquet as pq

    columns = {f"q{j}_rad": rng.uniform(-1, 1, 30) for j in (1, 2)} | {
        f"{axis}_mm": rng.uniform(1, 2, 30) for axis in "xyz"
    }
    columns["x_mm"][23] = np.nan
    pq.write_table(pa.table(columns), tmp_path / "data.parquet", row_group_size=10)
    with pytest.raises(DataError, match=r"data\.parquet, row 23, column x_mm"):
        read_measurements(tmp_path / "data.parquet", (False, False), group=2)
    read_measurements(tmp_path / "data.parquet", (False, False), group=1)


def test_a_refusal_counts_lines_as_an_editor_does(tmp_path) -> None:
    """A cell of several lines, in the header or above the place."""
    text = '"q1_rad",q2_rad,x_mm,y_mm,z_mm,"note\nof two lines"\n0,0,1,1,1,"a\n\nb"\n0,1,1,1,1,c\n0,2,1,1,wrong,d\n'
    (tmp_path / "data.csv").write_text(text)
    with pytest.raises(DataError, match=r"data\.csv, line 7, column z_mm"):
        read_measurements(tmp_path / "data.csv", (False, False))
    (tmp_path / "data.csv").write_text(text.replace("wrong,d", "1"))
    with pytest.raises(DataError, match=r"data\.csv, line 7: 5 cells, but the header has 6"):
        read_measurements(tmp_path / "data.csv", (False, False))


def test_a_clock_that_contradicts_the_order_is_refused_with_its_rows(tmp_path) -> None:
    """Within a group time_s may not go back while order goes on; whatever order the rows are in."""
    head = "q1_rad,q2_rad,x_mm,y_mm,z_mm,group,order,time_s"
    sound = ["0,0,1,2,3,a,2,20", "1,0,1,2,3,a,1,10", "1,1,1,2,3,b,3,5", "2,1,1,2,3,b,3,4"]
    file = tmp_path / "clock.csv"
    file.write_text("\n".join([head, *sound]))
    assert len(read_measurements(file, (False, False))) == 4

    file.write_text("\n".join([head, *sound, "2,2,1,2,3,b,4,1", "2,3,1,2,3,b,5,0"]))
    with pytest.raises(DataError) as caught:
        read_measurements(file, (False, False))
    assert str(caught.value) == (
        "clock.csv, line 6, column time_s: order goes on from 3 (line 4) to 4, but time_s goes back "
        "from 5 to 1 (and 1 more); within a group both are expected to grow. Correct the column "
        "that is wrong or leave it out; where the clock was started anew, give every session a "
        "name of its own in a column group."
    )


def test_rows_of_one_order_are_told_where_the_arm_moved(tmp_path) -> None:
    """An arm that stands still may be measured again under the same order; groups count anew."""
    head = "q1_rad,q2_rad,x_mm,y_mm,z_mm,group,order"
    sound = ["0,0,1,2,3,a,2", "1,0,1,2,3,a,1", "1,0.0001,1,2,4,a,1", "1,1,1,2,3,b,1"]
    file = tmp_path / "order.csv"
    file.write_text("\n".join([head, *sound]))
    codes = [note.code for note in read_measurements(file, (False, False)).notes]
    assert "orders-equal" not in codes

    file.write_text("\n".join([head, *sound, "2,2,1,2,3,b,1", "2,3,1,2,3,b,1"]))
    notes = read_measurements(file, (False, False)).notes
    (said,) = [note.sentence for note in notes if note.code == "orders-equal"]
    assert said == (
        "order is 1 on line 5 and on line 6, whose joint readings differ (and 1 more): rows with the "
        "same order are taken in the order of the file. Where order was started anew, give every "
        "session a name of its own in a column group."
    )
