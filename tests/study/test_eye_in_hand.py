"""A board on the table, seen by a camera on the flange: the arm is found by the textbook's matrices
and a camera of its own."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest
from scipy.spatial.transform import Rotation

from modelsel import Study, run_study
from modelsel.exceptions import DataError
from modelsel.measurements.reader import read_measurements
from modelsel.robot.files import load_robot

RIGHT = np.pi / 2
# Craig's rows of the arm: alpha, a, d [rad, mm]; then the flange
ROWS = (
    (0, 0, 333),
    (-RIGHT, 0, 0),
    (RIGHT, 0, 316),
    (RIGHT, 82.5, 0),
    (-RIGHT, -82.5, 384),
    (RIGHT, 0, 0),
    (RIGHT, 88, 0),
)
CAMERA = (Rotation.from_euler("xyz", [3, -2, 91], degrees=True), np.array([94.0, -9.0, 40.0]))
BOARD = (Rotation.from_euler("xyz", [178, 4, 30], degrees=True), np.array([520.0, 60.0, 15.0]))
POSE = ["x_mm", "y_mm", "z_mm", "qw", "qx", "qy", "qz"]


def camera_in_base(q: np.ndarray) -> tuple[Rotation, np.ndarray]:
    """Where the camera is (m,), and how it is turned."""
    turn, place = Rotation.identity(len(q)), np.zeros((len(q), 3))
    for (alpha, a, d), reading in zip(ROWS, q.T, strict=True):
        link = Rotation.from_euler("x", alpha)
        place = place + turn.apply([a, 0, 0])
        turn = turn * link
        place = place + turn.apply([0, 0, d])
        turn = turn * Rotation.from_euler("z", reading[:, None])
    place = place + turn.apply([0, 0, 107.0])
    place = place + turn.apply(CAMERA[1])
    return turn * CAMERA[0], place


def board_in_camera(q: np.ndarray) -> tuple[Rotation, np.ndarray]:
    turn, place = camera_in_base(q)
    return turn.inv() * BOARD[0], turn.inv().apply(BOARD[1] - place)


def as_columns(turn: Rotation, place: np.ndarray) -> dict[str, np.ndarray]:
    x, y, z, w = turn.as_quat().T
    return dict(zip(POSE, [*place.T, w, x, y, z], strict=True))


def table(q: np.ndarray, turn: Rotation, place: np.ndarray) -> pd.DataFrame:
    readings = {f"q{k}_rad": column for k, column in enumerate(q.T, 1)}
    return pd.DataFrame({**readings, **as_columns(turn, place), "kind": "board"})


@pytest.fixture
def q() -> np.ndarray:
    return load_robot("fr3").draw(np.random.default_rng(4), 110)


def test_camera_is_placed_in_the_board_frame(q: np.ndarray) -> None:
    data = read_measurements(table(q, *board_in_camera(q)), load_robot("fr3"))
    turn, place = camera_in_base(q)
    np.testing.assert_allclose(data.position, BOARD[0].inv().apply(place - BOARD[1]), atol=1e-9)
    np.testing.assert_allclose(data.rotation, (BOARD[0].inv() * turn).as_matrix(), atol=1e-12)
    assert "board-seen" in [note.code for note in data.notes]
    assert data.gauges is None


@pytest.mark.integration
def test_uncertainties_are_those_of_the_camera(q: np.ndarray) -> None:
    """By drawing what the camera sees."""
    one = np.tile(q[:1], (4000, 1))
    rng = np.random.default_rng(1)
    s, sr = np.array([0.1, 0.2, 0.9]), np.array([4e-4, 9e-4, 2e-4])
    turn, place = board_in_camera(one)
    noisy = Rotation.from_rotvec(rng.normal(0, sr, (4000, 3))) * turn
    seen = table(one, noisy, place + rng.normal(0, s, place.shape))
    seen = seen.assign(configuration=range(4000))
    seen[["sx_mm", "sy_mm", "sz_mm"]] = s
    seen[["srx_rad", "sry_rad", "srz_rad"]] = sr
    data = read_measurements(seen, load_robot("fr3"))
    assert data.rotation is not None
    assert data.sigma is not None
    assert data.sigma_rotation is not None
    np.testing.assert_allclose(data.sigma[0], data.position.std(0), rtol=0.06)
    mean = Rotation.from_matrix(data.rotation).mean()
    away = (Rotation.from_matrix(data.rotation) * mean.inv()).as_rotvec()
    np.testing.assert_allclose(data.sigma_rotation[0], away.std(0), rtol=0.06)


@pytest.mark.slow
def test_hidden_error_is_named_and_camera_found(q: np.ndarray) -> None:
    rng = np.random.default_rng(2)
    off = q.copy()
    off[:, 3] += 1.5e-3 * np.sin(q[:, 3] + 0.7)
    turn, place = board_in_camera(off)
    noisy = Rotation.from_rotvec(rng.normal(0, 1e-4, (len(q), 3))) * turn
    seen = table(q, noisy, place + rng.normal(0, 0.05, place.shape))
    study = Study(
        name="eye",
        seed=1,
        robot={"name": "fr3", "register": True},
        measurements=seen,
        split={"estimation": 75},
    )
    result = run_study(study, sampling=False)
    first = result.record.findings[0].credible_set[0]
    assert first.mechanism == "gear-eccentricity:4"
    assert result.record.registration is not None
    (camera,) = result.record.registration.target_on_flange
    np.testing.assert_allclose(camera.position_mm, CAMERA[1], atol=1.5)
    nominal, *_, chosen = result.record.ladder
    assert nominal.held_out is not None
    assert chosen.held_out is not None
    # what the camera's noise alone does: its own, and a turn of the board at its distance
    distance = np.linalg.norm(place, axis=1)
    noise = np.sqrt(np.mean(3 * 0.05**2 + 2 * (1e-4 * distance) ** 2))
    assert nominal.held_out.rms_mm > 3 * noise
    assert chosen.held_out.rms_mm < 1.5 * noise


def test_two_boards_are_two_groups(q: np.ndarray) -> None:
    seen = table(q, *board_in_camera(q)).assign(feature=["near"] * 60 + ["far"] * 50)
    data = read_measurements(seen, load_robot("fr3"))
    assert data.groups == ("near", "far")


@pytest.mark.parametrize(
    ("change", "problem"),
    [
        (lambda seen: seen.drop(columns=["qw", "qx", "qy", "qz"]), "need the board's orientation"),
        (lambda seen: seen.assign(kind=["board"] * 109 + ["point"]), "among rows of a board"),
        (lambda seen: seen.assign(s_mm=0.1), "position and of orientation come together"),
    ],
)
def test_rows_that_do_not_place_the_camera_are_refused(q, change, problem: str) -> None:
    seen = change(table(q, *board_in_camera(q)))
    with pytest.raises(DataError, match=problem):
        read_measurements(seen, load_robot("fr3"))
