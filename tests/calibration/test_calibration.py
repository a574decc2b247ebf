"""A stored calibration predicts what the study predicted, says what it saw, and refuses what it
cannot know."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from wide_calibration import wide

from modelsel.calibration.calibration_file import CALIBRATION_FILE, calibration_text
from modelsel.calibration.calibration_schema import CalibrationRecord
from modelsel.calibration.commands.command_notes import describe_extrapolation
from modelsel.calibration.commands.compensation import correct, tabulate_readings
from modelsel.calibration.export import export
from modelsel.calibration.loading import load_calibration, parse_calibration
from modelsel.calibration.prediction import predict, propagate_uncertainty, to_tracker_frame
from modelsel.config.study_file import read_study
from modelsel.exceptions import DataError, StudyError
from modelsel.fitting.design import Model, residuals
from modelsel.measurements.measurements import build_measurements
from modelsel.mechanisms.causes import Member, Number, q, sin
from modelsel.mechanisms.environment import zero_step
from modelsel.mechanisms.registry import every
from modelsel.mechanisms.serialization import cause_from_record, cause_record
from modelsel.robot.files import load_robot
from modelsel.study.pipeline.runner import run_study

PUMA = Path(__file__).parents[2] / "studies" / "puma760"


@pytest.fixture(scope="module")
def result():
    return run_study(read_study(PUMA / "study.toml"), PUMA, sampling=False)


@pytest.mark.integration
def test_study_comes_back_exactly(result, tmp_path) -> None:
    result.save(tmp_path)
    stored = load_calibration(tmp_path)
    at = result.split.problem
    wanted = at.data.position - result.models.chosen.residual
    assert np.abs(predict(stored, stored.problem(at.data, another_day=False)) - wanted).max() < 1e-9
    assert (
        calibration_text(load_calibration(tmp_path / "result.json"))
        == calibration_text(stored)
        == (tmp_path / CALIBRATION_FILE).read_text()
    )
    se = result.models.chosen.fit.standard_errors
    assert (
        np.abs(stored.factor @ stored.factor.T - result.models.chosen.fit.covariance)
        <= 1e-8 * np.outer(se, se)
    ).all()
    np.testing.assert_allclose(stored.standard_errors, se, rtol=1e-8)
    assert stored.ranges["q3"] == (
        at.data.q[result.split.used, 2].min(),
        at.data.q[result.split.used, 2].max(),
    )
    assert stored.provenance["data_sha256"] == result.run.provenance["data_sha256"]


def test_everything_a_model_can_hold_comes_back(rng) -> None:
    made, at = wide(rng)
    stored = parse_calibration(calibration_text(made))
    assert stored.model == made.model
    assert calibration_text(stored) == calibration_text(made)
    wanted = at.data.position - residuals(at, made.terms, made.theta)
    assert np.abs(predict(stored, stored.problem(at.data, another_day=False)) - wanted).max() < 1e-9
    shifted = stored.problem(at.data)  # another day: the drift stands at the campaign's middle
    assert np.abs(predict(stored, shifted) - wanted).max() > 1e-4
    assert "torque2" in stored.ranges
    assert to_tracker_frame(shifted, np.zeros((len(at), 3)))[0].tolist() == [1, 2, 3]


@pytest.mark.parametrize("moment", [0.3, 0.7])
def test_another_day_finds_what_stepped_as_it_stood_at_the_end(moment, rng) -> None:
    """Whichever half of the campaign it stepped in; without steps a drift stands in its middle."""
    made, at = wide(rng)
    assert made.after_steps == 0.5
    step = zero_step(made.robot, 4, moment)
    turned = 2e-3
    stepped = replace(
        made,
        model=Model((*made.model.mechanisms, step)),
        theta=np.append(made.theta, turned),
        factor=np.vstack([made.factor, np.zeros(made.factor.shape[1])]),
    )
    q = at.data.q.copy()
    q[:, 3] += turned
    # what depends on the reading of joint 4 apart, its zero is all that differs
    there = stepped.problem(at.data)
    late = replace(at.data, q=q, progress=np.full(len(at.data), stepped.after_steps))
    wanted = predict(made, made.problem(late, another_day=False))
    np.testing.assert_allclose(predict(stepped, there), wanted, atol=2e-3)
    assert stepped.after_steps == (moment + 1) / 2
    assert describe_extrapolation(made, at.data) == describe_extrapolation(stepped, at.data)[:-1]
    assert describe_extrapolation(stepped, at.data)[-1].startswith("zero-step:4: what moved")


@pytest.mark.integration
def test_uncertainty_is_the_spread_of_refits(rng) -> None:
    """Closed form: parameters drawn from the covariance scatter the prediction by what
    `uncertainty` says."""
    made, at = wide(rng)
    spread = np.sqrt(np.square(propagate_uncertainty(made, at.take(np.arange(5)))).sum(2))
    draws = []
    for _ in range(400):
        theta = made.theta + made.factor @ rng.standard_normal(made.factor.shape[1])
        draws.append(predict(replace(made, theta=theta), at.take(np.arange(5))))
    np.testing.assert_allclose(np.std(draws, axis=0), spread, rtol=0.15)


def test_every_registered_cause_is_structure() -> None:
    robot = load_robot("puma760")
    causes = {s.cause for m in every(robot) for t in m.terms for s in t.screws}
    causes |= {Member("group", 3), Number(2.5, "mm") * sin(q(1))}
    assert all(cause_from_record(json.loads(json.dumps(cause_record(c)))) == c for c in causes)


@pytest.mark.parametrize(
    "record",
    [
        3,
        {},
        {"number": "nan", "unit": "1"},
        {"function": "eval", "of": {"number": 1, "unit": "1"}},
        {"operator": "**", "left": {}, "right": {}},
        {"member": "robot", "index": 0},
    ],
)
def test_no_cause(record) -> None:
    with pytest.raises(ValueError, match=r"not a cause|finite|could not"):
        cause_from_record(record)


def test_refusals(rng) -> None:
    made, at = wide(rng)
    text = calibration_text(made)
    for broken, says in (
        (text[:-20], "not valid JSON"),
        ("<robot/>", "not a calibration; "),
        ("{}", "not a calibration"),
        (text.replace('"schema": 1', '"schema": 9', 1), "schema 9"),
        (text.replace('"axis": "rx"', '"axis": "up"'), "damaged"),
        (text.replace("0.02,", "null,", 1), "damaged"),
    ):
        with pytest.raises(StudyError, match=says):
            parse_calibration(broken)
    plain = build_measurements(at.data.q, at.data.position, target=["c"] * 150, group=["mon"] * 150)
    with pytest.raises(DataError, match='target "c" was not calibrated'):
        made.problem(plain)
    with pytest.raises(DataError, match="needs temperature_C"):
        made.problem(replace(at.data, covariates={}))
    with pytest.raises(StudyError, match="no such calibration"):
        load_calibration("nowhere")


def test_a_study_file_with_a_byte_order_mark_has_its_results(rng, tmp_path, monkeypatch) -> None:
    """As editors of Windows save it: the folder was said to have no results."""
    monkeypatch.chdir(tmp_path)
    made, _ = wide(rng)
    report = Path("reports/cellB")
    report.mkdir(parents=True)
    made.save(report)
    study = Path("cellB/study.toml")
    study.parent.mkdir()
    study.write_text(f'name = "{made.study}"\n', encoding="utf-8-sig")
    assert load_calibration("cellB").study == made.study
    study.write_text("name = \n")
    with pytest.raises(StudyError, match=r"study.toml: not valid TOML: .*line 1"):
        load_calibration("cellB")


@pytest.mark.slow
def test_same_bytes(result) -> None:
    again = run_study(read_study(PUMA / "study.toml"), PUMA, sampling=False)
    assert calibration_text(result.calibration) == calibration_text(again.calibration)


@pytest.mark.integration
def test_frame_and_notebook(result) -> None:
    stored = result.calibration
    frame = stored.to_frame()
    assert len(frame) == len(stored.terms)
    row = frame[frame["symbol"] == "w54"].iloc[0]
    assert (row["mechanism"], row["screws"]) == ("wrist-coupling:5", "frame 5 rz · q4")
    assert row["estimate"] == stored.theta[[t.symbol for t in stored.terms].index("w54")]
    assert "<table" in replace(stored, study="<script>")._repr_html_()
    assert "<script>" not in replace(stored, study="<script>")._repr_html_()


@pytest.mark.integration
def test_methods_are_the_functions(result, tmp_path) -> None:
    stored = result.calibration
    data = result.split.problem.data
    positions = stored.predict(data)
    np.testing.assert_array_equal(positions, predict(stored, stored.problem(data)))
    assert stored.export("urdf") == export(stored, "urdf")
    path = stored.save(tmp_path)
    assert path == tmp_path / CALIBRATION_FILE
    assert path.read_text() == calibration_text(stored)
    with pytest.raises(StudyError, match='Did you mean "urdf"'):
        stored.export("urfd")


@pytest.mark.integration
@pytest.mark.filterwarnings("ignore::UserWarning")
def test_readings_are_corrected_as_a_table_of_them(result) -> None:
    stored, wide_bound = result.calibration, (0.1, 50.0)
    q = result.split.problem.data.q[10:15]
    table = stored.correct(q, bound=wide_bound)
    same = correct(stored, tabulate_readings(stored, q), bound=wide_bound)
    pd.testing.assert_frame_equal(table, same)
    moved = table[[f"q{j}_rad" for j in range(1, 7)]].to_numpy() - q
    assert 0 < np.abs(moved).max() < 0.1
    with pytest.raises(DataError, match="expected an array of m x 6, found 5 x 2"):
        stored.correct(q[:, :2])
    with pytest.raises(DataError, match="beyond the bound"):
        stored.correct(q, bound=(1e-9, 1e-9))


@pytest.mark.integration
@pytest.mark.parametrize("bound", [(np.nan, 20.0), (-0.01, 20.0), (0, 0), 1, (1, 2, 3), "a"])
def test_a_bound_that_bounds_nothing_is_refused(result, bound) -> None:
    q = result.split.problem.data.q[:3]
    with pytest.raises(
        StudyError, match=r"^bound: expected \(rad, mm\), two numbers above 0, found "
    ):
        result.calibration.correct(q, bound=bound)


@pytest.mark.integration
def test_what_is_not_reached_is_told_of_every_program(result) -> None:
    """Python shows a warning of one place once: the table has it each time."""
    far = np.tile([0.0, 0.0, 1.5, 0.0, 0.0, 0.0], (3, 1))
    for _ in range(2):
        with pytest.warns(UserWarning, match="not|beyond|outside") as shown:
            table = result.calibration.correct(far, bound=(10.0, 1e4))
        assert table.attrs["notes"] == [str(one.message) for one in shown]
        assert table.attrs["notes"]
        assert {Path(one.filename).name for one in shown} == {Path(__file__).name}


@pytest.mark.integration
def test_the_schema_describes_the_file(result) -> None:
    schema = CalibrationRecord.model_json_schema(by_alias=True)
    written = json.loads(calibration_text(result.calibration))
    assert set(schema["required"]) <= written.keys() <= schema["properties"].keys()
    record = CalibrationRecord.model_validate(written)
    assert record.to_dict() == written


@pytest.mark.integration
@pytest.mark.parametrize(
    ("keys", "value", "says"),
    [
        (
            ("noise_floor", "coordinate_mm"),
            -1.0,
            "noise_floor.coordinate_mm: expected a number at least 0",
        ),
        (
            ("noise_floor", "freedom"),
            0.0,
            "noise_floor.freedom: expected a number above 0, found 0.0",
        ),
        (("held_out_rms_mm",), -1.0, "held_out_rms_mm: expected a number at least 0"),
        (("ranges", "q1"), [1.0, 0.0], "ranges.q1: expected the lower bound first"),
        (("ranges", "q1"), [1.0], "ranges.q1: expected a list of at least 2, found a list of 1"),
        (("targets",), [], "targets: expected a list of at least 1, found a list of 0"),
        (("registered",), 1, "registered: expected true or false, found 1"),
        (
            ("mechanisms", 0, "terms", 0, "screws", 0, "axis"),
            "up",
            "mechanisms.1.terms.1.screws.1.axis: expected one of",
        ),
        (
            ("mechanisms", 0, "terms", 0, "screws", 0, "cause"),
            {"number": "1", "unit": "1"},
            "screws.1.cause.number: expected a finite number",
        ),
        (
            ("mechanisms", 0, "terms", 0, "screws", 0, "cause"),
            {"eval": "1"},
            "screws.1.cause: expected a cause, found a table",
        ),
    ],
)
def test_damage_is_said_with_its_place(keys, value, says, result) -> None:
    record = json.loads(calibration_text(result.calibration))
    inner = record
    for key in keys[:-1]:
        inner = inner[key]
    inner[keys[-1]] = value
    with pytest.raises(StudyError, match=re.escape(says)):
        parse_calibration(json.dumps(record))
