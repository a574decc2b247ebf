"""An arm measured along lines without a clock: positions that belong to other moments than readings are told, and
errors of the arm are not told as such. Planted by exact kinematics."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest
from builders import bind, seeds

from modelsel import Study, run_study
from modelsel._typing import Array
from modelsel.fitting.design import Model
from modelsel.measurements.measurements import Measurements, build_measurements
from modelsel.measurements.stretches import measure_row_steps, number_stretches
from modelsel.mechanisms.registry import mechanism
from modelsel.notices import Note
from modelsel.robot.files import load_robot
from modelsel.robot.kinematics import forward
from modelsel.study.pipeline.late_rows import late_row_notes

NOISE_MM = 0.04
LINES, ROWS = 14, 9
TOOL = np.array([60.0, -30.0, 120.0])
Rng = np.random.Generator


def draw_lines(rng: Rng, name: str = "ur5e") -> tuple[Array, Array]:
    """Readings (m, 6) along lines of even speed, and how far each goes from row to row (m, 6)."""
    arm = load_robot(name)
    starts = arm.draw(rng, LINES)
    steps = np.radians(rng.uniform(1.0, 3.0, (LINES, 6)) * rng.choice([-1, 1], (LINES, 6)))
    # slower at both ends, as arms are
    along = np.cumsum(1 + 0.1 * np.sin(np.linspace(0, np.pi, ROWS))) - 1
    q = starts[:, None] + along[None, :, None] * steps[:, None]
    speed = np.gradient(along)
    return q.reshape(-1, 6), (speed[None, :, None] * steps[:, None]).reshape(-1, 6)


def measure(q: Array, where: Array, rng: Rng) -> Measurements:
    """Readings, and the noisy positions of an arm that stood elsewhere."""
    arm = load_robot("ur5e")
    reached = forward(arm, where, TOOL)
    return build_measurements(q, reached + rng.normal(0, NOISE_MM, reached.shape))


def say(data: Measurements) -> tuple[Note, ...]:
    arm = load_robot("ur5e")
    return late_row_notes(bind(arm, data, TOOL), Model((mechanism("geometric", arm),)))


@seeds(1, 2, 3)
def test_late_readings_are_told(rng: Rng) -> None:
    q, step = draw_lines(rng)
    share = float(rng.choice([-1, 1]) * rng.uniform(0.02, 0.05))
    (note,) = say(measure(q, q + share * step, rng))
    side = "later" if share > 0 else "earlier"
    assert f"% of a step from row to row {side} than" in note.sentence
    percent = float(note.sentence.split("With positions ")[1].split()[0])
    assert percent == pytest.approx(100 * abs(share), rel=0.1)


@seeds(1, 2, 3)
def test_errors_of_the_arm_are_no_late_readings(rng: Rng) -> None:
    q, step = draw_lines(rng)
    joint = int(rng.integers(6))
    uneven, sided = q.copy(), q.copy()
    uneven[:, joint] += 1e-3 * np.sin(q[:, joint] + 0.4)
    sided[:, joint] += 5e-4 * np.sign(step[:, joint])
    for where in (q, uneven, sided):
        assert not say(measure(q, where, rng))


def test_what_rounding_leaves_is_no_delay(rng: Rng) -> None:
    q, _ = draw_lines(rng)
    exact = forward(load_robot("ur5e"), q, TOOL)
    assert not say(build_measurements(q, exact))


def test_lines_are_numbered_and_separate_postures_are_none(rng: Rng) -> None:
    q, step = draw_lines(rng)
    data = build_measurements(q, np.zeros((len(q), 3)))
    number = number_stretches(data)
    assert number is not None
    np.testing.assert_array_equal(number, np.repeat(np.arange(LINES), ROWS))
    inner = np.tile(np.arange(ROWS), LINES)
    within = (inner > 0) & (inner < ROWS - 1)
    np.testing.assert_allclose(measure_row_steps(data)[within], step[within], atol=1e-12)
    # rows that are left out do not tear a line
    some = data.take(rng.permutation(len(q))[: len(q) // 2])
    torn = number_stretches(some)
    assert torn is not None
    assert len(np.unique(torn)) == len(np.unique(number[some.row]))
    apart = load_robot("ur5e").draw(rng, 100)
    assert number_stretches(build_measurements(apart, np.zeros((100, 3)))) is None


@pytest.mark.integration
def test_no_cause_is_sought_beside_late_readings(rng: Rng) -> None:
    q, step = draw_lines(rng)
    late = measure(q, q + 0.04 * step, rng)
    columns = {f"q{j}_rad": column for j, column in enumerate(q.T, 1)}
    columns |= dict(zip(("x_mm", "y_mm", "z_mm"), late.position.T, strict=True))
    study = Study(
        name="late",
        measurements=pd.DataFrame(columns),
        robot={"name": "ur5e", "tool_mm": TOOL.tolist()},
        split={"estimation": 90},
    )
    record = run_study(study, sampling=False).record
    assert not record.findings
    assert any(one.code == "rows-late" for one in record.warnings)
    assert any(sentence.startswith("No cause was looked for") for sentence in record.verdict)
