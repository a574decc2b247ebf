"""The good files: a study of three joints that takes a tenth of a second, its fleet, what it
leaves, and rows of other kinds."""

from __future__ import annotations

import io
import tempfile
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from modelsel.config.study_file import parse_study
from modelsel.robot.files import read_robot
from modelsel.robot.kinematics import forward
from modelsel.robot.urdf_writer import write_urdf
from modelsel.study.pipeline.runner import run_study
from modelsel.study.simulation import simulate_study

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

PLANTED = """size = 1e-3
[[simulate.effect]]
frame = 2
axis = "rz"
cause = "sign(torque2)"
size = 3e-3
"""
FEATURES = """
[measurements.features.north]
position_mm = [900, -700, 400]
[measurements.features.south]
position_mm = [-800, 300, 900]
estimate = true
zero = "unknown"
[measurements.features.bar]
position_mm = [300, 300, 300]
[measurements.features.plate]
position_mm = [0, 0, 300]
normal = [0, 0, 1]

[split]"""
ANCHORS = {"north": (900, -700, 400), "south": (-800, 300, 900), "bar": (300, 300, 300)}
PLATE_MM = 300.0


@cache
def base_files() -> dict[str, bytes]:
    """The good files: a study of 36 configurations with groups, an order, a payload and a text
    column."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "robot.toml").write_text(ROBOT)
        frame = _told(simulate_study(parse_study(STUDY, "study.toml"), folder))
        urdf = write_urdf(read_robot(folder / "robot.toml"), {}, {})
    return {
        "measurements.csv": _csv(frame),
        "robot.toml": ROBOT.encode(),
        "robot.urdf": urdf.encode(),
        "study.toml": STUDY.encode(),
    }


def _told(frame: Any) -> Any:
    """With groups, an order, a payload and a column of text."""
    m = len(frame)
    frame["group"], frame["order"] = (
        np.repeat(["monday", "tuesday"], m // 2),
        np.tile(np.arange(m // 2), 2),
    )
    frame["payload_kg"], frame["operator"] = np.round(np.linspace(0, 5, m), 3), "Ann"
    return frame


def _csv(frame: Any) -> bytes:
    text: str = frame.to_csv(index=False, float_format="%.9f", lineterminator="\n")
    return text.encode()


@cache
def stored_files() -> dict[str, bytes]:
    """What a study leaves that names a planted effect, with its study, its data and a plan of
    commands."""
    import pandas as pd

    with tempfile.TemporaryDirectory() as name:
        folder, study = (
            Path(name),
            STUDY.replace("size = 1e-3\n", PLANTED).replace("= 36", "= 60").replace("= 24", "= 40"),
        )
        (folder / "robot.toml").write_text(ROBOT)
        (folder / "study.toml").write_text(study)
        frame = _told(simulate_study(parse_study(study, "study.toml"), folder))
        (folder / "measurements.csv").write_bytes(_csv(frame))
        run_study(folder, sampling=False).save(folder)
        robot = read_robot(folder / "robot.toml")
        out = {path.name: path.read_bytes() for path in folder.iterdir() if path.is_file()}
    few: Any = pd.read_csv(io.BytesIO(out["measurements.csv"]))[:24]
    q = few[["q1_rad", "q2_rad", "q3_rad"]].to_numpy()
    few[["x_mm", "y_mm", "z_mm"]] = forward(robot, q, np.array([10.0, 20.0, 80.0]))
    return out | {"targets.csv": _csv(few), "other.json": out["calibration.json"]}


@cache
def gauged_files() -> dict[str, bytes]:
    """A study whose rows are points, single coordinates, wires, a bar, distances, a touched point
    and a known plate."""
    study = (
        STUDY.replace("= 36", "= 72")
        .replace("estimation = 24", "estimation = 48")
        .replace("\n[split]", FEATURES)
    )
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "robot.toml").write_text(ROBOT)
        robot, plain = read_robot(folder / "robot.toml"), STUDY.replace("= 36", "= 72")
        frame = _told(simulate_study(parse_study(plain, "study.toml"), folder))
    tool = np.array([10.0, 20.0, 80.0])
    frame["kind"], frame["feature"], frame["length_mm"], frame["s_mm"] = "point", "", np.nan, 0.05
    kind, feature, place = (frame.columns.get_loc(name) for name in ("kind", "feature", "x_mm"))
    last = np.zeros(3)
    for row in range(24, len(frame)):
        what = (
            "x",
            "z",
            "north",
            "north",
            "south",
            "south",
            "bar",
            "distance",
            "distance",
            "plate",
            "cone",
            "point",
        )[row % 12]
        x = frame.iloc[row, place : place + 3].to_numpy(float, copy=True)
        if what in ANCHORS:
            frame.iloc[row, kind], frame.iloc[row, feature] = (
                "ball-bar" if what == "bar" else "wire",
                what,
            )
            frame.loc[row, "length_mm"] = np.linalg.norm(x - ANCHORS[what]) - (
                25 if what == "south" else 0
            )
        elif what == "distance":
            frame.iloc[row, kind], frame.iloc[row, feature] = what, f"gauge {row // 12}"
            if row % 12 == 8:
                frame.loc[row, "length_mm"] = np.linalg.norm(x - last)
        elif what in ("plate", "cone"):
            frame.iloc[row, kind], frame.iloc[row, feature] = (
                "plane" if what == "plate" else "same-point",
                what,
            )
            turn = np.linspace(-np.pi, np.pi, 20001) if what == "plate" else 1e-4 * row * np.ones(1)
            q = frame.iloc[row if what == "plate" else 34, :3].to_numpy(float) * np.ones(
                (len(turn), 1)
            )
            q[:, 2] = turn if what == "plate" else q[:, 2] + turn
            frame.iloc[row, :3] = q[np.argmin(np.abs(forward(robot, q, tool)[:, 2] - PLATE_MM))]
            frame.loc[row, "s_mm"] = 0.5
        else:
            frame.iloc[row, kind] = what
        last = x
        keep = {"point": "xyz", "x": "x", "z": "z"}.get(what, "")
        frame.loc[row, [f"{axis}_mm" for axis in "xyz" if axis not in keep]] = np.nan
    return {
        "measurements.csv": _csv(frame),
        "robot.toml": ROBOT.encode(),
        "study.toml": study.encode(),
    }
