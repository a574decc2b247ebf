"""Columns of numbers that are no causes, whatever a search would make of them."""

import numpy as np
import pandas as pd
import pytest

from modelsel.measurements.reader import read_measurements
from modelsel.robot.rigid import rotation_matrix

pytestmark = pytest.mark.unit
ROWS = 12


def frame(**others) -> pd.DataFrame:
    """Measurements of an arm of one joint, and other columns."""
    rng = np.random.default_rng(5)
    columns = {"q1_rad": rng.uniform(-1, 1, ROWS)}
    columns |= {f"{axis}_mm": rng.uniform(-500, 500, ROWS) for axis in "xyz"}
    return pd.DataFrame({**columns, **others})


def noise(seed: int) -> np.ndarray:
    return np.random.default_rng(seed).normal(0, 0.1, ROWS)


def read(**others) -> tuple[set[str], dict[str, str]]:
    """(the causes, what is said by its code)."""
    data = read_measurements(frame(**others), [False])
    return set(data.covariates), {note.code: note.sentence for note in data.notes}


def quote(names) -> str:
    return ", ".join(f'"{name}"' for name in names)


@pytest.mark.parametrize(
    "names",
    [
        ("dX", "dY", "dZ", "Mag"),
        ("dx", "dy", "dz", "d"),
        ("X_dev", "Y_dev", "Z_dev", "Total"),
        ("Error",),
        ("Deviation 3D",),
        ("residual_mm",),
        ("delta_x_mm", "delta_y_mm", "delta_z_mm"),
    ],
)
def test_deviations_of_the_position_are_no_causes(names) -> None:
    causes, said = read(**{name: noise(k) for k, name in enumerate(names)})
    assert not causes
    assert said["computed-ignored"].endswith(f": {quote(names)}.")


@pytest.mark.parametrize(
    "names", [("X1", "Y1", "Z1"), ("x_2", "y_2", "z_2"), ("X_ist", "Y_ist", "Z_ist")]
)
def test_another_position_is_no_cause(names) -> None:
    """One coordinate alone may be anything: an axis that the arm travels along."""
    causes, said = read(**{name: noise(k) for k, name in enumerate(names)})
    assert not causes
    assert said["positions-ignored"].endswith(f": {quote(names)}.")
    causes, _ = read(**{names[0]: noise(0)})
    assert causes == {names[0]}


def test_a_position_of_any_name_is_no_cause() -> None:
    """A second reflector beside the first, and the controller's own position, in metres."""
    rows = frame()
    position = rows[["x_mm", "y_mm", "z_mm"]].to_numpy()
    turned = position @ rotation_matrix(2, 0.7) + [2000, 300, -400]
    beside = dict(zip(("B_X", "B_Y", "B_Z"), (turned + 90 * noise(3)[:, None]).T, strict=True))
    names = [f"actual_TCP_pose_{k}" for k in range(3)]
    controller = dict(zip(names, position.T / 1000, strict=True))
    heat = {f"temp_{k}": noise(k) for k in range(3)}
    causes, said = read(**beside, **heat, **controller)
    assert causes == set(heat)
    assert said["positions-ignored"].endswith(f": {quote([*beside, *controller])}.")


def test_what_grows_as_the_arm_goes_along_a_line_stays_a_cause() -> None:
    """Three temperatures rise with the position on a line, and are no position."""
    rising = np.linspace(0, 1, ROWS)
    rows = frame(**{f"temp_{k}": 20 + (k + 1) * rising for k in range(3)})
    for k, axis in enumerate("xyz"):
        rows[f"{axis}_mm"] = 400 * (k + 1) * rising + noise(k)
    data = read_measurements(rows, [False])
    assert set(data.covariates) == {"temp_0", "temp_1", "temp_2"}


@pytest.mark.parametrize("name", ["J{}_cmd", "target_q_{}", "A{} soll [deg]"])
def test_commanded_readings_are_no_causes(name) -> None:
    names = [name.format(k) for k in (1, 2)]
    rows = frame(**{each: noise(k) for k, each in enumerate(names)}, q2_rad=noise(7))
    data = read_measurements(rows, [False, False])
    assert not data.covariates
    said = {note.code: note.sentence for note in data.notes}
    assert said["commanded-ignored"].endswith(f": {quote(names)}.")


def test_other_columns_stay_causes() -> None:
    """Accelerations, a following error, a rise of temperature, an error's number."""
    names = ("acc_x", "acc_y", "acc_z", "error_code", "delta_T", "dT", "Mag", "RMS", "dX_speed")
    causes, said = read(**{name: noise(k) for k, name in enumerate(names)})
    assert causes == set(names)
    assert not [code for code in said if code.endswith("-ignored")]


@pytest.mark.parametrize("name", ["ID", "Pose", "Punkt", "n"])
def test_a_counter_of_any_name_is_no_cause(name) -> None:
    numbers = np.delete(np.arange(100, 101 + ROWS), 4)
    causes, said = read(**{name: numbers})
    assert not causes
    assert name in said["counters-ignored"]


def test_a_counter_of_configurations_is_no_cause() -> None:
    rows = frame(Pose=np.repeat(np.arange(ROWS // 2), 2), load=np.repeat([0, 1, 2], 4))
    rows["q1_rad"] = np.repeat(np.linspace(-1, 1, ROWS // 2), 2)
    data = read_measurements(rows, [False])
    assert set(data.covariates) == {"load"}


def test_whole_degrees_that_rise_count_no_rows() -> None:
    warm = np.array([20, 20, 20, 21, 21, 22, 22, 23, 23, 24, 25, 25])
    causes, _ = read(housing=warm, time_s=np.arange(ROWS))
    assert causes == {"housing", "time_s"}


def test_a_column_that_the_study_names_stays_a_cause() -> None:
    data = read_measurements(frame(dX=noise(1)), [False], used=("dX",))
    assert set(data.covariates) == {"dX"}


def test_orientations_and_uncertainties_are_no_causes() -> None:
    rng = np.random.default_rng(6)
    turns = rng.normal(size=(4, ROWS))
    q1, q2, q3, q4 = turns / np.linalg.norm(turns, axis=0)
    angles = rng.uniform(-180, 180, (3, ROWS))
    sizes = rng.uniform(0.03, 0.04, (3, ROWS))
    causes, said = read(
        **dict(zip("ABC", angles, strict=True)),
        **dict(zip(("sX", "sY", "sZ"), sizes, strict=True)),
        q1=q1,
        q2=q2,
        q3=q3,
        q4=q4,
    )
    assert not causes
    assert said["orientations-ignored"].endswith(f": {quote('ABC')}.")
    assert '"sX", "sY", "sZ". Map' in said["uncertainties-ignored"]
    assert '"q1", "q2", "q3", "q4". Map them to qw qx qy qz' in said["quaternion-ignored"]


def test_moments_are_no_orientation() -> None:
    names = ("Rx_Nm", "Ry_Nm", "Rz_Nm", "sX", "A", "B")
    causes, _ = read(**{name: noise(k) for k, name in enumerate(names)})
    assert causes == set(names)
