"""Held-out rows are left out where they are bad shots, not where the model is bad."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from builders import OFF_AXIS, bind, measured, planted, seeds, small_campaign, study_of

from modelsel import Study, run_study
from modelsel.diagnosis.faults.mistaken_rows import describe_slips
from modelsel.fitting.design import Model, residuals
from modelsel.fitting.problem import Problem
from modelsel.measurements.measurements import build_measurements
from modelsel.measurements.reader import read_measurements
from modelsel.mechanisms.registry import mechanism
from modelsel.robot.files import load_robot
from modelsel.robot.kinematics import forward
from modelsel.selection.evaluation import Split, evaluate
from modelsel.study.models.held_out_outliers import exclude_held_out_outliers

PUMA = Path(__file__).parents[3] / "studies" / "puma760" / "measurements.csv"
ARM = load_robot("irb120")
BASE = Model((mechanism("geometric", ARM),))
NOISE, HELD_OUT = 0.05, 25


def campaign(rng: np.random.Generator, postures: int, times: int) -> Problem:
    """Postures that estimate, each measured so many times, then others that are held out."""
    q = np.concatenate([ARM.draw(rng, postures).repeat(times, axis=0), ARM.draw(rng, HELD_OUT)])
    at = bind(ARM, build_measurements(q, forward(ARM, q, np.array(OFF_AXIS))))
    theta = rng.normal(size=len(BASE.terms)) * [
        0.5 if term.unit == "mm" else 1e-3 for term in BASE.terms
    ]
    return planted(at, BASE.terms, theta, rng, NOISE)


def left_out(at: Problem) -> tuple[Split, list[int]]:
    split = study_of(at, HELD_OUT)
    nominal = evaluate(split, Model(()), ("nominal",))
    base = evaluate(split, BASE, ("geometric",))
    split = exclude_held_out_outliers(split, [nominal, base])
    return split, np.flatnonzero(split.outlying).tolist()


@seeds(1, 2, 3)
def test_postures_that_a_model_does_not_predict_stay(rng: np.random.Generator) -> None:
    """Five postures determine half of the geometry: the others are off by many times the noise,
    and that is the result."""
    at = campaign(rng, 5, 15)
    split = study_of(at, HELD_OUT)
    left = evaluate(split, BASE, ("geometric",)).residual[-HELD_OUT:]
    assert (np.linalg.norm(left, axis=1) > 8 * NOISE).any()
    assert left_out(at)[1] == []


@seeds(1, 2, 3)
def test_a_bad_shot_is_left_out(rng: np.random.Generator) -> None:
    at = campaign(rng, 60, 1)
    row = 60 + int(rng.integers(HELD_OUT))
    position = at.data.position.copy()
    position[row] += rng.choice([-1, 1], 3) * 20 * NOISE
    assert left_out(measured(at, position))[1] == [row]
    assert left_out(at)[1] == []


@seeds(1)
@pytest.mark.parametrize("shots", [3, 8])
def test_many_bad_shots_are_what_the_model_does_not_know(
    rng: np.random.Generator, shots: int
) -> None:
    at = campaign(rng, 60, 1)
    rows = 60 + rng.choice(HELD_OUT, shots, replace=False)
    position = at.data.position.copy()
    position[rows] += 30 * NOISE
    moved = replace(at, data=replace(at.data, position=position))
    assert left_out(moved)[1] == (sorted(rows.tolist()) if shots == 3 else [])


@seeds(1)
def test_rows_that_a_slip_explains_are_left_out_however_many(rng: np.random.Generator) -> None:
    at = campaign(rng, 60, 1)
    rows = 60 + rng.choice(HELD_OUT, 8, replace=False)
    q = at.data.q.copy()
    q[rows] = np.radians(q[rows])
    assert left_out(replace(at, data=replace(at.data, q=q)))[1] == sorted(rows.tolist())


@seeds(1)
def test_rows_in_millimetres_of_a_file_in_metres_are_said_so(rng: np.random.Generator) -> None:
    at = campaign(rng, 60, 1)
    position = at.data.position.copy()
    position[:8] *= 1000
    data = replace(at.data, position=position, position_unit="m")
    is_mistaken = np.arange(len(at)) < 8
    (sentence,) = describe_slips(replace(at, data=data), residuals, is_mistaken)
    assert "8 rows are in millimetres, not metres" in sentence
    assert "divide x, y and z by 1000 there" in sentence


@pytest.mark.parametrize(("unit", "known"), [("mm", "mm"), ("m", "m"), ("inch", "in")])
def test_the_unit_of_positions_is_known(unit: str, known: str) -> None:
    frame = pd.DataFrame({f"q{j}_rad": [0.1, 0.2] for j in range(1, 7)})
    for axis in "xyz":
        frame[f"{axis}_{unit}"] = [1.0, 1.1]
    assert read_measurements(frame, ARM.prismatic).position_unit == known


def test_the_table_of_subsets_leaves_out_the_same_rows_as_the_ladder() -> None:
    """One held-out shot is 30 mm off: the base errs by the same in both."""
    _, frame, small = small_campaign()
    frame["role"] = ["estimation"] * 30 + ["held-out"] * 10
    frame.loc[35, "x_mm"] += 30
    study = Study(
        name="shot",
        robot=small.robot,
        measurements=frame,
        split={"column": "role"},
        model={"candidates": ["encoder-scale"]},
    )
    record = run_study(study, sampling=False).record
    base = next(rung for rung in record.ladder if rung.mechanisms == ["geometric"])
    assert base.held_out.left_out == 1
    assert {subset.held_out.left_out for subset in record.candidates.best} == {1}
    alone = next(one for one in record.candidates.best if one.mechanisms == ["geometric"])
    assert alone.held_out.rms_mm == pytest.approx(base.held_out.rms_mm, rel=1e-3)


@pytest.mark.slow
@seeds(1)
@pytest.mark.parametrize("shots", [0, 1])
def test_among_errors_that_last_a_bad_shot_does_not_make_its_neighbours_bad(
    rng: np.random.Generator, shots: int
) -> None:
    """What the restricted study leaves unnamed lasts along the order of motion."""
    frame = pd.read_csv(PUMA).head(65)
    frame["role"] = np.where(np.arange(65) < 50, "estimation", "held-out")
    rows = rng.choice(np.arange(50, 65), shots, replace=False)
    frame.loc[rows, "x_mm"] += 60.0
    study = Study(
        name="lasting",
        measurements=frame,
        split={"column": "role"},
        robot={"name": "puma760", "tool_mm": [0, 0, 100]},
        model={"candidates": ["wrist-coupling"]},
    )
    result = run_study(study, sampling=False)
    assert result.diagnosis.search.errors.names
    assert result.models.chosen.held_out.left_out == shots
    assert not any(one.code == "hopeless-fit" for one in result.record.warnings)
