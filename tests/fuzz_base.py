"""The good files: a study of three joints that takes a tenth of a second, and its fleet."""

from __future__ import annotations

import tempfile
from pathlib import Path

import numpy as np

from modelsel.machine.robotfile import read_robot
from modelsel.machine.urdf import write_urdf
from modelsel.telling.config import parse_study
from modelsel.telling.study import simulate_study

ROBOT = """name = "arm3"
source = "made up"
gravity = [0, 0, -1]
convention = "standard"
[[joint]]
dh = { theta_deg = 0, d_mm = 300, a_mm = 50, alpha_deg = -90 }
limits_deg = [-170, 170]
[[joint]]
xyz_mm = [20, 0, 0]
rpy_deg = [0, 0, 10]
axis = [0, 0, 1]
mass_kg = 12.0
com_mm = [200, 0, 0]
[[joint]]
transform_mm = [[1, 0, 0, 400], [0, 1, 0, 0], [0, 0, 1, 0]]
mass_kg = 5.0
[last]
xyz_mm = [350, 0, 0]
"""
STUDY = """name = "small"
seed = 3

[robot]
file = "robot.toml"
tool_mm = [10, 20, 80]

[measurements]
file = "measurements.csv"

[split]
estimation = 24

[model]
base = ["geometric"]
candidates = ["joint2-twist", "backlash:2"]
ladder = [["geometric"], ["geometric", "joint2-twist"]]

[comparison]
folds = 4
by = "configuration"

[noise]
floor_mm = 0.05

[simulate]
configurations = 36

[[simulate.effect]]
frame = 3
axis = "rz"
cause = "q2"
size = 1e-3
"""
FLEET = """name = "cell"
studies = ["*/study.toml"]

[[study]]
file = "arm/study.toml"
name = "again"
measurements = "arm/measurements.csv"
estimation = 20
candidates = ["backlash:2"]
seed = 4

[[parts]]
name = "whole"
files = ["day*.parquet"]
robot = "arm/robot.toml"
tool_mm = [10, 20, 80]
base = ["geometric"]
folds = 4
"""


def base_files() -> dict[str, bytes]:
    """The good files: a study of 36 configurations with groups, an order, a payload and a text column."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "robot.toml").write_text(ROBOT)
        frame = simulate_study(parse_study(STUDY, "study.toml"), folder)
        urdf = write_urdf(read_robot(folder / "robot.toml"), {}, {})
    m = len(frame)
    frame["group"], frame["order"] = np.repeat(["monday", "tuesday"], m // 2), np.tile(np.arange(m // 2), 2)
    frame["payload_kg"], frame["operator"] = np.round(np.linspace(0, 5, m), 3), "Ann"
    text = frame.to_csv(index=False, float_format="%.9f", lineterminator="\n")
    return {
        "measurements.csv": text.encode(),
        "robot.toml": ROBOT.encode(),
        "robot.urdf": urdf.encode(),
        "study.toml": STUDY.encode(),
    }
