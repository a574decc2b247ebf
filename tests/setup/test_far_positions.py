"""Positions that are far from the arm are refused with one figure: that of the reason where there is
one, which is with tracker and target found anew, else the distance."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from exact import flanges_of

from modelsel.exceptions import DataError
from modelsel.robot.files import load_robot
from modelsel.study.pipeline.runner import rehearse_study

pytestmark = pytest.mark.slow

ROWS = 50
STUDY = """
name = "far"
seed = 1
[robot]
name = "{robot}"
tool_mm = [40, -30, 110]
register = {register}
[measurements]
file = "m.csv"
[split]
estimation = 30
"""


def refuse(folder: Path, q: np.ndarray, x: np.ndarray, register: str, robot: str = "ur5") -> str:
    columns = {f"q{j + 1}_rad": readings for j, readings in enumerate(q.T)}
    columns |= dict(zip(("x_mm", "y_mm", "z_mm"), x.T, strict=True))
    pd.DataFrame(columns).to_csv(folder / "m.csv", index=False)
    path = folder / "study.toml"
    path.write_text(STUDY.format(robot=robot, register=register))
    with pytest.raises(DataError) as refusal:
        rehearse_study(path)
    return str(refusal.value)


def measure(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    arm = load_robot("ur5")
    q = arm.draw(rng, ROWS)
    flange = flanges_of(arm, q)
    x = flange[:, :3, 3] + flange[:, :3, :3] @ np.array([40.0, -30.0, 110.0])
    return q, x + rng.normal(0, 0.03, x.shape)


@pytest.mark.parametrize("register", ["true", "false"])
def test_a_reason_has_the_only_figure(rng, tmp_path, register: str) -> None:
    """The distance was told beside that of the reason, which was another one."""
    q, x = measure(rng)
    turned = q * [1, -1, 1, 1, 1, 1]
    said = refuse(tmp_path, turned, x, register)
    assert "joint 2 turns the other way" in said
    assert said.count("median") == 1
    assert "positions are more than a quarter of the length" in said


def test_so_has_another_robot(rng, tmp_path) -> None:
    said = refuse(tmp_path, *measure(rng), "true", robot="puma760")
    assert 'The readings fit robot "ur5"' in said
    assert said.count("median") == 1


def test_without_a_reason_the_distance_is_told(rng, tmp_path) -> None:
    q, x = measure(rng)
    said = refuse(tmp_path, rng.permutation(q), x, "true")
    assert said.count("median") == 1
    assert "mm apart (median), more than a quarter of the length" in said
