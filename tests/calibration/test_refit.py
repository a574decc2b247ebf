"""A file that cannot carry everything holds the best robot that it can, says how good that is, and
counts warmth from 20 °C."""

from __future__ import annotations

import csv
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from click.testing import CliRunner
from wide_calibration import wide

from modelsel.calibration.calibration import Calibration
from modelsel.calibration.calibration_file import calibration_text
from modelsel.calibration.constant_part import Part, constant_entries, restrict_to_form
from modelsel.calibration.export import FORMS, export
from modelsel.calibration.export.form import describe_left_out
from modelsel.calibration.loading import parse_calibration
from modelsel.cli.main import run_command_line
from modelsel.config.study_file import parse_study, read_study
from modelsel.exceptions import StudyError
from modelsel.measurements.campaign.reference_temperature import choose_reference
from modelsel.measurements.measurements import build_measurements
from modelsel.mechanisms.campaign_registry import set_reference
from modelsel.mechanisms.cause_formulas import parse
from modelsel.mechanisms.causes import Combined
from modelsel.mechanisms.environment import temperature_rise
from modelsel.mechanisms.registry import BUILTIN, mechanism
from modelsel.robot.files import load_robot, robot_from_table
from modelsel.robot.kinematics import Robot, forward
from modelsel.robot.urdf import read_urdf_text
from modelsel.study.pipeline.result import Result
from modelsel.study.pipeline.runner import run_study

PUMA = Path(__file__).parents[2] / "studies" / "puma760"
NOISE = 0.02
STUDY = """name = "warm"
seed = 1
[robot]
name = "puma760"
tool_mm = [0, 0, 100]
[measurements]
file = "m.csv"
[split]
estimation = 80
"""


@pytest.fixture(scope="module")
def puma() -> tuple[Result, Calibration]:
    result = run_study(read_study(PUMA / "study.toml"), PUMA, sampling=False)
    return result, parse_calibration(calibration_text(result.calibration))


def held_out(result: Result, predicted: np.ndarray) -> float:
    """mm rms, written again."""
    data = result.split
    rows = ~data.estimation & ~data.outlying
    return float(np.sqrt(np.square((data.problem.data.position - predicted)[rows]).sum(1).mean()))


def read(form: str, text: str) -> tuple[Robot, np.ndarray]:
    """The robot in a file of an export, and its target on the flange."""
    import tomllib

    if form == "urdf":
        return read_urdf_text(text, "file", tip="target"), np.zeros(3)
    (target,) = [
        line.partition("= ")[2].removesuffix(" mm")
        for line in text.splitlines()
        if line.startswith("# target ")
    ]
    return robot_from_table(tomllib.loads(text), "file"), np.array(
        [float(v) for v in target.split(",")]
    )


@pytest.mark.integration
@pytest.mark.parametrize("form", ["urdf", "dh", "mdh", "hayati"])
def test_a_geometry_is_as_good_as_geometry_alone(form, puma) -> None:
    result, c = puma
    made = export(c, form)
    robot, target = read(form, made.text)
    seen = held_out(result, forward(robot, result.split.problem.data.q, target))
    geometric = next(r for r in result.models.ladder if r.names == ("geometric",))
    assert seen == pytest.approx(geometric.held_out.rms_mm, rel=1e-6)
    assert made.errors == (
        "held out",
        pytest.approx(result.models.ladder[0].held_out.rms_mm),
        pytest.approx(seen, rel=1e-6),
        pytest.approx(result.models.chosen.held_out.rms_mm),
    )
    assert made.worse is None
    assert (
        f"{seen:.3g} mm rms, the whole model leaves {result.models.chosen.held_out.rms_mm:.3g} mm"
        in made.text + made.notes[0]
    )
    beside = replace(c, refits=None)  # as version 0.1.0 left it: fitted beside what is left out
    robot, target = read(form, export(beside, form).text)
    assert held_out(result, forward(robot, result.split.problem.data.q, target)) > 1.5 * seen
    assert "run the study again" in " ".join(export(beside, form).notes)


@pytest.mark.integration
def test_what_carries_everything_is_the_whole_model(puma) -> None:
    for form in ("json", "csv", "python"):
        assert export(puma[1], form).errors[2:] == (puma[0].models.chosen.held_out.rms_mm,) * 2
        assert not export(puma[1], form).left_out
    assert restrict_to_form(puma[1], "whole") is puma[1]


def warm_arm(robot: Robot, factor: float) -> Robot:
    """Every length of an arm times a factor."""

    def longer(N: np.ndarray) -> np.ndarray:
        out = N.copy()
        out[:3, 3] *= factor
        return out

    return replace(
        robot,
        joints=tuple(replace(j, before=longer(j.before)) for j in robot.joints),
        last=longer(robot.last),
    )


def warm_study(folder: Path, low: float, high: float, nominal_at: float, seed: int = 27) -> Result:
    """A study of an arm that is exactly nominal at one temperature and grows by 12 ppm/°C."""
    rng, robot = np.random.default_rng(seed), load_robot("puma760")
    q, warm = robot.draw(rng, 150), rng.uniform(low, high, 150)
    x = np.concatenate(
        [
            forward(
                warm_arm(robot, 1 + 12e-6 * (t - nominal_at)), q[k : k + 1], np.array([0, 0, 100.0])
            )
            for k, t in enumerate(warm)
        ]
    ) + rng.normal(0, NOISE, (150, 3))
    columns = {f"q{j + 1}_rad": q[:, j] for j in range(6)} | dict(
        zip(("x_mm", "y_mm", "z_mm"), x.T, strict=True)
    )
    pd.DataFrame(columns | {"temperature_C": warm}).to_csv(folder / "m.csv", index=False)
    return run_study(parse_study(STUDY, "study.toml"), folder, sampling=False)


@pytest.mark.slow
@pytest.mark.parametrize(("low", "high", "counted"), [(18.0, 36.0, 20), (22.0, 32.0, 27)])
def test_an_arm_that_is_nominal_at_27_degrees(low, high, counted, tmp_path) -> None:
    result = warm_study(tmp_path, low, high, 27.0)
    c = result.calibration
    assert f"counted from {counted} °C" in result.diagnosis.findings[0].sentence
    cause = {
        s["cause"]
        for f in result.record.to_dict()["findings"]
        for e in f["credible_set"]
        for s in e["screws"]
    }
    assert any(
        f"(temperature_C-{counted})" in text or text == f"temperature_C-{counted}" for text in cause
    )
    growth = next(
        s for s in result.record.to_dict()["significance"] if s["mechanism"].startswith("thermal")
    )
    assert (
        growth["mean_mm"] < 12e-6 * (high - 20) * load_robot("puma760").reach
    )  # not that of an arm that was frozen
    made = export(c, "urdf")
    robot, target = read("urdf", made.text)
    seen = held_out(result, forward(robot, result.split.problem.data.q, target))
    assert seen <= result.models.ladder[0].held_out.rms_mm or made.worse is not None
    nominal, geometric = result.models.ladder[:2]
    assert geometric.names == ("geometric",)
    best = (
        nominal if nominal.cv_rms_mm < geometric.cv_rms_mm else geometric
    )  # chosen without the held-out rows
    assert seen == pytest.approx(best.held_out.rms_mm, rel=1e-6)
    assert made.errors[2] == pytest.approx(seen, rel=1e-6)
    warm = result.split.problem.data.covariates["temperature_C"][result.split.used].mean()
    assert f"{warm:.1f} °C, the mean of the campaign" in made.text
    assert f"thermal effects are counted from {counted} °C" in export(c, "json").notes


def test_reference_temperature() -> None:
    assert choose_reference({}) == 20
    assert choose_reference({"temperature_C": np.array([18.0, 31.0])}) == 20
    assert choose_reference({"temperature_C": np.array([26.0, 29.0])}) == 28  # 27.5
    assert choose_reference({"temperature_C": np.array([-9.0, -5.0])}) == -7
    assert (
        build_measurements(
            np.zeros((2, 1)), np.zeros((2, 3)), covariates={"temperature_C": np.array([30.0, 32.0])}
        )
        .take([0])
        .reference_celsius
        == 31
    )  # of the whole campaign
    for t in (20.0, 28.0, -7.0, 0.0):
        cause = temperature_rise(t)
        assert parse(str(cause), {"temperature_C": "°C"}) == cause
        for name, unit in (
            ("thermal-zero:2", "rad/°C"),
            ("thermal-growth:3", "1/°C"),
            ("thermal-expansion", "1/°C"),
        ):
            own = mechanism(name, load_robot("puma760"), set_reference(BUILTIN, t))
            assert all(
                s.cause
                in (
                    cause,
                    Combined("*", s.cause.left, cause) if isinstance(s.cause, Combined) else cause,
                )
                for s in own.terms[0].screws
            )
            assert f"counted from {t:g} °C" in own.sentence
            assert own.terms[0].unit == unit


def test_a_plug_in_keeps_its_own_thermal_mechanism() -> None:
    def own(robot: Robot) -> None:
        return None

    assert set_reference({**BUILTIN, "thermal-expansion": own}, 27.0)["thermal-expansion"] is own


def test_a_table_needs_nothing_beside_the_nominal_chain() -> None:
    """Read without its reader: the constant rows are the constant corrections of what it
    carries."""
    c, _ = wide(np.random.default_rng(3))
    rows = list(csv.DictReader(export(c, "table").text.splitlines()))
    still = np.zeros((c.robot.n + 1, 6))
    for row in rows:
        if not row["name1"]:
            still[
                int(row["frame"]) - 1, ("tx", "ty", "tz", "rx", "ry", "rz").index(row["axis"])
            ] = float(row["correction"])
    np.testing.assert_allclose(still, constant_entries(restrict_to_form(c, "table")), rtol=1e-7)
    assert not np.allclose(
        still, constant_entries(c), rtol=1e-3
    )  # refitted without what hangs on three values


@pytest.mark.integration
def test_worse_than_nominal_is_said_first(puma, tmp_path) -> None:
    record = json.loads(calibration_text(puma[1]))
    record["refits"]["alone"]["nominal"]["held_out_rms_mm"] = 1.0
    (tmp_path / "calibration.json").write_text(json.dumps(record))
    words = ["export", str(tmp_path), "--format", "urdf", "--out", str(tmp_path / "a.urdf")]
    out = CliRunner().invoke(run_command_line, words).output
    assert (
        out.splitlines()[0]
        == "Warning: this file is worse than the nominal arm: 1.12 mm rms against 1.00 mm, held out."
    )
    told = json.loads(CliRunner().invoke(run_command_line, [*words, "--json"]).output)
    assert told["worse_than_nominal"]
    assert told["errors"]["nominal_rms_mm"] == 1.0


@pytest.mark.integration
@pytest.mark.parametrize("form", [f for f in FORMS if f not in ("grid", "ur-calibration")])
def test_without_held_out_rows_the_fitted_ones_are_said(form) -> None:
    c, _ = wide(np.random.default_rng(3))
    assert export(c, form).errors[0] == "on the rows that were fitted"


@pytest.mark.integration
@pytest.mark.parametrize(
    ("change", "says"),
    [
        (lambda r: r["alone"]["geometry"]["estimates"][0].update(term=999), "not of its terms"),
        (lambda r: r["alone"]["geometry"]["estimates"].reverse(), "not of its terms"),
        (lambda r: r["alone"]["geometry"]["estimates"][0].update(symbol="h1"), "other terms"),
        (lambda r: r["alone"].update(drawing=r["alone"]["geometry"]), "not of its terms"),
        (lambda r: r["alone"]["geometry"].update(held_out_rms_mm=-1.0), "at least 0"),
        (lambda r: r["alone"]["geometry"]["estimates"][0].update(value=None), "finite number"),
        (lambda r: r.pop("whole"), "whole"),
    ],
)
def test_damaged_refits_are_refused(change, says, puma) -> None:
    record = json.loads(calibration_text(puma[1]))
    change(record["refits"])
    with pytest.raises(StudyError, match=says):
        parse_calibration(json.dumps(record))


@pytest.mark.slow
def test_a_registered_geometry_is_as_good_as_it_says(tmp_path) -> None:
    """The tracker stands anywhere: the file's arm, put where the calibration has it, errs by what
    is said."""
    rng, robot = np.random.default_rng(5), load_robot("puma760")
    q = robot.draw(rng, 160)
    bent = (
        q
        + [0, 0, 4e-3, 0, -6e-3, 0]
        + 2e-3 * np.cos(q[:, 1] + q[:, 2])[:, None] * [0, 0, 1.0, 0, 0, 0]
    )
    x = forward(robot, bent, np.array([30.0, -20.0, 120.0])) + rng.normal(0, NOISE, (160, 3))
    x = x @ np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]]).T + [1500.0, 800, 300]
    columns = {f"q{j + 1}_rad": q[:, j] for j in range(6)} | dict(
        zip(("x_mm", "y_mm", "z_mm"), x.T, strict=True)
    )
    pd.DataFrame(columns).to_csv(tmp_path / "m.csv", index=False)
    result = run_study(
        parse_study(STUDY.replace("tool_mm = [0, 0, 100]", "register = true"), "study.toml"),
        tmp_path,
        sampling=False,
    )
    c = parse_calibration(calibration_text(result.calibration))
    made = export(c, "urdf")
    assert made.left_out
    arm, target = read("urdf", made.text)
    R, t = c.placement[0][0], c.placement[1][0]
    seen = held_out(result, forward(arm, result.split.problem.data.q, target) @ R.T + t)
    assert made.errors[2] == pytest.approx(seen, rel=1e-6)
    assert made.errors[1] == pytest.approx(result.models.ladder[0].held_out.rms_mm)
    assert made.errors[3] < made.errors[2] < made.errors[1]


def test_what_is_left_out_is_called_as_everywhere() -> None:
    """A cell of the error map by its place and causes, a registered mechanism by its name."""
    eccentric = mechanism("gear-eccentricity:3", load_robot("puma760"))
    own = [Part("4 rz 1 waves", term, 1e-3, 1e-4) for term in eccentric.terms]
    assert describe_left_out(own) == ("frame 3 rz · sin(q3) & cos(q3)",)
    named = [Part(eccentric.name, term, 1e-3, 1e-4) for term in eccentric.terms]
    assert describe_left_out(named) == ("gear-eccentricity:3 (frame 3 rz)",)
