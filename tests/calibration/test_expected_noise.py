"""What compensation expects of a measured position: with the noise that a study's held-out
configurations showed, where that is not the one that was stated."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from builders import OFF_AXIS
from exact import flanges_of
from wide_calibration import wide

from modelsel import Study, run_study
from modelsel.calibration.calibration import Calibration
from modelsel.calibration.calibration_file import calibration_text
from modelsel.calibration.commands.compensation import Commands, compensate_commands, note_commands
from modelsel.calibration.loading import parse_calibration
from modelsel.calibration.prediction import predict
from modelsel.exceptions import write_rounded
from modelsel.fitting.noise import Floor
from modelsel.measurements.measurements import Measurements, build_measurements
from modelsel.robot.files import load_robot

STATED = 0.02
PUMA = load_robot("puma760")


@pytest.fixture(scope="module")
def made() -> tuple[Calibration, Measurements]:
    """A calibration and planned commands of its arm."""
    c, at = wide(np.random.default_rng(3))
    rows = slice(1, 60)
    planned = build_measurements(
        at.data.q[rows],
        np.full((59, 3), np.nan),
        target=[at.data.targets[k] for k in at.data.target[rows]],
        group=[at.data.groups[k] for k in at.data.group[rows]],
        covariates={name: values[rows] for name, values in at.data.covariates.items()},
        approach=at.data.approach[rows],
    )
    return c, planned


def showing(c: Calibration, held_out_mm: float, stated: float, freedom: float) -> Calibration:
    """A calibration whose held-out coordinates are off by so many mm rms, with another floor."""
    floor = Floor(stated, "stated", freedom)
    return replace(c, floor=floor, held_out_rms_mm=held_out_mm * np.sqrt(3))


def noise_of(found: Commands) -> np.ndarray:
    """The noise of one coordinate that is in what is expected of every row."""
    known = found.left_mm**2 + found.model_mm**2
    return np.sqrt((found.expected_mm**2 - known) / 3)


def told(c: Calibration, found: Commands, planned: Measurements) -> list[str]:
    return [one for one in note_commands(c, found, planned) if "expected errors hold" in one]


@pytest.mark.filterwarnings("ignore::UserWarning")
def test_a_noise_that_is_stated_too_small_is_not_expected(made) -> None:
    """The parameters' uncertainty at these rows is in what was held out, too."""
    c, planned = made
    louder = showing(c, 0.5, STATED, np.inf)
    found = compensate_commands(louder, planned)
    of_model = np.square(found.model_mm).mean() / 3
    noise = np.sqrt(0.5**2 - of_model)
    np.testing.assert_allclose(noise_of(found), noise)
    (sentence,) = told(louder, found, planned)
    assert f"a noise of {write_rounded(noise, 2)} mm per coordinate" in sentence
    assert sentence.endswith("showed it, and not the stated 0.020 mm.")


@pytest.mark.filterwarnings("ignore::UserWarning")
def test_a_noise_that_is_stated_much_too_large_is_not_expected(made) -> None:
    c, planned = made
    quieter = showing(c, 0.05, 1.0, np.inf)
    found = compensate_commands(quieter, planned)
    np.testing.assert_allclose(noise_of(found), 0.05)
    assert len(told(quieter, found, planned)) == 1


@pytest.mark.filterwarnings("ignore::UserWarning")
def test_a_stated_noise_that_held_out_rows_bear_out_is_expected(made) -> None:
    c, planned = made
    found = compensate_commands(c, planned)
    of_model = np.square(found.model_mm).mean() / 3
    borne_out = showing(c, float(np.hypot(STATED, np.sqrt(of_model))), STATED, np.inf)
    again = compensate_commands(borne_out, planned)
    np.testing.assert_allclose(noise_of(again), STATED)
    assert told(borne_out, again, planned) == []


@pytest.mark.filterwarnings("ignore::UserWarning")
def test_what_was_measured_is_no_statement(made) -> None:
    """Repeats show less than a model leaves: what is left is expected, and nothing is doubted."""
    c, planned = made
    measured = showing(c, 0.5, STATED, 30.0)
    found = compensate_commands(measured, planned)
    assert (noise_of(found) > 0.3).all()
    assert told(measured, found, planned) == []


@pytest.mark.filterwarnings("ignore::UserWarning")
def test_what_a_row_expects_does_not_depend_on_the_other_rows(made) -> None:
    """The parameters' uncertainty is taken out of the held-out errors as it was there."""
    c, planned = made
    known = replace(showing(c, 0.5, STATED, np.inf), held_out_model_mm=0.3)
    together = compensate_commands(known, planned)
    alone = compensate_commands(known, planned.take(np.array([7])))
    assert alone.expected_mm[0] == pytest.approx(together.expected_mm[7], rel=1e-9)
    np.testing.assert_allclose(noise_of(together), np.sqrt(0.5**2 - 0.3**2 / 3))
    restored = parse_calibration(calibration_text(known))
    assert restored.held_out_model_mm == 0.3


@pytest.mark.slow
def test_uncertainty_at_held_out_rows_is_that_of_drawn_parameters(rng: np.random.Generator) -> None:
    """Predictions with parameters that are drawn from their covariance differ by it."""
    q = PUMA.draw(rng, 90)
    position = flanges_of(PUMA, q)[:, :3, 3] + rng.normal(0, 0.05, (90, 3))
    frame = pd.DataFrame({f"q{k + 1}_rad": q[:, k] for k in range(PUMA.n)})
    frame[["x_mm", "y_mm", "z_mm"]] = position
    study = Study(
        name="held out",
        robot={"name": "puma760", "tool_mm": [0, 0, 0]},
        measurements=frame,
        split={"estimation": 40},
        model={"candidates": []},
    )
    result = run_study(study, sampling=False)
    c = result.calibration
    at = result.split.others
    mean = predict(c, at)
    width = c.factor.shape[1]
    squares = [
        np.square(predict(replace(c, theta=c.theta + c.factor @ draw), at) - mean).sum(1).mean()
        for draw in rng.normal(size=(400, width))
    ]
    assert c.held_out_model_mm == pytest.approx(np.sqrt(np.mean(squares)), rel=0.1)


@pytest.mark.slow
def test_errors_that_a_study_names_and_does_not_add_are_no_noise(rng: np.random.Generator) -> None:
    """With `candidates = []` the base leaves a joint's scale, which is found: the floor is beside it."""
    q = PUMA.draw(rng, 90)
    scaled = q.copy()
    scaled[:, 2] *= 1.002
    flange = flanges_of(PUMA, scaled)
    position = flange[:, :3, 3] + flange[:, :3, :3] @ np.array(OFF_AXIS)
    position += rng.normal(0, 0.05, position.shape)
    frame = pd.DataFrame({f"q{k + 1}_rad": q[:, k] for k in range(PUMA.n)})
    frame[["x_mm", "y_mm", "z_mm"]] = position
    robot = {"name": "puma760", "tool_mm": OFF_AXIS}
    floors = {}
    for asked in ([], ["encoder-scale"]):
        study = Study(name="scale", robot=robot, measurements=frame, model={"candidates": asked})
        result = run_study(study, sampling=False)
        record = result.record
        floors[len(asked)] = record.noise_floor.coordinate_mm
        assert len(record.findings) == 1
        assert "limit-below-left" not in [one.code for one in record.warnings]
    assert floors[0] == pytest.approx(0.05, rel=0.15)
    assert floors[0] == pytest.approx(floors[1], rel=0.1)
