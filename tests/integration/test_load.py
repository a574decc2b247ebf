"""Too little, too much, too even: sensible words, the right exit status, bounded memory."""

from __future__ import annotations

import json
import tracemalloc
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from builders import bind, drawn, one, planted, study_of
from click.testing import CliRunner

from modelsel.cli.main import run_command_line
from modelsel.diagnosis.candidates.candidate_list import build_candidates, exceeds_cell_limit
from modelsel.diagnosis.candidates.options import DiagnosisOptions
from modelsel.diagnosis.procedure import diagnose_split
from modelsel.diagnosis.separation import Inquiry
from modelsel.fitting.design import Model
from modelsel.fitting.least_squares import fit
from modelsel.fitting.problem import Problem
from modelsel.measurements.measurements import build_measurements
from modelsel.mechanisms.causes import q, sin
from modelsel.mechanisms.registry import build_mechanisms, every, mechanism
from modelsel.results.conclusions.finding_notes import partial_map_notes
from modelsel.robot.files import load_robot, robot_from_table
from modelsel.robot.kinematics import Robot, forward

PUMA, TOOL, SIGMA = load_robot("puma760"), np.array([40.0, -25.0, 100.0]), 0.05
STUDY = """
name = "load"
[robot]
name = "puma760"
tool_mm = [40, -25, 100]
[measurements]
file = "measurements.csv"
[model]
candidates = ["wrist-coupling", "backlash:3", "thermal-growth"]
"""


def frame(
    rng: np.random.Generator, m: int, *, sigma: float = SIGMA, still: bool = False
) -> pd.DataFrame:
    """An arm whose second joint's zero is 2 mrad off; `still`: always in the same configuration."""
    angles = PUMA.draw(rng, 1).repeat(m, 0) if still else PUMA.draw(rng, m)
    off = angles + np.array([0, 2e-3, 0, 0, 0, 0])
    x = forward(PUMA, off, TOOL) + sigma * rng.standard_normal((m, 3))
    return pd.DataFrame(
        np.column_stack([angles, x]),
        columns=[*(f"q{j}_rad" for j in range(1, 7)), "x_mm", "y_mm", "z_mm"],
    )


def told(folder: Path, table: pd.DataFrame, status: int) -> str:
    """What `modelsel study` says of it, with the exit status it must have; a refused study leaves
    nothing behind."""
    (folder / "study.toml").write_text(STUDY)
    table.to_csv(folder / "measurements.csv", index=False)
    out = folder / "out"
    words = ("--out", str(out), "--no-report", "--no-sampling", "--verbose")
    ran = CliRunner().invoke(run_command_line, ["study", str(folder), *words])
    assert ran.exit_code == status, ran.output
    assert "Traceback" not in ran.output
    assert (out / "result.json").exists() == (status == 0)
    return " ".join(ran.output.split())


# -- too little
# ---------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("m", "still", "words"),
    [
        (1, False, "one set of joint readings"),
        (2, False, "6 measured coordinates cannot determine"),
        (40, True, "one set of joint readings"),
        (8, False, "or, where some are held out, let more estimate ([split] estimation)"),
        (8, False, "24 measured coordinates cannot determine the 24"),
    ],
)
def test_too_few_configurations(m, still, words, rng, tmp_path) -> None:
    assert words in told(tmp_path, frame(rng, m, still=still), 4)


def test_hardly_enough(rng, tmp_path) -> None:
    """Ten configurations, six degrees of freedom: an effect would have to be large to be found, and
    the limit says so."""
    told(tmp_path, frame(rng, 10), 0)
    result = json.loads((tmp_path / "out" / "result.json").read_text())
    limit = result["nothing_else"]["detection_limit_mm"]
    assert limit is None or limit > 3 * result["noise_floor"]["coordinate_mm"]


def test_a_still_arm_without_noise(rng, tmp_path) -> None:
    assert "one set of joint readings" in told(tmp_path, frame(rng, 12, sigma=0.0, still=True), 4)


# -- too even
# -----------------------------------------------------------------------------------------------------------------


def test_no_noise_at_all(rng, tmp_path) -> None:
    """Rounding is no finding; the errors are what is left of doubles."""
    told(tmp_path, frame(rng, 60, sigma=0.0), 0)
    result = json.loads((tmp_path / "out" / "result.json").read_text())
    assert result["findings"] == []
    assert result["ladder"][-1]["held_out"]["max_mm"] < 1e-9


def test_no_noise_and_an_effect(rng) -> None:
    """Named as it is, nothing beside it."""
    at = drawn("puma760", rng, 60)
    at = planted(at, one(4, "rz", sin(2.0 * q(4))).terms, np.array([1e-3]))
    base = Model((mechanism("geometric", PUMA),))
    _, extension, _ = diagnose_split(
        study_of(at),
        Inquiry(
            base,
            (
                *build_mechanisms("encoder-eccentricity", PUMA),
                *build_mechanisms("wrist-coupling", PUMA),
            ),
            1,
            cells=False,
        ),
    )
    assert [e.candidate.mechanism.name for e in extension.effects] == ["encoder-eccentricity:4"]
    assert extension.effects[0].estimate == pytest.approx([1e-3, 0.0], abs=1e-8)


@pytest.mark.parametrize("name", ["temperature_C", "payload_kg", "time_s"])
def test_a_covariate_of_no_numbers(name, rng, tmp_path) -> None:
    assert f"line 2, column {name}: expected a finite number" in told(
        tmp_path, frame(rng, 30).assign(**{name: np.nan}), 3
    )


def test_causes_that_never_change(rng, tmp_path) -> None:
    """Constant temperature, payload, time: nothing is made of them."""
    table = frame(rng, 50).assign(
        temperature_C=20.0, payload_kg=0.0, time_s=5.0, current_A=3.0, empty=np.nan
    )
    said = told(tmp_path, table, 0)
    assert 'Columns that hold no numbers are ignored: "empty' in said
    assert json.loads((tmp_path / "out" / "result.json").read_text())["findings"] == []


@pytest.mark.parametrize("name", ["puma760", "ur5", "scara"])
def test_targets_on_every_axis(name, rng) -> None:
    """A target on the last axis, at the flange, on any axis of the flange: fitted, its unseen turns
    left out."""
    robot = small_scara() if name == "scara" else load_robot(name)
    for tool in ((0.0, 0.0, 0.0), (0.0, 0.0, 80.0), (80.0, 0.0, 0.0), (0.0, 80.0, 0.0)):
        angles = robot.draw(rng, 60)
        at = bind(
            robot,
            build_measurements(
                angles, forward(robot, angles, np.array(tool)) + rng.normal(0, SIGMA, (60, 3))
            ),
            tool,
        )
        fitted = fit(at, Model((mechanism("geometric", robot),)))
        assert fitted.sigma == pytest.approx(SIGMA, rel=0.35)
        assert np.isfinite(fitted.standard_errors).all()


def small_scara() -> Robot:
    rows = [(0, 200, 300, 0), (0, 0, 250, 180), (0, 100, 0, 0)]
    return robot_from_table(
        {
            "name": "scara",
            "source": "made up",
            "joint": [
                {"dh": {"theta_deg": t, "d_mm": d, "a_mm": a, "alpha_deg": b}}
                for t, d, a, b in rows
            ],
        },
        "scara.toml",
    )


# -- too much
# -----------------------------------------------------------------------------------------------------------------


def snake(n: int) -> Robot:
    """Many joints, axes to all sides."""
    return robot_from_table(
        {
            "name": "snake",
            "source": "made up",
            "gravity": [0, 0, -1],
            "joint": [
                {
                    "dh": {
                        "theta_deg": 0,
                        "d_mm": 20.0 * (k % 3),
                        "a_mm": 80.0,
                        "alpha_deg": (90, -90, 60)[k % 3],
                    }
                }
                for k in range(n)
            ],
        },
        "snake.toml",
    )


def of_snake(n: int, m: int, rng: np.random.Generator) -> Problem:
    robot = snake(n)
    angles = rng.uniform(-1, 1, (m, n))
    at = bind(robot, build_measurements(angles, forward(robot, angles, TOOL)), tuple(TOOL))
    return planted(at, one(5, "rz", sin(2.0 * q(5))).terms, np.array([1e-3]), rng, SIGMA)


@pytest.mark.slow
def test_sixty_joints_and_two_hundred_mechanisms(rng) -> None:
    at = of_snake(60, 150, rng)
    base = Model((mechanism("geometric", at.robot),))
    offered = [
        part
        for name in (
            "encoder-eccentricity",
            "gear-eccentricity",
            "approach-backlash",
            "encoder-scale",
        )
        for part in build_mechanisms(name, at.robot)
    ]
    assert len(offered) > 200
    fitted = fit(at, base)
    assert fitted.rank > 200
    _, extension, _ = diagnose_split(study_of(at), Inquiry(base, tuple(offered), 1, cells=False))
    assert "encoder-eccentricity:5" in [e.candidate.mechanism.name for e in extension.effects]


def test_the_error_map_of_many_joints_is_bounded(rng) -> None:
    """Its cells grow with the cube of the joints; beyond a bound, neighbours alone, which is
    said."""
    at = of_snake(16, 12, rng)
    base = Model((mechanism("geometric", at.robot),))
    assert exceeds_cell_limit(at)
    (note,) = partial_map_notes(at)
    assert "16 joints" in note.sentence
    cells = [c for c in build_candidates(at, base, every(at.robot)) if not c.registered]
    assert len(cells) < 15_000
    names = {c.mechanism.name for c in cells}
    assert {"5 rz sin(q5+q6) & cos(q5+q6)", "4 tx sin(q3) & cos(q3)", "9 ry progress"} <= names
    assert "5 rz sin(q5+q9) & cos(q5+q9)" not in names
    few = of_snake(6, 12, rng)
    assert not exceeds_cell_limit(few)
    assert partial_map_notes(few) == ()
    whole = {
        c.mechanism.name
        for c in build_candidates(
            few, Model((mechanism("geometric", few.robot),)), every(few.robot)
        )
    }
    assert "1 rz sin(q3+q6) & cos(q3+q6)" in whole
    base, offered = Model((mechanism("geometric", few.robot),)), every(few.robot)
    options = DiagnosisOptions(max_cells=10)
    assert len(build_candidates(few, base, offered, options=options)) < len(whole)


def test_a_fit_holds_no_design_matrix(rng) -> None:
    """Forty thousand configurations: the fit takes a small part of what the design matrix alone
    would."""
    at = drawn("puma760", rng, 40_000)
    model = Model((mechanism("geometric", PUMA),))
    tracemalloc.start()
    fitted = fit(at, model)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert fitted.rows == 120_000
    assert peak < 0.25 * fitted.rows * len(model.terms) * 8
