"""Two files with a few empty cells are joined by what the other cells say, and told what has no partner."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from exact import flanges_of

from modelsel.exceptions import DataError
from modelsel.measurements.formats.table import DataFile
from modelsel.robot.files import load_robot
from modelsel.study.drafts.joined_study import draft_joined_study
from modelsel.study.drafts.new_study import StudyDraft

ROWS = 30
AXES = ("X [mm]", "Y [mm]", "Z [mm]")
ROBOT = load_robot("ur5")


def write(rng: np.random.Generator) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Points and readings, whose rows are in another order."""
    q = ROBOT.draw(rng, ROWS)
    flange = flanges_of(ROBOT, q)
    x = flange[:, :3, 3] + flange[:, :3, :3] @ np.array([40.0, -25.0, 100.0])
    names = [f"P{k + 1:03d}" for k in range(ROWS)]
    clock = [f"2026-01-05 10:{k // 6:02d}:{10 * (k % 6):02d}" for k in range(ROWS)]
    points = pd.DataFrame({"Name": names, **dict(zip(AXES, x.T, strict=True)), "Time": clock})
    degrees = np.degrees(q)
    readings = {f"J{j + 1} [deg]": column for j, column in enumerate(degrees.T)}
    log = pd.DataFrame({"Pose": names, **readings, "Timestamp": clock})
    return points.astype(object), log.astype(object)


def join(folder: Path, points: pd.DataFrame, log: pd.DataFrame) -> StudyDraft:
    points.to_csv(folder / "points.csv", index=False)
    log.to_csv(folder / "log.csv", index=False)
    files = (DataFile(folder / name) for name in ("points.csv", "log.csv"))
    return draft_joined_study(*files, ROBOT, {})


def test_a_point_without_a_name_has_no_partner(rng, tmp_path) -> None:
    """The column of names was none: the rows were joined in their order, or not at all."""
    points, log = write(rng)
    order = rng.permutation(ROWS)
    points, log = points.drop(columns="Time"), log.drop(columns="Timestamp").iloc[order]
    row, other = (int(k) for k in rng.choice(ROWS, 2, replace=False))
    points.loc[row, "Name"] = None
    log.loc[other, "Pose"] = None
    draft = join(tmp_path, points, log)
    said = " ".join(draft.remarks)
    assert f'Joined by name ("Name" = "Pose"): {ROWS - 2} of {ROWS} points.' in said
    assert f"P{other + 1:03d}" in said
    assert f"lines {min(row, other) + 2}, {max(row, other) + 2}" in said.replace(" and ", ", ")
    data = draft.read()
    flange = flanges_of(ROBOT, data.q)
    expected = flange[:, :3, 3] + flange[:, :3, :3] @ np.array([40.0, -25.0, 100.0])
    np.testing.assert_allclose(data.position, expected, atol=1e-6)


def test_a_point_without_coordinates_was_missed(rng, tmp_path) -> None:
    """It was refused, as a cell to be corrected."""
    points, log = write(rng)
    row = int(rng.integers(ROWS))
    points.loc[row, list(AXES)] = None
    draft = join(tmp_path, points, log)
    assert len(draft.read()) == ROWS - 1
    assert any("because there is no position" in one.sentence for one in draft.read().notes)


def test_a_point_without_one_coordinate_is_refused(rng, tmp_path) -> None:
    points, log = write(rng)
    row = int(rng.integers(ROWS))
    points.loc[row, "Y [mm]"] = None
    with pytest.raises(DataError, match=rf"points.csv, line {row + 2}, column Y \[mm\]"):
        join(tmp_path, points, log)


def test_a_row_without_a_time_is_left_out(rng, tmp_path) -> None:
    """The rest is joined by time, though there are as many rows in another order."""
    points, log = write(rng)
    order = rng.permutation(ROWS)
    points, log = points.drop(columns="Name"), log.drop(columns="Pose").iloc[order]
    points.loc[int(rng.integers(ROWS)), "Time"] = None
    draft = join(tmp_path, points, log)
    said = " ".join(draft.remarks)
    assert "Joined by nearest time" in said
    assert f"{ROWS - 1} of {ROWS} points" in said


def test_rows_in_the_same_order_keep_the_one_without_a_time(rng, tmp_path) -> None:
    """By the other times the order of the rows is the right one."""
    points, log = write(rng)
    points, log = points.drop(columns="Name"), log.drop(columns="Pose")
    log.loc[int(rng.integers(ROWS)), "Timestamp"] = None
    draft = join(tmp_path, points, log)
    assert f"Joined row by row, in their order: {ROWS} of {ROWS} points." in " ".join(draft.remarks)
