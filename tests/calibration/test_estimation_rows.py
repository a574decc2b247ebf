"""The rows that a calibration was estimated from are known again in any file, and no others are."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from builders import drawn, planted
from click.testing import CliRunner

from modelsel.calibration import estimation_rows
from modelsel.calibration.calibration import Calibration, calibrate
from modelsel.calibration.calibration_file import calibration_text
from modelsel.calibration.estimation_rows import EstimationRows, count_own_rows
from modelsel.calibration.loading import parse_calibration
from modelsel.cli.main import run_command_line
from modelsel.exceptions import StudyError
from modelsel.fitting.design import Model
from modelsel.fitting.least_squares import fit
from modelsel.fitting.noise import Floor
from modelsel.fitting.whitening import Whitening
from modelsel.measurements.measurements import Measurements
from modelsel.mechanisms.registry import mechanism
from modelsel.robot.files import load_robot
from modelsel.selection.evaluation import Split

NOISE, COUNT, FITTED = 0.05, 90, 60
ROBOT = load_robot("puma760")


@pytest.fixture(scope="module")
def campaign() -> tuple[Calibration, Measurements]:
    """A calibration from the first 60 rows of a campaign of 90, and the campaign."""
    rng = np.random.default_rng(11)
    model = Model((mechanism("geometric", ROBOT),))
    at = replace(drawn(ROBOT, rng, COUNT), whitening=Whitening(1 / NOISE))
    theta = rng.uniform(-0.1, 0.1, len(model.terms)) * [t.size[1] for t in model.terms]
    at = planted(at, model.terms, theta, rng, NOISE)
    rows = np.arange(COUNT) < FITTED
    folds = np.where(rows, 0, -1)
    split = Split(at, rows, np.zeros(COUNT, bool), folds, True)
    fitted = fit(at.take(rows), model)
    made = calibrate("own", split, fitted, Floor(NOISE, "stated"), None, False, {})
    return made, at.data


def tabulate(data: Measurements) -> pd.DataFrame:
    columns = {f"q{j}_rad": q for j, q in enumerate(data.q.T, 1)}
    places = zip(("x_mm", "y_mm", "z_mm"), data.position.T, strict=True)
    return pd.DataFrame(columns | dict(places))


def validate(c: Calibration, file: Path) -> str:
    (file.parent / "calibration.json").write_text(calibration_text(c))
    words = ["validate", str(file.parent), str(file)]
    ran = CliRunner().invoke(run_command_line, words)
    assert ran.exit_code == 0, ran.output
    return " ".join(ran.output.split())


def test_rows_are_known_in_another_format_order_and_unit(campaign, tmp_path) -> None:
    c, data = campaign
    table = tabulate(data)
    fitted = table.iloc[:FITTED].sample(frac=1, random_state=1)
    fitted.to_excel(tmp_path / "sheet.xlsx", index=False)
    whole = "These are the measurements that made the calibration (it was estimated from 60 rows)"
    assert whole in validate(c, tmp_path / "sheet.xlsx")
    other = pd.DataFrame({f"q{j}_deg": np.degrees(fitted[f"q{j}_rad"]) for j in range(1, 7)})
    for axis in "xyz":
        other[f"{axis}_m"] = (fitted[f"{axis}_mm"] / 1e3).round(6)
    other.iloc[:40].to_csv(tmp_path / "metres.csv", index=False)
    assert whole in validate(c, tmp_path / "metres.csv")


def test_only_the_rows_that_were_fitted_are_told(campaign, tmp_path) -> None:
    """Of the study's own file, its held-out rows had no part in the estimation."""
    c, data = campaign
    table = tabulate(data)
    table.to_csv(tmp_path / "all.csv", index=False)
    said = validate(c, tmp_path / "all.csv")
    assert "60 of the 90 rows are measurements that made the calibration" in said
    assert "The other 30 rows have no part in it" in said
    table.iloc[FITTED - 1 :].to_csv(tmp_path / "one.csv", index=False)
    assert "1 of the 31 rows is one of the measurements that made" in validate(
        c, tmp_path / "one.csv"
    )
    table.iloc[FITTED:].to_csv(tmp_path / "held_out.csv", index=False)
    assert "made the calibration" not in validate(c, tmp_path / "held_out.csv")


def test_targets_measured_for_the_calibration_are_told(campaign, tmp_path) -> None:
    c, data = campaign
    (tmp_path / "calibration.json").write_text(calibration_text(c))
    tabulate(data).iloc[5:25].to_csv(tmp_path / "some.csv", index=False)
    words = ["compensate", tmp_path, tmp_path / "some.csv", "--out", tmp_path / "out.csv"]
    words += ["--bound", "1000", "1000"]
    ran = CliRunner().invoke(run_command_line, list(map(str, words)))
    assert "where the target was measured is taken for where it is wanted" in ran.output


def test_configurations_measured_again_are_new(campaign, rng) -> None:
    """Positions in steps of 0.1 mm, with noise of half as much, agree by chance in a row of six."""
    c, data = campaign
    for noise, step in ((0.05, 1e-4), (0.005, 1e-4), (0.05, 0.1)):
        first = np.round(data.position / step) * step
        again = data.position + rng.normal(0, noise, first.shape)
        own = EstimationRows.of(first)
        new = replace(data, position=np.round(again / step) * step)
        assert count_own_rows(own, new, noise) == 0
        assert count_own_rows(own, replace(data, position=first), noise) == COUNT
    assert c.estimation_rows.count_among(np.full((3, 3), np.nan)) == 0


def test_of_many_rows_a_share_is_kept(monkeypatch, rng) -> None:
    monkeypatch.setattr(estimation_rows, "MAX_KEPT", 1_000)
    position = rng.uniform(-1e3, 1e3, (8_000, 3))
    rows = EstimationRows.of(position)
    assert (rows.count, len(rows.codes)) == (8_000, 1_000)
    assert rows.count_among(position) == 8_000
    assert rows.count_among(position[:2_000]) == pytest.approx(2_000, rel=0.2)
    assert rows.count_among(position + 0.01) == 0


def test_codes_are_read_back_and_damage_is_said(campaign) -> None:
    c, _ = campaign
    text = calibration_text(c)
    again = parse_calibration(text)
    np.testing.assert_array_equal(again.estimation_rows.codes, c.estimation_rows.codes)
    codes = c.estimation_rows.text
    for spoilt in (codes[:-4], "ä" + codes[1:]):
        with pytest.raises(StudyError, match=r"estimation_rows\.codes: expected numbers in base64"):
            parse_calibration(text.replace(codes, spoilt))
