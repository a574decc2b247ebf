"""Orientations by the conventions of controllers, against formulas of their manuals written down
apart from the program, and against scipy."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pandas as pd
import pytest
from scipy.spatial.transform import Rotation

from modelsel.exceptions import DataError
from modelsel.measurements.reader import read_measurements

TURNING = (False,) * 3
ROWS = 12


def quaternion_by_manual(about_x, about_y, about_z):
    """(x, y, z, w) of Rz Ry Rx, as the rc_cube's manual has it for KUKA, Fanuc and Yaskawa."""
    cx, cy, cz = (np.cos(angle / 2) for angle in (about_x, about_y, about_z))
    sx, sy, sz = (np.sin(angle / 2) for angle in (about_x, about_y, about_z))
    return np.stack(
        [
            cz * cy * sx - sz * sy * cx,
            cz * sy * cx + sz * cy * sx,
            sz * cy * cx - cz * sy * sx,
            cz * cy * cx + sz * sy * sx,
        ],
        1,
    )


def product(first, second):
    """Of quaternions (x, y, z, w)."""
    v, w = first[:, :3], first[:, 3:]
    u, t = second[:, :3], second[:, 3:]
    vector = w * u + t * v + np.cross(v, u)
    return np.concatenate([vector, w * t - (v * u).sum(1, keepdims=True)], 1)


def about(axis: int, angle):
    quaternion = np.zeros((len(angle), 4))
    quaternion[:, axis], quaternion[:, 3] = np.sin(angle / 2), np.cos(angle / 2)
    return quaternion


def of_vector(a, b, c):
    vector = np.stack([a, b, c], 1)
    angle = np.linalg.norm(vector, axis=1, keepdims=True)
    return np.concatenate([vector / angle * np.sin(angle / 2), np.cos(angle / 2)], 1)


EXPECTED = {
    "kuka_a kuka_b kuka_c": lambda a, b, c: quaternion_by_manual(c, b, a),
    "fanuc_w fanuc_p fanuc_r": quaternion_by_manual,
    "yaskawa_rx yaskawa_ry yaskawa_rz": quaternion_by_manual,
    "roll pitch yaw": quaternion_by_manual,
    "staubli_rx staubli_ry staubli_rz": lambda a, b, c: product(
        product(about(0, a), about(1, b)), about(2, c)
    ),
    "kawasaki_o kawasaki_a kawasaki_t": lambda a, b, c: product(
        product(about(2, a), about(1, b)), about(2, c)
    ),
    "ur_rx ur_ry ur_rz": of_vector,
}


def angles() -> np.ndarray:
    return np.random.default_rng(4).uniform(-1.4, 1.4, (ROWS, 3))


def frame_of(names: str, unit: str = "rad") -> pd.DataFrame:
    rng = np.random.default_rng(5)
    columns = [f"q{k}_rad" for k in (1, 2, 3)] + ["x_mm", "y_mm", "z_mm"]
    frame = pd.DataFrame(rng.uniform(-3, 3, (ROWS, 6)), columns=columns)
    values = angles() if unit == "rad" else np.degrees(angles())
    frame[[f"{name}_{unit}" for name in names.split()]] = values
    return frame


@pytest.mark.parametrize("unit", ["rad", "deg"])
@pytest.mark.parametrize("names", EXPECTED)
def test_conventions_are_those_of_the_manuals(names, unit) -> None:
    data = read_measurements(frame_of(names, unit), TURNING)
    expected = Rotation.from_quat(EXPECTED[names](*angles().T)).as_matrix()
    assert np.allclose(data.rotation, expected, rtol=0, atol=1e-12)
    assert not data.covariates


def test_conventions_differ() -> None:
    """Read by another convention, the same numbers are another orientation (but those of Fanuc,
    Yaskawa and roll-pitch-yaw, which are one)."""
    turns = [Rotation.from_quat(EXPECTED[names](*angles().T)) for names in EXPECTED]
    apart = [np.median((a.inv() * b).magnitude()) for a, b in pairwise(turns)]
    assert [difference > 0.1 for difference in apart] == [True, False, False, True, True, True]


def test_a_quaternion_and_angles_are_refused() -> None:
    frame = frame_of("kuka_a kuka_b kuka_c")
    frame[["qw", "qx", "qy", "qz"]] = [1.0, 0, 0, 0]
    with pytest.raises(DataError, match="orientations stand there twice"):
        read_measurements(frame, TURNING)
    frame = frame_of("kuka_a kuka_b kuka_c").join(frame_of("roll pitch yaw")[["roll_rad"]])
    with pytest.raises(DataError, match=r"stand there twice: .*roll_rad"):
        read_measurements(frame, TURNING)


def test_angles_come_together_and_in_one_unit() -> None:
    frame = frame_of("kuka_a kuka_b kuka_c", "deg").drop(columns="kuka_b_deg")
    with pytest.raises(DataError, match="kuka_a_deg, kuka_c_deg without kuka_b_deg"):
        read_measurements(frame, TURNING)
    frame = frame_of("roll pitch yaw", "deg").rename(columns=lambda n: n.replace("_deg", "_rad"))
    with pytest.raises(DataError, match=r"column roll_rad: .* looks like degrees.*roll_deg"):
        read_measurements(frame, TURNING)


def test_a_cell_that_is_no_number_is_told() -> None:
    frame = frame_of("ur_rx ur_ry ur_rz").astype(object)
    frame.loc[3, "ur_ry_rad"] = "?"
    with pytest.raises(DataError, match="row 3, column ur_ry_rad"):
        read_measurements(frame, TURNING)


def test_angles_by_other_names_are_mapped(tmp_path) -> None:
    frame = frame_of("kuka_a kuka_b kuka_c", "deg")
    named = {f"kuka_{axis}_deg": axis.upper() for axis in "abc"}
    path = tmp_path / "kuka.csv"
    frame.rename(columns=named).to_csv(path, sep=";", decimal=",", index=False)
    data = read_measurements(path, TURNING, named)
    assert np.allclose(data.rotation, read_measurements(frame, TURNING).rotation, atol=1e-12)
