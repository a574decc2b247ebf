"""What pictures are drawn from: details.json against fits made by other means, and words about
rivals."""

from __future__ import annotations

import json
from pathlib import Path

import builders
import numpy as np
import pytest
from report_studies import read_source

from modelsel import read_study
from modelsel._typing import Array
from modelsel.fitting.design import compute_design, field_of
from modelsel.fitting.problem import Problem
from modelsel.mechanisms.causes import Named, q
from modelsel.mechanisms.registry import BUILTIN, build_mechanisms
from modelsel.mechanisms.terms import Mechanism, Screw, Term
from modelsel.report.pages.findings import advise_separation
from modelsel.results.details import select_rows
from modelsel.results.pictures.covariate_panel import draw_covariate, find_covariate
from modelsel.results.schemas.finding_schema import EntryRecord, ScrewRecord
from modelsel.robot.files import load_robot
from modelsel.robot.kinematics import forward
from modelsel.study.models.model_ladder import build_model
from modelsel.study.pipeline.runner import run_study

PUMA = Path(__file__).parents[2] / "studies" / "puma760"


def entry(name: str | None, *screws: tuple[int, str, str]) -> EntryRecord:
    listed = [ScrewRecord(frame=f, axis=a, cause=c) for f, a, c in screws]
    return EntryRecord(mechanism=name, probability=0.4, alike=False, screws=listed)


@pytest.mark.parametrize(
    ("rival", "word"),
    [
        (entry(None, (6, "ty", "q4")), "second target"),
        (entry("thermal-zero:5", (5, "rz", "temperature_C")), "another time"),
        (entry("approach-backlash:5", (5, "rz", "approach5")), "both sides"),
        (entry("payload-deflection:5", (5, "rz", "payload_kg*torque5_7")), "payload"),
        (entry("joint-compliance:5", (5, "rz", "torque5")), "independently"),
        (entry("speed", (5, "rz", "approach_speed")), "independently"),
        (entry("speed", (5, "rz", "move_speed*q5")), "independently"),
    ],
)
def test_what_would_separate_rivals(rival, word) -> None:
    (sentence,) = advise_separation([entry("wrist-coupling:5", (5, "rz", "q4")), rival])
    assert word in sentence
    assert "wrist-coupling:5" in sentence


def test_panels_show_the_effect_and_take_it_out(drawn) -> None:
    """Wrist coupling: without it the residual about frame 5 rz grows with q4 as estimated, with it
    nothing is left."""
    result, details = (json.loads((drawn / f"{n}.json").read_text()) for n in ("result", "details"))
    k = next(k for k, f in enumerate(details["findings"]) if f["label"] == "wrist-coupling:5")
    (panel,) = details["findings"][k]["panels"]
    assert [panel[n] for n in ("frames", "axis", "against", "against_unit", "unit")] == [
        [5],
        "rz",
        "q4",
        "deg",
        "rad",
    ]
    x, w = np.radians(panel["x"]), np.array(panel["weight"])
    slope = {n: float(np.polyfit(x, panel[n], 1, w=np.sqrt(w))[0]) for n in ("before", "after")}
    value, error = (result["findings"][k]["estimate"][0][n] for n in ("value", "standard_error"))
    assert abs(slope["before"] - value) < 2 * error
    assert abs(slope["after"]) < 2 * error


def test_significance_counts_the_parameters_of_its_own_mechanism(drawn) -> None:
    result = json.loads((drawn / "result.json").read_text())
    own: dict[str, list[str]] = {}
    for parameter in result["parameters"]:
        symbol = parameter["symbol"].partition(" of ")[0]
        own.setdefault(parameter["mechanism"], []).append(symbol)
    rows = {row["mechanism"]: row["parameters"] for row in result["significance"]}
    assert len(rows) > 4
    assert rows == own


def thermal_panel(at: Problem, residual: Array) -> dict:
    """The panel of a growth of 20 ppm/K that leaves a residual."""
    (growth,) = build_mechanisms("thermal-expansion", at.robot, BUILTIN)
    assert find_covariate(growth.terms, at) == "temperature_C"
    whole = slice(0, len(at))
    field = field_of(at, at.pose(whole), whole)
    return draw_covariate(growth.terms, np.array([2e-5]), at, field, residual, "temperature_C")


def test_thermal_effect_is_drawn_against_the_temperature(rng) -> None:
    """Without noise every point lies on the line, which is straight and crosses zero at 20 °C; at a
    typical posture it rises by what the target moves per degree."""
    at = builders.drawn("puma760", rng, 200)
    panel = thermal_panel(at, np.zeros((200, 3)))
    assert (panel["against"], panel["against_unit"], panel["unit"]) == ("temperature_C", "°C", "mm")
    x, curve = np.array(panel["curve"])
    slope, start = np.polyfit(x, curve, 1)
    assert np.ptp(curve - slope * x - start) < 1e-4 * np.ptp(curve)
    assert -start / slope == pytest.approx(20, abs=0.01)
    assert panel["before"] == pytest.approx(slope * np.array(panel["x"]) + start, abs=1e-4)
    assert panel["after"] == pytest.approx(np.zeros(len(panel["x"])), abs=1e-9)
    # the target stands about a metre from the base of this arm
    assert 0.3 < slope / 2e-5 / 1000 < 2


def test_residual_of_a_thermal_effect_is_what_it_leaves(rng) -> None:
    """A residual of half the effect stands at half the line."""
    at = builders.drawn("puma760", rng, 200)
    (growth,) = build_mechanisms("thermal-expansion", at.robot, BUILTIN)
    moved = compute_design(at, growth.terms)[0][:, :3, 0] * 2e-5
    whole, half = thermal_panel(at, 0 * moved), thermal_panel(at, moved / 2)
    assert half["after"] == pytest.approx(np.array(whole["before"]) / 2, abs=1e-4)
    assert half["before"] == pytest.approx(np.array(whole["before"]) * 1.5, abs=1e-4)


def test_rows_that_an_effect_does_not_move_are_not_drawn(rng) -> None:
    """A drift of one target of two, drawn against the time, says nothing of the other."""
    is_of_second = np.arange(40) % 2 == 1
    covariates = {"time_s": np.arange(40.0), "second": is_of_second.astype(float)}
    at = builders.drawn("puma760", rng, 40, covariates=covariates)
    drift = Screw(7, "tx", Named("time_s") * Named("second"))
    term = Term("drift", (drift,))
    whole = slice(0, len(at))
    field = field_of(at, at.pose(whole), whole)
    panel = draw_covariate((term,), np.array([0.01]), at, field, np.zeros((40, 3)), "time_s")
    assert panel["x"] == np.flatnonzero(is_of_second).tolist()
    assert panel["before"] == pytest.approx(0.01 * np.array(panel["x"]), abs=1e-5)


def test_posture_is_the_arm_at_its_worst(drawn) -> None:
    """Of every finding: the chain at the readings of `worst`, and a displacement of its size."""
    result, details = (json.loads((drawn / f"{n}.json").read_text()) for n in ("result", "details"))
    robot = load_robot("puma760")
    for finding, one in zip(result["findings"], details["findings"], strict=True):
        posture, worst = one["posture"], finding["worst"]
        assert np.linalg.norm(posture["moved_mm"]) == pytest.approx(worst["mm"], abs=1e-4)
        readings = np.radians([worst["joints_deg"]])
        target = forward(robot, readings, np.array([0.0, 0.0, 100.0]))[0]
        assert posture["origins_mm"][-1] == pytest.approx(target, abs=0.06)
        assert posture["origins_mm"][0] == [0, 0, 0]
        places = {(s["frame"], s["axis"]) for s in finding["credible_set"][0]["screws"]}
        assert {(p["frame"], p["axis"]) for p in posture["places"]} == places


@pytest.mark.slow
def test_slopes_of_the_map_are_those_of_a_fit(drawn) -> None:
    """A cell's slope is the first step of least squares with the base and that cell."""
    study = read_study(PUMA / "study.toml")
    result, details = run_study(study, PUMA), read_source(drawn).details
    base = build_model(study, result.split.problem, BUILTIN, ("geometric",))
    fitted = next(r for r in result.models.ladder if r.names == ("geometric",)).fit
    cell = Mechanism("cell", (Term("m", (Screw(5, "rz", q(4)),)),))
    problem = result.split.training
    A, r = compute_design(problem, (*base.terms, *cell.terms), fitted.at())
    keep = [*fitted.found.kept, len(base.terms)]
    theta = np.linalg.lstsq(A.reshape(-1, A.shape[2])[:, keep], r.ravel(), rcond=None)[0]
    i, j = (
        result.diagnosis.error_map.where.index((5, "rz")),
        result.diagnosis.error_map.causes.index("q4"),
    )
    assert details.map.slopes[i][j][0] == pytest.approx(theta[-1], rel=2e-2)  # nominal column


def test_thinning_keeps_outliers_and_both_sides(rng) -> None:
    estimation, outlying = rng.random(5000) < 0.9, rng.random(5000) < 0.005
    rows = select_rows(estimation, outlying, 400)
    assert len(rows) <= 400
    assert set(np.flatnonzero(outlying)) <= set(rows)
    assert (np.diff(rows) > 0).all()
    assert min((estimation & ~outlying)[rows].sum(), (~estimation & ~outlying)[rows].sum()) > 100
    assert select_rows(estimation[:300], outlying[:300], 400).tolist() == list(range(300))
