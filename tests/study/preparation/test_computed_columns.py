"""Columns computed from the measured positions are told by their values, strong causes are not."""

from dataclasses import replace

import numpy as np
import pytest

from modelsel.fitting.problem import Problem
from modelsel.measurements.measurements import build_measurements
from modelsel.robot.files import load_robot
from modelsel.study.preparation.computed_columns import drop_computed_columns

pytestmark = pytest.mark.unit
ROWS = 80
NOISE_MM = 0.05


def measured(drift_mm: float = 0.0) -> tuple[Problem, np.ndarray, np.ndarray]:
    """(an arm whose base moves with a temperature, the deviations in the tracker's frame (m, 3),
    the temperature (m,), of spread one)."""
    rng = np.random.default_rng(8)
    robot = load_robot("ur10")
    q = robot.draw(rng, ROWS)
    tool = np.array([[0.0, 0.0, 100.0]])
    blank = build_measurements(q, np.zeros((ROWS, 3)))
    nominal = -_residuals(Problem(robot, blank, tool))
    warm = np.sort(rng.normal(size=ROWS))
    deviation = rng.normal(0, NOISE_MM, (ROWS, 3)) + drift_mm * np.outer(warm, [0.6, 0.0, 0.8])
    data = build_measurements(q, nominal + deviation)
    return Problem(robot, data, tool), deviation, warm


def _residuals(problem: Problem) -> np.ndarray:
    from modelsel.fitting.design import residuals

    return residuals(problem)[:, :3]


def left(problem: Problem, **columns) -> tuple[set[str], list[str]]:
    """(the columns that stay, what is said)."""
    data = replace(problem.data, covariates=columns)
    rows = np.ones(ROWS, bool)
    kept, notes = drop_computed_columns(replace(problem, data=data), rows, {"named"})
    return set(kept.data.covariates), [note.sentence for note in notes]


def test_a_deviation_in_another_frame_is_computed() -> None:
    """Turned by a third of a radian, the frame moved by a degree, cut off at a micrometre."""
    problem, deviation, _ = measured()
    position = problem.data.position
    other = deviation @ [0.9, -0.3, 0.3] + 1e-3 * position @ [0.0, 1.0, -2.0] + 0.4
    columns = {
        "along": np.round(other, 3),
        "named": other,
        "size": np.linalg.norm(deviation, axis=1),
    }
    names, said = left(problem, **columns)
    assert names == {"named"}
    assert 'Column "along" follows the deviations from the nominal arm' in said[0]


def test_measured_coordinates_in_another_frame_are_computed() -> None:
    problem, _, _ = measured()
    turned = np.round(problem.data.position @ [0.6, 0.0, 0.8] + 200, 3)
    names, said = left(problem, turned=turned)
    assert not names
    assert "the measured coordinates" in said[0]


@pytest.mark.parametrize("drift_mm", [0.2, 1.0, 3.0])
def test_a_cause_that_drives_nearly_all_of_the_error_stays(drift_mm) -> None:
    """R² of the drift on the deviations: 0.94 to 0.9997."""
    problem, _, warm = measured(drift_mm)
    assert left(problem, oil=warm) == ({"oil"}, [])


def test_what_follows_the_pose_stays() -> None:
    """An accelerometer on the flange, a reach, a reading, noise."""
    problem, _, _ = measured()
    rng = np.random.default_rng(9)
    flange = problem.pose(slice(None)).axes[-1, 2, 0]
    reach = np.linalg.norm(problem.data.position[:, :2], axis=1)
    columns = {
        "acc": flange + rng.normal(0, 1e-3, ROWS),
        "exact": flange,
        "reach": reach,
        "torque": np.cos(problem.data.q[:, 1]) * reach,
        "current": rng.normal(size=ROWS),
    }
    assert left(problem, **columns) == (set(columns), [])
