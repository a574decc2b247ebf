"""The page on coupled joints: its two arms, hidden errors found in them and corrected, by an
arithmetic of their own."""

from __future__ import annotations

import tomllib

import numpy as np
import pandas as pd
import pytest
from scipy.spatial.transform import Rotation
from shown_code import ROOT, fenced

from modelsel import Calibration, Result, Study, run_study
from modelsel.calibration.calibration_file import calibration_text
from modelsel.calibration.export import export
from modelsel.calibration.export.robot_programs import write_program
from modelsel.calibration.loading import parse_calibration
from modelsel.exceptions import StudyError
from modelsel.measurements.reader import read_measurements
from modelsel.mechanisms.registry import build_mechanisms
from modelsel.robot.dh import dh_table, format_robot_table
from modelsel.robot.files import robot_from_table
from modelsel.robot.kinematics import Robot, forward

PAGE = ROOT / "docs" / "how-to" / "coupled-joints.md"
TABLES = [tomllib.loads(block) for block in fenced("toml", PAGE.read_text(encoding="utf-8"))]
ARMS = [robot_from_table(table, "page") for table in TABLES]
PARALLELOGRAM, PALLETISER, WRIST = ARMS
TOOL = np.array([40.0, 0.0, 90.0])
NAMES = [f"q{k}_rad" for k in range(1, 7)]


def turn(axis: str, angle: np.ndarray) -> np.ndarray:
    return Rotation.from_euler(axis, angle[:, None]).as_matrix()


def place(m: np.ndarray) -> np.ndarray:
    """The page's parallelogram at motor readings (m, 6): its third motor turns the forearm against
    the base, whatever the second does."""
    m1, m2, m3, m4, m5, m6 = m.T
    hand = np.array([120, 0, 0]) + turn("x", m6) @ TOOL
    wrist = np.array([700, 0, 0]) + (turn("y", m5) @ hand[..., None])[..., 0]
    elbow = np.array([150, 0, 120]) + (turn("x", m4) @ wrist[..., None])[..., 0]
    shoulder = turn("y", m2) @ [0, 0, 850.0] + (turn("y", m3) @ elbow[..., None])[..., 0]
    shoulder[:, 0] += 150
    return np.array([0, 0, 475]) + (turn("z", m1) @ shoulder[..., None])[..., 0]


def real(m: np.ndarray) -> np.ndarray:
    """The arm with an uneven gear at motor 3, and a fifth joint that turns with the fourth."""
    off = m.copy()
    off[:, 2] += 6e-4 * np.sin(m[:, 2] + 0.4)
    off[:, 4] += 5e-4 * m[:, 3]
    return place(off)


def measured(robot: Robot, count: int, seed: int) -> np.ndarray:
    """Motor readings (count, 6) of joint angles within the limits."""
    q = robot.draw(np.random.default_rng(seed), count)
    assert robot.coupling is not None
    return np.linalg.solve(robot.coupling.matrix, q.T).T


def studied(robot: Robot, m: np.ndarray, x: np.ndarray, candidates: object = "all") -> Result:
    columns = dict(zip([*NAMES, "x_mm", "y_mm", "z_mm"], np.column_stack([m, x]).T, strict=True))
    study = Study(
        name="coupled",
        seed=3,
        robot={"nominal": robot, "tool_mm": TOOL.tolist()},
        measurements=pd.DataFrame(columns),
        noise={"floor_mm": 0.01},
        split={"estimation": 90},
        model={"candidates": candidates},
    )
    return run_study(study, sampling=False)


@pytest.fixture(scope="module")
def found() -> Result:
    m = measured(PARALLELOGRAM, 130, 1)
    noise = np.random.default_rng(2).normal(0, 0.01, (len(m), 3))
    return studied(PARALLELOGRAM, m, real(m) + noise)


@pytest.fixture(scope="module")
def calibrated(found: Result) -> Calibration:
    return found.calibration


def named(result: Result) -> list[str | None]:
    return [finding.credible_set[0].mechanism for finding in result.record.findings]


def test_nominal_arm_takes_motor_readings() -> None:
    m = measured(PARALLELOGRAM, 20, 5)
    data = read_measurements(pd.DataFrame(m, columns=NAMES), PARALLELOGRAM, positions=False)
    np.testing.assert_allclose(forward(PARALLELOGRAM, data.q, TOOL), place(m), atol=1e-9)
    np.testing.assert_allclose(data.readings, m, atol=1e-12)
    step = np.diff(m[:, 2])
    np.testing.assert_array_equal(data.approach[1:, 2], np.sign(step))
    np.testing.assert_allclose(data.move[1:, 2], np.abs(step), atol=1e-12)
    assert "coupled-joints" in [note.code for note in data.notes]


def test_errors_of_motor_and_wrist_are_named(found: Result) -> None:
    assert sorted(map(str, named(found))) == ["gear-eccentricity:3", "wrist-coupling:5"]
    gear = next(f for f in found.record.findings if "gear" in str(f.credible_set[0].mechanism))
    assert gear.sentence.startswith("Motor 3 turns unevenly")
    causes = {(s.frame, s.axis, s.cause) for s in gear.credible_set[0].screws}
    assert causes == {(3, "rz", "sin(q2+q3)"), (3, "rz", "cos(q2+q3)")}


def test_corrected_readings_land_on_the_target(calibrated: Calibration, tmp_path) -> None:
    m = 0.9 * measured(PARALLELOGRAM, 40, 7)
    planned = pd.DataFrame(np.degrees(m), columns=[f"q{k}_deg" for k in range(1, 7)])
    table = calibrated.correct(planned)
    corrected = np.radians(table[list(planned)].to_numpy())
    before = np.linalg.norm(real(m) - place(m), axis=1)
    after = np.linalg.norm(real(corrected) - place(m), axis=1)
    assert before.mean() > 0.4
    assert after.max() < 0.03
    assert (table["error_left_mm"] < 1e-3).all()
    text = write_program("krl", tmp_path / "pick.src", corrected, (False,) * 6, [])
    third = [
        float(line.split("A3 ")[1].split(",")[0]) for line in text.splitlines() if "A3 " in line
    ]
    np.testing.assert_allclose(third, np.degrees(corrected[:, 2]), atol=1e-6)


def palletise(m: np.ndarray) -> np.ndarray:
    """The page's palletiser at the readings (m, 5) of its four motors: what hangs at the flange is
    level."""
    hand = np.array([220, 0, -200]) + turn("z", m[:, 4]) @ TOOL
    arms = turn("y", m[:, 1]) @ [0, 0, 1100.0] + turn("y", m[:, 2]) @ [1200.0, 0, 0]
    reach = np.array([260, 0, 0]) + arms + hand
    return np.array([0, 0, 680]) + (turn("z", m[:, 0]) @ reach[..., None])[..., 0]


def test_no_command_turns_a_level_flange() -> None:
    """The flange of the palletiser stays level, the other four motors correct."""
    rng = np.random.default_rng(6)
    ranges = np.radians([[-160, 160], [-35, 80], [-20, 50], [0, 0], [-250, 250]])
    m = rng.uniform(*ranges.T, (120, 5))
    off = m.copy()
    off[:, 2] += 5e-4 * np.sin(m[:, 2] + 0.3)
    names = NAMES[:5]
    x = palletise(off) + rng.normal(0, 0.01, (120, 3))
    columns = dict(zip([*names, "x_mm", "y_mm", "z_mm"], np.column_stack([m, x]).T, strict=True))
    data = read_measurements(pd.DataFrame(columns), PALLETISER)
    np.testing.assert_allclose(forward(PALLETISER, data.q, TOOL), palletise(m), atol=1e-9)
    study = Study(
        name="pallets",
        seed=3,
        robot={"nominal": PALLETISER, "tool_mm": TOOL.tolist()},
        measurements=pd.DataFrame(columns),
        noise={"floor_mm": 0.01},
    )
    result = run_study(study, sampling=False)
    calibrated = parse_calibration(calibration_text(result.calibration))
    planned = 0.9 * m[:30]
    table = calibrated.correct(pd.DataFrame(planned, columns=names))
    corrected = table[names].to_numpy()
    np.testing.assert_allclose(corrected[:, 3], 0.0, atol=1e-12)
    moved = corrected.copy()
    moved[:, 2] += 5e-4 * np.sin(corrected[:, 2] + 0.3)
    planned_off = planned.copy()
    planned_off[:, 2] += 5e-4 * np.sin(planned[:, 2] + 0.3)
    before = np.linalg.norm(palletise(planned_off) - palletise(planned), axis=1)
    after = np.linalg.norm(palletise(moved) - palletise(planned), axis=1)
    assert before.mean() > 0.2
    assert after.max() < 0.04


@pytest.mark.parametrize("passive", [[0], [7], [1, 1], [1, 2, 3, 4, 5, 6], "4", [True]])
def test_motors_that_are_none_are_refused(passive: object) -> None:
    with pytest.raises(StudyError, match=r"passive: expected some of the motors 1 to 6, each once"):
        robot_from_table(TABLES[0] | {"passive": passive}, "arm.toml")


def test_files_hold_the_coupling(calibrated: Calibration) -> None:
    again = parse_calibration(calibration_text(calibrated), "calibration.json")
    m = measured(PARALLELOGRAM, 10, 8)
    data = read_measurements(pd.DataFrame(m, columns=NAMES), again.robot, positions=False)
    np.testing.assert_allclose(again.predict(data), calibrated.predict(data), atol=1e-9)
    assert np.linalg.norm(again.predict(data) - real(m), axis=1).max() < 0.03
    module: dict[str, object] = {}
    exec(export(calibrated, "python").text, module)  # noqa: S102 - our own export
    position = module["position"]
    assert callable(position)
    np.testing.assert_allclose(position(m), again.predict(data), atol=1e-6)
    rows = robot_from_table(
        tomllib.loads(format_robot_table(dh_table(PARALLELOGRAM, "modified"))), "dh"
    )
    assert rows.coupling is not None
    assert PARALLELOGRAM.coupling is not None
    np.testing.assert_array_equal(rows.coupling.matrix, PARALLELOGRAM.coupling.matrix)
    notes = " ".join(export(calibrated, "urdf").notes)
    assert "not the motors' readings m1 to m6: q3 = m3 - m2" in notes


def test_drive_moves_what_its_motor_moves() -> None:
    """Motor 2 holds upper arm and forearm against the base, motor 3 the forearm alone."""
    (lag,) = build_mechanisms("settle:2", PARALLELOGRAM)
    assert [(s.frame, str(s.cause)) for s in lag.terms[0].screws] == [
        (2, "approach2*move2"),
        (3, "(-1)*approach2*move2"),
    ]
    (wind,) = (
        each
        for each in build_mechanisms("joint-compliance:2", PARALLELOGRAM)
        if len(each.terms) == 1
    )
    causes = [str(screw.cause) for screw in wind.terms[0].screws]
    assert causes == ["torque2-torque3", "(-1)*(torque2-torque3)"]
    (scale,) = build_mechanisms("encoder-scale:3", PARALLELOGRAM)
    assert [(s.frame, str(s.cause)) for s in scale.terms[0].screws] == [(3, "q2+q3")]


def test_stiffness_is_the_motors() -> None:
    """Motor 2 carries the upper arm and, at its end, all that is beyond: the forearm's own moment is
    motor 3's. Its spring gives by that torque alone."""
    masses = [0.0, 60.0, 45.0, 0.0, 12.0, 5.0]
    rows = [
        row | {"mass_kg": mass, "com_mm": [0, -425, 0] if number == 2 else [0, 0, 0]}
        for number, (row, mass) in enumerate(zip(TABLES[0]["joint"], masses, strict=True), 1)
    ]
    robot = robot_from_table(TABLES[0] | {"joint": rows}, "page")
    m = measured(robot, 130, 9)
    torque = 9.81 * (60.0 * 0.425 + (45.0 + 12.0 + 5.0) * 0.850) * np.sin(m[:, 1])
    stiffness = 1.5e6
    off = m.copy()
    off[:, 1] += torque / stiffness
    noise = np.random.default_rng(2).normal(0, 0.01, (len(m), 3))
    result = studied(robot, m, place(off) + noise, ["joint-compliance"])
    assert named(result) == ["joint-compliance:2"]
    (finding,) = result.record.findings
    assert finding.sentence.startswith("Motor 2 winds up")
    assert finding.usable is not None
    (spring,) = [number for number in finding.usable if number.quantity == "stiffness"]
    assert spring.low is not None
    assert spring.high is not None
    assert spring.low < stiffness < spring.high
    assert spring.high < 1.3 * spring.low
    assert any("wind-up of motor 2" in number.text for number in finding.usable)


def test_wrist_coupling_beyond_the_file_is_named() -> None:
    """What the ratios miss, on an arm whose wrist is coupled already."""
    m = measured(WRIST, 130, 4)
    assert WRIST.coupling is not None
    q = m @ WRIST.coupling.matrix.T
    assert np.abs(q - m)[:, 4:].max() > 0.02
    q[:, 5] += 4e-4 * q[:, 4]
    noise = np.random.default_rng(2).normal(0, 0.01, (len(m), 3))
    result = studied(WRIST, m, forward(WRIST, q, TOOL) + noise)
    assert named(result) == ["wrist-coupling:6"]


@pytest.mark.parametrize(
    ("coupling", "problem"),
    [
        (np.eye(5).tolist(), "expected 6 x 6 finite numbers"),
        ([[1] * 6] * 6, "the matrix is singular"),
        ([1, 1, 1, 1, 1, 1], "expected 6 x 6 finite numbers"),
    ],
)
def test_matrix_that_is_none_is_refused(coupling: object, problem: str) -> None:
    with pytest.raises(StudyError) as refused:
        robot_from_table(TABLES[0] | {"coupling": coupling}, "arm.toml")
    (sentence,) = refused.value.problems
    assert sentence.startswith(f"arm.toml: coupling: {problem}")


def test_slide_is_not_coupled_with_a_turn() -> None:
    joints = [dict(row) for row in TABLES[0]["joint"]]
    joints[1] |= {"kind": "prismatic"}
    joints[1].pop("limits_deg")
    with pytest.raises(StudyError, match="row 3, column 2 couples a joint that turns"):
        robot_from_table(TABLES[0] | {"joint": joints}, "arm.toml")
