"""What follows from the arm's way or speed is planted where these are known, and refused where not."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from modelsel.config.study_file import read_study
from modelsel.exceptions import StudyError
from modelsel.mechanisms.registry import BUILTIN
from modelsel.robot.files import load_robot
from modelsel.robot.kinematics import pose
from modelsel.study.inputs.inputs import read_inputs
from modelsel.study.inspection.study_inspection import inspect_study
from modelsel.study.simulation import simulate_study

WIDTH = 0.5
STUDY = """
name = "drawn along"
seed = 1
[robot]
name = "irb120"
tool_mm = [40, -30, 110]
[measurements]
file = "m.csv"
[split]
estimation = 30
[simulate]
noise_mm = 0.0
[[simulate.effect]]
frame = 7
axis = "tx"
cause = "{cause}"
size = {size}
"""


def write(folder: Path, rng: np.random.Generator, approach: str, **changed: object) -> Path:
    """Write a study of readings with directions of approach of joint 2: those of the order, or always
    from one side."""
    robot = load_robot("irb120")
    q = robot.draw(rng, 60)
    columns = {f"q{j + 1}_rad": readings for j, readings in enumerate(q.T)}
    columns |= {f"{axis}_mm": np.zeros(len(q)) for axis in "xyz"}
    if approach:
        signs = np.sign(np.diff(q, axis=0, prepend=q[:1]))
        if approach == "one side":
            signs[:, 1] = 1
        columns |= {f"approach{j + 1}": sign.astype(int) for j, sign in enumerate(signs.T)}
    pd.DataFrame(columns).to_csv(folder / "m.csv", index=False)
    path = folder / "study.toml"
    usual = {"cause": "drag2_500", "size": 2.0}
    path.write_text(STUDY.format(**(usual | changed)))
    return path


def draw_play(q: np.ndarray) -> np.ndarray:
    """Follow readings (m,) with what they draw along with slack to either side."""
    drawn = [q[0]]
    for reading in q[1:]:
        drawn.append(np.clip(drawn[-1], reading - WIDTH, reading + WIDTH))
    return np.array(drawn)


@pytest.mark.parametrize("approach", ["", "order"])
def test_hysteresis_is_planted_by_the_way_of_the_joint(tmp_path, rng, approach) -> None:
    path = write(tmp_path, rng, approach)
    planted = simulate_study(path)
    path.write_text(path.read_text().replace("size = 2.0", "size = 0.0"))
    still = simulate_study(path)
    axes = ["x_mm", "y_mm", "z_mm"]
    moved = np.linalg.norm(planted[axes] - still[axes], axis=1)
    q = planted["q2_rad"].to_numpy()
    np.testing.assert_allclose(moved, np.abs(2.0 * (q - draw_play(q))), atol=1e-6)
    assert moved.max() == pytest.approx(2.0 * WIDTH)


def test_hysteresis_is_refused_where_the_way_is_not_known(tmp_path, rng) -> None:
    """It planted nothing, and said nothing."""
    path = write(tmp_path, rng, "one side")
    with pytest.raises(StudyError, match="nobody knows which way joint 2 went") as refusal:
        simulate_study(path)
    (sentence,) = refusal.value.problems
    assert sentence.startswith('study.toml: simulate.effect.1: "drag2_500" is not known')
    assert "Leave these columns out" in sentence


def test_what_cannot_be_planted_is_no_matter_of_measurements(tmp_path, rng) -> None:
    """`check` and `study`, which plant nothing, refused as `simulate` does."""
    path = write(tmp_path, rng, "one side")
    table = pd.read_csv(tmp_path / "m.csv")
    arm = load_robot("irb120")
    q = table[[f"q{j}_rad" for j in range(1, 7)]].to_numpy()
    exact = pose(arm, q, np.array([40.0, -30.0, 110.0])).target.T
    table[["x_mm", "y_mm", "z_mm"]] = exact + rng.normal(0.0, 0.05, exact.shape)
    table.to_csv(tmp_path / "m.csv", index=False)
    study = read_study(path)
    with pytest.raises(StudyError, match="drag2_500"):
        simulate_study(path)
    checked = inspect_study(study, tmp_path)
    assert checked["study"]["refused"] is None
    _, _, measured, _ = read_inputs(study, tmp_path, BUILTIN)
    assert len(measured) == 60


def test_a_speed_is_refused_without_a_clock(tmp_path, rng) -> None:
    path = write(tmp_path, rng, "", cause="rate3")
    with pytest.raises(StudyError, match="nobody knows how fast joint 3 moves"):
        simulate_study(path)


@pytest.mark.parametrize("cause", ["temperature_25_min_late", "exp(since_rest_s/(-900))"])
def test_what_went_before_is_refused_without_a_clock(cause: str, tmp_path, rng) -> None:
    path = write(tmp_path, rng, "", cause=cause)
    table = pd.read_csv(tmp_path / "m.csv")
    table["temperature_C"] = rng.uniform(15, 25, len(table))
    table.to_csv(tmp_path / "m.csv", index=False)
    with pytest.raises(StudyError, match="nobody knows what went before a row"):
        simulate_study(path)
