"""Held-out rows on an unknown side of a step are left out of the held-out errors, and told."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest
from builders import OFF_AXIS
from exact import flanges_of

from modelsel import Study, run_study
from modelsel.notices import STEP_SIDE_OPEN
from modelsel.robot.files import load_robot
from modelsel.study.pipeline.result import Result

ROBOT = load_robot("puma760")
ROWS, FIRST = 90, 50
NOISE = 0.03


def moved_instrument(held_out: list[int], rng: np.random.Generator) -> Study:
    """A campaign whose instrument is moved by 1 mm before row FIRST."""
    q = ROBOT.draw(rng, ROWS)
    flange = flanges_of(ROBOT, q)
    position = flange[:, :3, 3] + flange[:, :3, :3] @ np.array(OFF_AXIS)
    position[FIRST:] += [0.6, -0.8, 0.0]
    position += rng.normal(0, NOISE, position.shape)
    frame = pd.DataFrame({f"q{k + 1}_rad": q[:, k] for k in range(ROBOT.n)})
    frame[["x_mm", "y_mm", "z_mm"]] = position
    frame["role"] = ["held-out" if k in held_out else "estimation" for k in range(ROWS)]
    return Study(
        name="moved",
        robot={"name": "puma760", "tool_mm": OFF_AXIS},
        measurements=frame,
        split={"column": "role"},
        model={"candidates": ["tracker-step", "zero-step"]},
    )


def run(held_out: list[int], rng: np.random.Generator) -> tuple[Result, list[str]]:
    result = run_study(moved_instrument(held_out, rng), sampling=False)
    told = [one.sentence for one in result.record.warnings if one.code == STEP_SIDE_OPEN]
    return result, told


@pytest.mark.slow
def test_rows_around_a_step_are_left_out_and_told(rng: np.random.Generator) -> None:
    around = [FIRST - 3, FIRST - 2, FIRST - 1]
    result, told = run([*range(5, 45, 4), *around, *range(60, 90, 4)], rng)
    record = result.record
    name = record.chosen.mechanisms[-1]
    sentence = (
        f"3 held-out rows lie between row {FIRST - 4} and row {FIRST}, as the step {name} does: whether they "
        "were measured before or after it, the estimation rows cannot tell, and they are left out of "
        "the held-out errors."
    )
    assert told == [sentence]
    errors = record.ladder[-1].held_out
    assert {rung.held_out.left_out for rung in record.ladder} == {3}
    assert errors.max_mm < 8 * NOISE < errors.mean_all_mm * (errors.rows + 3)
    assert record.outliers == []
    rows = result.residuals()
    assert not rows["outlier"].any()
    assert rows.index[rows["side_open"]].tolist() == around


@pytest.mark.slow
def test_where_all_rows_would_be_left_out_they_stay(rng: np.random.Generator) -> None:
    result, told = run([FIRST - 1], rng)
    assert [one.endswith("the held-out errors may be too large.") for one in told] == [True]
    assert result.record.ladder[-1].held_out.rows == 1


@pytest.mark.integration
def test_nothing_is_told_where_the_step_has_its_place(rng: np.random.Generator) -> None:
    result, told = run([*range(5, 45, 4), *range(60, 90, 4)], rng)
    assert "step" in result.record.chosen.mechanisms[-1]
    assert told == []


TOOLS = {"A": [40.0, -30.0, 110.0], "B": [40.0, 60.0, 90.0], "C": [-50.0, 10.0, 120.0]}


@pytest.mark.integration
def test_a_target_that_was_only_held_out_is_open_after_all_others_slipped(
    rng: np.random.Generator,
) -> None:
    """It stood still, and all targets were told to stand elsewhere: held-out errors of 0.5 mm."""
    q = ROBOT.draw(rng, ROWS)
    flange = flanges_of(ROBOT, q)
    is_third = np.arange(ROWS) % 4 == 0
    frames = []
    for name, tool in TOOLS.items():
        frame = pd.DataFrame({f"q{k + 1}_rad": q[:, k] for k in range(ROBOT.n)})
        slip = np.outer(np.arange(ROWS) >= FIRST, [0.3, -0.4, 0.0] if name != "C" else [0, 0, 0])
        position = flange[:, :3, 3] + np.einsum("mij,mj->mi", flange[:, :3, :3], tool + slip)
        frame[["x_mm", "y_mm", "z_mm"]] = position + rng.normal(0, NOISE, position.shape)
        frame["target"] = name
        frame["order"] = range(ROWS)
        frames.append(frame[is_third == (name == "C")])
    table = pd.concat(frames).sort_values("order", kind="stable")
    table["role"] = np.where(table["order"] % 5 == 0, "held-out", "estimation")
    table.loc[table["target"] == "C", "role"] = "held-out"
    table = table.drop(columns="order").reset_index(drop=True)
    study = Study(
        name="slipped",
        robot={"name": "puma760", "tools_mm": TOOLS, "register": False},
        measurements=table,
        split={"column": "role"},
        model={"candidates": ["target-step"]},
    )
    result = run_study(study, sampling=False)
    record = result.record
    assert record.chosen.mechanisms[-1] == "target-step:A & B"
    told = [one.sentence for one in record.warnings if one.code == STEP_SIDE_OPEN]
    own = [one for one in told if "target C moved, too" in one]
    assert len(own) == 1
    later = ((table["target"] == "C") & (table.index > 0)).to_numpy()
    opened = result.residuals()["side_open"].to_numpy()
    assert 8 <= (opened & later).sum() <= 12
    assert record.ladder[-1].held_out.max_mm < 8 * NOISE
