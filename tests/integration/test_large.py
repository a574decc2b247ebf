"""Large data: naming sees a drawn share of the rows and says so; fits, errors and gains are of all
rows."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest
from builders import drawn, estimate_gain, one, planted

from modelsel.config.study_file import parse_study
from modelsel.fitting.shrinkage import fit_shrunk
from modelsel.measurements.campaign.visits import number_blocks
from modelsel.mechanisms.causes import q
from modelsel.selection.gain import ResamplingOptions
from modelsel.study.pipeline.runner import run_study

STUDY = """
name = "large"
[robot]
name = "puma760"
tool_mm = [40, -25, 100]
[measurements]
file = "measurements.csv"
[split]
estimation = 200
[model]
candidates = ["wrist-coupling", "backlash:3", "joint-compliance"]
"""


def campaign(rng, folder) -> None:
    """Write an arm's measurements, two of them gross, on either side of the split."""
    at = drawn("puma760", rng, 320)
    at = planted(at, one(5, "rz", q(4)).terms, np.array([1.5e-3]), rng, 0.05)
    position = at.data.position.copy()
    position[[11, 250]] += 5.0
    names = [*(f"q{j}_rad" for j in range(1, 7)), "x_mm", "y_mm", "z_mm"]
    pd.DataFrame(np.column_stack([at.data.q, position]), columns=names).to_csv(
        folder / "measurements.csv", index=False
    )


def test_naming_sees_a_share_and_says_so(rng, tmp_path) -> None:
    campaign(rng, tmp_path)
    study = parse_study(STUDY + "[search]\nmax_rows = 100\n", "study.toml")
    result = run_study(study, tmp_path, sampling=False)
    assert "wrist-coupling" in " ".join(result.models.chosen.names)
    assert result.diagnosis.search.fit.rows == 3 * 100
    assert result.models.chosen.fit.rows == 3 * int(result.split.used.sum()) >= 3 * 198
    said = [w.sentence for w in result.warnings if w.code == "scan-of-some"]
    assert len(said) == 1
    assert "100 of the" in said[0]
    assert "with 90 %" in said[0]
    assert set(np.flatnonzero(result.split.outlying)) == {11, 250}


@pytest.mark.slow
def test_rungs_are_the_minimum_of_all_rows(rng, tmp_path, monkeypatch) -> None:
    """Of a study that names on a sample and fits very many rows from one, too."""
    campaign(rng, tmp_path)
    study = parse_study(STUDY + "[search]\nmax_rows = 100\n", "study.toml")
    with monkeypatch.context() as few:
        few.setattr("modelsel.fitting.sampled.MANY_ROWS", 150)
        result = run_study(study, tmp_path, sampling=False)
    rungs = result.models.ladder[1:]
    assert len(rungs) > 1
    training = result.split.training
    for rung in rungs:
        assert rung.fit.reduction.parts, "the rows were not fitted from a sample"
        whole = fit_shrunk(training, rung.fit.model, held="all")
        assert rung.fit.rss == pytest.approx(whole.rss, rel=1e-8)
        error = np.maximum(whole.standard_errors, 1e-12)
        assert np.abs((rung.fit.theta - whole.theta) / error).max() < 1e-3


def test_bundled_bootstrap_has_the_same_interval(rng) -> None:
    before, after = rng.normal(0, 2, (4000, 3)), rng.normal(0, 1, (4000, 3))
    whole = estimate_gain(before, after, np.arange(4000), np.random.default_rng(1))
    bundles = ResamplingOptions(max_units=400)
    bundled = estimate_gain(before, after, np.arange(4000), np.random.default_rng(1), bundles)
    assert bundled.held_out_rms_before_mm == pytest.approx(whole.held_out_rms_before_mm, rel=1e-12)
    assert bundled.interval_mm == pytest.approx(whole.interval_mm, rel=0.01)


def test_readings_alike_by_neighbours_or_by_tree(rng) -> None:
    """Few close neighbours are compared along one direction, many by a tree: the same blocks."""
    few = np.repeat(rng.uniform(-1, 1, (50, 3)), 2, axis=0) + rng.uniform(-4e-7, 4e-7, (100, 3))
    by_tree = number_blocks(few, np.arange(100), max_lag=0)
    assert np.array_equal(number_blocks(few, np.arange(100)), by_tree)
    assert len(np.unique(by_tree)) == 50
    many = np.zeros((40, 3))
    assert len(np.unique(number_blocks(many, np.arange(40)))) == 1
