"""A scale error of a slide, or of all slides of a gantry, that the tracker's scale may be as well: commands
reckon with either.

Positions come from the sum of two turning links and a slide, or of three slides, written out here."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from builders import seeds

from modelsel import Study, StudyError, load_calibration, run_study
from modelsel.calibration.commands.compensation import (
    compensate_commands,
    note_commands,
    read_planned,
)
from modelsel.calibration.export.notes import describe_instrument

Array = np.ndarray
LINKS, TOOL, SIGMA = (325.0, 275.0), (50.0, 10.0, -10.0), 0.012
STATION = np.array([3400.0, -300.0, 120.0])  # of the base in the tracker's frame
SCARA = """
name = "two links and a slide"
[[joint]]
xyz_mm = [0.0, 0.0, 320.0]
axis = [0.0, 0.0, 1.0]
limits_deg = [-130.0, 130.0]
[[joint]]
xyz_mm = [325.0, 0.0, 0.0]
axis = [0.0, 0.0, 1.0]
limits_deg = [-140.0, 140.0]
[[joint]]
xyz_mm = [275.0, 0.0, 0.0]
axis = [0.0, 0.0, 1.0]
kind = "prismatic"
limits_mm = [-200.0, 0.0]
[[joint]]
xyz_mm = [0.0, 0.0, 0.0]
axis = [0.0, 0.0, 1.0]
limits_deg = [-300.0, 300.0]
[last]
xyz_mm = [0.0, 0.0, -60.0]
"""

GANTRY = """
name = "three slides and a wrist"
[[joint]]
xyz_mm = [0.0, 0.0, 0.0]
axis = [1.0, 0.0, 0.0]
kind = "prismatic"
limits_mm = [0.0, 2500.0]
[[joint]]
xyz_mm = [0.0, 0.0, 800.0]
axis = [0.0, 1.0, 0.0]
kind = "prismatic"
limits_mm = [0.0, 1400.0]
[[joint]]
xyz_mm = [0.0, 0.0, 0.0]
axis = [0.0, 0.0, 1.0]
kind = "prismatic"
limits_mm = [-700.0, 0.0]
[[joint]]
xyz_mm = [0.0, 0.0, 0.0]
axis = [0.0, 0.0, 1.0]
limits_deg = [-180.0, 180.0]
"""


def reach(q: Array, scale: float) -> Array:
    """Where the tool is (m, 3), the slide too long by its scale."""
    first, second, last = q[:, 0], q[:, 0] + q[:, 1], q[:, 0] + q[:, 1] + q[:, 3]
    x = LINKS[0] * np.cos(first) + LINKS[1] * np.cos(second)
    y = LINKS[0] * np.sin(first) + LINKS[1] * np.sin(second)
    x = x + TOOL[0] * np.cos(last) - TOOL[1] * np.sin(last)
    y = y + TOOL[0] * np.sin(last) + TOOL[1] * np.cos(last)
    z = 320.0 - 60.0 + TOOL[2] + (1 + scale) * q[:, 2]
    return STATION + np.stack([x, y, z], axis=1)


def draw_readings(rng: np.random.Generator, count: int) -> pd.DataFrame:
    low, high = np.array([-2.2, -2.4, -200.0, -5.0]), np.array([2.2, 2.4, 0.0, 5.0])
    q = rng.uniform(low, high, (count, 4))
    return pd.DataFrame(q, columns=["q1_rad", "q2_rad", "q3_mm", "q4_rad"])


@pytest.fixture
def campaign(tmp_path: Path) -> Callable[[np.random.Generator, float], Study]:
    """A study of 110 configurations of an arm whose slide has a scale error."""
    robot = tmp_path / "scara.toml"
    robot.write_text(SCARA, encoding="utf-8")

    def build(rng: np.random.Generator, scale: float) -> Study:
        frame = draw_readings(rng, 110)
        position = reach(frame.to_numpy(), scale) + rng.normal(0, SIGMA, (110, 3))
        frame[["x_mm", "y_mm", "z_mm"]] = position
        return Study(
            name="slide",
            robot={"file": str(robot), "tool_mm": list(TOOL), "register": True},
            measurements=frame,
            split={"estimation": 75},
        )

    return build


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::UserWarning")
@seeds(1, 2, 3)
def test_commands_reckon_with_the_side_that_is_not_fitted(
    campaign: Callable[[np.random.Generator, float], Study],
    rng: np.random.Generator,
    tmp_path: Path,
) -> None:
    """What is expected of corrected commands is about what they are really off, on either side of the
    coin, weighed by its probability."""
    scale = float(rng.uniform(5e-4, 9e-4) * rng.choice([-1, 1]))
    result = run_study(campaign(rng, scale), sampling=False)
    c = result.calibration
    ((name, other),) = c.other_sides.items()
    assert {name, other.label} == {"encoder-scale:3", "tracker-scale"}
    assert other.share == pytest.approx(0.5, abs=0.1)

    plan = read_planned(c, draw_readings(rng, 200))
    commands = compensate_commands(c, plan)
    goes = reach(commands.q, scale)
    missed = np.sqrt(np.square(goes - commands.wanted).sum(1).mean())
    if name == "tracker-scale":
        assert missed == pytest.approx(other.rms_mm, rel=0.15)
    else:
        assert missed < 0.1 * other.rms_mm
    expected = np.sqrt(np.square(commands.expected_mm).mean())
    assert expected == pytest.approx(np.sqrt(other.share) * other.rms_mm, rel=0.1)
    if name == "tracker-scale":
        each = np.linalg.norm(goes - commands.wanted, axis=1)
        np.testing.assert_allclose(commands.expected_mm, np.sqrt(other.share) * each, rtol=0.2)

    told = [note for note in note_commands(c, commands, plan) if "may as well be" in note]
    assert len(told) == 1
    assert told[0].startswith(f"{name}, an error of the ")
    assert [f"{note}." for note in describe_instrument(c)] == told
    result.save(tmp_path / "out")
    assert load_calibration(tmp_path / "out").other_sides == c.other_sides
    file = tmp_path / "out" / "calibration.json"
    record = json.loads(file.read_text(encoding="utf-8"))
    record["other_sides"][name]["estimate"].append(0.0)
    file.write_text(json.dumps(record), encoding="utf-8")
    with pytest.raises(StudyError, match="one number for each term of the instrument's error"):
        load_calibration(tmp_path / "out")


def slide_to(q: Array, scales: Array) -> Array:
    """Where the tool of a gantry is (m, 3), its slides too long by their scales."""
    x, y, z = (1 + scales)[:, None] * q[:, :3].T
    return STATION + np.stack(
        [
            x + TOOL[0] * np.cos(q[:, 3]) - TOOL[1] * np.sin(q[:, 3]),
            y + TOOL[0] * np.sin(q[:, 3]) + TOOL[1] * np.cos(q[:, 3]),
            800.0 + TOOL[2] + z,
        ],
        axis=1,
    )


def draw_slides(rng: np.random.Generator, count: int) -> pd.DataFrame:
    low, high = np.array([0.0, 0.0, -700.0, -3.0]), np.array([2500.0, 1400.0, 0.0, 3.0])
    return pd.DataFrame(
        rng.uniform(low, high, (count, 4)), columns=["q1_mm", "q2_mm", "q3_mm", "q4_rad"]
    )


def study_gantry(folder: Path, rng: np.random.Generator, scales: Array) -> Study:
    """A study of a gantry whose slides have scale errors."""
    robot = folder / "gantry.toml"
    robot.write_text(GANTRY, encoding="utf-8")
    frame = draw_slides(rng, 90)
    position = slide_to(frame.to_numpy(), scales) + rng.normal(0, SIGMA, (90, 3))
    frame[["x_mm", "y_mm", "z_mm"]] = position
    return Study(
        name="gantry",
        robot={"file": str(robot), "tool_mm": list(TOOL), "register": True},
        measurements=frame,
        split={"estimation": 60},
    )


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::UserWarning")
@seeds(1, 2, 3)
def test_all_slides_of_a_gantry_are_the_other_side_of_the_trackers_scale(
    tmp_path: Path, rng: np.random.Generator
) -> None:
    scale = float(rng.uniform(2e-4, 5e-4) * rng.choice([-1, 1]))
    scales = np.full(3, scale)
    result = run_study(study_gantry(tmp_path, rng, scales), sampling=False)
    c = result.calibration
    ((name, other),) = c.other_sides.items()
    assert {name, other.label} == {"slide-scales", "tracker-scale"}
    assert other.share == pytest.approx(0.5, abs=0.1)
    (finding,) = result.findings
    assert finding.claim.probability < 0.9

    plan = read_planned(c, draw_slides(rng, 150))
    commands = compensate_commands(c, plan)
    goes = slide_to(commands.q, scales)
    missed = np.linalg.norm(goes - commands.wanted, axis=1)
    if name == "tracker-scale":
        np.testing.assert_allclose(commands.expected_mm, np.sqrt(other.share) * missed, rtol=0.2)
    else:
        assert missed.max() < 0.1 * other.rms_mm
    # each row has its own: the points near the corner of the gantry have the least
    far = np.linalg.norm(commands.q[:, :3], axis=1)
    assert np.corrcoef(commands.expected_mm, far)[0, 1] > 0.9


@pytest.mark.integration
@pytest.mark.filterwarnings("ignore::UserWarning")
@seeds(1)
def test_slides_of_scales_of_their_own_are_the_arms(
    tmp_path: Path, rng: np.random.Generator
) -> None:
    scales = np.array([4e-4, 0.0, 0.0])
    result = run_study(study_gantry(tmp_path, rng, scales), sampling=False)
    assert not result.calibration.other_sides
    (finding,) = result.findings
    assert finding.first.mechanism == "encoder-scale:1"


@pytest.mark.integration
@pytest.mark.filterwarnings("ignore::UserWarning")
def test_without_an_error_there_is_no_other_side(
    campaign: Callable[[np.random.Generator, float], Study], rng: np.random.Generator
) -> None:
    c = run_study(campaign(rng, 0.0), sampling=False).calibration
    assert not c.other_sides
